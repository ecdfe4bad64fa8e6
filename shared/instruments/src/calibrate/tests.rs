//! The command, but for its printing.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use echogrid_core::config::Systematic;
use echogrid_core::{Pose2, wrap_angle};
use echogrid_formats::log::{self, LogEvent};
use echogrid_service::Sensor as _;
use echogrid_simulator::{Motion, Simulator, SimulatorConfig, world_of};

use super::report::Report;
use super::*;
use echogrid_config::{Config, LoadRequest, parse_graph, parse_robot};

fn request(inputs: &[&Path]) -> Calibrate {
    Calibrate { inputs: inputs.iter().map(|path| path.to_path_buf()).collect(), seed: 1, ..Calibrate::default() }
}

fn simulated(seed: u64) -> Calibrate {
    Calibrate { simulate: true, trials: 200, seed, ..Calibrate::default() }
}

fn error(request: &Calibrate) -> String {
    echogrid_service::in_words(&calibrate(request).unwrap_err())
}

fn estimate(report: &Report, key: &str) -> f64 {
    report.coefficients.iter().find(|coefficient| coefficient.key == key).unwrap().estimate
}

/// What lies beside the workspace, if it is there.
fn shared(variable: &str, folder: &str, file: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(folder);
    let file = std::env::var_os(variable).map_or_else(beside, PathBuf::from).join(file);
    file.exists().then_some(file)
}

#[test]
fn the_golden_table() {
    let golden = |file| shared("ECHOGRID_GOLDEN", "golden", file);
    let (Some(trials), Some(expected)) = (golden("calibration_trials.csv"), golden("calibration_expected.csv")) else {
        return;
    };
    let expected = std::fs::read_to_string(expected).unwrap();
    let mut lines = expected.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let mut rows = 0;
    for row in lines {
        let report = calibrate(&Calibrate { series: Some(row[0].to_owned()), ..request(&[&trials]) }).unwrap();
        for (name, value) in names.iter().zip(&row).skip(1) {
            let (found, expected) = (estimate(&report, name), value.parse::<f64>().unwrap());
            assert!((found - expected).abs() <= 1e-9 * expected.abs(), "{name}: {found}, expected {expected}");
        }
        rows += 1;
    }
    assert_eq!(rows, 4);
    // All together, too.
    assert_eq!(calibrate(&request(&[&trials])).unwrap().translations.count, 80);
}

#[test]
fn a_simulated_robot_is_found_to_be_what_it_was_given() {
    let (mut inside, mut all) = (0, 0);
    for seed in 1..=20 {
        for robot in ["pioneer3at", "pioneer3dx"] {
            let report = calibrate(&Calibrate { robot: Some(robot.to_owned()), ..simulated(seed) }).unwrap();
            inside += report.coefficients.iter().filter(|coefficient| coefficient.inside == Some(true)).count();
            all += report.coefficients.len();
        }
    }
    // 95 % of 320, and four standard errors: the two robots have draws in common, so of half as many.
    let share = inside as f64 / all as f64;
    assert!((share - 0.95).abs() < 4.0 * (0.95_f64 * 0.05 / 160.0).sqrt(), "{inside} of {all}");
}

#[test]
fn the_report_says_what_it_found_and_is_the_same_again() {
    let report = calibrate(&simulated(1)).unwrap();
    let text = report.to_string();
    for expected in
        ["pioneer3at, seed 1: 200 translations (", "lin_scale       m/m         0.0", "given", "of 8 intervals hold"]
    {
        assert!(text.contains(expected), "no {expected:?} in:\n{text}");
    }
    assert_eq!(text, calibrate(&simulated(1)).unwrap().to_string());
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!((&json["coefficients"][4]["key"], &json["coefficients"][4]["unit"]), (&"k_ll".into(), &"m²/m".into()));
    assert!(json["coefficients"][4]["inside"].is_boolean() && json["rotations"]["count"] == 200);
}

