//! Range sensors of all kinds in CARMEN logs: whatever a sensor is and however its log says so, echoes lie on the walls of the room
//! that they were made in, and what is odd is said.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI, TAU};
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

use echogrid_core::{Echo, Pose2, SensorKind};
use echogrid_formats::convert::convert;
use echogrid_formats::log::{self, FaultKind, LogError, LogEvent, LogSurvey, RangeUnit, SurveyOptions, carmen};

/// Half the room: 8 × 6 m around the origin.
const ROOM: [f64; 2] = [4.0, 3.0];
const DEGREE: f64 = PI / 180.0;

/// From a place in the room along a bearing to the wall, metres.
fn to_the_wall(pose: Pose2) -> f64 {
    let (sin, cos) = pose.theta.sin_cos();
    let along =
        |at: f64, way: f64, half: f64| if way == 0.0 { f64::INFINITY } else { (half * way.signum() - at) / way };
    along(pose.x, cos, ROOM[0]).min(along(pose.y, sin, ROOM[1]))
}

/// Where the robot is in its step `n` of 60.
fn place(n: u32) -> Pose2 {
    let (sin, cos) = (0.04 * f64::from(n)).sin_cos();
    Pose2::new(2.0 * cos, 1.5 * sin, (1.5 * cos).atan2(-2.0 * sin))
}

/// The log of a drive: `scan` writes the line of each step, but for its stamp.
fn drive(mut scan: impl FnMut(u32, Pose2) -> String) -> String {
    let mut text = String::new();
    for n in 0..60 {
        let (Pose2 { x, y, theta }, stamp) = (place(n), 1000.0 + 0.3 * f64::from(n));
        let line = scan(n, place(n));
        write!(text, "ODOM {x} {y} {theta} 0.3 0.1 0 {stamp} h {stamp}\n{line} {stamp} h {stamp}\n").unwrap();
    }
    text
}

fn words(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers.into_iter().map(|number| format!(" {number}")).collect()
}

fn pose_words(pose: Pose2) -> String {
    words([pose.x, pose.y, pose.theta])
}

/// What beams hear that lie like this, in units of `unit_m` metres.
fn ranges(sensor: Pose2, first: f64, step: f64, count: u32, unit_m: f64) -> String {
    let heard = |n: u32| to_the_wall(sensor * Pose2::new(0.0, 0.0, first + f64::from(n) * step)) / unit_m;
    words((0..count).map(|n| (heard(n) * 1000.0).round() / 1000.0))
}

/// `ROBOTLASER1` of beams that lie like this; `stated`: what it says of start, field of view, step and maximum.
fn described(base: Pose2, first: f64, step: f64, count: u32, stated: &str, unit_m: f64) -> String {
    let heard = ranges(base, first, step, count, unit_m);
    format!("ROBOTLASER1 0 {stated} 0.01 0 {count}{heard} 0{}{} 0.3 0.1 0 0 0", pose_words(base), pose_words(base))
}

fn honest(base: Pose2, first: f64, step: f64, count: u32) -> String {
    let stated = format!("{first} {} {step} 12", f64::from(count - 1) * step);
    described(base, first, step, count, &stated, 1.0)
}

/// `FLASER` or `RLASER` of 181 beams at a mount, whose line says `heading` for the laser's.
fn plain(name: &str, base: Pose2, mount: Pose2, heading: f64, unit_m: f64) -> String {
    let sensor = base * mount;
    let heard = ranges(sensor, -FRAC_PI_2, DEGREE, 181, unit_m);
    format!("{name} 181{heard}{}{}", pose_words(Pose2 { theta: heading, ..sensor }), pose_words(base))
}

/// `SONAR` with one sonar at each heading.
fn sonars(base: Pose2, cone: &str, headings: &[f64], unit_m: f64) -> String {
    let mounts = headings.iter().map(|heading| Pose2::new(0.0, 0.0, *heading) * Pose2::new(0.2, 0.0, 0.0));
    let mounts: Vec<Pose2> = mounts.collect();
    let heard = words(mounts.iter().map(|mount| to_the_wall(base * *mount) / unit_m));
    let mounts: String = mounts.into_iter().map(pose_words).collect();
    format!("SONAR {cone} {}{heard}{mounts}{}", headings.len(), pose_words(base))
}

fn ring(count: u32) -> Vec<f64> {
    (0..count).map(|n| TAU * f64::from(n) / f64::from(count)).collect()
}

