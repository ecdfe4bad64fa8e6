//! Talking to a running graph.

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;

use crate::support::{Drive, ECHOGRID, echogrid, said};

#[test]
fn a_running_graph_saves_when_told_and_tells_how_it_is() {
    let drive = Drive::new(f64::INFINITY);
    let name = format!("talk-{}", std::process::id());
    let mut graph = GraphProcess::start_in(&name, ECHOGRID, drive.map_arguments("maps", &["--rate", "10"]));
    graph.wait_for("messages");
    let saved = echogrid(["save", "--domain", &name]);
    assert!(saved.status.success(), "{}", said(&saved));
    assert!(String::from_utf8_lossy(&saved.stdout).contains("publisher: saved in "), "{}", said(&saved));
    let so_far = native::read(&drive.out("maps/map.echogrid")).unwrap();
    let status = echogrid(["status", "--domain", &name]);
    let text = String::from_utf8_lossy(&status.stdout);
    for service in ["sensor", "odometry", "mapper", "publisher"] {
        let line = text.lines().find(|line| line.starts_with(service)).unwrap_or_else(|| panic!("{}", said(&status)));
        assert!(line.contains("running") && line.contains(&graph.pid_of(service).to_string()), "{line}");
    }
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
    // Saving neither stopped nor changed anything: the map went on to grow.
    let whole = native::read(&drive.out("maps/map.echogrid")).unwrap();
    assert!(whole.path.len() > so_far.path.len());
}

#[test]
fn a_graph_that_does_not_run_is_named() {
    for arguments in [["save", "--domain", "nobody"], ["status", "--domain", "nobody"]] {
        let output = echogrid(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("domain \"nobody\": no echogrid runs there"), "{error}");
    }
}
