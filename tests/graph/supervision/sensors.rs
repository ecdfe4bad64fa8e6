//! A sensor of each kind of fault.

use echogrid_harness::Ended;
use echogrid_harness::fault::Mode;
use echogrid_harness::fault::walk::{GARBLED_EVERY, MESSAGES, STEPS};

use nix::sys::signal::Signal;

use super::graph_file::{GraphFile, IMPATIENT, NOTHING};
use crate::support::Drive;

/// A run whose sensor misbehaves, to its end; and the map that came of it, if it went well.
fn run(mode: Mode, argument: u64, sets: &[&str]) -> (Ended, Option<Vec<u8>>) {
    let drive = Drive::new(0.5);
    let file = GraphFile::new(&drive, "maps").fault("sensor", "sensor", mode, argument, "");
    let ended = file.start(&[&IMPATIENT, sets].concat()).wait();
    assert_eq!(ended.leftovers(), NOTHING, "{}", ended.stderr);
    let map = ended.status.success().then(|| file.map_bytes());
    (ended, map)
}

/// A run that is given up, the log of which has these lines.
fn fails(mode: Mode, argument: u64, sets: &[&str], lines: &[&str]) {
    let (ended, _) = run(mode, argument, sets);
    assert_eq!(ended.status.code(), Some(1), "{mode:?}: {}", ended.stderr);
    for line in lines {
        assert!(ended.stderr.contains(line), "{mode:?}: no {line:?} in:\n{}", ended.stderr);
    }
}

const GIVEN_UP: &str = "it was restarted 1 times within 60 s (supervision.restarts_max)";

#[test]
fn a_sensor_that_crashes_at_once_is_restarted_and_then_given_up() {
    let died = "sensor died (killed by signal 6 (SIGABRT)): restart 1 in 0.0 s";
    fails(Mode::AlwaysCrash, 0, &[], &[died, "sensor: killed by signal 6 (SIGABRT)", GIVEN_UP]);
}

#[test]
fn a_sensor_that_crashes_in_every_life_is_given_up() {
    fails(Mode::CrashLate, MESSAGES / 2, &[], &["sensor died (killed by signal 6 (SIGABRT)): restart 1", GIVEN_UP]);
}

#[test]
fn a_sensor_that_never_becomes_ready_is_given_up() {
    let hangs = "sensor died (not ready for 1 s: it hangs): restart 1";
    fails(Mode::HangBeforeReady, 0, &["supervision.ready_within_s=1"], &[hangs, GIVEN_UP]);
}

#[test]
fn a_sensor_that_hangs_in_every_life_is_given_up() {
    let hangs = "sensor died (no sign of life for 2 s: it hangs): restart 1";
    fails(Mode::HangAfterReady, MESSAGES / 2, &[], &[hangs, GIVEN_UP]);
}

#[test]
fn a_sensor_that_says_nothing_is_given_up() {
    let silent = "sensor died (not a single message for 1 s: it hangs): restart 1";
    fails(Mode::Silent, 0, &["supervision.first_output_within_s=1"], &[silent, GIVEN_UP]);
}

#[test]
fn a_sensor_of_another_run_is_told_apart() {
    let lines = ["message refused", "epoch", "sensor: left without saying that its streams end"];
    fails(Mode::WrongEpoch, 100, &[], &lines);
}

#[test]
fn what_a_flood_washes_away_is_counted() {
    // However much of the way is washed away, the readings after it count.
    let exact = ["systematic=\"off\"", "k_ll=0", "k_lt=0", "k_tt=0", "k_tl=0"].map(|set| format!("odometry.{set}"));
    let (ended, _) = run(Mode::Flooding, 20_000, &exact.each_ref().map(String::as_str));
    let summary = ended.summary();
    assert!(summary["lost_messages"].as_u64() > Some(0), "{summary}");
    assert_eq!((&summary["faulty_messages"], ended.restarts()), (&0.into(), 0), "{summary}");
}

#[test]
fn garbage_between_good_messages_is_counted_and_changes_nothing() {
    let (good, map) = run(Mode::Good, 0, &[]);
    let (garbled, garbled_map) = run(Mode::Garbage, 0, &[]);
    assert_eq!(good.summary()["faulty_messages"], 0);
    let summary = garbled.summary();
    assert_eq!((&summary["faulty_messages"], &summary["lost_messages"]), (&(STEPS / GARBLED_EVERY).into(), &0.into()));
    assert_eq!(garbled.stderr.matches("message refused").count(), 1, "{}", garbled.stderr);
    assert!(map == garbled_map, "the map differs");
}

#[test]
fn a_second_request_to_end_waits_for_nobody() {
    let drive = Drive::new(0.5);
    let file =
        GraphFile::new(&drive, "maps").fault("sensor", "sensor", Mode::IgnoresSigterm, 0, "").with("[run]\nrate = 1");
    let mut graph = file.start(&[]);
    graph.wait_for_progress("mapper", 10);
    let sensor = u64::from(graph.pid_of("sensor"));
    let asked = std::time::Instant::now();
    graph.signal(Signal::SIGINT);
    // It is not on its way out.
    graph.wait_until("the sensor goes on", |graph| graph.pid("sensor") == sensor && graph.progress("sensor") > 30);
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("would not leave and was killed: sensor"), "{}", ended.stderr);
    assert!(asked.elapsed().as_secs() < 10, "nobody was in a hurry");
    assert_eq!(ended.leftovers(), NOTHING);
}