fn survey(text: &str) -> Result<LogSurvey, LogError> {
    carmen::survey(text.as_bytes(), Path::new("a.log"))
}

fn events(text: &str, survey: &LogSurvey) -> Vec<LogEvent> {
    let read = carmen::read(Cursor::new(text.as_bytes().to_vec()), Path::new("a.log"), survey).unwrap();
    read.map(Result::unwrap).collect()
}

/// All echoes must lie on the walls of the room around `origin`, and nothing be refused; how many there are.
fn echoes_on_the_walls(survey: &LogSurvey, events: &[LogEvent], origin: [f64; 2]) -> u64 {
    let (mut base, mut echoes) = (Pose2::IDENTITY, 0);
    for event in events {
        match event {
            LogEvent::Odometry { odom_from_base, .. } => base = *odom_from_base,
            LogEvent::Scan { readings, .. } => {
                for reading in readings {
                    let Echo::Hit { range_m } = reading.echo else { continue };
                    let transducer = survey.robot.transducer(reading.transducer).unwrap();
                    let [x, y] = (base * transducer.base_from_transducer).transform([range_m, 0.0]);
                    let off = [(x - origin[0]).abs() - ROOM[0], (y - origin[1]).abs() - ROOM[1]];
                    let off = off[0].max(off[1]).abs();
                    // Noise of the recordings, and bearings that are rounded
                    assert!(off < 0.06, "an echo {off} m off the wall at ({x}, {y}): {reading:?}");
                    echoes += 1;
                }
            }
            LogEvent::TruePose { .. } => {}
        }
    }
    echoes
}

/// A log that is used to the last reading, with every echo on the walls; what is known of it.
fn used(text: &str) -> LogSurvey {
    let survey = survey(text).unwrap();
    let events = events(text, &survey);
    assert_eq!(survey.scan_count, 60);
    let echoes = echoes_on_the_walls(&survey, &events, [0.0; 2]);
    // The largest range may be taken for the sensor's maximum.
    assert!(echoes * 100 >= survey.reading_count * 98, "{echoes} of {}", survey.reading_count);
    for sensor in survey.robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Lidar) {
        assert!(sensor.aperture_rad <= DEGREE, "{sensor:?}");
    }
    survey
}

/// Likewise, and this must have been said.
fn said(text: &str, expected: &str) -> LogSurvey {
    let survey = used(text);
    let all: Vec<String> =
        survey.remarks.iter().cloned().chain(survey.faults.iter().map(ToString::to_string)).collect();
    assert!(all.iter().any(|one| one.contains(expected)), "no {expected:?} in {all:?}");
    survey
}

#[test]
fn a_number_of_beams_that_varies() {
    // In a turn, as a spinning lidar tells it
    let spinning = |n: u32, base| {
        let count = [120, 119, 60, 121, 120, 118][n as usize % 6];
        honest(base, -PI, TAU / f64::from(count), count)
    };
    let survey = said(&drive(spinning), "120 beams in 20 of 60 scans, 60 to 121 in the others");
    assert_eq!(survey.robot.sensors.len(), 5);
    // The same lattice, more or less of it
    let survey = said(&drive(|n, base| honest(base, -1.0, DEGREE, 100 + n)), "100 to 159 in the others");
    assert_eq!((survey.robot.sensors.len(), survey.robot.transducer_count()), (1, 159));
    // As FLASER spreads them
    let flaser = |n: u32, base| {
        let count = 46 + n % 5;
        let heard = ranges(base, -FRAC_PI_2, PI / f64::from(count - 1), count, 1.0);
        format!("FLASER {count}{heard}{}{}", pose_words(base), pose_words(base))
    };
    assert_eq!(said(&drive(flaser), "46 to 50 in the others").robot.sensors.len(), 5);
}

#[test]
fn a_first_bearing_that_jitters() {
    let scan = |n: u32, base| {
        let count = 440 + n * 7 % 30;
        honest(base, -PI + 0.0137 * f64::from(n * 31 % 60) / 60.0, TAU / f64::from(count), count)
    };
    // Sixty ways are few enough to be told apart; those of five lidars are not.
    assert_eq!(said(&drive(scan), "in 60 ways").robot.sensors.len(), 60);
    let five = |n: u32, base| {
        let line = |k: u32| scan(n, base).replacen("ROBOTLASER1", &format!("ROBOTLASER{k}"), 1);
        let stamp = 1000.0 + 0.3 * f64::from(n);
        let before: String = (3..7).map(|k| format!("{} {stamp} h 0\n", line(k))).collect();
        before + &line(7)
    };
    let text = drive(five);
    let survey = survey(&text).unwrap();
    assert_eq!(survey.scan_count, 300);
    assert!(survey.robot.sensors.len() <= echogrid_core::robot::SENSORS_MAX);
    for kind in ["own bearings", "rounded"] {
        assert!(survey.remarks.iter().any(|remark| remark.contains(kind)), "{:?}", survey.remarks);
    }
    echoes_on_the_walls(&survey, &events(&text, &survey), [0.0; 2]);
}

