//! Logs of real robots, read where they lie: `$ECHOGRID_DATA`, or `../shared/data` beside the workspace.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use echogrid_core::{DrivePose, Echo, Leaps, SensorKind};
use echogrid_formats::log::{self, LogEvent, LogSurvey};

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("skipped: {name} is not there");
        None
    }
}

#[derive(Debug, PartialEq, Eq, Default)]
struct Counts {
    odometry: u64,
    scans: u64,
    readings: u64,
    true_poses: u64,
    hits: u64,
    no_echoes: u64,
    invalid: u64,
}

/// Reads the log and checks that its events are what the survey promised.
fn read(path: &Path) -> (LogSurvey, Counts, Vec<LogEvent>) {
    let survey = log::survey(path).unwrap();
    let events: Vec<_> = log::open(path, &survey).unwrap().collect::<Result<_, _>>().unwrap();
    assert!(events.windows(2).all(|pair| pair[0].stamp_ns() <= pair[1].stamp_ns()));
    assert_eq!(events.first().unwrap().stamp_ns(), survey.first_stamp_ns);
    assert_eq!(events.last().unwrap().stamp_ns(), survey.last_stamp_ns);
    let mut counts = Counts::default();
    let (mut distance_m, mut last) = (0.0, None);
    for event in &events {
        match event {
            LogEvent::Odometry { odom_from_base, .. } => {
                counts.odometry += 1;
                distance_m += last.map_or(0.0, |last| odom_from_base.distance_m(last));
                last = Some(*odom_from_base);
            }
            LogEvent::TruePose { .. } => counts.true_poses += 1,
            LogEvent::Scan { readings, .. } => {
                counts.scans += 1;
                counts.readings += readings.len() as u64;
                assert!(readings.len() <= survey.max_readings_per_scan);
                for reading in readings {
                    assert!(survey.robot.transducer(reading.transducer).is_some());
                    match reading.echo {
                        Echo::Hit { .. } => counts.hits += 1,
                        Echo::NoEcho => counts.no_echoes += 1,
                        Echo::Invalid => counts.invalid += 1,
                    }
                }
            }
        }
    }
    assert_eq!(counts.odometry, survey.odometry_count);
    assert_eq!(counts.scans, survey.scan_count);
    assert_eq!(counts.readings, survey.reading_count);
    assert_eq!(counts.true_poses, survey.true_pose_count);
    assert!((distance_m - survey.distance_m).abs() < 1e-9);
    assert_eq!(survey.sha256.len(), 64);
    (survey, counts, events)
}

#[test]
fn aces() {
    let Some(path) = data("carmen/aces-raw.log.gz") else { return };
    let (survey, counts, _) = read(&path);
    assert_eq!((counts.odometry, counts.scans, counts.readings), (7374, 440, 440 * 180));
    assert!(survey.clock.is_clean(), "{:?}", survey.clock);
    assert!((survey.distance_m - 325.218).abs() < 0.01, "{}", survey.distance_m);
    assert_eq!(counts.no_echoes, 620);
    let sensor = &survey.robot.sensors[0];
    assert_eq!((sensor.kind, sensor.transducers, sensor.range_max_m), (SensorKind::Lidar, 180, 50.0));
    assert!((sensor.bearing_step_rad.to_degrees() - 1.0).abs() < 1e-12);
    assert!(survey.faults.is_empty(), "{:?}", survey.faults);
}

#[test]
fn freiburg_101() {
    let Some(path) = data("carmen/freiburg-101-raw.log.gz") else { return };
    let (survey, counts, _) = read(&path);
    assert_eq!((counts.odometry, counts.scans, counts.readings), (4277, 292, 292 * 360));
    assert!((survey.distance_m - 211.0).abs() < 1.0, "{}", survey.distance_m);
    let sensor = &survey.robot.sensors[0];
    assert_eq!(sensor.range_max_m, 80.99);
    assert_eq!(sensor.base_from_sensor.x, -0.04);
    assert!((sensor.bearing_step_rad.to_degrees() - 0.5).abs() < 1e-12);
    assert_eq!(survey.robot.footprint.length_m, 0.47);
    assert!(counts.no_echoes > 12_000);
}

#[test]
fn belgioioso_has_order_only() {
    let Some(path) = data("carmen/belgioioso-raw.log.gz") else { return };
    let (survey, counts, events) = read(&path);
    assert_eq!((counts.odometry, counts.scans), (4047, 395));
    assert!(survey.clock.order_only);
    assert!((survey.distance_m - 227.584).abs() < 0.01, "{}", survey.distance_m);
    // The parameter is in the log twice; the last value before the first scan counts.
    assert_eq!(survey.robot.sensors[0].base_from_sensor.x, -0.04);
    let mut latest_ns = 0;
    for event in events {
        match event {
            LogEvent::Odometry { stamp_ns, .. } => {
                assert_eq!(stamp_ns, latest_ns + 100_000_000);
                latest_ns = stamp_ns;
            }
            LogEvent::Scan { stamp_ns, .. } => assert_eq!(stamp_ns, latest_ns),
            LogEvent::TruePose { .. } => panic!("there is none"),
        }
    }
}

