//! Readers that dawdle and writers that do not belong there.

use echogrid_harness::fault::Mode;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::Drive;

#[test]
fn a_slow_service_slows_the_others_down_and_costs_them_nothing() {
    let drive = Drive::new(1.5);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").publisher().fault("dawdler", "publisher", Mode::Slow, 0, "");
    let ended = file.start(&[]).wait();
    let summary = ended.summary();
    assert_eq!((ended.restarts(), &summary["lost_messages"]), (0, &0.into()), "{summary}");
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");
}

#[test]
fn nobody_waits_for_a_reader_that_is_no_service() {
    let drive = Drive::new(6.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = 20");
    let mut graph = file.start(&[]);
    let topics = ["odometry/raw", "range/scan", "odometry/estimate", "map/tiles"];
    let mut readers = topics.map(|topic| graph.slow_reader(topic)).into_iter();
    graph.wait_for_progress("mapper", 100);
    // Its queue is not empty; it takes nothing out of shared memory.
    readers.next().unwrap().kill();
    let ended = graph.wait();
    assert_eq!(ended.summary()["lost_messages"], 0);
    drop(readers);
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");
}

#[test]
fn a_service_that_is_killed_with_a_full_queue_blocks_nobody() {
    let drive = Drive::new(f64::INFINITY);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = \"max\"");
    let mut graph = file.start(&["supervision.backoff_s=0.02"]);
    graph.wait_for("all services ready");
    graph.stop("mapper");
    // As far as anybody may be ahead of what is stored, and a little less: all of it queues before the mapper.
    graph.wait_for_progress("odometry", 1000);
    graph.kill("mapper");
    let ended = graph.wait();
    let summary = ended.summary();
    assert_eq!((&summary["restarts"]["mapper"], &summary["lost_messages"]), (&1.into(), &0.into()), "{summary}");
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");
}

#[test]
fn garbage_of_a_second_producer_is_counted_said_once_and_ignored() {
    let drive = Drive::new(6.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = 5");
    for (topic, service) in [("odometry/raw", "odometry"), ("range/scan", "mapper")] {
        let mut graph = file.start(&[]);
        graph.wait_for_progress("mapper", 20);
        let stranger = graph.garbage(topic);
        graph.wait_until("all of it is counted", |graph| graph.faults(service) == 30);
        drop(stranger);
        let ended = graph.wait();
        let summary = ended.summary();
        assert_eq!(summary["faulty_messages"], 30, "{topic}: {summary}");
        assert_eq!((ended.restarts(), &summary["lost_messages"]), (0, &0.into()), "{topic}: {summary}");
        assert_eq!(ended.stderr.matches("message refused").count(), 1, "{topic}: {}", ended.stderr);
        assert_eq!(ended.leftovers(), NOTHING);
        assert!(file.map_bytes() == reference, "{topic}: the map differs");
    }
}
