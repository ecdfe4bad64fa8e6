//! The driver against an emulated lidar at the other end of a pseudo-terminal: bytes that are lost, turned, foreign or do not come, and a
//! cable that is pulled.

#![allow(clippy::unwrap_used, clippy::panic)] // a test that can not go on has failed

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use echogrid_core::{Echo, Footprint, Pose2, Reading, Robot, SensorKind};
use echogrid_lidar::codec::{ld19, rplidar};
use echogrid_lidar::{Lidar, LidarConfig, Model};
use echogrid_service::Sensor;
use echogrid_topics::Message;
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// Bearings of a turn.
const BEAMS: u16 = 360;

/// A cable, of which the lidar holds one end and the path leads to the other.
struct Cable {
    end: File,
    /// Else the line hangs up before the driver is there.
    _other: OwnedFd,
}

impl Cable {
    fn plug(path: &Path) -> Self {
        let pty = openpty(None, None).unwrap();
        let mut settings = tcgetattr(&pty.slave).unwrap();
        cfmakeraw(&mut settings);
        tcsetattr(&pty.slave, SetArg::TCSANOW, &settings).unwrap();
        let _ = std::fs::remove_file(path);
        std::os::unix::fs::symlink(ttyname(&pty.slave).unwrap(), path).unwrap();
        Self { end: File::from(pty.master), _other: pty.slave }
    }

    fn say(&mut self, bytes: &[u8]) {
        self.end.write_all(bytes).unwrap();
    }
}

/// A lidar in the middle of the robot, looking ahead.
fn driver(port: &Path, model: Model) -> Lidar {
    let sensor = echogrid_core::Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: BEAMS,
        first_bearing_rad: 0.0,
        bearing_step_rad: core::f64::consts::TAU / f64::from(BEAMS),
        aperture_rad: 0.01,
        range_min_m: 0.05,
        range_max_m: 12.0,
        range_error_ratio: 0.01,
    };
    let robot =
        Robot { name: "cart".into(), footprint: Footprint { length_m: 0.4, width_m: 0.4 }, sensors: vec![sensor] };
    let config = LidarConfig { model, port: port.to_str().unwrap().into(), silence_s: 0.3, ..LidarConfig::default() };
    Lidar::new(config, &robot).unwrap()
}

/// All scans that have come.
fn hear(lidar: &mut Lidar, scans: &mut Vec<Vec<Reading>>) {
    for _ in 0..3 {
        while lidar.is_ready().unwrap() {
            match lidar.next().unwrap() {
                Some((_, Message::Scan(readings))) => scans.push(readings),
                other => panic!("{other:?}"),
            }
        }
    }
}

/// What every beam of a turn sees: metres that tell which turn and which beam it is.
fn range_mm(turn: u16, clockwise_cdeg: u16) -> u16 {
    1000 + 1000 * (turn % 3) + clockwise_cdeg / 100
}

/// A turn of an LD19, 40 packets.
fn ld19_turn(turn: u16) -> Vec<u8> {
    let packet = |n: u16| {
        let first = n * 900;
        let points = core::array::from_fn(|k| (range_mm(turn, first + 75 * k as u16), 200));
        ld19::Packet { speed_degps: 3600, first, last: first + 825, stamp_ms: (turn * 100 + n) % 30_000, points }
    };
    (0..40).flat_map(|n| packet(n).bytes()).collect()
}

/// Whether all readings are those of one turn.
fn is_of_one_turn(readings: &[Reading]) -> bool {
    let metre = |reading: &Reading| {
        let Echo::Hit { range_m } = reading.echo else { return None };
        let clockwise_deg = f64::from((BEAMS - reading.transducer) % BEAMS);
        let metre = range_m - clockwise_deg * 1e-3;
        ((metre - metre.round()).abs() < 2e-3).then_some(metre.round() as u64)
    };
    let first = readings.first().and_then(metre);
    first.is_some() && readings.iter().all(|reading| metre(reading) == first)
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("ttyLIDAR0");
    (folder, port)
}

#[test]
fn every_turn_of_an_ld19_is_a_scan() {
    let (_folder, port) = folder();
    let mut cable = Cable::plug(&port);
    let mut lidar = driver(&port, Model::Ld19);
    let mut scans = Vec::new();
    for turn in 0..30 {
        cable.say(&ld19_turn(turn));
        hear(&mut lidar, &mut scans);
    }
    // What comes before the first passage of the front is no whole turn, and the last has not ended.
    assert_eq!((scans.len(), lidar.skipped_bytes()), (28, 0));
    assert!(scans.iter().all(|readings| readings.len() == usize::from(BEAMS) && is_of_one_turn(readings)));
}

