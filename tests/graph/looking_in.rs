//! Looking in from outside: `info`, `status`, completions, the manual, maps that are saved while they grow, the page as a service.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, path, said};

fn json(arguments: &[&str]) -> Value {
    let output = echogrid(arguments);
    assert!(output.status.success(), "{}", said(&output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{}", said(&output)))
}

#[test]
fn info_tells_what_a_file_is() {
    let drive = Drive::new(3.0);
    drive.native_map("maps", &[]);
    let graph = drive.out("graph.toml");
    std::fs::write(&graph, "[services.sensor]\nexec = \"builtin:simulator\"\n").unwrap();
    let foreign = drive.out("cloud");
    std::fs::write(&foreign, "ply\nformat ascii 1.0\n").unwrap();
    let parameters = drive.out("p3dx.p");
    std::fs::write(&parameters, "Class Pioneer ; general\nSubclass p3dx\nDistConvFactor 0.5\nSonarUnit 0 69 136 90\n")
        .unwrap();
    for (file, kind) in [
        (drive.log(), "log"),
        (parameters, "aria-parameters"),
        (drive.out("maps/map.echogrid"), "native-map"),
        (drive.out("maps"), "native-map"),
        (drive.out("maps/map.yaml"), "map-server"),
        (graph, "graph"),
        (foreign, "foreign"),
    ] {
        assert_eq!(json(&["info", &path(&file), "--json"])["kind"], kind, "{}", file.display());
        let told = echogrid(["info", &path(&file)]);
        assert!(told.status.success() && !told.stdout.is_empty(), "{}", said(&told));
    }
    assert_eq!(json(&["info", &path(&drive.log()), "--json"])["survey"]["format"], "carmen-log");
}

#[test]
fn the_command_line_completes_itself_and_has_a_manual() {
    for shell in ["bash", "zsh", "fish"] {
        let output = echogrid(["completions", shell]);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && text.contains("record") && text.contains("emulate"), "{shell}: {text}");
    }
    let page = echogrid(["man"]);
    assert!(String::from_utf8_lossy(&page.stdout).contains(".TH echogrid"), "{}", said(&page));
    let folder = tempfile::tempdir().unwrap();
    let pages = echogrid(["man", "--out", &path(folder.path())]);
    assert!(pages.status.success(), "{}", said(&pages));
    for name in ["echogrid.1", "echogrid-map.1", "echogrid-record.1"] {
        assert!(std::fs::read_to_string(folder.path().join(name)).unwrap().contains(".TH"), "{name}");
    }
}

#[test]
fn status_is_json_and_looks_on_until_the_graph_ends() {
    let drive = Drive::new(f64::INFINITY);
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &["--rate", "10"]));
    graph.wait_for_progress("mapper", 50);
    let name = graph.domain().name().to_owned();
    let status = json(&["status", "--json", "--domain", &name]);
    assert_eq!(status["domain"], name.as_str());
    let services: Vec<&Value> = status["services"].as_array().unwrap().iter().collect();
    assert_eq!(services.len(), 4, "{status}");
    assert!(services.iter().all(|service| service["health"]["state"] == "running"), "{status}");
    let mut watching = Command::new(ECHOGRID)
        .args(["status", "--watch", "--json", "--domain", &name])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut looks = BufReader::new(watching.stdout.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&looks.next().unwrap().unwrap()).unwrap();
    assert_eq!(first["domain"], name.as_str());
    graph.signal(Signal::SIGINT);
    assert!(graph.wait().status.success());
    // It ends with its graph, and every look was a line.
    assert!(looks.all(|look| serde_json::from_str::<Value>(&look.unwrap()).is_ok()));
    watching.wait().unwrap();
}

#[test]
fn a_map_is_saved_while_it_grows() {
    let drive = Drive::new(100.0);
    let whole = drive.native_map("whole", &[]);
    let saves = ["--rate", "20", "--set", "publisher.save_every_s=5", "--log-level", "info"];
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &saves));
    graph.wait_for_nth(" saved ", 2);
    // Nothing has ended yet, and there is a map.
    graph.stop("sensor");
    let file = drive.out("maps/map.echogrid");
    let so_far = std::fs::read(&file).unwrap();
    graph.go_on("sensor");
    assert!(graph.wait().status.success());
    assert!(so_far != whole && std::fs::read(&file).unwrap() == whole, "saving changes no map");
}

/// The mapper, the publisher, a recorder, the page, and three tools more: one for each place that a stream has.
#[test]
fn all_who_look_on_find_a_place_at_once() {
    let drive = Drive::new(f64::INFINITY);
    let more = ["--rate", "5", "--record", "--watch=127.0.0.1:0"];
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("maps", &more));
    graph.wait_for("live page: ");
    graph.wait_for_progress("mapper", 20);
    let mut tools: Vec<_> = (0..3).map(|_| graph.topic("odometry/estimate")).collect();
    for tool in &mut tools {
        tool.wait_until("it reads along", |line| line["sequence"].is_u64());
    }
    graph.signal(Signal::SIGINT);
    for tool in &mut tools {
        tool.wait_until("the stream ends", |line| line["end"] == true);
    }
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    let recording = json(&["info", &path(&drive.out("maps/recording.mcap")), "--json"]);
    assert!(recording["survey"]["scan_count"].as_u64().is_some_and(|scans| scans > 0), "{recording}");
}

#[test]
fn the_live_page_is_a_service_of_a_graph_file() {
    let folder = tempfile::tempdir().unwrap();
    let graph = folder.path().join("graph.toml");
    let text = "[run]\nrate = 4\nout = \"maps\"\n[services.sensor]\nexec = \"builtin:simulator\"\n\
                [services.page]\nexec = \"builtin:live\"\n[services.page.env]\nECHOGRID_LIVE_LISTEN = \"127.0.0.1:0\"\n";
    std::fs::write(&graph, text).unwrap();
    let mut graph = GraphProcess::start(ECHOGRID, ["up", &path(&graph)]);
    // Nobody was told a token, so that the page's own is told.
    let line = graph.wait_for("http://127.0.0.1:");
    let address = line.split("http://").nth(1).unwrap().trim_end();
    let (authority, page) = address.split_once('/').unwrap();
    let ask = |page: &str| {
        let mut stream = TcpStream::connect(authority).unwrap();
        write!(stream, "GET /{page} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        BufReader::new(stream).take(64).read_to_string(&mut answer).unwrap_or_default();
        answer.split(' ').nth(1).map(str::to_owned)
    };
    assert_eq!(ask(page.split_whitespace().next().unwrap()).as_deref(), Some("200"), "{line}");
    assert_eq!(ask("?token=wrong").as_deref(), Some("403"), "{line}");
    graph.wait_until("the page is a service like others", |view| view.progress("mapper") > 50);
    graph.kill("page");
    graph.wait_for_nth("page started (process", 2);
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
}
