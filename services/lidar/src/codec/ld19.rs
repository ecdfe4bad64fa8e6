//! LD06 and LD19 (LDROBOT): they talk without being asked, 230400 bits per second.
//!
//! Source: "LD19 Development Manual" of the maker, V2.3. A packet of 47 bytes: `54 2C`, the speed in degrees per second, the angle of the
//! first point in hundredths of a degree, twelve points (distance in mm, intensity), the angle of the last point, a time in ms, and a
//! checksum. Between first and last the angles are evenly spaced. A turn is as many points as the speed allows: some 450 at 10 Hz.

use core::f64::consts::TAU;
use std::collections::VecDeque;

use super::{Beam, Buffer, Decoder};

/// Bits per second.
pub const BAUD: u32 = 230_400;
/// Bytes of a packet.
pub const PACKET_BYTES: usize = 47;
/// Points of a packet.
pub const POINTS: usize = 12;
/// A packet begins so: its kind, and that it has twelve points.
const HEAD: [u8; 2] = [0x54, 0x2c];
/// Hundredths of a degree of a turn.
const TURN: u16 = 36_000;
/// Twelve points take no more of a turn than this, hundredths of a degree: a packet that says so is damaged.
const SPAN_MAX: u16 = 9_000;
/// The checksum's polynomial.
const POLYNOMIAL: u8 = 0x4d;

/// One packet of an LD19: points of a part of a turn, and when they were taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// How fast it turns, degrees per second.
    pub speed_degps: u16,
    /// Where the first point lies, hundredths of a degree clockwise, below 36000.
    pub first: u16,
    /// Where the last point lies, hundredths of a degree clockwise, below 36000.
    pub last: u16,
    /// Milliseconds, from 0 to 29999, then from 0 again.
    pub stamp_ms: u16,
    /// Distances, millimetres (0: nothing was seen), and how bright it was.
    pub points: [(u16, u8); POINTS],
}

/// The checksum of bytes.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| {
        (0..8).fold(sum ^ byte, |sum, _| if sum & 0x80 == 0 { sum << 1 } else { (sum << 1) ^ POLYNOMIAL })
    })
}

impl Packet {
    /// A packet of these bytes; none unless they are one, with the right checksum and angles that can be.
    #[must_use]
    pub fn read(bytes: &[u8; PACKET_BYTES]) -> Option<Self> {
        let (body, sum) = bytes.split_at(PACKET_BYTES - 1);
        if !body.starts_with(&HEAD) || sum != [checksum(body)] {
            return None;
        }
        let number = |at: usize| Some(u16::from_le_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let mut points = [(0, 0); POINTS];
        for (index, point) in points.iter_mut().enumerate() {
            let at = 6 + 3 * index;
            *point = (number(at)?, *body.get(at + 2)?);
        }
        let (first, last) = (number(4)?, number(42)?);
        let can_be = first < TURN && last < TURN && span(first, last) <= SPAN_MAX;
        can_be.then_some(Self { speed_degps: number(2)?, first, last, stamp_ms: number(44)?, points })
    }

    /// The bytes of the packet.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = HEAD.to_vec();
        bytes.extend(self.speed_degps.to_le_bytes());
        bytes.extend(self.first.to_le_bytes());
        for (range_mm, intensity) in self.points {
            bytes.extend(range_mm.to_le_bytes());
            bytes.push(intensity);
        }
        bytes.extend(self.last.to_le_bytes());
        bytes.extend(self.stamp_ms.to_le_bytes());
        bytes.push(checksum(&bytes));
        bytes
    }

    /// Where a point lies, radians clockwise, 0 to 2π.
    fn clockwise_rad(&self, index: usize) -> f64 {
        let along = f64::from(span(self.first, self.last)) * index as f64 / (POINTS - 1) as f64;
        let turn = f64::from(TURN);
        let angle = f64::from(self.first) + along;
        (if angle >= turn { angle - turn } else { angle }) / turn * TAU
    }
}

/// From one angle to the other, clockwise.
fn span(first: u16, last: u16) -> u16 {
    if last >= first { last - first } else { TURN - (first - last) }
}

/// Finds packets in a stream.
#[derive(Debug, Default)]
pub struct Ld19 {
    buffer: Buffer,
    beams: VecDeque<Beam>,
    /// Where the last beam lay: a turn begins where the next lies before it.
    last_rad: Option<f64>,
}

impl Ld19 {
    /// The next packet, if one is whole.
    pub fn next_packet(&mut self) -> Option<Packet> {
        loop {
            let rest = self.buffer.rest();
            let may_begin = |at: usize| rest.get(at).is_none_or(|byte| HEAD.get(at) == Some(byte));
            if rest.is_empty() {
                return None;
            }
            if !may_begin(0) || !may_begin(1) {
                self.buffer.skip();
                continue;
            }
            let bytes = rest.first_chunk()?;
            match Packet::read(bytes) {
                Some(packet) => {
                    self.buffer.take(PACKET_BYTES);
                    return Some(packet);
                }
                None => self.buffer.skip(),
            }
        }
    }
}

