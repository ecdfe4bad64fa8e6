//! What a newcomer sees first.

use std::process::Command;

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;

use crate::support::{ECHOGRID, echogrid, path, said};

/// The score in what the demo printed as JSON: the last of two documents.
fn bits(stdout: &[u8]) -> f64 {
    let summary: serde_json::Value = serde_json::from_slice(stdout).unwrap();
    assert_eq!((&summary["lost_messages"], &summary["faulty_messages"]), (&0.into(), &0.into()));
    assert!(summary["fixes"].as_u64().unwrap() > 10, "{summary}");
    summary["score"]["bits"].as_f64().unwrap()
}

#[test]
fn without_a_word_a_floor_is_mapped_and_the_map_scored() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(ECHOGRID).current_dir(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let text = String::from_utf8_lossy(&output.stdout);
    for told in ["simulator in office: ", "localized ", "maps/map.png", "map.echogrid in office, along the true path"] {
        assert!(text.contains(told), "{}", said(&output));
    }
    for file in ["map.png", "map.echogrid", "drive.log.gz", "score.png"] {
        assert!(folder.path().join("maps").join(file).exists(), "{file}");
    }
    // All six rooms and the corridor.
    let map = echogrid_formats::map::native::read(&folder.path().join("maps/map.echogrid")).unwrap();
    for [x, y] in [[3.0, 2.5], [10.0, 2.5], [18.0, 2.5], [2.5, 9.0], [11.5, 9.5], [18.5, 8.2], [10.0, 6.0]] {
        let cell = map.grid.cell_at(x, y);
        let free = map.grid.log_odds(cell).is_some_and(|log_odds| log_odds < -0.62);
        assert!(free, "({x}, {y})");
    }
}

#[test]
fn other_drives_make_maps_as_good() {
    let folder = tempfile::tempdir().unwrap();
    for seed in ["2", "3"] {
        let out = path(&folder.path().join(seed));
        let output = echogrid(["demo", "--seed", seed, "--out", &out, "--json", "-q"]);
        assert!(output.status.success(), "{}", said(&output));
        assert!(bits(&output.stdout) < 1.0, "{}", said(&output));
    }
}

#[test]
fn a_demo_that_is_stopped_keeps_and_scores_the_map_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(folder.path());
    let mut graph = GraphProcess::start(ECHOGRID, ["demo", "--rate", "20", "--out", &out]);
    graph.wait_for("messages");
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert!(ended.stdout.contains("stopped before its end") && ended.stdout.contains("bits "), "{}", ended.stdout);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn with_slam_the_demo_drives_a_lidar_that_asks_nobody_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(folder.path());
    let output = echogrid(["demo", "--slam", "--set", "simulator.duration_s=40", "--out", &out, "--json", "-q"]);
    assert!(output.status.success(), "{}", said(&output));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["fixes"] == 0 && told["slam"].is_object(), "{told}");
    let error = &told["score"]["path_error"];
    assert!(error["absolute_mean_m"].as_f64().is_some_and(|mean_m| mean_m < 0.05), "{error}");
}
