//! Streams that lost, changed and gained bytes: every packet that came through whole is found, and nothing else.

#![allow(clippy::unwrap_used)]

use draws::Draw as _;
use echogrid_arcos::{Command, Configuration, Decoder, Found, HEADER, Identity, Packet, Sip, SonarRange};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

mod draws {
    //! Draws from proptest's generator, which is seeded.

    use proptest::prelude::Rng;

    pub(super) trait Draw: Rng {
        fn below(&mut self, end: usize) -> usize {
            (self.next_u64() % end.max(1) as u64) as usize
        }
    }

    impl<R: Rng> Draw for R {}
}

fn sip(number: u16, sonars: usize) -> Packet {
    let sonars = (0..sonars).map(|sonar| SonarRange { number: sonar as u8, range: number.wrapping_mul(7) % 5000 });
    let sip = Sip {
        x: number,
        y: number / 3,
        heading: 100,
        left_speed: -7,
        sonars: sonars.collect(),
        gripper: Some(0),
        ..Sip::default()
    };
    sip.packet().unwrap()
}

/// A stream, and the packets that are whole in it, with their places.
fn damaged(
    rng: &mut TestRng,
    packets: usize,
    damage: impl Fn(&mut TestRng, &mut Vec<u8>) -> bool,
) -> (Vec<u8>, Vec<Found>) {
    let (mut stream, mut whole) = (Vec::new(), Vec::new());
    for number in 0..packets {
        let packet =
            if number % 97 == 0 { Command::Velocity.with(number as i32) } else { sip(number as u16, rng.below(17)) };
        let mut bytes = packet.bytes().to_vec();
        if !damage(rng, &mut bytes) {
            whole.push(Found { packet, at: stream.len() as u64 });
        }
        stream.extend(bytes);
    }
    (stream, whole)
}

fn decode(stream: &[u8], pieces: impl Fn(usize) -> usize) -> Vec<Found> {
    let mut decoder = Decoder::default();
    let (mut found, mut at) = (Vec::new(), 0);
    while at < stream.len() {
        let end = (at + pieces(at).max(1)).min(stream.len());
        decoder.push(&stream[at..end]);
        found.extend(std::iter::from_fn(|| decoder.next_packet()));
        at = end;
    }
    found.extend(std::iter::from_fn(|| decoder.last_packet()));
    found
}

fn rng() -> TestRng {
    TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32])
}

#[test]
fn of_a_stream_with_faults_in_2_percent_of_its_packets_all_others_are_found_and_no_more() {
    let mut rng = rng();
    let (stream, whole) = damaged(&mut rng, 100_000, |rng, bytes| {
        if rng.below(50) != 0 {
            return false;
        }
        let at = rng.below(bytes.len());
        match rng.below(6) {
            0 => drop(bytes.remove(at)),
            1 => bytes[at] ^= 1 << rng.below(8),
            // What follows is merged into it.
            2 => bytes.truncate(at),
            3 => bytes.insert(at.max(1), (rng.below(255) as u8 + 1) ^ bytes[at.max(1)]),
            4 => bytes[at] = bytes[at].wrapping_add(rng.below(255) as u8 + 1),
            // A second header, before the packet has ended.
            _ => bytes.splice(at.max(1)..at.max(1), [HEADER[0], HEADER[1], 4 + rng.below(252) as u8]).for_each(drop),
        }
        true
    });
    assert!(whole.len() > 97_000 && whole.len() < 99_000);
    let found = decode(&stream, |at| 1 + at % 61);
    let wrong = found.iter().find(|found| whole.binary_search_by_key(&found.at, |whole| whole.at).is_err());
    assert_eq!(wrong, None);
    assert_eq!(found.len(), whole.len());
    assert!(found == whole);
}

/// Two damaged bytes can make up for each other: 16 bits of checksum notice not all of it. No whole packet is lost by that.
#[test]
fn of_a_stream_with_faults_in_2_percent_of_its_bytes_every_whole_packet_is_found() {
    let mut rng = rng();
    let (stream, whole) = damaged(&mut rng, 30_000, |rng, bytes| {
        let before = bytes.clone();
        let mut after = Vec::new();
        for byte in bytes.drain(..) {
            match (rng.below(50), rng.below(3)) {
                (0, 0) => {}
                (0, 1) => after.extend([byte, rng.below(256) as u8]),
                (0, _) => after.push(byte ^ (1 << rng.below(8))),
                _ => after.push(byte),
            }
        }
        *bytes = after;
        *bytes != before
    });
    assert!(whole.len() > 8_000);
    let found = decode(&stream, |_| 89);
    let places: std::collections::BTreeMap<u64, &Packet> =
        found.iter().map(|found| (found.at, &found.packet)).collect();
    let missed = whole.iter().filter(|whole| places.get(&whole.at) != Some(&&whole.packet)).count();
    assert_eq!(missed, 0);
}

