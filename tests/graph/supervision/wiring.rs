//! Services that play no role: what they read and write is what the graph file says.

use echogrid_harness::fault::{Mode, READS_VARIABLE};

use super::graph_file::{GraphFile, IMPATIENT, NOTHING};
use crate::support::Drive;

/// The map of an undisturbed run.
fn reference(drive: &Drive) -> Vec<u8> {
    let file = GraphFile::new(drive, "reference");
    let ended = file.start(&[]).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    file.map_bytes()
}

#[test]
fn readers_of_the_tiles_and_onlookers_run_to_the_end_and_change_nothing() {
    let drive = Drive::new(0.5);
    let file = GraphFile::new(&drive, "maps")
        .fault("tiles", "other", Mode::Good, 0, "reads = [\"map/tiles\"]")
        .fault("viewer", "other", Mode::Good, 0, "looks_on = [\"odometry/estimate\", \"map/tiles\"]")
        .fault("numbers", "other", Mode::Good, 0, "looks_on = [\"map/info\"]");
    let ended = file.start(&IMPATIENT).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert!(!ended.stderr.contains("restart"), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING, "{}", ended.stderr);
    assert_eq!(file.map_bytes(), reference(&drive));
}

#[test]
fn a_publisher_that_reads_less_than_it_is_waited_for_is_named_and_nobody_else_is_blamed() {
    let drive = Drive::new(0.5);
    let file = GraphFile::new(&drive, "maps").publisher().fault(
        "another",
        "publisher",
        Mode::Good,
        0,
        &format!("env = {{ {READS_VARIABLE} = \"map/tiles\" }}"),
    );
    let ended = file.start(&IMPATIENT).wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    let named =
        "another: it takes messages, but does not acknowledge odometry/estimate, on which odometry waits for it";
    assert!(ended.stderr.contains(named), "{}", ended.stderr);
    assert!(!ended.stderr.contains("it hangs"), "{}", ended.stderr);
    // It says what it reads, and the map is made.
    let file = GraphFile::new(&drive, "said").publisher().fault(
        "another",
        "publisher",
        Mode::Good,
        0,
        "reads = [\"map/tiles\"]",
    );
    let ended = file.start(&IMPATIENT).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(file.map_bytes(), reference(&drive));
}
