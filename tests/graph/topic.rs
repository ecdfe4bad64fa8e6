//! `echogrid topic`: what goes through a running graph.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Instant;

use echogrid_harness::{GraphProcess, PATIENCE};
use nix::sys::signal::Signal;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, said};

fn topic(domain: &str, arguments: &[&str]) -> String {
    let output = echogrid(["topic"].iter().chain(arguments).chain(&["--domain", domain]));
    assert!(output.status.success(), "{}", said(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// Of places for tools a topic has less than half as many.
#[test]
fn killed_tools_leave_room_for_others() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "1"]));
    graph.wait_for("all services ready");
    let domain = graph.domain().name().to_owned();
    let deadline = Instant::now() + PATIENCE;
    let mut killed = 0;
    while killed < 24 {
        assert!(Instant::now() < deadline, "only {killed} tools found a place");
        let mut tool = Command::new(ECHOGRID)
            .args(["topic", "echo", "health", "--json", "--domain", &domain])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // With its first word it has its places; one that finds none says nothing.
        let mut line = String::new();
        BufReader::new(tool.stdout.take().unwrap()).read_line(&mut line).unwrap();
        killed += u32::from(!line.is_empty());
        tool.kill().unwrap();
        tool.wait().unwrap();
    }
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn topics_are_listed_shown_and_measured() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "5"]));
    graph.wait_for_progress("mapper", 60);
    let domain = graph.domain().name().to_owned();

    let list = topic(&domain, &["list"]);
    let line = list.lines().find(|line| line.starts_with("odometry/estimate")).unwrap();
    assert!(line.contains("lossless") && line.ends_with("odometry → mapper, publisher"), "{line}");
    let list: Vec<Value> = serde_json::from_str(&topic(&domain, &["list", "--json"])).unwrap();
    assert!(list.iter().any(|topic| topic["topic"] == "map/tiles" && topic["writers"][0] == "mapper"), "{list:?}");

    let lines = topic(&domain, &["echo", "odometry/raw", "--count", "3", "--json"]);
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let numbers: Vec<u64> = lines.iter().map(|line| line["sequence"].as_u64().unwrap()).collect();
    // What is kept for whoever comes late begins with the first.
    assert_eq!(numbers, [1, 2, 3], "{lines:?}");
    assert!(lines.iter().all(|line| line["message"]["odom_from_base"]["x"].is_f64()), "{lines:?}");
    let text = topic(&domain, &["echo", "robot/description", "--count", "1"]);
    assert!(text.contains("sonar"), "{text}");
    let tile = topic(&domain, &["echo", "map/tiles", "--count", "1", "--json"]);
    let tile: Value = serde_json::from_str(&tile).unwrap();
    assert_eq!(tile["message"]["log_odds"].as_array().unwrap().len(), 4096);

    // Ten poses in a second of the sensor's clock; how many in one of ours is up to the machine.
    let hz: Value = serde_json::from_str(&topic(&domain, &["hz", "odometry/raw", "--count", "1", "--json"])).unwrap();
    let (wall, sensor) = (hz["hz"].as_f64().unwrap(), hz["hz_by_stamps"].as_f64().unwrap());
    assert!((9.0..11.0).contains(&sensor) && wall > 0.0, "{hz}");

    // An onlooker leaves with the graph, and costs it nothing.
    let mut reader = graph.topic("range/scan");
    reader.wait_until("it is there", |line| line["sequence"].is_u64());
    graph.signal(Signal::SIGINT);
    reader.wait_until("the stream ends", |line| line["end"] == true);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    drop(reader);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn a_topic_that_is_none_is_named_with_those_that_are() {
    let output = echogrid(["topic", "echo", "map/tile"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("no topic \"map/tile\"") && error.contains("map/tiles"), "{error}");
}