/// A robot that is real sends its configuration with a wrong checksum.
#[test]
fn a_configuration_with_a_wrong_checksum_is_kept_apart() {
    let told =
        Configuration { subclass: "p3dx-sh".into(), sonar_cycle_ms: 40, watchdog_ms: 2000, ..Configuration::default() };
    let mut bytes = told.packet().unwrap().bytes().to_vec();
    *bytes.last_mut().unwrap() ^= 0x55;
    let pulse = Command::Pulse.plain();
    bytes.extend(pulse.bytes());
    let mut decoder = Decoder::default();
    decoder.push(&bytes);
    assert_eq!(decoder.next_packet().unwrap().packet, pulse);
    assert_eq!(decoder.next_packet(), None);
    let unchecked = decoder.take_unchecked_configuration().unwrap();
    assert_eq!(Configuration::read(&unchecked).unwrap(), told);
    assert_eq!(decoder.take_unchecked_configuration(), None);
    // Any other packet with a wrong checksum is none.
    let mut bytes = sip(1, 3).bytes().to_vec();
    bytes[7] ^= 1;
    decoder.push(&bytes);
    assert_eq!((decoder.last_packet(), decoder.take_unchecked_configuration()), (None, None));
}

#[test]
fn an_information_packet_may_end_after_any_field() {
    let whole = Sip {
        sonars: vec![SonarRange { number: 3, range: 4999 }, SonarRange { number: 15, range: 7 }],
        gripper: Some(1),
        analog_port: Some(2),
        analog: Some(3),
        digital_in: Some(4),
        digital_out: Some(5),
        wide_battery: Some(251),
        charge: Some(1),
        turn_rate: Some(-300),
        faults: Some(9),
        lateral_speed: Some(-1),
        temperature: Some(-127),
        state_of_charge: Some(80),
        is_moving: true,
        x: 0x7FFF,
        battery: 130,
        flags: 0x1F,
        ..Sip::default()
    };
    let packet = whole.packet().unwrap();
    assert_eq!(Sip::read(&packet).unwrap(), whole);
    assert_eq!((whole.battery_v(), whole.motors_on()), (25.1, true));
    let arguments = packet.arguments();
    // Where fields end: ten bytes, then battery, stalls, control, flags, compass, no sonar or all of them, and so on.
    let ends = [10, 11, 13, 15, 17, 18, 25, 26, 27, 28, 29, 30, 32, 33, 35, 37, 39, 40, 41];
    for end in 0..=arguments.len() {
        let read = Sip::read(&Packet::new(Sip::MOVING, &arguments[..end]).unwrap());
        assert_eq!(read.is_ok(), ends.contains(&end), "{end}: {read:?}");
    }
    let later = [arguments, &[1, 2, 3]].concat();
    assert_eq!(Sip::read(&Packet::new(Sip::MOVING, &later).unwrap()).unwrap(), whole);
    let error = Sip::read(&Packet::new(Sip::STOPPED, &arguments[..20]).unwrap()).unwrap_err();
    assert_eq!(error.to_string(), "a packet of id 0x32 ends within its sonars");
}

#[test]
fn an_identity_is_three_texts() {
    let who = Identity { name: "Rover".into(), class: "Pioneer".into(), subclass: "p3at-sh".into() };
    assert_eq!(Identity::read(&who.packet().unwrap()).unwrap(), who);
    // The last zero may be missing; the last text may not.
    assert_eq!(Identity::read(&Packet::new(2, b"a\0b\0c").unwrap()).unwrap().subclass, "c");
    assert!(Identity::read(&Packet::new(2, b"a\0b\0").unwrap()).is_err());
}

#[test]
fn whole_packets_between_anything_are_found() {
    let mut runner = TestRunner::new_with_rng(Config::with_cases(2000), rng());
    let parts = vec((vec(any::<u8>(), 0..40), any::<u8>(), vec(any::<u8>(), 0..80)), 1..12);
    runner
        .run(&(parts, any::<Index>()), |(parts, piece)| {
            let (mut stream, mut whole) = (Vec::new(), Vec::new());
            for (noise, id, arguments) in parts {
                // Noise that is no header cannot hide what follows.
                stream.extend(noise.into_iter().filter(|byte| *byte != HEADER[0]));
                let packet = Packet::new(id.max(1), &arguments).unwrap();
                whole.push(Found { packet: packet.clone(), at: stream.len() as u64 });
                stream.extend(packet.bytes());
            }
            let piece = 1 + piece.index(200);
            prop_assert_eq!(decode(&stream, |_| piece), whole);
            Ok(())
        })
        .unwrap();
}