#[test]
fn bearings_that_are_all_different_are_rounded_and_it_is_said() {
    let scan = |n: u32, base| {
        let first = -PI + 0.0011 * f64::from(n);
        let text = honest(base, first, TAU / f64::from(400 + n), 400 + n);
        let stamp = 1000.0 + 0.3 * f64::from(n);
        format!("{text} {stamp} h 0\n{}", honest(base, first + 0.0005, TAU / f64::from(300 + n), 300 + n))
    };
    let text = drive(scan);
    let survey = survey(&text).unwrap();
    assert_eq!(survey.scan_count, 120);
    assert!(survey.remarks[0].contains("bearings are rounded by up to 0.0"), "{:?}", survey.remarks);
    assert!(survey.robot.transducer_count() <= 65_535);
    assert_eq!(echoes_on_the_walls(&survey, &events(&text, &survey), [0.0; 2]), survey.reading_count);
}

#[test]
fn few_beams_are_thin() {
    for count in [4, 8, 16] {
        let step = TAU / f64::from(count);
        said(&drive(|_, base| honest(base, -PI, step, count)), "each is taken to be 1° wide");
    }
    for count in [2, 5] {
        let flaser = |_, base| {
            let heard = ranges(base, -FRAC_PI_2, PI / f64::from(count - 1), count, 1.0);
            format!("FLASER {count}{heard}{}{}", pose_words(base), pose_words(base))
        };
        said(&drive(flaser), "each is taken to be 1° wide");
    }
}

#[test]
fn a_single_beam() {
    used(&drive(|_, base| described(base, 0.3, 0.0, 1, "0.3 0 0 12", 1.0)));
    used(&drive(|_, base| {
        format!("FLASER 1{}{}{}", ranges(base, 0.0, 0.0, 1, 1.0), pose_words(base), pose_words(base))
    }));
}

#[test]
fn negative_steps_and_fields_of_view_turn_clockwise() {
    let step = 2.0 * DEGREE;
    for stated in
        [format!("{FRAC_PI_2} {PI} {}", -step), format!("{FRAC_PI_2} {} {step}", -PI), format!("{FRAC_PI_2} {} 0", -PI)]
    {
        let survey = used(&drive(|_, base| described(base, FRAC_PI_2, -step, 91, &format!("{stated} 20"), 1.0)));
        assert!(survey.robot.sensors[0].bearing_step_rad < 0.0);
    }
}

#[test]
fn angles_that_contradict_each_other_or_are_degrees() {
    let as_said = |stated: &str, expected: &str| {
        said(&drive(|_, base| described(base, -FRAC_PI_2, DEGREE, 181, &format!("{stated} 20"), 1.0)), expected);
    };
    as_said("-90 180 1", "read as degrees (60 times, first in line 2");
    as_said(&format!("{} {PI} 1", -FRAC_PI_2), "the field of view is believed");
    as_said(&format!("{} 2 {DEGREE}", -FRAC_PI_2), "the step is believed");
    as_said("0 0 0", "as in FLASER");
    let error = survey(&drive(|_, base| described(base, 0.0, 0.0, 9, "nan 3 0.1 20", 1.0))).unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("nan"), "{error}");
    let error = survey(&drive(|_, base| described(base, 0.0, 0.0, 9, "0 0 3 20", 1.0))).unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("step 3"), "{error}");
}

#[test]
fn turned_mounts_in_laser_lines() {
    for turned in [PI, FRAC_PI_2, -PI / 4.0] {
        let mount = Pose2::new(0.2, -0.1, turned);
        said(
            &drive(|_, base| plain("FLASER", base, mount, (base * mount).theta, 1.0)),
            "it is mapped as turned by that",
        );
    }
    // In classic logs the heading of both is the robot's, and the rear laser looks back.
    let front = Pose2::new(0.2, 0.0, 0.0);
    assert!(used(&drive(|_, base| plain("FLASER", base, front, base.theta, 1.0))).remarks.is_empty());
    let rear = Pose2::new(-0.2, 0.0, PI);
    assert!(used(&drive(|_, base| plain("RLASER", base, rear, base.theta, 1.0))).remarks.is_empty());
    assert!(used(&drive(|_, base| plain("RLASER", base, rear, (base * rear).theta, 1.0))).remarks.is_empty());
    let left = Pose2::new(0.0, 0.1, FRAC_PI_2);
    said(&drive(|_, base| plain("RLASER", base, left, (base * left).theta, 1.0)), "90.0°");
}

