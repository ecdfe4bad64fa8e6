//! Services that are stopped in their tracks.

use echogrid_harness::GraphProcess;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, ECHOGRID};

#[test]
fn a_service_that_is_stopped_is_found_out_and_replaced_and_the_map_is_the_same() {
    let drive = Drive::new(12.0);
    let services = ["sensor", "odometry", "localizer", "mapper", "publisher"];
    let reference = drive.native_map("reference", &["--fix", "truth"]);
    let impatient = ["--set", "run.alive_within_s=2", "--set", "supervision.backoff_s=0.02"];
    let arguments = [&["--fix", "truth", "--rate", "4", "--json"], &impatient[..]].concat();
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &arguments));
    for service in services {
        graph.wait_until("all is well", |graph| services.iter().all(|service| graph.progress(service) > 10));
        graph.stop(service);
        graph.wait_for(&format!("{service} died (no sign of life for 2 s: it hangs): restart 1"));
        graph.wait_for_nth(&format!("{service} started (process "), 2);
        let pid = u64::from(graph.pid_of(service));
        graph.wait_until("it is back", |graph| graph.pid(service) == pid && graph.state(service) == "running");
    }
    let ended = graph.wait();
    let summary = ended.summary();
    assert_eq!(ended.restarts(), 5, "{summary}");
    assert_eq!(summary["lost_messages"], 0, "{summary}");
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(std::fs::read(drive.out("maps/map.echogrid")).unwrap() == reference, "the map differs");
}

#[test]
fn a_service_that_is_stopped_for_a_moment_only_is_left_alone() {
    let drive = Drive::new(3.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = 5");
    let mut graph = file.start(&[]);
    graph.wait_for_progress("mapper", 20);
    graph.stop("mapper");
    // The others go on meanwhile.
    let mut odometry = graph.topic("odometry/estimate");
    odometry.wait_until("more", |line| line["sequence"].as_u64() > Some(60));
    graph.go_on("mapper");
    let ended = graph.wait();
    assert_eq!((ended.restarts(), &ended.summary()["lost_messages"]), (0, &0.into()));
    assert!(file.map_bytes() == reference, "the map differs");
}
