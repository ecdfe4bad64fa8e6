//! What comes out: the promises of every sensor, the same each time.

use echogrid_core::{Echo, Robot};
use echogrid_formats::log::{self, LogEvent};
use echogrid_service::{Sensor as _, conformance};
use echogrid_simulator::{Cause, Route, Simulator, SimulatorConfig, Waypoint};
use echogrid_topics::Message;

use crate::support::{laser, named, pioneer, pioneer_config, standing};

/// A drive of a minute at most.
fn minute(world: &str, robot: &Robot) -> SimulatorConfig {
    let order = if robot.sensors.len() > 1 { pioneer_config(world).firing_order } else { Vec::new() };
    SimulatorConfig { duration_s: 60.0, firing_order: order, ..pioneer_config(world) }
}

#[test]
fn it_keeps_the_promises_of_a_sensor() {
    for (world, robot) in [("office", pioneer()), ("room", pioneer()), ("office", laser()), ("room", laser())] {
        let config = minute(world, &robot);
        let given = conformance::check(|| Ok(Simulator::new(&config, named(world), robot.clone())?)).unwrap();
        assert!(given.odometry >= 300 && given.scans >= 90 && given.hits > 500, "{world}, {}: {given:?}", robot.name);
    }
}

#[test]
fn a_whole_drive_ends_by_itself_with_odometry() {
    let config = SimulatorConfig { route: Route::Places(vec![Waypoint::Point([2.0, 1.0])]), ..pioneer_config("room") };
    let mut simulator = Simulator::new(&config, named("room"), pioneer()).unwrap();
    let mut last = None;
    let mut last_scan_ns = 0;
    while let Some((stamp_ns, message)) = simulator.next().unwrap() {
        if matches!(message, Message::Scan(_)) {
            last_scan_ns = stamp_ns;
        }
        last = Some((stamp_ns, matches!(message, Message::Odometry(_))));
    }
    let (last_ns, is_odometry) = last.unwrap();
    assert!(is_odometry && last_ns > last_scan_ns && last_ns - last_scan_ns <= 400_000_000);
    assert!(simulator.true_pose().distance_m(echogrid_core::Pose2::new(2.0, 1.0, 0.0)) < 0.05);
}

#[test]
fn another_seed_is_another_drive() {
    let messages = |seed| {
        let config = SimulatorConfig { seed, duration_s: 5.0, ..pioneer_config("room") };
        let mut simulator = Simulator::new(&config, named("room"), pioneer()).unwrap();
        let mut text = String::new();
        while let Some(message) = simulator.next().unwrap() {
            text += &format!("{message:?}");
        }
        text
    };
    assert_ne!(messages(1), messages(2));
}

#[test]
fn sonars_fire_in_turn() {
    let mut simulator = Simulator::new(&pioneer_config("office"), named("office"), pioneer()).unwrap();
    let mut scans = 0;
    while let Some((stamp_ns, message)) = simulator.next().unwrap() {
        let Message::Scan(readings) = message else { continue };
        // Eight slots of 40 ms, the last one at the stamp.
        assert_eq!(stamp_ns, 280_000_000 + scans * 320_000_000);
        assert_eq!(readings.len(), 16);
        for reading in &readings {
            assert_eq!(reading.offset_ns, -40_000_000 * (7 - i32::from(reading.transducer % 8)), "{reading:?}");
        }
        assert!(readings.iter().zip(simulator.last_causes()).all(|(reading, heard)| reading.echo == heard.echo));
        scans += 1;
        if scans == 20 {
            break;
        }
    }
    assert_eq!(scans, 20);
}

#[test]
fn a_lidar_sees_walls_whatever_the_angle_and_loses_a_few_beams() {
    let config = SimulatorConfig { lidar_dropout_ratio: 0.1, ..SimulatorConfig::default() };
    let world = named("office");
    let scans = standing(&config, world.clone(), laser(), [3.0, 2.0, 30.0], 8.0);
    let (mut seen, mut lost) = (0.0_f64, 0.0_f64);
    for heard in scans.iter().flatten() {
        match heard.echo {
            Echo::Hit { range_m } => {
                // Six standard deviations.
                let ahead_m = heard.ahead_m.unwrap();
                assert!((range_m / ahead_m - 1.0).abs() < 6.0 * 0.005, "{heard:?}");
                assert_eq!(heard.cause, Cause::Direct);
                seen += 1.0;
            }
            _ => lost += 1.0,
        }
    }
    let share = lost / (seen + lost);
    assert!((share - 0.1).abs() < 5.0 * (0.09_f64 / (seen + lost)).sqrt(), "{share}");
}

#[test]
fn a_recorded_drive_replays_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log.gz");
    let config = SimulatorConfig { record: path.clone(), duration_s: 20.0, ..pioneer_config("office") };
    let mut simulator = Simulator::new(&config, named("office"), pioneer()).unwrap();
    let (mut odometry, mut scans, mut truth) = (Vec::new(), Vec::new(), Vec::new());
    while let Some((stamp_ns, message)) = simulator.next().unwrap() {
        match message {
            Message::Odometry(message) => {
                odometry.push((stamp_ns, message.odom_from_base));
                truth.push((stamp_ns, simulator.true_pose()));
            }
            Message::Scan(readings) => scans.push((stamp_ns, readings)),
            _ => {}
        }
    }
    let survey = log::survey(&path).unwrap();
    assert!(survey.faults.is_empty() && survey.skipped.is_empty(), "{survey:?}");
    assert_eq!(survey.robot.sensors, pioneer().sensors);
    let (mut odometry_read, mut scans_read, mut truth_read) = (Vec::new(), Vec::new(), Vec::new());
    for event in log::open(&path, &survey).unwrap() {
        match event.unwrap() {
            LogEvent::Odometry { stamp_ns, odom_from_base, .. } => odometry_read.push((stamp_ns, odom_from_base)),
            LogEvent::Scan { stamp_ns, readings } => scans_read.push((stamp_ns, readings)),
            LogEvent::TruePose { stamp_ns, map_from_base } => truth_read.push((stamp_ns, map_from_base)),
        }
    }
    assert!(scans.len() > 50);
    assert_eq!(odometry_read, odometry);
    assert_eq!(scans_read, scans);
    assert_eq!(truth_read, truth);
}

#[test]
fn a_drive_that_is_given_up_leaves_its_record_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log");
    let config = SimulatorConfig { record: path.clone(), ..pioneer_config("room") };
    let mut simulator = Simulator::new(&config, named("room"), pioneer()).unwrap();
    // Two messages of each moment: the truth and the odometry.
    for _ in 0..200 {
        simulator.next().unwrap();
    }
    assert!(!path.exists());
    drop(simulator);
    assert!(log::survey(&path).unwrap().odometry_count > 50);
}

/// Recorded: a drive that is simulated today must be the same with tomorrow's version, and on any machine.
#[test]
fn the_first_ten_seconds_are_those_that_were_recorded() {
    let config = SimulatorConfig { duration_s: 10.0, ..pioneer_config("office") };
    let mut simulator = Simulator::new(&config, named("office"), pioneer()).unwrap();
    // FNV-1a over what is said, every number as exact as it is.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    while let Some(message) = simulator.next().unwrap() {
        for byte in format!("{message:?}").bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
    assert_eq!(hash, RECORDED, "{hash:#018x}");
}

const RECORDED: u64 = 0x7a23_4300_b6ed_fb17;
