//! Logs with and without damage: small hand-written ones, and any bytes at all.

#![allow(clippy::unwrap_used)]

use std::io::{Cursor, Write as _};
use std::path::Path;

use echogrid_core::{Echo, Pose2};
use echogrid_formats::log::{self, FaultKind, LogError, LogEvent, LogSurvey, carmen, udacity};
use proptest::prelude::*;

fn read(bytes: &[u8]) -> Result<(LogSurvey, Vec<LogEvent>), LogError> {
    let path = Path::new("a.log");
    let survey = carmen::survey(bytes, path)?;
    let events = carmen::read(Cursor::new(bytes.to_vec()), path, &survey)?.collect::<Result<Vec<_>, _>>()?;
    assert!(events.windows(2).all(|pair| pair[0].stamp_ns() <= pair[1].stamp_ns()));
    let count = |is: fn(&LogEvent) -> bool| events.iter().filter(|event| is(event)).count() as u64;
    assert_eq!(count(|event| matches!(event, LogEvent::Odometry { .. })), survey.odometry_count);
    assert_eq!(count(|event| matches!(event, LogEvent::Scan { .. })), survey.scan_count);
    assert_eq!(count(|event| matches!(event, LogEvent::TruePose { .. })), survey.true_pose_count);
    assert_eq!(events.first().map(LogEvent::stamp_ns), Some(survey.first_stamp_ns));
    assert_eq!(events.last().map(LogEvent::stamp_ns), Some(survey.last_stamp_ns));
    for event in &events {
        if let LogEvent::Scan { readings, .. } = event {
            assert!(readings.iter().all(|reading| survey.robot.transducer(reading.transducer).is_some()));
        }
    }
    Ok((survey, events))
}