#[test]
fn a_maximum_that_is_no_sensors() {
    let stated = format!("{} {PI} {DEGREE} 1e+06", -FRAC_PI_2);
    let survey = said(&drive(|_, base| described(base, -FRAC_PI_2, DEGREE, 181, &stated, 1.0)), "1000000 m (line 2)");
    assert!(survey.robot.sensors[0].range_max_m < 10.0);
}

#[test]
fn cones_of_sonars() {
    let check = |cone: &str, aperture_rad: f64, kind: Option<FaultKind>| {
        let survey = used(&drive(|_, base| sonars(base, cone, &ring(8), 1.0)));
        let of_first = survey.robot.sensors[0].aperture_rad;
        assert!((of_first - aperture_rad).abs() < 1e-4, "{cone}: {of_first}");
        assert_eq!(
            survey.faults.iter().map(|fault| (fault.kind, fault.first_line)).collect::<Vec<_>>(),
            Vec::from_iter(kind.map(|kind| (kind, 2)))
        );
    };
    check("0.5", 0.5, None);
    check("6.2832", TAU, Some(FaultKind::ConeWide));
    check("0", FRAC_PI_6, Some(FaultKind::ConeMissing));
    check("-0.5", 0.5, Some(FaultKind::ConeNegative));
    for degrees in ["5", "15", "30"] {
        check(degrees, degrees.parse::<f64>().unwrap().to_radians(), Some(FaultKind::ConeInDegrees));
    }
    let error = survey(&drive(|_, base| sonars(base, "1000", &ring(8), 1.0))).unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("1000"), "{error}");
}

#[test]
fn many_sonars_and_rings_in_turn() {
    for count in [33, 48, 256] {
        assert_eq!(used(&drive(|_, base| sonars(base, "0.13", &ring(count), 1.0))).robot.sensors.len(), count as usize);
    }
    let error = survey(&drive(|_, base| sonars(base, "0.13", &ring(257), 1.0))).unwrap_err().to_string();
    assert!(error.contains("a.log:2: SONAR of 257 sonars") && error.contains("256"), "{error}");
    let half = |n: u32| ring(48).into_iter().skip(n as usize % 2).step_by(2).collect::<Vec<_>>();
    assert_eq!(said(&drive(|n, base| sonars(base, "0.13", &half(n), 1.0)), "48 in all").robot.sensors.len(), 48);
}

#[test]
fn ranges_in_millimetres_and_centimetres() {
    for (unit_m, name) in [(0.001, "millimetres"), (0.01, "centimetres")] {
        said(&drive(|_, base| plain("FLASER", base, Pose2::IDENTITY, base.theta, unit_m)), name);
        said(&drive(|_, base| sonars(base, "0.5", &ring(16), unit_m)), name);
    }
    let stated = format!("{} {PI} {DEGREE} 8000", -FRAC_PI_2);
    said(&drive(|_, base| described(base, -FRAC_PI_2, DEGREE, 181, &stated, 0.001)), "millimetres");
    // Too few beams to compare; the maximum tells it.
    said(
        &drive(|_, base| described(base, -PI, FRAC_PI_2, 4, &format!("{} 4.71 {FRAC_PI_2} 12", -PI), 0.001)),
        "millimetres",
    );
}

