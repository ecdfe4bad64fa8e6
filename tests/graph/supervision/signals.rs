//! Signals to single services, from somebody who is not their launcher: a daemon that is short of memory, `systemctl kill`.

use std::collections::BTreeMap;

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, ECHOGRID};

const ASKS: [Signal; 3] = [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP];
const SERVICES: [&str; 5] = ["sensor", "odometry", "localizer", "mapper", "publisher"];
const FIXED: [&str; 4] = ["--fix", "truth", "--fix-every", "2m"];

#[test]
fn a_service_that_somebody_else_tells_to_end_is_started_again_and_the_map_is_the_same() {
    let drive = Drive::new(12.0);
    let reference = drive.native_map("reference", &FIXED);
    let check = &|signal: Signal| {
        let out = signal.as_str();
        let arguments = [&FIXED[..], &["--rate", "4", "--json", "--set", "supervision.backoff_s=0.02"]].concat();
        let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments(out, &arguments));
        for service in SERVICES {
            graph.wait_until("all is well", |graph| SERVICES.iter().all(|service| graph.progress(service) > 10));
            graph.signal_to(service, signal);
            graph.wait_for_nth(&format!("{service} started (process "), 2);
            let pid = u64::from(graph.pid_of(service));
            graph.wait_until("it is back", |graph| graph.pid(service) == pid && graph.state(service) == "running");
        }
        let ended = graph.wait();
        let summary = ended.summary();
        assert_eq!((ended.restarts(), &summary["lost_messages"]), (5, &0.into()), "{signal}: {summary}");
        assert!(ended.stderr.contains(&format!("mapper died ({signal} from process ")), "{}", ended.stderr);
        assert_eq!(ended.leftovers(), NOTHING, "{signal}");
        let map = std::fs::read(drive.out(out).join("map.echogrid")).unwrap();
        assert!(map == reference, "{signal}: the map differs");
    };
    std::thread::scope(|scope| {
        let checks = ASKS.map(|signal| scope.spawn(move || check(signal)));
        checks.into_iter().for_each(|check| check.join().unwrap());
    });
}

/// Where the poses are corrected (SLAM), from a simulated robot with a lidar; every file that there is.
#[test]
fn so_it_is_with_slam_and_a_simulator() {
    let drive = Drive::new(0.5);
    let sensor = "[run]\nrobot = \"laser\"\n[simulator]\nduration_s = 24\n[services.sensor]\nkind = \"sensor\"\nexec = \"builtin:simulator\"";
    let graph = |name| GraphFile::new(&drive, name).with(sensor);
    let files = |name: &str| {
        let entries = std::fs::read_dir(drive.out(name)).unwrap().flatten();
        entries.map(|entry| (entry.file_name(), std::fs::read(entry.path()).unwrap())).collect::<BTreeMap<_, _>>()
    };
    assert!(graph("reference").start_with(&[], &["--slam"]).wait().status.success());
    let reference = files("reference");
    assert!(reference.contains_key(std::ffi::OsStr::new("graph.g2o")), "{:?}", reference.keys());
    for (signal, name) in ASKS.into_iter().zip(["term", "int", "hup"]) {
        let mut graph = graph(name).start_with(&["supervision.backoff_s=0.02"], &["--slam", "--rate", "6"]);
        for service in ["sensor", "odometry", "mapper", "publisher"] {
            graph.wait_until("all run", |graph| {
                ["odometry", "mapper", "publisher"].iter().all(|service| graph.state(service) == "running")
                    && graph.progress("odometry") > 10
            });
            graph.signal_to(service, signal);
            graph.wait_for_nth(&format!("{service} started (process "), 2);
            let pid = u64::from(graph.pid_of(service));
            graph.wait_until("it is back", |graph| graph.pid(service) == pid && graph.state(service) == "running");
        }
        let ended = graph.wait();
        assert_eq!((ended.restarts(), ended.leftovers()), (4, NOTHING), "{signal}: {}", ended.stderr);
        let found = files(name);
        assert!(found.keys().eq(reference.keys()), "{signal}: {:?}", found.keys());
        let other: Vec<_> = found.iter().filter(|(name, bytes)| reference[*name] != **bytes).collect();
        assert!(other.is_empty(), "{signal}: {:?} differ", other.iter().map(|(name, _)| name).collect::<Vec<_>>());
    }
}

/// `systemctl kill`, or a shell that closes: every process is told, in whatever order.
#[test]
fn when_all_are_told_to_end_the_map_so_far_is_saved() {
    let drive = Drive::new(f64::INFINITY);
    for launcher_first in [true, false] {
        let arguments = drive.map_arguments("maps", &["--rate", "10", "--fix", "truth"]);
        let mut graph = GraphProcess::start(ECHOGRID, arguments);
        graph.wait_until("all is well", |graph| SERVICES.iter().all(|service| graph.progress(service) > 10));
        graph.wait_for_progress("mapper", 50);
        if launcher_first {
            graph.signal(Signal::SIGTERM);
        }
        for service in SERVICES {
            graph.signal_to(service, Signal::SIGTERM);
        }
        if !launcher_first {
            graph.signal(Signal::SIGTERM);
        }
        let ended = graph.wait();
        assert!(ended.status.success(), "launcher first: {launcher_first}: {}", ended.stderr);
        let map = echogrid_formats::map::native::read(&drive.out("maps/map.echogrid")).unwrap();
        assert!(map.grid.tile_count() > 0 && !map.path.is_empty());
        assert_eq!(ended.leftovers(), NOTHING);
        std::fs::remove_dir_all(drive.out("maps")).unwrap();
    }
}