fn usable(text: &str) -> (LogSurvey, Vec<LogEvent>) {
    read(text.as_bytes()).unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn fault(survey: &LogSurvey, kind: FaultKind) -> Option<(u64, u64)> {
    survey.faults.iter().find(|fault| fault.kind == kind).map(|fault| (fault.count, fault.first_line))
}

const LASER: &str = "ODOM 0 0 0 0 0 0 1.0 h 1\nFLASER 3 1 2 9 0 0 0 0 0 0 1.0 h 1\nODOM 3 4 0 0 0 0 2.0 h 2\n";

#[test]
fn a_small_log() {
    let (survey, events) = usable(LASER);
    assert_eq!((survey.odometry_count, survey.scan_count, survey.reading_count), (2, 1, 3));
    assert_eq!((survey.distance_m, survey.clock.is_clean()), (5.0, true));
    assert_eq!((survey.first_stamp_ns, survey.last_stamp_ns), (1_000_000_000, 2_000_000_000));
    assert!(survey.faults.is_empty());
    assert!(matches!(&events[1], LogEvent::Scan { readings, .. } if readings[2].echo == Echo::Hit { range_m: 9.0 }));
    assert_eq!(usable(&LASER.replace('\n', "\r\n")).1, events);
    assert_eq!(read(&gzip(LASER.as_bytes())).unwrap().1, events);
    assert_eq!(usable(LASER.trim_end()).1, events);
}

#[test]
fn without_odom_lines_the_scans_carry_the_odometry() {
    let line = |x: f64, stamp: f64| {
        format!("ROBOTLASER1 0 -1.57 3.14 1.57 50 0.01 0 3 1 60 0 0 {x} 0 0 {x} 0 0 0.5 0.1 0 0 0 {stamp} h 0\n")
    };
    let (survey, events) = usable(&(line(0.0, 1.0) + &line(1.0, 2.0) + &line(3.0, 3.0)));
    assert_eq!((survey.odometry_count, survey.scan_count, survey.distance_m), (3, 3, 3.0));
    assert!(matches!(events[0], LogEvent::Odometry { v_mps: 0.5, .. }));
    assert!(matches!(&events[1], LogEvent::Scan { readings, .. }
        if readings.iter().map(|reading| reading.echo).eq([Echo::Hit { range_m: 1.0 }, Echo::NoEcho, Echo::Invalid])));
}

#[test]
fn one_scan_under_several_names_is_used_once() {
    let raw = "RAWLASER1 0 -1.57 3.14 1.57 50 0.01 0 3 1 2 3 0 1.0 h 1\n";
    let (survey, _) = usable(&format!("{raw}{LASER}"));
    assert_eq!((survey.scan_count, survey.skipped.get("RAWLASER1")), (1, Some(&1)));
    assert_eq!(survey.robot.sensors.len(), 1);
}

#[test]
fn front_and_rear_lasers_are_numbered_through() {
    let params = "PARAM robot_rearlaser_offset -0.2 h 0\nPARAM robot_frontlaser_offset 0.1 h 0\n";
    let rear = "RLASER 2 1 2 0 0 0 0 0 0 1.5 h 1\n";
    let (survey, events) = usable(&format!("{params}{LASER}{rear}"));
    let [front, back] = survey.robot.sensors.as_slice() else { panic!("two sensors") };
    assert_eq!((front.base_from_sensor.x, front.first_transducer, front.transducers), (0.1, 0, 3));
    assert_eq!((back.base_from_sensor.x, back.first_transducer, back.transducers), (-0.2, 3, 2));
    assert!((back.base_from_sensor.theta.abs() - std::f64::consts::PI).abs() < 1e-12);
    assert!(matches!(&events[2], LogEvent::Scan { readings, .. } if readings[1].transducer == 4));
}

#[test]
fn a_laser_offset_shows_in_the_poses_if_no_parameter_says_it() {
    let line = |theta: f64, stamp: f64| {
        let (x, y) = (0.3 * theta.cos(), 0.3 * theta.sin());
        format!("FLASER 3 1 2 3 {x} {y} {theta} 0 0 {theta} {stamp} h 0\n")
    };
    let (survey, _) = usable(&(line(0.0, 1.0) + &line(1.0, 2.0) + &line(2.0, 3.0)));
    assert!(survey.robot.sensors[0].base_from_sensor.distance_m(Pose2::new(0.3, 0.0, 0.0)) < 1e-9);
}

#[test]
fn stamps_out_of_order_are_sorted() {
    let lines = "ODOM 1 0 0 0 0 0 1.0 h 0\nODOM 3 0 0 0 0 0 1.3 h 0\nODOM 2 0 0 0 0 0 1.2 h 0\n\
        FLASER 1 1 0 0 0 0 0 0 1.1 h 0\n";
    let (survey, events) = usable(lines);
    assert_eq!(survey.clock.reordered, 1);
    assert_eq!(survey.distance_m, 2.0);
    assert!(matches!(events[1], LogEvent::Scan { stamp_ns: 1_100_000_000, .. }));
}

/// A line from long ago stays where it is in the file: at its stamp it would be somewhere else.
#[test]
fn a_stray_stamp_does_not_count() {
    let odometry = |stamp: f64| format!("ODOM {stamp} 0 0 0 0 0 {stamp} h 0\n");
    let late: String = [3.0, 4.0, 5.0, 6.0, 2.5].map(odometry).concat();
    let (survey, events) = usable(&(LASER.to_owned() + &late));
    assert_eq!((survey.clock.strays, survey.clock.first_stray), (1, Some(8)));
    let Some(LogEvent::Odometry { odom_from_base, .. }) = events.last() else { panic!("odometry") };
    assert_eq!(odom_from_base.x, 2.5);
}

#[test]
fn useless_stamps_leave_the_order() {
    let lines = "FLASER 1 1 0 0 0 0 0 0 1e9 h 0\nODOM 1 0 0 0 0 0 1e9 h 0\nFLASER 1 1 0 0 0 0 0 0 1e9 h 0\n\
        ODOM 2 0 0 0 0 0 1e9 h 0\n";
    let (survey, events) = usable(lines);
    assert!(survey.clock.order_only);
    let stamps: Vec<_> = events.iter().map(LogEvent::stamp_ns).collect();
    assert_eq!(stamps, [0, 100_000_000, 100_000_000, 200_000_000]);
    // Stamps that are no stamps are as useless.
    assert!(usable(&lines.replace("1e9", "-3")).0.clock.order_only);
}

/// The survey said that the drive began when the first pose came, not with the scan before it (found by fuzzing).
#[test]
fn a_scan_before_the_first_carried_pose_comes_first() {
    let lines = "SONAR 0.5 1 2 0.1 0 0 9 h 1\nSONAR 0.5 1 2 0.1 0 0 7 8 0 9 h 1\nSONAR 0.5 1 2 0.1 0 0 9 h 1\n";
    let (survey, events) = usable(lines);
    assert_eq!((survey.clock.order_only, survey.first_stamp_ns), (true, 0));
    assert_eq!(events.iter().map(LogEvent::stamp_ns).collect::<Vec<_>>(), [0, 100_000_000, 100_000_000, 100_000_000]);
}

#[test]
fn damage_is_counted_and_the_rest_kept() {
    let mut log = LASER.as_bytes().to_vec();
    log.extend(b"\x00\xff\xfe garbage\nODOM 1 2\nODOM 9e9 0 0 0 0 0 3 h 3\nFLASER 3 nan 1e7 inf 0 0 0 0 0 0 3.0 h 3\n");
    log.extend(b"FLASER 2 1 1 0 0 0 0 0 0 3.0 h 3\nWHATEVER 1 2\nODOM 5 4 0 0 0 0 zzz h 3\nODOM 3 4 0 0 0 0 3.");
    let (survey, events) = read(&log).unwrap();
    assert_eq!(fault(&survey, FaultKind::NotUtf8), Some((1, 4)));
    assert_eq!(fault(&survey, FaultKind::Truncated), Some((2, 5)));
    assert_eq!(fault(&survey, FaultKind::AbsurdPose), Some((1, 6)));
    assert_eq!(fault(&survey, FaultKind::RangeNotFinite), Some((2, 7)));
    assert_eq!(fault(&survey, FaultKind::AbsurdRange), Some((1, 7)));
    assert_eq!(fault(&survey, FaultKind::BadStamp), Some((1, 10)));
    assert_eq!(survey.skipped.get("WHATEVER"), Some(&1));
    // A scan of another number of beams is a scan.
    assert_eq!(events.len(), 6);
}

#[test]
fn a_cut_gzip_keeps_what_came_before() {
    let lines: String = (0..5000).map(|n| format!("ODOM {n} {} 0 0 0 0 {n}.5 h 0\n", n * 7919 % 1000)).collect();
    let whole = gzip(format!("{LASER}{lines}").as_bytes());
    let (survey, events) = read(&whole[..whole.len() / 2]).unwrap();
    assert_eq!(fault(&survey, FaultKind::GzipDamaged).unwrap().0, 1);
    assert!(events.len() > 1000 && events.len() < 5000);
    let mut bad = whole;
    let middle = bad.len() / 2;
    bad[middle] ^= 0xff;
    assert!(read(&bad).is_ok());
}

#[test]
fn no_map_is_an_error_that_says_why() {
    let error = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
    assert!(error("ODOM 0 0 0 0 0 0 1.0 h 1\n").contains("a.log: no range readings"));
    let message = error("RAWLASER1 0 -1.57 3.14 1.57 50 0.01 0 1 1 0 1.0 h 1\nODOM 1 x\n");
    assert!(message.contains("no odometry") && message.contains("line 2: \"x\""), "{message}");
    let folder = tempfile::tempdir().unwrap();
    let survey = |name: &str, content: &[u8]| {
        std::fs::write(folder.path().join(name), content).unwrap();
        log::survey(&folder.path().join(name)).unwrap_err()
    };
    assert!(matches!(survey("empty", b""), LogError::Empty { .. }));
    assert!(matches!(survey("empty.gz", &gzip(b"")), LogError::Empty { .. }));
    assert!(matches!(survey("x", b"\x01\x02\x03"), LogError::UnknownFormat { .. }));
    assert!(matches!(survey("x", b"%PDF-1.7"), LogError::Foreign { .. }));
    assert!(matches!(survey("measurement.txt", b"1 2 3 4 5 6 7 8 9\n"), LogError::MissingPair { .. }));
    assert!(matches!(log::survey(folder.path()), Err(LogError::MissingPair { .. })));
    std::fs::remove_file(folder.path().join("measurement.txt")).unwrap();
    assert!(matches!(log::survey(folder.path()), Err(LogError::Folder { .. })));
    let near = log::survey(&folder.path().join("emty.gz")).unwrap_err().to_string();
    assert!(near.contains("did you mean") && near.contains("empty.gz"), "{near}");
    #[cfg(unix)]
    assert!(matches!(log::survey(Path::new("/dev/null")), Err(LogError::NotAFile { .. })));
}

#[test]
fn a_growing_log_gives_what_was_surveyed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("growing.log");
    std::fs::write(&path, LASER).unwrap();
    let survey = log::survey(&path).unwrap();
    std::fs::write(&path, format!("{LASER}{LASER}")).unwrap();
    assert_eq!(log::open(&path, &survey).unwrap().count(), 3);
}

