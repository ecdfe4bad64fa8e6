//! Services that play no role: what they read and write is what the graph file says.

use echogrid_harness::Ended;
use echogrid_harness::fault::{Mode, READS_VARIABLE, halt};

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

/// It has no helper of ours: that it is to leave it hears by a signal, which must not be blocked as it is in the launcher.
#[test]
fn a_program_of_ones_own_is_told_by_a_signal_that_the_run_is_over() {
    let drive = Drive::new(0.5);
    let file = GraphFile::new(&drive, "maps")
        .with("[services.idle]\nkind = \"other\"\nexec = \"/bin/sleep\"\nargs = [\"1000\"]");
    let ended = file.start(&IMPATIENT).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!((ended.restarts(), ended.leftovers()), (0, NOTHING), "{}", ended.stderr);
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

/// A robot that drives until whoever reads its map has seen enough: without the declared topic it would drive for ever.
#[test]
fn a_planner_drives_the_robot_by_the_topic_for_it() {
    let drive = Drive::new(0.5);
    let sensor = |reads: &str| {
        format!(
            "[services.sensor]\nkind = \"sensor\"\nexec = \"builtin:simulator\"\n{reads}\n[simulator]\nduration_s = 20"
        )
    };
    let on_tour = GraphFile::new(&drive, "tour").with(&sensor("")).start(&[]).wait();
    let driven_m = |ended: &Ended| ended.summary()["distance_m"].as_f64().unwrap_or(f64::NAN);
    let halted = GraphFile::new(&drive, "halted").with(&sensor("reads = [\"drive/command\"]")).fault(
        "planner",
        "other",
        Mode::Halts,
        5,
        "reads = [\"map/info\"]\nwrites = [\"drive/command\"]",
    );
    let halted = halted.start(&["run.rate=4"]).wait();
    assert!(halted.status.success(), "{}", halted.stderr);
    assert_eq!((halted.restarts(), halted.leftovers()), (0, NOTHING), "{}", halted.stderr);
    // However late the word came: the tour takes 5 s here.
    assert!(driven_m(&halted) < 0.9 * driven_m(&on_tour), "{}", halted.stdout);
}

#[test]
fn a_loop_over_a_declared_topic_runs_to_its_end_and_is_stopped_in_order() {
    let drive = Drive::new(0.5);
    let file = GraphFile::new(&drive, "loop")
        .with(halt::DECLARATION)
        .fault("sensor", "sensor", Mode::WalksUntilTold, 0, &format!("reads = [{:?}]", halt::TOPIC))
        .fault(
            "planner",
            "other",
            Mode::TellsToHalt,
            20,
            &format!("reads = [\"map/info\"]\nwrites = [{:?}]", halt::TOPIC),
        )
        .fault("viewer", "other", Mode::Good, 0, "looks_on = [\"map/tiles\"]");
    let ended = file.start(&["run.rate=20"]).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!((ended.restarts(), ended.leftovers()), (0, NOTHING), "{}", ended.stderr);
    assert!(ended.summary()["scans"].as_u64().is_some_and(|scans| scans >= 20), "{}", ended.stdout);
    let at = |name: &str| ended.stderr.find(&format!("{name} ended")).unwrap_or_else(|| panic!("{}", ended.stderr));
    assert!(at("publisher") < at("planner") && at("sensor") < at("planner"), "{}", ended.stderr);
}