#[test]
fn of_damaged_packets_nothing_reaches_a_scan() {
    let (_folder, port) = folder();
    let mut cable = Cable::plug(&port);
    let mut lidar = driver(&port, Model::Ld06);
    let mut scans = Vec::new();
    let mut random: u32 = 7;
    let mut damaged = 0;
    for turn in 0..60 {
        let mut bytes = ld19_turn(turn);
        // One packet of fifty: a bit turned, a byte lost, or something between.
        for packet in (0..40).rev() {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if (random >> 16).is_multiple_of(50) {
                let at = packet * ld19::PACKET_BYTES + (random >> 8) as usize % ld19::PACKET_BYTES;
                match (random >> 5) % 3 {
                    0 => bytes[at] ^= 1 << (random % 8),
                    1 => drop(bytes.remove(at)),
                    _ => bytes.insert(at, 0x54),
                }
                damaged += 1;
            }
        }
        cable.say(&bytes);
        hear(&mut lidar, &mut scans);
    }
    assert!(damaged > 20 && lidar.skipped_bytes() > 0, "{damaged}");
    assert!(scans.len() >= 56 && scans.iter().all(|readings| is_of_one_turn(readings)), "{}", scans.len());
    let readings: usize = scans.iter().map(Vec::len).sum();
    let (all, of_damaged) = (scans.len() * usize::from(BEAMS), damaged * ld19::POINTS);
    assert!(readings + of_damaged >= all, "{readings} of {all}: every whole packet counts");
}

#[test]
fn garbage_silence_and_a_pulled_cable_are_survived() {
    let (_folder, port) = folder();
    let mut lidar = driver(&port, Model::Ld19);
    let mut scans = Vec::new();
    hear(&mut lidar, &mut scans);
    assert!(lidar.note().contains("ttyLIDAR0"), "it is not there yet: {}", lidar.note());
    for life in 1..=3 {
        // Behind the same name another device.
        let mut cable = Cable::plug(&port);
        let deadline = Instant::now() + PATIENCE;
        let before = lidar.count();
        let mut turn = 0;
        while lidar.count() < before + 5 {
            assert!(Instant::now() < deadline, "life {life}: {}", lidar.note());
            let noise: Vec<u8> = (0..100).map(|n| (n * 37 + turn) as u8).collect();
            cable.say(&[noise, ld19_turn(turn)].concat());
            hear(&mut lidar, &mut scans);
            turn += 1;
        }
        // Nothing comes any more: it says so.
        while !lidar.note().contains("says nothing") {
            assert!(Instant::now() < deadline, "life {life}: {}", lidar.note());
            hear(&mut lidar, &mut scans);
        }
    }
    assert!(scans.iter().all(|readings| is_of_one_turn(readings)));
}

#[test]
fn an_rplidar_is_asked_to_scan_and_told_to_rest() {
    let (_folder, port) = folder();
    let mut cable = Cable::plug(&port);
    let mut lidar = driver(&port, Model::RplidarA1);
    let mut scans = Vec::new();
    hear(&mut lidar, &mut scans);
    let mut asked = [0; 4];
    cable.end.read_exact(&mut asked).unwrap();
    assert_eq!(asked, [rplidar::STOP, rplidar::SCAN].concat()[..]);
    cable.say(&rplidar::SCAN_DESCRIPTOR);
    for turn in 0..10_u16 {
        let points = (0..360_u16).flat_map(|degree| {
            let range = range_mm(turn, degree * 100) * 4;
            rplidar::Point { begins_turn: degree == 0, quality: 15, angle: degree * 64, range }.bytes()
        });
        cable.say(&points.collect::<Vec<u8>>());
        hear(&mut lidar, &mut scans);
    }
    assert_eq!(scans.len(), 9, "the last has not ended");
    assert!(scans.iter().all(|readings| readings.len() == usize::from(BEAMS) && is_of_one_turn(readings)));
    lidar.close();
    let mut told = [0; 2];
    cable.end.read_exact(&mut told).unwrap();
    assert_eq!(told, rplidar::STOP);
}