#[test]
fn a_sonar_pair() {
    let measurement = b"1000 5110 160 170 5000 5001 1 2 1000\n1100 bad\n1200 1 1 1 1 1 1 1 1\n";
    let poses = b"1000 0 0 0\n1100 3000 4000 900\n";
    let path = Path::new("pair");
    let survey = udacity::survey(Cursor::new(measurement), path, Cursor::new(poses), path).unwrap();
    assert_eq!((survey.odometry_count, survey.scan_count, survey.distance_m), (2, 2, 5.0));
    assert_eq!(fault(&survey, FaultKind::BadNumber), Some((1, 2)));
    let events: Vec<_> = udacity::read(measurement.as_slice(), path, poses.as_slice(), path, &survey)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let LogEvent::Scan { readings, .. } = &events[1] else { panic!("odometry first, then its scan") };
    let echoes: Vec<_> = readings.iter().map(|reading| reading.echo).collect();
    let hit = |range_m| Echo::Hit { range_m };
    assert_eq!(echoes[..5], [Echo::NoEcho, Echo::Invalid, hit(0.17), hit(5.0), Echo::NoEcho]);
    assert!(matches!(events[2], LogEvent::Odometry { odom_from_base: Pose2 { x, .. }, .. } if x == 3.0));
    assert_eq!(survey.sha256.len(), 64);
}

