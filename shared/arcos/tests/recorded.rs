//! A session with a simulator of the robots' maker, as it went over the line: `$ECHOGRID_DATA`, or `../shared/data`.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use echogrid_arcos::{Command, Configuration, Counter, Decoder, Identity, Packet, Parameters, Sip};

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if !path.exists() {
        println!("skipped: {name} is not there");
        return None;
    }
    Some(path)
}

/// Bytes to the robot, and bytes from it. A record is its time (f64), its direction (1: from the robot), its length (u16), its bytes.
fn session() -> Option<[Vec<u8>; 2]> {
    let bytes = std::fs::read(data("arcos/session_room.bin")?).unwrap();
    let mut lines = [Vec::new(), Vec::new()];
    let mut rest = bytes.as_slice();
    while let Some((head, after)) = rest.split_first_chunk::<11>() {
        let (line, after) = after.split_at(usize::from(u16::from_le_bytes([head[9], head[10]])));
        lines[usize::from(head[8])].extend(line);
        rest = after;
    }
    Some(lines)
}

fn packets(line: &[u8]) -> Vec<Packet> {
    let mut decoder = Decoder::default();
    decoder.push(line);
    let found = std::iter::from_fn(|| decoder.last_packet()).map(|found| found.packet).collect();
    assert_eq!(decoder.skipped(), 0);
    found
}

#[test]
fn every_byte_of_a_session_is_understood() {
    let Some([to, from]) = session() else { return };
    let (to, from) = (packets(&to), packets(&from));
    assert!(to.contains(&Command::Velocity.with(200)) && to.contains(&Command::Velocity.with(-100)));
    assert!(to.contains(&Command::Sonar.with(1)) && to.contains(&Command::Enable.with(0)));
    assert_eq!(from[..2], [Command::sync(0), Command::sync(1)]);
    let who = Identity::read(&from[2]).unwrap();
    assert_eq!((who.name.as_str(), who.class.as_str(), who.subclass.as_str()), ("AMRISim", "Pioneer", "p3at"));
    let configuration = Configuration::read(&from[3]).unwrap();
    assert_eq!((configuration.sip_cycle_ms, configuration.watchdog_ms), (100, 2000));
    assert_eq!((configuration.turn_rate_max, configuration.speed_max), (150, 3000));
    assert_eq!((configuration.front_sonar, configuration.rear_sonar), (true, true));
    assert_eq!((configuration.name.as_str(), configuration.firmware.as_str()), ("AMRISim", "S.0"));
    let sips: Vec<Sip> = from[4..].iter().map(|packet| Sip::read(packet).unwrap()).collect();
    assert_eq!(sips.len(), 59);
    let mut x = Counter::default();
    let way: Vec<i64> = sips.iter().map(|sip| x.follow(sip.x)).collect();
    assert_eq!((way[13] - way[0], way[58] - way[0]), (436, 1469));
    let first = &sips[0];
    assert_eq!((first.sonars.len(), first.sonars[6].range, first.battery), (16, 3734, 130));
    assert_eq!((first.motors_on(), first.stalls(), first.bumpers()), (true, [false; 2], 0));
    assert_eq!((first.temperature, first.state_of_charge), (Some(-127), Some(0)));
    // What was read is what was sent.
    let again: Vec<Packet> = sips.iter().map(|sip| sip.packet().unwrap()).collect();
    let same = again.iter().zip(&from[4..]).filter(|(again, sent)| again == sent).count();
    assert_eq!(same, 59, "{:?}\n{:?}", again[0], from[4]);
}

#[test]
fn robots_of_the_maker_are_read() {
    for (name, sonars, millimetres) in
        [("p3at", 16, 0.465), ("p3at-sh", 16, 1.0), ("p3dx", 16, 0.485), ("p3dx-sh", 16, 1.0), ("amigo", 8, 0.5083)]
    {
        let Some(path) = data(&format!("robots/{name}.p")) else { return };
        let found = Parameters::read(&std::fs::read_to_string(path).unwrap()).unwrap();
        println!("{found:?}");
        assert_eq!((found.sonars.len(), found.distance_mm_per_count), (sonars, millimetres), "{name}");
        assert!(found.subclass.starts_with(name) && found.length_mm > 250.0);
        assert!((found.angle_rad_per_count * 4096.0 - core::f64::consts::TAU).abs() < 1e-9, "{name}");
    }
}