#[test]
fn columbia_sonar() {
    let Some(path) = data("sonar/columbia-sonar.log.gz") else { return };
    let (survey, counts, events) = read(&path);
    assert_eq!((counts.odometry, counts.scans, counts.true_poses), (6948, 1737, 1737));
    assert_eq!(counts.readings, 1737 * 16);
    assert_eq!(counts.no_echoes, 14_062);
    assert_eq!(survey.robot.sensors.len(), 16);
    assert_eq!(survey.robot.sensors[3].range_max_m, 5.0);
    assert!((survey.robot.sensors[1].base_from_sensor.theta.to_degrees() - 50.0).abs() < 1e-4);
    assert!((survey.distance_m - 105.0).abs() < 2.0, "{}", survey.distance_m);
    assert!(matches!(events[0], LogEvent::Odometry { .. }));
    assert!(matches!(events[1], LogEvent::TruePose { .. }));
    assert!(matches!(events[2], LogEvent::Scan { .. }));
}

#[test]
fn udacity_by_either_file_or_the_folder() {
    let Some(folder) = data("sonar/udacity") else { return };
    let (survey, counts, events) = read(&folder);
    assert_eq!((counts.odometry, counts.scans, counts.readings), (413, 413, 413 * 8));
    assert!((survey.duration().as_secs_f64() - 92.837).abs() < 1e-6, "{:?}", survey.duration());
    assert!((survey.distance_m - 25.0).abs() < 1.0, "{}", survey.distance_m);
    assert!((counts.no_echoes as f64 / counts.readings as f64 - 1.0 / 3.0).abs() < 0.05);
    for file in ["measurement.txt", "poses.txt"] {
        let (other, _, other_events) = read(&folder.join(file));
        assert_eq!(other.sha256, survey.sha256);
        assert_eq!(other_events, events);
    }
}

#[test]
fn reading_twice_gives_the_same_events() {
    let Some(path) = data("carmen/aces-raw.log.gz") else { return };
    assert_eq!(read(&path).2, read(&path).2);
}

#[test]
fn every_cut_of_a_real_log_is_survived() {
    let Some(path) = data("carmen/aces-raw.log.gz") else { return };
    let whole = std::fs::read(path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.log.gz");
    for percent in [1, 10, 50, 99] {
        std::fs::write(&cut, &whole[..whole.len() * percent / 100]).unwrap();
        if let Ok(survey) = log::survey(&cut) {
            assert_eq!(log::open(&cut, &survey).unwrap().count() as u64, survey.odometry_count + survey.scan_count);
            assert!(!survey.faults.is_empty());
        }
    }
}

#[test]
fn converted_logs_give_the_same_events() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["carmen/freiburg-101-raw.log.gz", "sonar/columbia-sonar.log.gz", "sonar/udacity"] {
        let Some(path) = data(name) else { continue };
        let (survey, _, events) = read(&path);
        let copy = folder.path().join("copy.log.gz");
        echogrid_formats::convert::convert(&path, &copy).unwrap();
        let (survey_again, _, events_again) = read(&copy);
        assert!(events == events_again, "{name}");
        assert_eq!(survey.robot.transducer_count(), survey_again.robot.transducer_count());
    }
}

/// Raw odometry does not slide sideways and does not leap; what a SLAM corrected slides.
#[test]
fn a_drive_is_told_from_poses_that_were_corrected() {
    let raw = ["aces-raw", "belgioioso-raw", "freiburg-101-raw"].map(|name| (name, false));
    let corrected = ["acapulco", "freiburg-campus", "infinite-corridor", "seattle"];
    let names = raw.into_iter().map(|(name, slides)| (name.to_owned(), slides));
    for (name, slides) in names.chain(corrected.map(|name| (format!("{name}-corrected"), true))) {
        let Some(path) = data(&format!("carmen/{name}.log.gz")) else { return };
        let (survey, _, events) = read(&path);
        assert_eq!(survey.sideways.is_no_drive(), slides, "{name}: {:?}", survey.sideways);
        let mut leaps = Leaps::default();
        for event in events {
            let LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps } = event else { continue };
            let leap = leaps.next(DrivePose { stamp_ns, odom_from_base, v_mps, w_radps });
            // In the order of stamps the poses of the corrected logs do leap: those of one kind of line have none.
            assert!(leap.is_none() || slides, "{name}: {leap:?}");
        }
    }
}