#[test]
fn the_section_is_loaded_whole_and_replaces_nothing_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let (out, picture) = (folder.path().join("odometry.toml"), folder.path().join("errors.png"));
    let asked = Calibrate { out: Some(out.clone()), picture: Some(picture.clone()), ..simulated(1) };
    let report = calibrate(&asked).unwrap();
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    let text = std::fs::read_to_string(&out).unwrap();
    let loaded = parse_graph(&text).unwrap().odometry;
    assert_eq!((loaded.k_tl, loaded.systematic), (estimate(&report, "k_tl"), Systematic::Correct));
    // As a graph file by its path, and as a part of a robot file.
    let request = LoadRequest { graph: Some(out.clone()), robot: Some("pioneer3at".into()), ..LoadRequest::default() };
    assert_eq!(Config::load(&request).unwrap().config().odometry, loaded);
    let sensor = "[lidar]\nx_m = 0\ny_m = 0\nheading_deg = 0\nbeams = 2\nfirst_bearing_deg = 0\nfield_of_view_deg = 9\n\
        range_min_m = 0.1\nrange_max_m = 9\nrange_error_ratio = 0\n";
    let robot = format!("name = \"mine\"\n{text}\n{sensor}");
    parse_robot(&robot).unwrap();

    std::fs::write(&out, "mine").unwrap();
    let told = error(&asked);
    assert!(told.contains("odometry.toml: is there already; --force replaces it"), "{told}");
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "mine");
    calibrate(&Calibrate { force: true, ..asked }).unwrap();
    assert_eq!(std::fs::read_to_string(&out).unwrap(), text);
}

/// A drive in squares, there and back again, recorded as a CARMEN log with its truth.
pub(super) fn squares(folder: &Path, config: &SimulatorConfig) -> PathBuf {
    let log = folder.join("squares.log");
    let config =
        SimulatorConfig { record: log.clone(), start: vec![1.4, 1.9, 0.0], world: "room".into(), ..config.clone() };
    let side =
        |turn: f64| [Motion::Straight { metres: 0.9 }, Motion::Turn { radians: turn * core::f64::consts::FRAC_PI_2 }];
    let script = (0..60).flat_map(|index| side(if index % 12 < 4 { 1.0 } else { -1.0 }));
    let robot = Config::load(&LoadRequest { robot: Some("pioneer3dx".into()), ..LoadRequest::default() }).unwrap();
    let robot = robot.into_config().robot.unwrap();
    let mut simulator = Simulator::scripted(&config, world_of(&config).unwrap(), robot, script).unwrap();
    while simulator.next().unwrap().is_some() {}
    log
}

/// The true poses of a log, by stamp.
fn truth(file: &Path) -> Vec<(u64, Pose2)> {
    let survey = log::survey(file).unwrap();
    let pose = |event: LogEvent| match event {
        LogEvent::TruePose { stamp_ns, map_from_base } => Some((stamp_ns, map_from_base)),
        _ => None,
    };
    log::open(file, &survey).unwrap().filter_map(|event| pose(event.unwrap())).collect()
}

#[test]
fn a_recorded_drive_by_its_truth_by_a_reference_and_by_landmarks() {
    let folder = tempfile::tempdir().unwrap();
    let config = SimulatorConfig {
        left_scale: 0.05,
        right_scale: 0.05,
        axle_scale: 0.03,
        bumps_per_m: 0.0,
        ..SimulatorConfig::default()
    };
    let given = config.expected_error_model().per_way;
    let log = squares(folder.path(), &config);
    let by_truth = calibrate(&request(&[&log])).unwrap();
    // One piece of every side, two of every quarter turn.
    assert!((55..=62).contains(&by_truth.translations.count), "{}", by_truth.made_of());
    assert!((110..=124).contains(&by_truth.rotations.count), "{}", by_truth.made_of());
    for (key, given) in [
        ("lin_scale", given.lin_scale),
        ("ang_scale", given.ang_scale),
        ("k_ll", given.k_ll),
        ("k_tt", given.k_tt),
        ("k_tl", given.k_tl),
    ] {
        let of = by_truth.coefficients.iter().find(|coefficient| coefficient.key == key).unwrap();
        // Ticks and times between two poses are in the variances of short trials, too.
        let around = of.high - of.low;
        assert!((of.low - around..=of.high + around).contains(&given), "{of:?}, given {given:e}");
    }

    let file = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file
    };
    let marks = [("a", [0.5, 0.2]), ("b", [5.5, 0.4]), ("c", [3.0, 3.8])];
    let (mut path, mut seen, mut surveyed) = (String::new(), String::new(), String::new());
    for (name, [x, y]) in marks {
        let _ = writeln!(surveyed, "[[landmark]]\nname = \"{name}\"\nat = [{x}, {y}]");
    }
    for (stamp_ns, pose) in truth(&log) {
        let t = format!("{}.{:09}", stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
        let _ = writeln!(path, "{t} {} {} {}", pose.x, pose.y, pose.theta);
        for (name, at) in marks {
            let [x, y] = pose.inverse().transform(at);
            let _ = writeln!(seen, "{t} {name} {} {}", x.hypot(y), wrap_angle(y.atan2(x)));
        }
    }
    let (path, seen, surveyed) = (file("path.txt", &path), file("seen.txt", &seen), file("marks.toml", &surveyed));
    let by_reference = Calibrate { reference: Some(path), ..request(&[&log]) };
    let by_landmarks = Calibrate { landmarks: Some(surveyed), sightings: Some(seen), ..request(&[&log]) };
    for asked in [by_reference, by_landmarks] {
        let report = calibrate(&asked).unwrap();
        for key in ["lin_scale", "ang_scale"] {
            let (found, truth) = (estimate(&report, key), estimate(&by_truth, key));
            assert!((found - truth).abs() < 1e-3, "{key}: {found}, by its truth {truth}; {asked:?}");
        }
    }
}

