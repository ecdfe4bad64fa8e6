//! RPLIDAR A1 (Slamtec): asked to scan, it sends a point in five bytes, 115200 bits per second.
//!
//! Source: "RPLIDAR A series, interface protocol and application notes" of the maker, V2.1. A request is `A5` and a command; an answer has a
//! descriptor of seven bytes before it. A point has no checksum: a bit and its opposite, a bit that is always set, an angle below a turn.
//! So one is believed only where others that can follow it stand behind it: what a lost byte has shifted is noticed, while a turned bit of
//! a distance is not.

use core::f64::consts::TAU;

use super::{Beam, Buffer, Decoder};

/// Bits per second.
pub const BAUD: u32 = 115_200;
/// The command that asks the lidar to stop.
pub const STOP: [u8; 2] = [0xa5, 0x25];
/// The command that asks the lidar to scan.
pub const SCAN: [u8; 2] = [0xa5, 0x20];
/// The command that asks the lidar how it is.
pub const GET_HEALTH: [u8; 2] = [0xa5, 0x52];
/// What stands before the points of a scan.
pub const SCAN_DESCRIPTOR: [u8; 7] = [0xa5, 0x5a, 0x05, 0x00, 0x00, 0x40, 0x81];
/// What stands before an answer to [`GET_HEALTH`].
pub const HEALTH_DESCRIPTOR: [u8; 7] = [0xa5, 0x5a, 0x03, 0x00, 0x00, 0x00, 0x06];
/// Bytes of a point.
pub const POINT_BYTES: usize = 5;
/// Points in a row that have to be possible for the first of them to be believed …
const GROUP: usize = 4;
/// … and where it is not known where points begin.
const FIRST_GROUP: usize = 8;
/// The angle of a turn, 1/64 degrees.
const TURN: u16 = 360 * 64;
/// From point to point no more, 1/64 degrees: at 10 turns a second and 2000 points it is 1.8°.
const STEP_MAX: u16 = 30 * 64;

/// One point of a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Point {
    /// Whether a turn begins with it.
    pub begins_turn: bool,
    /// How well it was seen, 0 to 63.
    pub quality: u8,
    /// Clockwise from the front, 1/64 degrees, below a turn.
    pub angle: u16,
    /// How far, quarters of a millimetre; 0: nothing.
    pub range: u16,
}

impl Point {
    /// A point of these bytes, if they can be one.
    #[must_use]
    pub fn read(bytes: &[u8; POINT_BYTES]) -> Option<Self> {
        let [first, low, high, range @ ..] = *bytes;
        let (begins_turn, is_within) = (first & 1 == 1, first & 2 == 2);
        let angle = u16::from(low >> 1) | u16::from(high) << 7;
        // Turns begin at the front.
        let is_ahead = angle <= STEP_MAX || angle >= TURN - STEP_MAX;
        let can_be = begins_turn != is_within && low & 1 == 1 && angle < TURN && (is_ahead || !begins_turn);
        can_be.then_some(Self { begins_turn, quality: first >> 2, angle, range: u16::from_le_bytes(range) })
    }

    /// The bytes of the point; the angle is taken within a turn.
    #[must_use]
    pub fn bytes(self) -> [u8; POINT_BYTES] {
        let angle = self.angle % TURN;
        let [range_low, range_high] = self.range.to_le_bytes();
        let first = self.quality << 2 | if self.begins_turn { 1 } else { 2 };
        [first, ((angle & 0x7f) << 1) as u8 | 1, (angle >> 7) as u8, range_low, range_high]
    }

    /// Whether it can follow another in a turn: a little farther round, or, as the lidar rounds, a little less. Where a byte was lost,
    /// every point seems to begin a turn.
    fn follows(self, before: Self) -> bool {
        let ahead = (self.angle + TURN - before.angle) % TURN;
        (ahead <= STEP_MAX || TURN - ahead <= 64) && !(self.begins_turn && before.begins_turn)
    }
}

/// How the lidar says it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Health {
    /// The lidar is as it should be.
    Good,
    /// It may soon fail, and its code for why.
    Warning(u16),
    /// It does not work, and its code for why.
    Failed(u16),
}

/// Finds points in a stream.
#[derive(Debug, Default)]
pub struct Rplidar {
    buffer: Buffer,
    /// The last point, while they follow each other without a gap.
    last: Option<Point>,
    is_scanning: bool,
    /// Whether it is certain that a point begins where the next byte is.
    is_aligned: bool,
    health: Option<Health>,
}

impl Rplidar {
    /// What it has said of its health, once.
    pub fn take_health(&mut self) -> Option<Health> {
        self.health.take()
    }

    /// The next point, if it is certain.
    pub fn next_point(&mut self) -> Option<Point> {
        loop {
            let rest = self.buffer.rest();
            if rest.is_empty() {
                return None;
            }
            if let Some(length) = self.descriptor()? {
                self.buffer.take(length);
                continue;
            }
            if !self.is_scanning {
                self.buffer.skip();
                continue;
            }
            match self.group()? {
                Some(point) => {
                    self.buffer.take(POINT_BYTES);
                    self.last = Some(point);
                    // The first byte of the first one may be another's, and says whether a turn begins.
                    if core::mem::replace(&mut self.is_aligned, true) {
                        return Some(point);
                    }
                }
                None => {
                    self.buffer.skip();
                    (self.last, self.is_aligned) = (None, false);
                }
            }
        }
    }

