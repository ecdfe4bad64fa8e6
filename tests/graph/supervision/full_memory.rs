//! Shared memory that somebody else fills while a graph runs.

use std::path::Path;

use echogrid_harness::disk::{empty, fill_up};

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, folder_in_a_namespace, in_a_namespace};

#[test]
fn a_running_graph_survives_full_shared_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mount = "mount -t tmpfs -o size=128m tmpfs /dev/shm";
    in_a_namespace("supervision::full_memory::a_graph_in_a_small_memory", mount, folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn a_graph_in_a_small_memory() {
    let Some(_) = folder_in_a_namespace() else { return };
    let memory = Path::new("/dev/shm");
    let drive = Drive::new(6.0);
    let reference = drive.native_map("reference", &[]);
    // In pages that nobody has written yet there is no room any more.
    let dies = "(killed by signal 7 (SIGBUS): is /dev/shm full? See echogrid doctor): restart 1";

    // There is room again before anybody is given up.
    let file = GraphFile::new(&drive, "maps").with("[run]\nrate = 5");
    let mut graph = file.start(&[]);
    graph.wait_for_progress("mapper", 30);
    fill_up(memory);
    graph.wait_for(dies);
    empty(memory);
    let ended = graph.wait();
    let summary = ended.summary();
    assert_eq!(summary["lost_messages"], 0, "{summary}");
    assert_eq!(ended.leftovers(), NOTHING);
    assert!(file.map_bytes() == reference, "the map differs");

    // There is none: somebody is given up.
    let mut graph = file.start(&["supervision.restarts_max=1"]);
    graph.wait_for_progress("mapper", 30);
    fill_up(memory);
    graph.wait_for(dies);
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("the graph stopped early"), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING);
    empty(memory);
}
