//! A service that fails stops the graph with its name, and the map so far is kept.

use echogrid::testing::GraphProcess;
use echogrid_formats::map::native;

use crate::support::{Drive, ECHOGRID};

#[test]
fn a_service_that_is_killed_is_named_and_nothing_is_left() {
    for service in ["sensor", "odometry", "localizer", "mapper", "publisher"] {
        let drive = Drive::new(f64::INFINITY);
        let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "5", "--fix", "truth"]));
        graph.wait_for("all services ready");
        graph.kill(service);
        let ended = graph.wait();
        assert_eq!(ended.status.code(), Some(1), "{service}: {}", ended.stderr);
        assert!(ended.stderr.contains(&format!("{service}: killed by signal 9 (SIGKILL)")), "{}", ended.stderr);
        assert_eq!(ended.leftovers(), Vec::<String>::new(), "{service}");
    }
}

#[test]
fn the_map_so_far_outlives_the_sensor() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "20"]));
    // By then there are seconds of the drive in the map.
    graph.wait_for("messages");
    graph.kill("sensor");
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1));
    assert!(ended.stderr.contains("is the map so far"), "{}", ended.stderr);
    let map = native::read(&drive.out("maps/map.echogrid")).unwrap();
    assert!(map.grid.tile_count() > 4 && map.path.len() > 10);
}

#[test]
fn a_service_that_hangs_after_its_end_is_pressed_to_leave() {
    // `sleep` never joins the graph: it neither starts nor listens to anyone.
    let drive = Drive::new(1.0);
    let graph_file = drive.out("graph.toml");
    let text = "[replay]\nlog = \"drive.log\"\n[services.publisher]\nkind = \"publisher\"\nexec = \"sleep\"\nargs = [\"1000\"]\n";
    std::fs::write(&graph_file, text).unwrap();
    let mut graph = GraphProcess::start(ECHOGRID, ["up", graph_file.to_str().unwrap()]);
    graph.wait_for("publisher started");
    graph.signal(nix::sys::signal::Signal::SIGINT);
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}
