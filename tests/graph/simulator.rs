//! The simulator in place of a log: nothing else changes.

use std::time::{Duration, Instant};

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use echogrid_replay::{Replay, config::ReplayConfig};
use echogrid_service::conformance;
use nix::sys::signal::Signal;
use tempfile::TempDir;

use crate::support::{Drive, ECHOGRID, echogrid, native_map_of, path, said, summary};

/// A folder with a graph file for either sensor: half a minute in the small room.
fn graph() -> (TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("graph.toml");
    let text = "[run]\nrobot = \"pioneer3at\"\nout = \"maps\"\n[replay]\nlog = \"drive.log.gz\"\n\
        [simulator]\nworld = \"room\"\nduration_s = 30\n[odometry]\nsystematic = \"correct\"\n";
    std::fs::write(&file, text).unwrap();
    let file = path(&file);
    (folder, file)
}

#[test]
fn one_graph_runs_with_either_sensor_and_the_record_of_the_one_makes_the_map_of_the_other() {
    let (folder, graph) = graph();
    let at = |name: &str| folder.path().join(name);
    let map = || (std::fs::read(at("maps/map.npy")).unwrap(), native::read(&at("maps/map.echogrid")).unwrap().path);
    // There is no log yet: the simulator needs none, and writes it.
    let record = format!("simulator.record={}", path(&at("drive.log.gz")));
    let simulated = summary(&echogrid(["up", &graph, "--sensor", "simulator", "--json", "-q", "--set", &record]));
    let simulated_map = map();
    let replayed = summary(&echogrid(["up", &graph, "--sensor", "replay", "--json", "-q"]));
    assert!(map() == simulated_map, "the maps differ");
    assert_eq!(simulated["source"], "simulator in room");
    let recorded_s = simulated["recorded_s"].as_f64().unwrap();
    assert!((30.0..30.6).contains(&recorded_s), "{simulated}");
    for figure in ["scans", "odometry", "readings", "accepted", "refused", "distance_m", "trust", "cells", "extent_m"] {
        assert_eq!(simulated[figure], replayed[figure], "{figure}");
    }
    assert!(simulated["scans"].as_u64().unwrap() >= 90 && simulated["lost_messages"] == 0, "{simulated}");
    // The world goes by its name here too.
    let (map, log) = (path(&at("maps/map.echogrid")), path(&at("drive.log.gz")));
    let judged = summary(&echogrid(["score", &map, "--world", "room", "--path", &log, "--json"]));
    assert!(judged["wall_recall_10cm"].as_f64().unwrap() > 0.5, "{judged}");
}

#[test]
fn processes_and_steps_in_one_thread_make_the_same_map() {
    let (folder, graph) = graph();
    let graph_out = folder.path().join("maps");
    summary(&echogrid(["up", &graph, "--sensor", "simulator", "--json", "-q"]));
    let request = echogrid::config::LoadRequest {
        graph: Some(graph.into()),
        sensor: Some("simulator".into()),
        ..Default::default()
    };
    let config = echogrid::config::Config::load(&request).unwrap().into_config();
    let provenance = config.provenance(None).unwrap();
    let local = native_map_of(&config, provenance, &folder.path().join("local"));
    assert!(local == std::fs::read(graph_out.join("map.echogrid")).unwrap());
}

#[test]
fn a_simulated_robot_can_be_driven_by_hand() {
    let (folder, graph) = graph();
    let domain = format!("drive-{}", std::process::id());
    let out = path(&folder.path().join("driven"));
    let mut driven = GraphProcess::start_in(
        &domain,
        ECHOGRID,
        ["up", &graph, "--sensor", "simulator", "--set", "simulator.route=commands", "--rate", "20", "--out", &out]
            .into_iter()
            .chain(["--set", "simulator.duration_s=0"]),
    );
    driven.wait_for("messages");
    let told = |arguments: &[&str]| {
        let output = echogrid(arguments.iter().chain(&["--domain", &domain]));
        (output.status.success(), said(&output))
    };
    let (done, answer) = told(&["drive", "0.3", "-10deg"]);
    assert!(done && answer.contains("sensor: drives at 0.3 m/s and -0.17"), "{answer}");
    let (done, answer) = told(&["drive", "1000"]);
    assert!(!done && answer.contains("speed 1000 m/s: expected at most 10 m/s either way"), "{answer}");
    // It stood where it was until it was told.
    let deadline = Instant::now() + Duration::from_secs(20);
    while !told(&["status"]).1.lines().any(|line| line.starts_with("map ") && !line.contains(" 0.0 m, ")) {
        assert!(Instant::now() < deadline, "{}", told(&["status"]).1);
    }
    driven.signal(Signal::SIGINT);
    let ended = driven.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn a_log_keeps_the_promises_of_a_sensor() {
    let drive = Drive::new(3.0);
    let make = || Replay::new(&ReplayConfig { log: drive.log(), ..ReplayConfig::default() }, None);
    let given = conformance::check(make).unwrap();
    assert!(given.scans > 20 && given.odometry > 3 * (given.scans - 1) && given.hits > 100, "{given:?}");
}

#[test]
fn what_is_wrong_with_the_world_or_the_way_is_told_before_anything_is_started() {
    let (folder, graph) = graph();
    let check = |sets: &[&str], snippets: &[&str]| {
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let output = echogrid(["up", &graph, "--sensor", "simulator"].into_iter().chain(sets));
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        assert!(snippets.iter().all(|snippet| said(&output).contains(snippet)), "{}", said(&output));
        assert!(!folder.path().join("maps").exists(), "a graph was started");
    };
    check(&["simulator.world=rom"], &["simulator.world: rom", "did you mean room?"]);
    check(&["simulator.world=none.map"], &["none.map: no such file"]);
    check(&["simulator.start=[3.6, 2.0]"], &["at (3.6, 2) in room the nearest wall is 0.30 m"]);
    check(&["simulator.route=[\"Rihgt\"]"], &["room has no goal \"Rihgt\"", "did you mean \"Right\"?"]);
    check(&["simulator.route=[[9.0, 9.0]]"], &["place [9, 9] of room can't be reached"]);
    check(&["simulator.route=tuor"], &["simulator.route = \"tuor\": expected", "did you mean \"tour\"?"]);
    check(&["simulator.speed=1"], &["simulator.speed: unknown key; did you mean `speed_mps`"]);
    check(&["simulator.rays=0"], &["simulator.rays = 0: expected a whole number from 1 to 1001"]);
    check(&["simulator.record=/nowhere/drive.log"], &["simulator.record: /nowhere/drive.log can't be written there"]);
}
