//! A sensor that measures what will not be there again.

use echogrid_harness::fault::walk::MESSAGES;
use echogrid_harness::fault::{Mode, WORLD_VARIABLE};
use echogrid_harness::{Ended, GraphProcess};
use nix::sys::signal::Signal;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, path};

/// Restarts come soon, and there may be many.
const PATIENT: [&str; 2] = ["supervision.backoff_s=0.02", "supervision.restarts_max=30"];

/// A graph over a live sensor that dies whenever it has given `after` messages.
fn live<'a>(drive: &'a Drive, name: &'static str, after: u64) -> GraphFile<'a> {
    let world = path(&drive.out(&format!("{name}.world")));
    let env = format!("env = {{ {WORLD_VARIABLE} = {world:?} }}");
    GraphFile::new(drive, name).fault("sensor", "sensor", Mode::Live, after, &env)
}

fn good(ended: &Ended) -> &Ended {
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING, "{}", ended.stderr);
    assert!(!ended.stderr.contains("lost"), "{}", ended.stderr);
    ended
}

/// Waits for the death of the sensor, time after time, and kills those that read it in the same moment.
fn kill_readers_at_its_deaths(graph: &mut GraphProcess, deaths: usize) {
    for death in 1..=deaths {
        graph.wait_for_nth("sensor died", death);
        graph.kill("odometry");
        graph.kill("mapper");
    }
}

#[test]
fn what_a_live_sensor_measured_outlives_it_and_its_readers() {
    let drive = Drive::new(0.5);
    let undisturbed = live(&drive, "undisturbed", MESSAGES * 2);
    good(&undisturbed.start(&PATIENT).wait());
    // Without --spool it is kept in shared memory, with it on disk.
    let spool = path(&drive.out("spool"));
    for (name, more) in [("memory", vec![]), ("disk", vec!["--spool", &spool])] {
        let disturbed = live(&drive, name, 150);
        let mut graph = disturbed.start_with(&PATIENT, &more);
        kill_readers_at_its_deaths(&mut graph, 3);
        let ended = graph.wait();
        assert!(good(&ended).restarts() >= 5, "{}", ended.stdout);
        assert!(disturbed.map_bytes() == undisturbed.map_bytes(), "{name}: another map\n{}", ended.stderr);
    }
}

#[test]
fn what_a_live_sensor_measured_outlives_the_whole_graph() {
    let drive = Drive::new(0.5);
    let undisturbed = live(&drive, "undisturbed", MESSAGES * 2);
    good(&undisturbed.start(&PATIENT).wait());
    let (disturbed, spool) = (live(&drive, "disturbed", MESSAGES / 2), path(&drive.out("spool")));
    // Dead, and nobody starts it again in time: the robot does not move on unseen.
    let mut graph =
        disturbed.start_with(&["supervision.backoff_s=60", "supervision.backoff_max_s=60"], &["--spool", &spool]);
    graph.wait_for("sensor died");
    graph.signal(Signal::SIGKILL);
    let killed = graph.wait();
    assert!(killed.status.code().is_none(), "{}", killed.stderr);
    let resumed = disturbed.start_with(&PATIENT, &["--spool", &spool, "--resume"]).wait();
    good(&resumed);
    assert!(disturbed.map_bytes() == undisturbed.map_bytes(), "another map\n{}", resumed.stderr);
}
