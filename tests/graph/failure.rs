//! A service that dies is started again and nothing is lost; one that may not be ends the graph, which keeps the map so far.

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use echogrid_topics::Domain;

use crate::support::{Drive, ECHOGRID};

#[test]
fn a_service_that_is_killed_is_started_again_and_the_map_is_the_same() {
    let drive = Drive::new(20.0);
    let more = ["--fix", "truth", "--fix-every", "2m"];
    let undisturbed = drive.native_map("undisturbed", &more);
    for service in ["sensor", "odometry", "localizer", "mapper", "publisher"] {
        let mut arguments = drive.map_arguments("maps", &more);
        arguments.extend(["--rate".to_owned(), "10".to_owned()]);
        let mut graph = GraphProcess::start(ECHOGRID, arguments);
        graph.wait_for("all services ready");
        graph.kill(service);
        let ended = graph.wait();
        assert!(ended.status.success(), "{service}: {}", ended.stderr);
        let died = format!("{service} died (killed by signal 9 (SIGKILL)): restart 1 in 0.1 s");
        assert!(ended.stderr.contains(&died), "{}", ended.stderr);
        assert!(ended.stdout.contains(&format!("restarts  {service} 1 ×")), "{}", ended.stdout);
        assert!(std::fs::read(drive.out("maps/map.echogrid")).unwrap() == undisturbed, "{service}: another map");
        assert_eq!(ended.leftovers(), Vec::<String>::new(), "{service}");
    }
}

#[test]
fn a_graph_whose_shared_memory_is_wedged_is_made_anew_and_the_map_is_the_same() {
    let drive = Drive::new(20.0);
    let undisturbed = drive.native_map("undisturbed", &[]);
    let name = format!("wedged-{}", std::process::id());
    let mut graph = GraphProcess::start_in(&name, ECHOGRID, drive.map_arguments("maps", &["--rate", "10"]));
    graph.wait_for("all services ready");
    // Who cleans up after the dead finds no way in.
    std::fs::write(Domain::named(&name).unwrap().iceoryx2_config(), "no configuration").unwrap();
    graph.kill("mapper");
    graph.wait_for("the graph's shared memory is made anew");
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert!(std::fs::read(drive.out("maps/map.echogrid")).unwrap() == undisturbed);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn a_service_that_is_never_restarted_is_named_and_nothing_is_left() {
    for service in ["sensor", "odometry", "localizer", "mapper", "publisher"] {
        let drive = Drive::new(f64::INFINITY);
        let never = format!("services.{service}.restart=never");
        let arguments = drive.map_arguments("maps", &["--rate", "5", "--fix", "truth", "--set", &never]);
        let mut graph = GraphProcess::start(ECHOGRID, arguments);
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
    let arguments = drive.map_arguments("maps", &["--rate", "20", "--set", "services.sensor.restart=never"]);
    let mut graph = GraphProcess::start(ECHOGRID, arguments);
    // By then there are seconds of the drive in the map.
    graph.wait_for("messages");
    graph.kill("sensor");
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1));
    assert!(ended.stderr.contains("is the map so far"), "{}", ended.stderr);
    let map = native::read(&drive.out("maps/map.echogrid")).unwrap();
    assert!(map.grid.tile_count() > 4 && map.path.len() > 10);
}

/// What is gone will be gone in another life, too: nobody is started again for it.
#[test]
fn a_log_that_loses_its_end_while_it_is_played_fails_at_once_and_keeps_the_map() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "20", "--json"]));
    graph.wait_for_progress("mapper", 20);
    let length = std::fs::metadata(drive.log()).unwrap().len();
    std::fs::OpenOptions::new().write(true).open(drive.log()).unwrap().set_len(length / 2).unwrap();
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    let told = format!("drive.log: has {} bytes and had {length} when it was surveyed", length / 2);
    assert!(ended.stderr.contains(&told), "{}", ended.stderr);
    assert!(!ended.stderr.contains("restart 1"), "{}", ended.stderr);
    assert!(native::read(&drive.out("maps/map.echogrid")).unwrap().grid.tile_count() > 4);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
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
