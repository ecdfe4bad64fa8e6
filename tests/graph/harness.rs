//! What tests are made with holds its promises.

use echogrid_harness::{GraphProcess, leftovers};

use crate::support::{Drive, ECHOGRID};

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
