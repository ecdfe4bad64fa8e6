//! What a run says while it lasts: to people, and to machines.

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, said};

/// The lives of the services at `info`, each line as JSON.
#[test]
fn all_of_a_log_is_json_where_json_is_asked_for() {
    let drive = Drive::new(12.0);
    let more = ["--fix", "truth", "--fix-every", "3m", "--rate", "3", "--log-level", "info", "--log-format", "json"];
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &more));
    graph.wait_for("started (process ");
    graph.wait_for_nth("robot seen", 2);
    graph.wait_for("progress: ");
    graph.signal_to("odometry", Signal::SIGKILL);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    let lines: Vec<Value> = ended
        .stderr
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")))
        .collect();
    let says = |service: &str, what: &str| {
        lines.iter().any(|line| {
            line["span"]["service"] == service && line["message"].as_str().is_some_and(|text| text.contains(what))
        })
    };
    for (service, what) in [
        ("launcher", "mapper started (process "),
        ("launcher", "all services ready"),
        ("launcher", "odometry died (killed by signal 9 (SIGKILL)): restart 1"),
        ("launcher", "mapper ended: done"),
        ("sensor", "ready"),
        ("mapper", "robot seen"),
        ("odometry", "localized: fix taken"),
        ("odometry", "restarted: goes on where an earlier process was"),
        ("publisher", "saved"),
        ("mapper", "ended"),
    ] {
        assert!(says(service, what), "{service} does not say {what:?}:\n{}", ended.stderr);
    }
    assert!(lines.iter().all(|line| line["timestamp"].is_string() && line["level"].is_string()), "{}", ended.stderr);
}

#[test]
fn an_error_is_json_too() {
    let output = echogrid(["map", "/nowhere/at/all.log", "--log-format", "json"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let line: Value = serde_json::from_slice(&output.stderr).unwrap();
    assert_eq!(line["level"], "ERROR");
    assert!(line["message"].as_str().unwrap().contains("/nowhere/at/all.log"), "{line}");
}

#[test]
fn who_asks_for_nothing_hears_nothing_but_the_summary() {
    let drive = Drive::new(3.0);
    let output = drive.map("maps", &[]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", said(&output));
    // That a map is replaced is worth a line.
    let again = drive.map("maps", &[]);
    let text = String::from_utf8(again.stderr.clone()).unwrap();
    assert!(text.lines().count() == 1 && text.contains("the map of an earlier run is replaced"), "{}", said(&again));
}

#[test]
fn a_folder_is_the_output_of_one_graph() {
    let drive = Drive::new(f64::INFINITY);
    let mut first = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "5"]));
    first.wait_for("all services ready");
    let second = drive.map("maps", &[]);
    assert_eq!(second.status.code(), Some(1), "{}", said(&second));
    let said_of = String::from_utf8_lossy(&second.stderr).into_owned();
    let holder = format!("another graph saves its map there (process {})", first.pid());
    assert!(said_of.contains(&holder) && said_of.contains("--out"), "{said_of}");
    // However the holder ends, the folder is free then.
    first.signal(Signal::SIGKILL);
    assert_eq!(first.survivors_after(std::time::Duration::from_secs(2)), Vec::<String>::new());
    drop(first);
    let short = Drive::new(1.0);
    let out = drive.out("maps");
    let third = echogrid(["map", short.log().to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(third.status.success(), "{}", said(&third));
}

#[test]
fn the_help_of_the_demo_tells_its_own_defaults() {
    let help = |command: &str| String::from_utf8(echogrid([command, "--help"]).stdout).unwrap();
    let fix = |help: &str| {
        let (_, rest) = help.split_once("--fix <").unwrap();
        rest.split_once("--fix-every").unwrap().0.to_owned()
    };
    assert!(fix(&help("demo")).contains("[default: truth]"));
    assert!(fix(&help("map")).contains("[default: none]"));
}

#[test]
fn a_log_that_can_be_read_only_once_is_refused() {
    let drive = Drive::new(1.0);
    let pipe = drive.out("pipe.log");
    nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let output = echogrid(["map", pipe.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("pipe.log: not a regular file; a log is read twice"), "{text}");
}