    /// The point that stands here, if those behind it can follow it, and it the last one; `None` where more has to come to tell.
    #[expect(clippy::option_option, reason = "not yet told, and told that there is none")]
    fn group(&self) -> Option<Option<Point>> {
        let count = if self.last.is_some() { GROUP } else { FIRST_GROUP };
        let (points, _) = self.buffer.rest().get(..count * POINT_BYTES)?.as_chunks();
        let mut before = self.last;
        for bytes in points {
            let point = Point::read(bytes).filter(|point| before.is_none_or(|before| point.follows(before)));
            let Some(point) = point else { return Some(None) };
            before = Some(point);
        }
        Some(points.first().and_then(Point::read))
    }

    /// How long the descriptor is that stands here, with its answer where that has an end; `None` where more has to come to tell.
    #[expect(clippy::option_option, reason = "not yet told, and told that there is none")]
    fn descriptor(&mut self) -> Option<Option<usize>> {
        let rest = self.buffer.rest();
        let begins = |descriptor: &[u8; 7]| rest.starts_with(descriptor) || descriptor.starts_with(rest);
        if begins(&SCAN_DESCRIPTOR) {
            let length = rest.len().ge(&7).then_some(7)?;
            (self.is_scanning, self.is_aligned, self.last) = (true, true, None);
            return Some(Some(length));
        }
        if begins(&HEALTH_DESCRIPTOR) {
            let answer: [u8; 3] = rest.get(7..10)?.try_into().ok()?;
            let code = u16::from_le_bytes([answer[1], answer[2]]);
            self.health = match answer[0] {
                0 => Some(Health::Good),
                1 => Some(Health::Warning(code)),
                2 => Some(Health::Failed(code)),
                _ => self.health,
            };
            return Some(Some(10));
        }
        Some(None)
    }
}

impl Decoder for Rplidar {
    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_beam(&mut self) -> Option<Beam> {
        let point = self.next_point()?;
        Some(Beam {
            clockwise_rad: f64::from(point.angle) / f64::from(TURN) * TAU,
            range_m: f64::from(point.range) * 0.25e-3,
            begins_turn: point.begins_turn,
            at: self.buffer.at(),
        })
    }

    fn skipped(&self) -> u64 {
        self.buffer.skipped()
    }

    fn clear(&mut self) {
        self.buffer.clear();
        (self.last, self.health) = (None, None);
        (self.is_scanning, self.is_aligned) = (false, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two turns and a half of 200 points, a little uneven.
    fn points() -> Vec<Point> {
        let point = |n: u16| {
            let angle = (n % 200) * 115 + n % 3;
            Point { begins_turn: n.is_multiple_of(200), quality: 15, angle, range: 4000 + n }
        };
        (0..500).map(point).collect()
    }

    fn bytes(points: &[Point]) -> Vec<u8> {
        SCAN_DESCRIPTOR.into_iter().chain(points.iter().flat_map(|point| point.bytes())).collect()
    }

    fn decode(pieces: &[&[u8]]) -> Vec<Point> {
        let mut decoder = Rplidar::default();
        let mut found = Vec::new();
        for piece in pieces {
            decoder.push(piece);
            found.extend(core::iter::from_fn(|| decoder.next_point()));
        }
        found
    }

    #[test]
    fn a_point_is_read_as_it_is_written() {
        // From the maker's notes: 45° and 1 m, quality 15.
        let point = Point { begins_turn: false, quality: 15, angle: 45 * 64, range: 4000 };
        assert_eq!(point.bytes(), [0x3e, 0x81, 0x16, 0xa0, 0x0f]);
        for point in points() {
            assert_eq!(Point::read(&point.bytes()), Some(point));
        }
        for impossible in
            [[0x3f, 0x81, 0x16, 0, 0], [0x3c, 0x81, 0x16, 0, 0], [0x3e, 0x80, 0x16, 0, 0], [0x3e, 0xff, 0xff, 0, 0]]
        {
            assert_eq!(Point::read(&impossible), None, "{impossible:x?}");
        }
    }

    #[test]
    fn however_the_bytes_come_the_points_are_the_same() {
        let points = points();
        let stream = [b"noise".as_slice(), &HEALTH_DESCRIPTOR, &[0, 0, 0], &bytes(&points)].concat();
        // Those at the end wait for what could follow them.
        let certain = &points[..points.len() - GROUP + 1];
        for size in [1, 4, 5, 7, 64, 4096] {
            assert_eq!(decode(&stream.chunks(size).collect::<Vec<_>>()), certain, "in pieces of {size}");
        }
        let mut decoder = Rplidar::default();
        decoder.push(&[&HEALTH_DESCRIPTOR[..], &[2, 3, 0]].concat());
        assert_eq!((decoder.next_point(), decoder.take_health()), (None, Some(Health::Failed(3))));
    }

    /// Two bits of a check are few: of a thousand bytes that are lost one may go unnoticed.
    #[test]
    fn where_bytes_are_lost_hardly_a_shifted_point_is_given() {
        let points = points();
        let whole = bytes(&points);
        let mut strange = 0;
        for lost in 7..whole.len() {
            let mut stream = whole.clone();
            stream.remove(lost);
            let found = decode(&[&stream]);
            strange += found.iter().filter(|point| !points.contains(point)).count();
            assert!(found.len() + 20 > points.len(), "byte {lost}: {} of {}", found.len(), points.len());
        }
        assert!(strange * 1000 <= whole.len(), "{strange} of {}", whole.len());
    }

    #[test]
    fn nothing_is_a_point_before_the_scan_begins() {
        let stream: Vec<u8> = points().iter().flat_map(|point| point.bytes()).collect();
        assert_eq!(decode(&[&stream]), []);
    }
}
