//! Sensors of others: a good one gives a map, a bad one a clear error and the map so far.

use std::path::PathBuf;

use echogrid_core::log_odds::probability_of;
use echogrid_formats::map::native;
use echogrid_harness::{Ended, GraphProcess, example};
use serde_json::Value;
use tempfile::TempDir;

use crate::support::{ECHOGRID, path};

/// Exact odometry, as the walk has it.
const NO_ERROR: [&str; 5] = ["systematic=\"off\"", "k_ll=0", "k_lt=0", "k_tt=0", "k_tl=0"];

/// A graph with a sensor of the examples in it.
struct Walk {
    folder: TempDir,
}

impl Walk {
    /// The random walk as it is, the way the README shows.
    fn good() -> (Self, GraphProcess) {
        let walk = Self { folder: tempfile::tempdir().unwrap() };
        let graph = concat!(env!("CARGO_MANIFEST_DIR"), "/launch/graphs/map.toml");
        let sensor = path(&example("random_walk"));
        let graph = walk.start(&["up", graph, "--sensor", &sensor]);
        (walk, graph)
    }

    /// The random walk with a fault after so many messages.
    fn with(fault: &str, after: u64, more: &[&str]) -> (Self, GraphProcess) {
        let walk = Self { folder: tempfile::tempdir().unwrap() };
        let file = walk.folder.path().join("graph.toml");
        let text = format!(
            "[services.sensor]\nkind = \"sensor\"\nexec = {:?}\nenv = {{ FAULT = {fault:?}, FAULT_AFTER = \"{after}\" }}\n",
            example("faulty_sensor")
        );
        std::fs::write(&file, text).unwrap();
        let graph = walk.start(&[&["up", &path(&file)], more].concat());
        (walk, graph)
    }

    fn start(&self, arguments: &[&str]) -> GraphProcess {
        let out = path(&self.folder.path().join("maps"));
        let sets = NO_ERROR.map(|set| format!("odometry.{set}"));
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let arguments: Vec<&str> = arguments.iter().copied().chain(["--json", "--out", &out]).chain(sets).collect();
        GraphProcess::start(ECHOGRID, arguments)
    }

    fn map_file(&self) -> PathBuf {
        self.folder.path().join("maps/map.echogrid")
    }

    fn map_bytes(&self) -> Vec<u8> {
        std::fs::read(self.map_file()).unwrap()
    }
}

/// A run to its good end: its map, and the summary.
fn succeeded((walk, graph): (Walk, GraphProcess)) -> (Vec<u8>, Value) {
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
    (walk.map_bytes(), serde_json::from_str(&ended.stdout).unwrap())
}

/// A run that has failed with this error.
fn failed(graph: GraphProcess, error: &str) -> Ended {
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains(error), "no {error:?} in:\n{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
    ended
}

#[test]
fn a_sensor_of_ones_own_makes_a_map() {
    let (walk, graph) = Walk::good();
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    let map = native::read(&walk.map_file()).unwrap();
    // The drive took as long as its stamps say, however fast it was mapped.
    let stamps = [&map.path[0], map.path.last().unwrap()].map(|point| point.stamp_ns as f64 * 1e-9);
    let told = ended.summary()["recorded_s"].as_f64().unwrap();
    assert!((told - (stamps[1] - stamps[0])).abs() < 0.3, "{told} {stamps:?}");
    let p = |x: f64, y: f64| map.grid.log_odds(map.grid.cell_at(x, y)).map(|l| probability_of(f64::from(l)));
    // Free as far as the walls, nothing at all behind them.
    let along = (0..=40).map(|i| 1.0 + 0.1 * f64::from(i));
    for at in along.clone() {
        assert!(p(at, 3.0).unwrap() < 0.2 && p(3.0, at).unwrap() < 0.2, "({at}, 3) or (3, {at})");
        for (x, y) in [(at, -0.3), (at, 6.3), (-0.3, at), (6.3, at)] {
            assert!(p(x, y).is_none_or(|p| p <= 0.5), "({x}, {y}): {:?}", p(x, y));
        }
    }
    // The walls, within a cell.
    let near = |x: f64, y: f64, dx: f64, dy: f64| {
        (-1..=1).filter_map(|k| p(x + dx * 0.05 * f64::from(k), y + dy * 0.05 * f64::from(k))).fold(0.0, f64::max)
    };
    let walls: Vec<f64> = along
        .flat_map(|at| {
            [near(at, 0.0, 0.0, 1.0), near(at, 6.0, 0.0, 1.0), near(0.0, at, 1.0, 0.0), near(6.0, at, 1.0, 0.0)]
        })
        .collect();
    let found = walls.iter().filter(|p| **p > 0.65).count();
    assert!(found > walls.len() * 9 / 10, "{found} of {} places on the walls: {walls:.2?}", walls.len());
}

