//! What tests are made with holds its promises.

use echogrid_harness::{GraphProcess, leftovers};

use crate::support::{Drive, ECHOGRID};

/// As the README has it.
#[test]
fn a_dead_mapper_costs_nothing() {
    let drive = Drive::new(6.0);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "5", "--json"]));
    graph.wait_for_progress("mapper", 50);
    graph.kill("mapper");
    graph.wait_for("mapper died (killed by signal 9 (SIGKILL)): restart 1");
    graph.wait_until("all is well", |graph| graph.state("mapper") == "running" && graph.faults("mapper") == 0);
    graph.topic("map/info").wait_until("20 scans are in the map", |info| info["message"]["scans"].as_u64() > Some(20));
    let ended = graph.wait();
    let summary = ended.summary();
    assert_eq!((&summary["restarts"]["mapper"], &summary["lost_messages"]), (&1.into(), &0.into()));
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn a_test_that_fails_leaves_nothing() {
    let drive = Drive::new(6.0);
    let mut domain = None;
    let failed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "1"]));
        graph.wait_for_progress("mapper", 5);
        // It would not even hear that its launcher has died.
        graph.stop("mapper");
        domain = Some(graph.domain().clone());
        assert!(leftovers(graph.domain()).len() > 4);
        panic!("a test fails");
    }));
    assert!(failed.is_err());
    assert_eq!(leftovers(&domain.unwrap()), Vec::<String>::new());
}

#[test]
fn a_condition_of_a_graph_that_has_ended_is_not_waited_for() {
    let drive = Drive::new(1.0);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &[]));
    let waited = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| graph.wait_for_progress("mapper", u64::MAX)));
    let why = waited.unwrap_err();
    assert!(why.downcast_ref::<String>().unwrap().contains("ended before: mapper has"));
    assert!(graph.wait().status.success());
}
