//! Orders of the user to services that die over them.

use std::time::{Duration, Instant};

use echogrid_harness::fault::{GATE_VARIABLE, Mode};
use echogrid_harness::{Ended, GraphProcess, files};
use echogrid_topics::Domain;
use nix::sys::signal::Signal;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, echogrid, path, said};

/// Messages before the gate, and of those how many are poses.
const BEFORE: u64 = 301;
const POSES: u64 = (BEFORE - 1) / 2;

/// A graph over a sensor that waits in the middle of its walk until `NAME.gate` is there.
fn gated<'a>(drive: &'a Drive, name: &'static str) -> GraphFile<'a> {
    let gate = path(&drive.out(&format!("{name}.gate")));
    GraphFile::new(drive, name).fault(
        "sensor",
        "sensor",
        Mode::Gated,
        BEFORE,
        &format!("env = {{ {GATE_VARIABLE} = {gate:?} }}"),
    )
}

fn start(file: &GraphFile<'_>) -> GraphProcess {
    file.start(&["supervision.backoff_s=0.02", "supervision.restarts_max=100", "odometry.lin_scale=0.05"])
}

/// Whether all that was before the gate is where it is to be; of the scans the last waits for the pose after it.
fn wait_at_the_gate(graph: &mut GraphProcess) {
    graph.wait_until("all is taken in", |graph| {
        graph.progress("odometry") > POSES && graph.progress("mapper") >= BEFORE && graph.state("mapper") == "running"
    });
}

/// Waits until a tool has come to a graph in which nothing else happens: there is more in its shared memory than `before`.
fn wait_for_a_tool(domain: &Domain, before: usize) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while files(domain).len() <= before {
        assert!(Instant::now() < deadline, "no tool came");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn end(drive: &Drive, name: &str, graph: GraphProcess) -> Ended {
    std::fs::write(drive.out(&format!("{name}.gate")), "").unwrap();
    let ended = graph.wait();
    assert!(ended.status.success(), "{name}: {}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING, "{name}");
    ended
}

#[test]
fn an_order_to_a_service_that_dies_is_carried_out_once() {
    let drive = Drive::new(0.5);
    let fix = ["fix", "2.9", "0.1", "0", "--sigma", "0.1"];
    for (service, order, names) in [
        ("odometry", &fix[..], ["fix", "fix-killed", "fix-stopped"]),
        ("mapper", &["pause"], ["pause", "pause-killed", "pause-stopped"]),
    ] {
        let mut maps = Vec::new();
        for (way, name) in names.into_iter().enumerate() {
            let file = gated(&drive, name);
            let mut graph = start(&file);
            wait_at_the_gate(&mut graph);
            let domain = graph.domain().clone();
            // Stopped, it has the order before it when it dies.
            if way > 0 {
                graph.stop(service);
            }
            let words: Vec<&str> = order.iter().copied().chain(["--domain", domain.name()]).collect();
            let before = files(&domain).len();
            let told = std::thread::scope(|scope| {
                let told = scope.spawn(|| echogrid(&words));
                if way > 0 {
                    // If the order itself is still on its way, the successor alone hears it, which is as good.
                    wait_for_a_tool(&domain, before);
                    graph.kill(service);
                    graph.go_on(service);
                }
                if way > 1 {
                    graph.wait_for_nth(&format!("{service} started (process "), 2);
                    graph.kill(service);
                }
                told.join().unwrap()
            });
            assert!(told.status.success(), "{name}: {}", said(&told));
            let ended = end(&drive, name, graph);
            assert_eq!(ended.restarts(), way as u64, "{name}: {}", ended.stderr);
            maps.push(file.map_bytes());
        }
        assert!(maps.iter().all(|map| *map == maps[0]), "{service}: the order counted otherwise than once");
        let untold = gated(&drive, "untold");
        let mut graph = start(&untold);
        wait_at_the_gate(&mut graph);
        end(&drive, "untold", graph);
        assert!(untold.map_bytes() != maps[0], "{service}: the order changes nothing");
        std::fs::remove_file(drive.out("untold.gate")).unwrap();
    }
}

#[test]
fn an_order_to_a_graph_that_dies_fails_soon_and_says_so() {
    let drive = Drive::new(0.5);
    let mut graph = start(&gated(&drive, "gone"));
    wait_at_the_gate(&mut graph);
    let domain = graph.domain().clone();
    graph.stop("publisher");
    let words = ["save", "--domain", domain.name()];
    let before = files(&domain).len();
    let told = std::thread::scope(|scope| {
        let told = scope.spawn(|| echogrid(words));
        wait_for_a_tool(&domain, before);
        graph.signal(Signal::SIGKILL);
        graph.kill("publisher");
        told.join().unwrap()
    });
    assert!(!told.status.success() && said(&told).contains("the graph has ended"), "{}", said(&told));
}
