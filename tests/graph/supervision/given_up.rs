//! Services that are not started again, and those that depend on them.

use echogrid_harness::fault::Mode;

use super::graph_file::{GraphFile, IMPATIENT, NOTHING};
use crate::support::Drive;

const EXTRA: &str = "extra";

/// An extra publisher that misbehaves, and that nobody requires, costs no more than itself.
fn goes_on_without(mode: Mode, argument: u64, sets: &[&str], how: &str) {
    let drive = Drive::new(3.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").publisher().fault(EXTRA, "publisher", mode, argument, "required = false");
    let ended = file.start(&[&IMPATIENT, sets].concat()).wait();
    let summary = ended.summary();
    assert_eq!(summary["given_up"].as_array().unwrap().len(), 1, "{summary}");
    assert!(summary["given_up"][0].as_str().unwrap().starts_with(&format!("{EXTRA}: {how}")), "{summary}");
    assert_eq!(summary["restarts"][EXTRA], 1, "{summary}");
    let said = format!("{EXTRA} died ({how}): given up, the others go on without it");
    assert!(ended.stderr.contains(&said), "{}", ended.stderr);
    assert_eq!(summary["lost_messages"], 0);
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");
}

#[test]
fn the_others_go_on_without_a_service_that_always_crashes() {
    goes_on_without(Mode::AlwaysCrash, 0, &[], "killed by signal 6 (SIGABRT)");
}

#[test]
fn the_others_go_on_without_a_service_that_crashes_late() {
    goes_on_without(Mode::CrashLate, 10, &[], "killed by signal 6 (SIGABRT)");
}

#[test]
fn the_others_go_on_without_a_service_that_hangs() {
    goes_on_without(Mode::HangAfterReady, 10, &[], "no sign of life for 2 s: it hangs");
}

#[test]
fn a_service_that_is_never_to_be_restarted_ends_the_graph() {
    let drive = Drive::new(3.0);
    let file = GraphFile::new(&drive, "maps")
        .with("[services.mapper]\nkind = \"mapper\"\nexec = \"builtin:mapper\"\nrestart = \"never\"\n[run]\nrate = 5");
    let mut graph = file.start(&[]);
    graph.wait_for_progress("mapper", 50);
    graph.kill("mapper");
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("mapper: killed by signal 9 (SIGKILL)"), "{}", ended.stderr);
    assert!(!ended.stderr.contains("restart 1"), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING);
}

#[test]
fn with_rest_for_one_those_downstream_begin_anew_too() {
    let drive = Drive::new(6.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = 10\n[supervision]\nstrategy = \"rest_for_one\"");
    let mut graph = file.start(&[]);
    graph.wait_for_progress("mapper", 60);
    let services = ["sensor", "odometry", "mapper", "publisher"];
    let before = services.map(|service| graph.pid_of(service));
    graph.kill("odometry");
    for downstream in ["odometry", "mapper", "publisher"] {
        graph.wait_for_nth(&format!("{downstream} started (process "), 2);
    }
    let after = services.map(|service| graph.pid_of(service));
    assert_eq!(before[0], after[0], "the sensor is upstream");
    assert!((1..4).all(|service| before[service] != after[service]), "{before:?} {after:?}");
    let ended = graph.wait();
    let summary = ended.summary();
    assert_eq!((&summary["restarts"]["odometry"], &summary["lost_messages"]), (&1.into(), &0.into()), "{summary}");
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");
}