#[test]
fn a_drive_by_another_simulator() {
    let Some(log) = shared("ECHOGRID_DATA", "data", "sonar/columbia-sonar.log.gz") else { return };
    let report = calibrate(&request(&[&log])).unwrap();
    assert!(report.coefficients.iter().all(|of| of.low.is_finite() && of.low <= of.estimate && of.estimate <= of.high));
    assert!(report.translations.count > 40 && report.rotations.count > 8, "{}", report.made_of());
}

#[test]
fn errors_name_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file
    };
    let check = |request: &Calibrate, expected: &[&str]| {
        let told = error(request);
        assert!(expected.iter().all(|expected| told.contains(expected)), "{told}");
    };
    const HEAD: &str = "phase,measured_dl_m,measured_dtheta_rad,true_dl_m,true_dtheta_rad\n";
    let table = |name: &str, rows: &str| file(name, &format!("{HEAD}{rows}"));
    let (straight, turn) = ("translation,1,0,0.9,0\n", "rotation,0,1,0,0.9\n");

    check(&request(&[&file("a.csv", "phase,measured_dl_m\n")]), &["a.csv: line 1: no column measured_dtheta_rad"]);
    check(&request(&[&table("b.csv", &straight.repeat(9))]), &["b.csv", "0 trials of rotation; expected two or more"]);
    check(
        &request(&[&table("c.csv", &[straight.repeat(9), turn.repeat(7)].concat())]),
        &["c.csv", "7 trials of rotation; expected 8 or more"],
    );
    check(&request(&[&table("d.csv", "rotation,0,NaN,0,1\n")]), &["d.csv: line 2: measured_dtheta_rad is \"NaN\""]);
    let still = table("e.csv", &[straight.repeat(9), "rotation,0,0,0,1\n".repeat(9)].concat());
    check(&request(&[&still]), &["e.csv", "no trial of rotation measured any rotation"]);
    let reversed = table("f.csv", &["translation,1,0,-1,0\n".repeat(9), turn.repeat(9)].concat());
    check(&request(&[&reversed]), &["f.csv", "lin_scale = 2: expected a number between -1 and 1"]);
    check(&request(&[&folder.path().join("g.csv")]), &["g.csv: no such file; did you mean"]);
    check(
        &Calibrate { series: Some("x".into()), ..request(&[&still]) },
        &["e.csv: no series \"x\"", "no column series"],
    );
    check(&request(&[&still, &folder.path().join("drive.log")]), &["tables and logs together"]);
    check(
        &Calibrate { reference: Some("path.txt".into()), ..request(&[&still]) },
        &["--reference and --landmarks are for logs"],
    );
    check(&Calibrate { robot: Some("laser".into()), ..request(&[&still]) }, &["--robot and --set are for logs"]);

    let lines = "ODOM 0 0 0 0 0 0 0.1 host 0.1\nFLASER 3 1 2 1 0 0 0 0 0 0 0.1 host 0.1\n\
        ODOM 0.1 0 0 0 0 0 0.2 host 0.2\nFLASER 3 1 2 1 0.1 0 0 0.1 0 0 0.2 host 0.2\n";
    let log = file("drive.log", lines);
    check(
        &request(&[&log]),
        &["drive.log: no true pose in it; expected a log with TRUEPOS lines, or --reference FILE"],
    );
    let elsewhere = file("path.txt", "90 0 0 0\n91 1 0 0\n");
    check(
        &Calibrate { reference: Some(elsewhere), ..request(&[&log]) },
        &["drive.log: where the robot was is known at none of its 2 odometry poses"],
    );
    let near = file("near.txt", "0.1 0 0 0\n0.2 0.1 0 0\n");
    check(
        &Calibrate { reference: Some(near), ..request(&[&log]) },
        &[
            "drive.log: 0 translations (of 0.3 m or more, with less than 0.1 rad turned) and 0 rotations",
            "expected 8 or more",
        ],
    );
    check(&Calibrate { series: Some("1".into()), ..request(&[&log]) }, &["--series is for tables"]);
    let unknown = Calibrate { sets: vec!["localizer.nothing=1".into()], ..request(&[&log]) };
    check(&unknown, &["localizer.nothing"]);
}