#[test]
fn poses_that_are_none_are_counted_and_reach_no_map() {
    let (reference, summary) = succeeded(Walk::good());
    assert_eq!(summary["faulty_messages"], 0);
    let (map, summary) = succeeded(Walk::with("nan", 0, &[]));
    // 4001 messages and the faulty ones, of which every hundredth is one.
    assert_eq!(summary["faulty_messages"], 40, "{summary}");
    assert_eq!(summary["lost_messages"], 0);
    assert!(map == reference, "the map differs");
}

#[test]
fn readings_that_cannot_be_are_refused_and_their_neighbours_are_not() {
    let (reference, good) = succeeded(Walk::good());
    let (map, bad) = succeeded(Walk::with("absurd", 0, &[]));
    let invalid = |summary: &Value| {
        let refused = summary["refused"].as_array().unwrap();
        refused.iter().find(|refused| refused["reason"] == "invalid").map_or(0, |r| r["readings"].as_u64().unwrap())
    };
    assert_eq!((invalid(&good), invalid(&bad)), (0, 2 * 2000));
    assert_eq!(bad["accepted"], good["accepted"]);
    assert_eq!(bad["readings"], 10 * 2000);
    assert!(map == reference, "the map differs");
}

#[test]
fn a_sensor_that_crashes_is_named_and_what_it_gave_is_in_the_map() {
    let (walk, graph) = Walk::with("crash", 2001, &[]);
    let ended = failed(graph, "sensor: killed by signal 6 (SIGABRT)");
    assert!(ended.stderr.contains("is the map so far"), "{}", ended.stderr);
    // Not a part of it: everything it gave.
    let map = native::read(&walk.map_file()).unwrap();
    assert_eq!(map.path.last().unwrap().stamp_ns, 1000 * 100_000_000);
}

#[test]
fn a_sensor_that_hangs_is_killed_and_what_it_gave_is_in_the_map() {
    let (walk, graph) = Walk::with("hang", 2001, &["--set", "run.alive_within_s=2"]);
    failed(graph, "sensor: no sign of life for 2 s: it hangs");
    let map = native::read(&walk.map_file()).unwrap();
    assert_eq!(map.path.last().unwrap().stamp_ns, 1000 * 100_000_000);
}

#[test]
fn a_sensor_that_leaves_without_a_word_is_an_error_and_what_it_gave_is_in_the_map() {
    let (walk, graph) = Walk::with("leave", 2001, &[]);
    failed(graph, "sensor: left without saying that its streams end");
    let map = native::read(&walk.map_file()).unwrap();
    assert_eq!(map.path.last().unwrap().stamp_ns, 1000 * 100_000_000);
}

#[test]
fn a_sensor_that_ends_only_one_of_its_streams_is_an_error() {
    let (_walk, graph) = Walk::with("mute", 0, &[]);
    failed(graph, "sensor: left without saying that its streams end");
}

#[test]
fn a_sensor_that_never_describes_its_robot_is_an_error() {
    let (_walk, graph) = Walk::with("undescribed", 0, &[]);
    failed(graph, "the sensor has sent messages but no robot/description for 5 s");
}

#[test]
fn a_sensor_that_will_not_leave_is_killed_and_the_map_is_saved_first() {
    let (walk, mut graph) = Walk::with("deaf", 0, &["--rate", "5"]);
    graph.wait_for("messages");
    graph.signal(nix::sys::signal::Signal::SIGINT);
    graph.wait_for("SIGTERM was heard and ignored");
    failed(graph, "would not leave and was killed: sensor");
    assert!(!native::read(&walk.map_file()).unwrap().path.is_empty());
}
