//! A log in, a map out; the same log, the same map.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use echogrid::config::{Config, LoadRequest};
use echogrid_core::{CellIndex, Pose2};
use echogrid_formats::log;
use echogrid_formats::map::native;

use crate::support::{Drive, ECHOGRID, data, echogrid, native_map_of, path, said, summary};

#[test]
fn a_drive_becomes_a_map_and_every_reading_is_accounted_for() {
    let drive = Drive::new(12.0);
    let surveyed = log::survey(&drive.log()).unwrap();
    let summary = summary(&drive.map("maps", &["--json", "--quiet"]));
    assert_eq!(summary["scans"], surveyed.scan_count);
    assert_eq!(summary["odometry"], surveyed.odometry_count);
    assert_eq!(summary["readings"], surveyed.reading_count);
    assert_eq!(summary["lost_messages"], 0);
    assert_eq!(summary["faulty_messages"], 0);
    let refused: u64 = summary["refused"].as_array().unwrap().iter().map(|r| r["readings"].as_u64().unwrap()).sum();
    assert_eq!(summary["accepted"].as_u64().unwrap() + refused, surveyed.reading_count);
    for file in ["map.png", "map.pgm", "map.yaml", "map.npy", "map.echogrid"] {
        assert!(drive.out("maps").join(file).exists(), "{file}");
    }
}