impl Decoder for Ld19 {
    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_beam(&mut self) -> Option<Beam> {
        if self.beams.is_empty() {
            let packet = self.next_packet()?;
            let at = self.buffer.at();
            for (index, (range_mm, _)) in packet.points.iter().enumerate() {
                let clockwise_rad = packet.clockwise_rad(index);
                let begins_turn = self.last_rad.is_some_and(|last_rad| clockwise_rad < last_rad);
                self.last_rad = Some(clockwise_rad);
                self.beams.push_back(Beam { clockwise_rad, range_m: f64::from(*range_mm) * 1e-3, begins_turn, at });
            }
        }
        self.beams.pop_front()
    }

    fn skipped(&self) -> u64 {
        self.buffer.skipped()
    }

    fn clear(&mut self) {
        self.buffer.clear();
        self.beams.clear();
        self.last_rad = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the maker's manual.
    const EXAMPLE: [u8; PACKET_BYTES] = [
        0x54, 0x2c, 0x68, 0x08, 0xab, 0x7e, 0xe0, 0x00, 0xe4, 0xdc, 0x00, 0xe2, 0xd9, 0x00, 0xe5, 0xd5, 0x00, 0xe3,
        0xd3, 0x00, 0xe4, 0xd0, 0x00, 0xe9, 0xcd, 0x00, 0xe4, 0xca, 0x00, 0xe2, 0xc7, 0x00, 0xe9, 0xc5, 0x00, 0xe5,
        0xc2, 0x00, 0xe5, 0xc0, 0x00, 0xe5, 0xbe, 0x82, 0x3a, 0x1a, 0x50,
    ];

    #[test]
    fn the_packet_of_the_manual_is_read_and_written() {
        let packet = Packet::read(&EXAMPLE).unwrap();
        assert_eq!((packet.speed_degps, packet.first, packet.last, packet.stamp_ms), (2152, 32427, 33470, 6714));
        assert_eq!((packet.points[0], packet.points[11]), ((224, 228), (192, 229)));
        assert_eq!(packet.bytes(), EXAMPLE);
    }

    #[test]
    fn a_packet_that_would_span_most_of_a_turn_is_none() {
        let packet = Packet { first: 35_900, last: 35_000, ..Packet::read(&EXAMPLE).unwrap() };
        assert_eq!(Packet::read(packet.bytes().first_chunk().unwrap()), None);
        let over_the_front = Packet { last: 800, ..packet };
        assert_eq!(Packet::read(over_the_front.bytes().first_chunk().unwrap()), Some(over_the_front));
    }

    /// A turn and a half, and the beams of it.
    fn stream() -> Vec<Packet> {
        (0..60)
            .map(|n: u16| {
                let first = ((35_000 + u32::from(n) * 960) % u32::from(TURN)) as u16;
                let points = core::array::from_fn(|k| (1000 + n * 12 + k as u16, 200));
                Packet { speed_degps: 3600, first, last: (first + 880) % TURN, stamp_ms: n * 3, points }
            })
            .collect()
    }

    fn decode(pieces: &[&[u8]]) -> (Vec<Beam>, u64) {
        let mut decoder = Ld19::default();
        let mut beams = Vec::new();
        for piece in pieces {
            decoder.push(piece);
            beams.extend(core::iter::from_fn(|| decoder.next_beam()));
        }
        (beams, decoder.skipped())
    }

    #[test]
    fn however_the_bytes_come_the_beams_are_the_same() {
        let bytes: Vec<u8> = stream().iter().flat_map(Packet::bytes).collect();
        let (whole, skipped) = decode(&[&bytes]);
        assert_eq!((whole.len(), skipped), (60 * POINTS, 0));
        assert_eq!(whole.iter().filter(|beam| beam.begins_turn).count(), 2, "at each passage of the front");
        assert!(whole.iter().all(|beam| (0.0..TAU).contains(&beam.clockwise_rad)));
        assert!((whole[1].clockwise_rad - 350.8_f64.to_radians()).abs() < 1e-9, "{:?}", whole[1]);
        for size in [1, 2, 46, 47, 48, 100] {
            let pieces: Vec<&[u8]> = bytes.chunks(size).collect();
            assert_eq!(decode(&pieces).0, whole, "in pieces of {size}");
        }
    }

    #[test]
    fn of_a_damaged_stream_every_whole_packet_is_given_and_no_other() {
        let packets = stream();
        let bytes: Vec<Vec<u8>> = packets.iter().map(Packet::bytes).collect();
        for damaged in 0..packets.len() {
            let at = (damaged * 7) % PACKET_BYTES;
            let mut flipped = bytes.clone();
            flipped[damaged][at] ^= 0x10;
            let mut lost = bytes.clone();
            lost[damaged].remove(at);
            for stream in [flipped.concat(), lost.concat()] {
                let mut decoder = Ld19::default();
                decoder.push(&stream);
                let found: Vec<Packet> = core::iter::from_fn(|| decoder.next_packet()).collect();
                let wanted: Vec<Packet> =
                    packets.iter().enumerate().filter(|(n, _)| *n != damaged).map(|(_, p)| p.clone()).collect();
                assert_eq!(found, wanted, "packet {damaged}, byte {at}");
            }
        }
    }
}
