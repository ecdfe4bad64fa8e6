//! However a graph ends, nothing of it stays.

use std::time::Duration;

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;

use crate::support::{Drive, ECHOGRID, path};

/// A drive that takes far longer than a test at this rate.
const REAL_TIME: &[&str] = &["--rate", "1"];

const NOTHING: Vec<String> = Vec::new();

fn running(drive: &Drive) -> GraphProcess {
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", REAL_TIME));
    graph.wait_for("all services ready");
    graph
}

#[test]
fn a_normal_end_leaves_nothing() {
    let drive = Drive::new(3.0);
    let ended = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &[])).wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING);
}

#[test]
fn ctrl_c_saves_the_map_so_far_and_leaves_nothing() {
    let drive = Drive::new(f64::INFINITY);
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let mut graph = running(&drive);
        // By then there is something in the map: a sensor that has only just become ready has sent nothing yet.
        graph.wait_for("messages");
        graph.signal(signal);
        let ended = graph.wait();
        assert!(ended.status.success(), "{signal}: {}", ended.stderr);
        assert!(ended.stdout.contains("stopped before its end"), "{}", ended.stdout);
        assert_eq!(ended.leftovers(), NOTHING);
        native::read(&drive.out("maps/map.echogrid")).unwrap();
        std::fs::remove_dir_all(drive.out("maps")).unwrap();
    }
}

/// A robot that is not switched on, a program that prints nothing: nobody downstream has heard of anything that could end.
#[test]
fn a_sensor_that_has_said_nothing_does_not_hold_the_graph_up() {
    let drive = Drive::new(0.5);
    let file = drive.out("mute.toml");
    let sensor = "[services.sensor]\nkind = \"sensor\"\nexec = \"sleep\"\nargs = [\"600\"]\nspeaks = \"carmen\"\n";
    std::fs::write(&file, sensor).unwrap();
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let mut graph = GraphProcess::start(ECHOGRID, ["up", &path(&file), "--out", &path(&drive.out("maps"))]);
        graph.wait_for("publisher started");
        graph.signal(signal);
        let ended = graph.wait();
        assert!(!ended.stderr.contains("twice") && !ended.stderr.contains("killed"), "{signal}: {}", ended.stderr);
        // A robot that has not driven yet is no failure.
        assert_eq!((ended.status.code(), ended.leftovers()), (Some(0), NOTHING), "{signal}: {}", ended.stderr);
    }
}

/// Whatever is starting at that moment.
#[test]
fn a_graph_that_is_stopped_while_it_starts_leaves_at_once_and_says_that_there_is_no_map() {
    let drive = Drive::new(f64::INFINITY);
    for step in ["sensor started", "odometry started", "publisher started", "all services ready"] {
        for signal in [Signal::SIGINT, Signal::SIGTERM] {
            let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", REAL_TIME));
            graph.wait_for(step);
            graph.signal(signal);
            let ended = graph.wait();
            assert!(!ended.stderr.contains("killed"), "{step}, {signal}: {}", ended.stderr);
            assert_eq!(ended.leftovers(), NOTHING, "{step}, {signal}");
            let has_map = drive.out("maps/map.echogrid").exists();
            assert_eq!(ended.status.success(), has_map, "{step}, {signal}: {}", ended.stderr);
            if has_map {
                std::fs::remove_dir_all(drive.out("maps")).unwrap();
            } else {
                assert!(ended.stderr.contains("stopped before anything was mapped"), "{}", ended.stderr);
            }
        }
    }
}

#[test]
fn a_killed_launcher_takes_its_services_along_and_the_next_start_sweeps() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "10"]));
    // By then there is something in the map.
    graph.wait_for("messages");
    graph.signal(Signal::SIGKILL);
    assert_eq!(graph.survivors_after(Duration::from_secs(2)), NOTHING);
    let killed = graph.wait();
    assert!(!killed.leftovers().is_empty(), "a killed launcher can't have swept");
    // The publisher saw the launcher go and saved what there was.
    native::read(&drive.out("maps/map.echogrid")).unwrap();
    let short = Drive::new(1.0);
    let next = GraphProcess::start(ECHOGRID, short.map_arguments("maps", &[])).wait();
    assert!(next.status.success(), "{}", next.stderr);
    assert_eq!(killed.leftovers(), NOTHING);
    assert_eq!(next.leftovers(), NOTHING);
}

#[test]
fn each_service_is_a_process_with_its_name() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = running(&drive);
    let mut pids = vec![graph.pid()];
    for (service, shown) in [
        ("sensor", "echogrid-replay"),
        ("odometry", "echogrid-odomet"),
        ("mapper", "echogrid-mapper"),
        ("publisher", "echogrid-publis"),
    ] {
        let pid = graph.pid_of(service);
        assert_eq!(std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap().trim(), shown);
        pids.push(pid);
    }
    pids.sort_unstable();
    pids.dedup();
    assert_eq!(pids.len(), 5);
    graph.signal(Signal::SIGINT);
    assert!(graph.wait().status.success());
}

#[test]
fn a_domain_has_one_graph() {
    let drive = Drive::new(f64::INFINITY);
    let name = format!("one-{}", std::process::id());
    let mut first = GraphProcess::start_in(&name, ECHOGRID, drive.map_arguments("maps", REAL_TIME));
    first.wait_for("all services ready");
    let second = GraphProcess::start_in(&name, ECHOGRID, drive.map_arguments("other", &[])).wait();
    assert_eq!(second.status.code(), Some(1));
    assert!(
        second.stderr.contains(&format!("domain {name:?} is in use by process {}", first.pid())),
        "{}",
        second.stderr
    );
    assert!(second.stderr.contains("--domain"), "{}", second.stderr);
    first.signal(Signal::SIGINT);
    let first = first.wait();
    assert!(first.status.success(), "{}", first.stderr);
    assert_eq!(first.leftovers(), NOTHING);
}