#[test]
fn only_the_chosen_files_are_written_and_listed() {
    let drive = Drive::new(3.0);
    let summary = summary(&drive.map("maps", &["--json", "--quiet", "--set", "publisher.formats=[\"npy\"]"]));
    let listed = summary["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap().into()).collect();
    let files = |folder: &str| -> BTreeSet<PathBuf> {
        std::fs::read_dir(drive.out(folder)).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    assert_eq!(files("maps"), ["map.npy", "map.yaml"].map(|name| drive.out("maps").join(name)).into());
    assert_eq!(files("maps"), listed);
}

#[test]
fn the_map_shows_the_corridor_in_the_coordinates_of_the_log() {
    let drive = Drive::new(20.0);
    drive.native_map("maps", &[]);
    let map = native::read(&drive.out("maps/map.echogrid")).unwrap();
    let p = |x: f64, y: f64| {
        let cell = map.grid.cell_at(x, y);
        map.grid.log_odds(cell).map(|l| echogrid_core::log_odds::probability_of(f64::from(l)))
    };
    // The corridor runs from y = 5 to y = 7; the drive starts at (1, 6).
    assert_eq!(map.path.first().unwrap().pose, Pose2::new(1.0, 6.0, 0.0));
    assert!(p(1.5, 5.5).unwrap() < 0.2, "{:?}", p(1.5, 5.5));
    // Its walls, within a cell, away from the doors.
    let wall = |x: f64, y: f64| (-1..=1).filter_map(|row| p(x, y + 0.05 * f64::from(row))).fold(0.0, f64::max);
    let walls: Vec<f64> = (0..20).flat_map(|i| [4.0, 6.0].map(|x| wall(x + 0.05 * f64::from(i), 5.0))).collect();
    let found = walls.iter().filter(|p| **p > 0.5).count();
    assert!(found > 32, "{found} of 40 places on the wall: {walls:.2?}");
    // Nothing was seen behind the wall at the end of the building: not "free", not "even odds".
    assert_eq!(map.grid.log_odds(CellIndex { i: -40, j: 120 }), None);
    assert!(map.provenance.log_sha256.is_some() && map.provenance.config_toml.contains("resolution_m"));
}

#[test]
fn the_same_log_gives_the_same_bytes_at_any_rate_on_any_number_of_processors() {
    let drive = Drive::new(8.0);
    let reference = drive.native_map("reference", &["--rate", "max"]);
    for (name, rate) in [("a", "max"), ("b", "40"), ("c", "300"), ("d", "max")] {
        assert!(drive.native_map(name, &["--rate", rate]) == reference, "--rate {rate}");
    }
    let one_processor =
        Command::new("taskset").args(["-c", "0", ECHOGRID]).args(drive.map_arguments("e", &[])).output();
    match one_processor {
        Ok(output) => {
            assert!(output.status.success(), "{}", said(&output));
            assert!(std::fs::read(drive.out("e/map.echogrid")).unwrap() == reference, "one processor");
        }
        Err(error) => eprintln!("skipped: taskset: {error}"),
    }
}

#[test]
fn the_same_steps_in_one_process_give_the_same_bytes() {
    let drive = Drive::new(8.0);
    let reference = drive.native_map("processes", &[]);
    assert!(in_one_process(&drive.log(), &drive.out("local"), &[]) == reference);
    // The odometry waits for the localizer, in any schedule.
    let fixed = drive.native_map("fixed", &["--fix", "truth", "--fix-every", "2m"]);
    let sets = ["localizer.source=truth", "localization.ask=schedule", "localization.every_m=2"];
    assert!(in_one_process(&drive.log(), &drive.out("fixed-local"), &sets) == fixed);
    assert!(fixed != reference);
}

/// Maps a log by calling the `step` of each service.
pub(crate) fn in_one_process(log: &std::path::Path, out: &std::path::Path, sets: &[&str]) -> Vec<u8> {
    let log_name = Some(path(log));
    let request =
        LoadRequest { log: log_name, sets: sets.iter().map(|set| (*set).into()).collect(), ..Default::default() };
    let config = Config::load(&request).unwrap().into_config();
    let provenance = config.provenance(Some(&log::survey(log).unwrap())).unwrap();
    native_map_of(&config, provenance, out)
}

#[test]
fn odometry_error_fades_the_map_and_can_be_turned_off() {
    let drive = Drive::new(30.0);
    let decided = |name: &str, sets: &[&str]| {
        let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
        let summary = summary(&drive.map(name, &[&["--json", "--quiet"][..], &sets].concat()));
        let cells = |key: &str| summary["cells"][key].as_f64().unwrap();
        (cells("occupied") + cells("free"), summary["trust"].as_f64().unwrap())
    };
    let none = ["odometry.k_ll=0", "odometry.k_lt=0", "odometry.k_tt=0", "odometry.k_tl=0"];
    let (decided_without, trust_without) = decided("off", &[&none[..], &["odometry.systematic=off"]].concat());
    let (decided_with, trust_with) = decided("carry", &["odometry.systematic=carry", "odometry.seed=3"]);
    assert!((trust_without - 1.0).abs() < 1e-12, "{trust_without}");
    assert!(trust_with < 0.05, "{trust_with}");
    assert!(decided_with < 0.6 * decided_without, "{decided_with} of {decided_without} cells decided");
}

#[test]
fn graphs_run_side_by_side() {
    let drive = Drive::new(6.0);
    let outputs: Vec<_> = std::thread::scope(|scope| {
        let runs: Vec<_> = (0..3)
            .map(|n| {
                scope.spawn({
                    let drive = &drive;
                    move || drive.native_map(&format!("side{n}"), &[])
                })
            })
            .collect();
        runs.into_iter().map(|run| run.join().unwrap()).collect()
    });
    assert!(outputs.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn a_graph_file_runs_like_the_command() {
    let drive = Drive::new(6.0);
    let reference = drive.native_map("command", &[]);
    let graph = drive.out("graph.toml");
    std::fs::write(&graph, "[run]\nout = \"from-graph\"\n\n[replay]\nlog = \"drive.log\"\n").unwrap();
    let output = echogrid(["up", graph.to_str().unwrap(), "--sensor", "replay"]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(std::fs::read(drive.out("from-graph/map.echogrid")).unwrap() == reference);
}

#[test]
fn a_map_converts_to_what_other_programs_read() {
    let drive = Drive::new(3.0);
    drive.native_map("maps", &[]);
    let native = drive.out("maps/map.echogrid");
    for ending in ["png", "npy", "yaml"] {
        let output = echogrid(
            [native.as_os_str(), drive.out(&format!("converted.{ending}")).as_os_str()]
                .map(ToOwned::to_owned)
                .into_iter()
                .fold(vec!["convert".into()], |mut all: Vec<std::ffi::OsString>, one| {
                    all.push(one);
                    all
                }),
        );
        assert!(output.status.success(), "{}", said(&output));
    }
    assert_eq!(std::fs::read(drive.out("converted.npy")).unwrap(), std::fs::read(drive.out("maps/map.npy")).unwrap());
    assert_eq!(std::fs::read(drive.out("converted.png")).unwrap(), std::fs::read(drive.out("maps/map.png")).unwrap());
}

#[test]
fn a_real_sonar_log_maps_the_same_in_one_process_and_loses_nothing() {
    let Some(log) = data("sonar/columbia-sonar.log.gz") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("maps");
    let summary = summary(&echogrid(["map", log.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json", "-q"]));
    assert_eq!(
        (&summary["scans"], &summary["odometry"], &summary["readings"]),
        (&1737.into(), &6948.into(), &(1737 * 16).into())
    );
    assert_eq!(summary["lost_messages"], 0);
    let reference = std::fs::read(out.join("map.echogrid")).unwrap();
    assert!(in_one_process(&log, &folder.path().join("local"), &[]) == reference);
}
