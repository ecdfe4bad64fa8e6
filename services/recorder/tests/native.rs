//! What is recorded is what is read: the wire's bytes mean the same to the recorder, which knows topics, and to the reader of
//! recordings, which does not.

#![allow(clippy::unwrap_used, clippy::panic)] // a test that can not go on has failed

use std::path::Path;

use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Echo, Footprint, Pose2, Reading, Robot, Sensor, SensorKind};
use echogrid_formats::log::{self, LogEvent};
use echogrid_recorder::config::RecorderConfig;
use echogrid_recorder::{DECLARATION, INPUTS, RecorderService};
use echogrid_service::{Input, Outbox, Service};
use echogrid_topics::{Message, RawOdometry, Topic, TruePose};

fn robot() -> Robot {
    let lidar = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::new(0.2, -0.1, 0.3),
        first_transducer: 1,
        transducers: 3,
        first_bearing_rad: -0.5,
        bearing_step_rad: 0.5,
        aperture_rad: 0.01,
        range_min_m: 0.02,
        range_max_m: 8.0,
        range_error_ratio: 0.01,
    };
    let sonar =
        Sensor { kind: SensorKind::Sonar, first_transducer: 0, transducers: 1, aperture_rad: 0.5, ..lidar.clone() };
    Robot { name: "Käfer".into(), footprint: Footprint { length_m: 0.5, width_m: 0.4 }, sensors: vec![sonar, lidar] }
}

/// A message of each kind, and what it is in a log.
fn drive() -> Vec<(u64, Message, Option<LogEvent>)> {
    let mut drive = vec![(0, Message::Robot(robot()), None)];
    for step in 0..40_u64 {
        let (stamp_ns, along) = (step * 100_000_000, step as f64 * 0.1);
        let [odom_from_base, map_from_base] = [0.0, 1e-3].map(|off| Pose2::new(along + off, -off, 0.1 * along));
        // Known half of the time.
        let known = (step % 2 == 0).then_some(map_from_base);
        let event = known.map(|map_from_base| LogEvent::TruePose { stamp_ns, map_from_base });
        drive.push((stamp_ns, Message::TruePose(TruePose { map_from_base: known }), event));
        let (v_mps, w_radps) = (1.0, -0.25);
        let event = LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps };
        drive.push((stamp_ns, Message::Odometry(RawOdometry { odom_from_base, v_mps, w_radps }), Some(event)));
        let readings = vec![
            Reading { transducer: 0, echo: Echo::Hit { range_m: 1.0 + along }, offset_ns: -5 },
            Reading { transducer: 2, echo: Echo::NoEcho, offset_ns: 0 },
            Reading { transducer: 3, echo: Echo::Invalid, offset_ns: 9 },
        ];
        let event = LogEvent::Scan { stamp_ns, readings: readings.clone() };
        drive.push((stamp_ns, Message::Scan(readings), Some(event)));
    }
    drive
}

fn service(file: &Path) -> RecorderService {
    RecorderService::new(file.into(), RecorderConfig::default())
}

/// Streams come as they come: the scans are there before the poses of the same time.
fn as_it_came(mut drive: Vec<(u64, Message, Option<LogEvent>)>) -> Vec<(u64, Message, Option<LogEvent>)> {
    drive.sort_by_key(|(.., event)| matches!(event, Some(LogEvent::Odometry { .. } | LogEvent::TruePose { .. })));
    drive.sort_by_key(|(_, message, _)| !matches!(message, Message::Robot(_)));
    drive
}

fn step(service: &mut RecorderService, input: Input) {
    service.step(input, &mut Outbox::default()).unwrap();
}

fn record(service: &mut RecorderService, messages: &[(u64, Message, Option<LogEvent>)]) {
    for (stamp_ns, message, _) in messages {
        step(service, Input::Message { sequence: 1, stamp_ns: *stamp_ns, message: message.clone() });
    }
}

fn saved(service: &mut RecorderService) -> Saved {
    let mut parts = Parts::default();
    service.save(&mut parts);
    let changes = parts.into_changes().into_iter();
    Saved::from_parts(changes.filter_map(|(name, bytes)| Some((name, bytes?))).collect())
}

fn assert_holds(file: &Path, drive: &[(u64, Message, Option<LogEvent>)]) {
    let survey = log::survey(file).unwrap();
    assert_eq!(survey.robot, robot());
    let events: Vec<LogEvent> = log::open(file, &survey).unwrap().map(Result::unwrap).collect();
    let expected: Vec<LogEvent> = drive.iter().filter_map(|(.., event)| event.clone()).collect();
    assert_eq!(events, expected);
    assert_eq!(survey.faults.len(), 0, "{:?}", survey.faults);
    assert_eq!((survey.odometry_count, survey.scan_count, survey.true_pose_count), (40, 40, 20));
}

#[test]
fn what_is_recorded_is_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let (drive, mut service) = (drive(), service(&file));
    record(&mut service, &as_it_came(drive.clone()));
    step(&mut service, Input::Finish);
    assert_holds(&file, &drive);
}

#[test]
fn who_takes_the_place_of_one_that_was_killed_loses_nothing_and_repeats_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let drive = drive();
    // At once, before anything was recorded.
    let mut killed = service(&file);
    let mut state = saved(&mut killed);
    for at in [0, 31, 70] {
        let mut service = service(&file);
        service.restore(&state).unwrap();
        let from = [0, 31, 70].into_iter().take_while(|place| *place < at).last().unwrap_or(0);
        record(&mut service, &drive[from..at]);
        state = saved(&mut service);
        // What was not stored comes again.
        record(&mut service, &drive[at..at + 9]);
        drop(saved(&mut service));
    }
    let mut last = service(&file);
    last.restore(&state).unwrap();
    record(&mut last, &drive[70..]);
    step(&mut last, Input::Finish);
    assert_holds(&file, &drive);
}

#[test]
fn where_nothing_can_be_written_the_graph_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let taken = folder.path().join("run.mcap");
    let before = vec![7; 1000];
    std::fs::write(&taken, &before).unwrap();
    let mut service = service(&taken);
    record(&mut service, &drive());
    let state = saved(&mut service);
    step(&mut service, Input::Finish);
    assert_eq!(std::fs::read(&taken).unwrap(), before, "a recording is never replaced");
    // Nor does the next life try again.
    let mut next = self::service(&taken);
    next.restore(&state).unwrap();
    std::fs::remove_file(&taken).unwrap();
    record(&mut next, &drive());
    step(&mut next, Input::Finish);
    assert!(!taken.exists());
}

#[test]
fn it_takes_what_it_declares() {
    let declared: Vec<Topic> = DECLARATION.reads.iter().chain(DECLARATION.looks_on).copied().collect();
    assert_eq!(declared, INPUTS);
    assert_eq!(Topic::ALL.len(), INPUTS.len(), "every topic is recorded");
}