/// Words that a log is made of, and some that it isn't.
fn word() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => "(ODOM|FLASER|RLASER|SONAR|ROBOTLASER1|RAWLASER2|TRUEPOS|PARAM|SYNC|#)",
        8 => "(0|1|2|3|-1|0\\.5|1e9|nan|inf|-inf|1e300|65535|99999999999|h)",
        4 => (0..2000_u32).prop_map(|stamp| format!("{}", f64::from(stamp) / 10.0)),
        1 => "\\PC{0,5}",
        4 => "(\n|\r\n)",
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400), zip: bool) {
        let _ = read(&bytes);
        let _ = read(&if zip { gzip(&bytes) } else { [&[0x1f, 0x8b, 8, 0], bytes.as_slice()].concat() });
        let survey = udacity::survey(Cursor::new(&bytes), Path::new(""), Cursor::new(&bytes), Path::new(""));
        prop_assert!(survey.is_err() || bytes.is_ascii());
    }

    #[test]
    fn any_words_are_survived(words in prop::collection::vec(word(), 0..200)) {
        let _ = read((LASER.to_owned() + &words.join(" ")).as_bytes());
        let _ = read(words.join(" ").as_bytes());
    }

    #[test]
    fn any_stamps_give_events_in_order(stamps in prop::collection::vec(0..100_000_u32, 1..80)) {
        let mut log = LASER.to_owned();
        for (number, stamp) in stamps.iter().enumerate() {
            let stamp = f64::from(*stamp) / 1000.0;
            log += &match number % 3 {
                0 => format!("FLASER 3 1 2 9 0 0 0 0 0 0 {stamp} h 1\n"),
                1 => format!("TRUEPOS 0 0 0 0 0 0 {stamp} h 1\n"),
                _ => format!("ODOM {number} 0 0 0 0 0 {stamp} h 1\n"),
            };
        }
        usable(&log);
    }
}

/// Each line twice: the copies are no evidence, and do not move their like in time.
#[test]
fn lines_that_stand_twice_count_once() {
    let lines = |copies: usize| -> String {
        let scan = |n: usize| format!("FLASER 3 2.0 2.{n} 2.0 0.{n} 0 0 0.{n} 0 0 {n}.5 h {n}.5\n");
        (1..9)
            .map(|n| format!("ODOM 0.{n} 0 0 0.1 0 0 {n}.25 h {n}.25\n").repeat(copies) + &scan(n).repeat(copies))
            .collect()
    };
    let ((once, _), (twice, _)) = (usable(&lines(1)), usable(&lines(2)));
    // Until the clock has moved it can't be told from one that stands still.
    assert_eq!(twice.scan_count, once.scan_count);
    assert_eq!(twice.odometry_count, once.odometry_count + 1);
    assert_eq!(fault(&twice, FaultKind::Repeated), Some((15, 4)));
}
