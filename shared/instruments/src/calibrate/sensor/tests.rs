//! The command, but for its printing.

use std::path::{Path, PathBuf};

use echogrid_core::MapperConfig;
use echogrid_service::Sensor as _;
use echogrid_simulator::{Simulator, SimulatorConfig, world_of};

use super::report::{Learnt, Report};
use super::*;
use crate::calibrate::CalibrateSensor;
use echogrid_config::{Config, LoadRequest, parse_graph};

fn request(log: &Path) -> CalibrateSensor {
    CalibrateSensor {
        log: log.to_path_buf(),
        robot: None,
        fix: None,
        fix_every: None,
        poses: None,
        seed: 1,
        sets: Vec::new(),
        json: false,
        out: None,
        force: false,
    }
}

fn error(request: &CalibrateSensor) -> String {
    echogrid_service::in_words(&learn(request).unwrap_err())
}

/// A drive in squares.
fn squares(folder: &Path) -> PathBuf {
    super::super::tests::squares(folder, &SimulatorConfig::default())
}

/// A tour of the office, whose walls answer up to so far from their normal.
fn tour(folder: &Path, critical_incidence_deg: f64) -> PathBuf {
    let log = folder.join(format!("{critical_incidence_deg}.log"));
    let world = "office".to_owned();
    let config = SimulatorConfig { critical_incidence_deg, record: log.clone(), world, ..SimulatorConfig::default() };
    let robot = Config::load(&LoadRequest { robot: Some("pioneer3at".into()), ..LoadRequest::default() }).unwrap();
    let robot = robot.into_config().robot.unwrap();
    let mut simulator = Simulator::new(&config, world_of(&config).unwrap(), robot).unwrap();
    while simulator.next().unwrap().is_some() {}
    log
}

fn of<'a>(report: &'a Report, key: &str) -> &'a Learnt {
    report.parameters.iter().find(|learnt| learnt.key == key).unwrap()
}

/// With cells of 10 cm, for the sake of time.
fn coarse(log: &Path) -> CalibrateSensor {
    let sets = vec!["mapper.resolution_m=0.1".to_owned()];
    CalibrateSensor { poses: Some("exact".into()), sets, ..request(log) }
}

#[test]
fn echoes_tell_how_far_from_its_normal_a_wall_answers() {
    let folder = tempfile::tempdir().unwrap();
    for (given_deg, other_deg) in [(15.0, 35.0), (35.0, 15.0)] {
        let log = tour(folder.path(), given_deg);
        let heard = Heard::of(&CalibrateSensor { sets: Vec::new(), ..coarse(&log) }).unwrap();
        let sum = |oriented_incidence_deg: f64| {
            // In the office few echoes are nobody's.
            let others = MapperConfig { oriented_clutter: 0.02, oriented_detection: 0.7, ..heard.mapper.clone() };
            let mapper = MapperConfig { oriented_incidence_deg, ..others };
            heard.likelihoods(&mapper, &heard.robot).unwrap().iter().sum::<f64>()
        };
        // Best is some 6° above what is given (docs/calibration.md).
        let (found, other) = (sum(given_deg + 6.0), sum(other_deg + 6.0));
        assert!(found > other + 20.0, "{given_deg}°: {found} and {other} nat");
    }
}

#[test]
fn the_section_is_loaded_whole_and_replaces_nothing_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("sonars.toml");
    let asked = CalibrateSensor { out: Some(out.clone()), ..coarse(&squares(folder.path())) };
    let report = learn(&asked).unwrap();
    assert!(report.nats_after > report.nats_before, "{report}");
    assert!(report.to_string().contains("sonar echoes on 5"), "{report}");
    // Its ranges are off by 1 %; cells of 10 cm are of no help.
    assert!(of(&report, "range_error_ratio").estimate < 0.04, "{report}");
    let text = std::fs::read_to_string(&out).unwrap();
    let (loaded, incidence) = (parse_graph(&text).unwrap().mapper, of(&report, "oriented_incidence_deg"));
    assert_eq!(loaded.oriented_incidence_deg, incidence.low, "{text}");

    std::fs::write(&out, "mine").unwrap();
    let told = error(&asked);
    assert!(told.contains("sonars.toml: is there already; --force replaces it"), "{told}");
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "mine");
}

#[test]
fn what_tells_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        file
    };
    let line = |k: u32| format!("FLASER 3 1.0 1.1 1.2 {0} 0 0 {0} 0 0 {k} nohost {k}\n", 0.1 * f64::from(k));
    let lidar = file("lidar.log", &(0..400).map(line).collect::<String>());
    let told = error(&request(&lidar));
    assert!(told.contains("its robot has no sonar; what a lidar is like is not learnt"), "{told}");

    let still = |k: u32| format!("ODOM 0 0 0 0 0 0 {k} nohost {k}\nSONAR 1 2.0 0 0 0 0 0 0 0 {k} nohost {k}\n");
    let short = file("short.log", &(0..20).map(still).collect::<String>());
    let told = error(&request(&short));
    assert!(told.contains("expected 200 or more, on 16 m or more") || told.contains("SONAR"), "{told}");

    let log = squares(folder.path());
    let told = error(&CalibrateSensor { sets: vec!["mapper.fusion=paper".into()], ..request(&log) });
    assert!(told.contains("mapper.fusion = paper: expected \"auto\" or \"oriented\""), "{told}");
}
