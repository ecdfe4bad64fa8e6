//! Services that are stopped in their tracks, or at one step for long: nobody is blamed for that.

use echogrid_harness::GraphProcess;
use echogrid_harness::fault::Mode;
use nix::sys::signal::Signal;

use super::graph_file::{GraphFile, IMPATIENT, NOTHING};
use crate::support::{Drive, ECHOGRID};

/// Far less than a service is stopped for below.
const SHORT: [&str; 2] = ["--set", "run.alive_within_s=1"];

#[test]
fn a_service_that_is_stopped_is_waited_for_and_the_map_is_the_same() {
    let drive = Drive::new(12.0);
    let reference = drive.native_map("reference", &["--fix", "truth"]);
    let check = &|service: &str| {
        let arguments = [&["--fix", "truth", "--rate", "2", "--json"], &SHORT[..]].concat();
        let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments(service, &arguments));
        graph.wait_for_progress("mapper", 20);
        graph.stop(service);
        graph.wait_for(&format!("{service} is stopped (process "));
        graph.go_on(service);
        graph.wait_for(&format!("{service} goes on"));
        let ended = graph.wait();
        let summary = ended.summary();
        assert_eq!((ended.restarts(), &summary["lost_messages"]), (0, &0.into()), "{service}: {summary}");
        assert_eq!(ended.leftovers(), NOTHING, "{service}");
        let map = std::fs::read(drive.out(service).join("map.echogrid")).unwrap();
        assert!(map == reference, "{service}: the map differs");
    };
    std::thread::scope(|scope| {
        let services = ["sensor", "odometry", "localizer", "mapper", "publisher"];
        let checks = services.map(|service| scope.spawn(move || check(service)));
        checks.into_iter().for_each(|check| check.join().unwrap());
    });
}

/// When the sensor has nothing more to give, whoever is stopped keeps the others waiting, and that is all.
#[test]
fn a_service_that_is_stopped_when_the_log_ends_blames_nobody() {
    let drive = Drive::new(3.0);
    let reference = drive.native_map("reference", &[]);
    let check = &|service: &str| {
        let arguments = drive.map_arguments(service, &[&["--rate", "5", "--json"], &SHORT[..]].concat());
        let mut graph = GraphProcess::start(ECHOGRID, arguments);
        graph.wait_for_progress("mapper", 20);
        graph.stop(service);
        if service != "sensor" {
            graph.wait_until("the log has ended", |graph| graph.state("sensor") == "draining");
        }
        graph.wait_for(&format!("{service} is stopped (process "));
        graph.go_on(service);
        let ended = graph.wait();
        assert!(ended.status.success(), "{service}: {}", ended.stderr);
        assert_eq!(ended.restarts(), 0, "{service}: {}", ended.stderr);
        assert_eq!(ended.leftovers(), NOTHING, "{service}");
        let map = std::fs::read(drive.out(service).join("map.echogrid")).unwrap();
        assert!(map == reference, "{service}: the map differs");
    };
    std::thread::scope(|scope| {
        let checks = ["sensor", "odometry", "mapper", "publisher"].map(|service| scope.spawn(move || check(service)));
        checks.into_iter().for_each(|check| check.join().unwrap());
    });
}

#[test]
fn a_service_that_works_at_one_step_for_long_is_left_alone() {
    let drive = Drive::new(1.0);
    let reference = drive.native_map("reference", &[]);
    let file = GraphFile::new(&drive, "maps").publisher().fault("toiler", "publisher", Mode::Toiling, 10, "");
    let ended = file.start(&IMPATIENT).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.restarts(), 0, "{}", ended.stderr);
    assert!(ended.stderr.contains("toiler has been at one step for 2 s"), "{}", ended.stderr);
    assert!(file.map_bytes() == reference, "the map differs");
}

/// However long whoever is to save it is held up, the map that the user has end is there.
#[test]
fn a_graph_that_is_told_to_end_while_a_service_is_stopped_keeps_its_map() {
    let drive = Drive::new(f64::INFINITY);
    let arguments = drive.map_arguments("maps", &["--rate", "10"]);
    let mut graph = GraphProcess::start(ECHOGRID, arguments);
    graph.wait_for_progress("mapper", 50);
    graph.stop("publisher");
    graph.signal(Signal::SIGINT);
    graph.wait_for("publisher is stopped (process ");
    graph.go_on("publisher");
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert!(ended.stdout.contains("stopped before its end"), "{}", ended.stdout);
    echogrid_formats::map::native::read(&drive.out("maps/map.echogrid")).unwrap();
    assert_eq!(ended.leftovers(), NOTHING);
}