#[test]
fn ranges_in_an_unknown_unit_are_refused_unless_it_is_said() {
    // A robot that stands still in a log that states no maximum
    let text = drive(|_, _| plain("FLASER", place(0), Pose2::IDENTITY, place(0).theta, 0.001));
    let text: String = text.lines().filter(|line| !line.starts_with("ODOM")).map(|line| format!("{line}\n")).collect();
    let error = survey(&text).unwrap_err().to_string();
    assert!(error.contains("a.log:1: ranges of FLASER") && error.contains("replay.range_unit=mm"), "{error}");
    let options = SurveyOptions { range_unit: Some(RangeUnit::Millimetres), ..SurveyOptions::default() };
    let told = carmen::survey_with(text.as_bytes(), Path::new("a.log"), options).unwrap();
    assert!(echoes_on_the_walls(&told, &events(&text, &told), [0.0; 2]) > 10_000);
    // Odometry in the same unit: it is not for ranges alone to be another.
    let scaled = |pose: Pose2| Pose2 { x: 1000.0 * pose.x, y: 1000.0 * pose.y, ..pose };
    let text = drive(|_, base| {
        let heard = ranges(base, -FRAC_PI_2, DEGREE, 181, 0.001);
        format!("FLASER 181{heard}{}{}", pose_words(scaled(base)), pose_words(scaled(base)))
    });
    let text: String = text.lines().filter(|line| !line.starts_with("ODOM")).map(|line| format!("{line}\n")).collect();
    let error = survey(&text).unwrap_err().to_string();
    assert!(error.contains("odometry"), "{error}");
}

#[test]
fn coordinates_of_utm() {
    let far = |pose: Pose2| Pose2 { x: pose.x + 690_000.0, y: pose.y + 9_330_000.0, ..pose };
    let mut text = String::new();
    for n in 0..20 {
        let (base, heard) = (far(place(n)), ranges(place(n), -FRAC_PI_2, DEGREE, 181, 1.0));
        writeln!(text, "FLASER 181{heard}{}{} {n}.5 h 0", pose_words(base), pose_words(base)).unwrap();
    }
    let survey = survey(&text).unwrap();
    assert!(survey.faults.is_empty() && survey.remarks.is_empty(), "{:?} {:?}", survey.faults, survey.remarks);
    assert!(echoes_on_the_walls(&survey, &events(&text, &survey), [690_000.0, 9_330_000.0]) > 3500);
}

/// Whatever scans there are, a log that was converted gives the same readings.
#[test]
fn scans_of_varying_beams_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["a.txt", "b.log"].map(|name| folder.path().join(name));
    let counts = |n: u32, base| honest(base, -PI, TAU / f64::from(100 + n % 7), 100 + n % 7);
    let clockwise = |n: u32, base| honest(base, 1.5, -0.02, 100 + n % 7);
    let jitter = |n: u32, base| {
        let stamp = 1000.0 + 0.3 * f64::from(n);
        let at = |n: u32| honest(base, -PI + 0.0011 * f64::from(n), TAU / f64::from(300 + n), 300 + n);
        format!("{} {stamp} h 0\n{}", at(n), at(n + 60))
    };
    for text in [drive(counts), drive(clockwise), drive(jitter)] {
        std::fs::write(&from, text).unwrap();
        convert(&from, &to).unwrap();
        let read = |path: &Path| {
            let survey = log::survey(path).unwrap();
            let events: Vec<LogEvent> = log::open(path, &survey).unwrap().map(Result::unwrap).collect();
            echoes_on_the_walls(&survey, &events, [0.0; 2]);
            let echoes = |event: &LogEvent| match event {
                LogEvent::Scan { readings, .. } => readings.iter().map(|reading| reading.echo).collect(),
                _ => Vec::new(),
            };
            events.iter().map(|event| (event.stamp_ns(), echoes(event))).collect::<Vec<_>>()
        };
        assert_eq!(read(&from), read(&to));
    }
}

/// The recordings of these kinds, where they are.
#[test]
fn recordings_of_odd_sensors() {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), Into::into);
    for (name, origin) in [
        ("B1-beam-count-varies", [0.0; 2]),
        ("B2-four-beams", [0.0; 2]),
        ("B3-negative-step", [0.0; 2]),
        ("B4-rear-as-FLASER", [0.0; 2]),
        ("C1-max-1e6", [0.0; 2]),
        ("D3-range-in-mm", [0.0; 2]),
        ("E1-utm", [448_262.25, 5_411_932.75]),
    ] {
        let path = root.join(format!("faults/{name}.log"));
        if !path.exists() {
            println!("skipped: no {}", path.display());
            continue;
        }
        let survey = log::survey(&path).unwrap();
        let events: Vec<LogEvent> = log::open(&path, &survey).unwrap().map(Result::unwrap).collect();
        let echoes = echoes_on_the_walls(&survey, &events, origin);
        assert!(echoes * 100 >= survey.reading_count * 98, "{name}: {echoes} of {}", survey.reading_count);
        let scans = std::fs::read_to_string(&path).unwrap().lines().filter(|line| line.contains("LASER")).count();
        assert_eq!(survey.scan_count, scans as u64, "{name}");
    }
}
