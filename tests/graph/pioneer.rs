//! A Pioneer that is emulated, its driver, and the whole graph behind it: mapped as the simulator itself, whoever is killed.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};

use echogrid_harness::GraphProcess;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::languages::{MODULE, python};
use crate::support::{ECHOGRID, echogrid, path, summary};

/// The drive, and what is known of the robot.
const DRIVE: [&str; 2] = ["simulator.world=room", "simulator.duration_s=30"];

/// `echogrid emulate pioneer`.
struct Emulated {
    child: Child,
    lines: std::io::Lines<BufReader<ChildStdout>>,
}

impl Emulated {
    fn start(link: &str, drive: &[&str]) -> Self {
        let sets = drive.iter().flat_map(|set| ["--set", set]);
        let mut child = Command::new(ECHOGRID)
            .args(["emulate", "pioneer", "--world", "room", "--link", link])
            .args(sets)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    fn wait_for(&mut self, text: &str) -> String {
        self.lines.by_ref().map(Result::unwrap).find(|line| line.contains(text)).unwrap()
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        let _ = kill(Pid::from_raw(self.child.id() as i32), Signal::SIGTERM);
        let _ = self.child.wait();
    }
}

/// Bits by which a map of the room is wrong in the mean.
fn bits(map: &str) -> f64 {
    let judged = summary(&echogrid(["score", map, "--world", "room", "--json"]));
    judged["bits"].as_f64().unwrap_or_else(|| panic!("{judged}"))
}

#[test]
fn an_emulated_pioneer_is_mapped_as_the_simulator_itself() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| path(&folder.path().join(name));
    let graph = concat!(env!("CARGO_MANIFEST_DIR"), "/launch/graphs/map.toml");
    let sets = DRIVE.iter().flat_map(|set| ["--set", set]).chain(["--set", "odometry.systematic=correct"]);
    let itself = ["up", graph, "--sensor", "simulator", "--json", "-q", "--out"].map(ToOwned::to_owned);
    let simulated = summary(&echogrid(itself.into_iter().chain([at("itself")]).chain(sets.map(ToOwned::to_owned))));

    let mut robot = Emulated::start(&at("ttyUSB0"), &DRIVE);
    let told = robot.wait_for("echogrid up");
    let start = told.split("--start ").nth(1).unwrap().split_whitespace();
    let mut arguments: Vec<String> =
        ["up", graph, "--sensor", "pioneer", "--robot", "pioneer3at", "--rate", "1", "--json"]
            .map(ToOwned::to_owned)
            .to_vec();
    arguments.extend(["--set".into(), format!("pioneer.port={}", at("ttyUSB0"))]);
    arguments.extend([
        "--set".into(),
        "odometry.systematic=correct".into(),
        "--out".into(),
        at("maps"),
        "--start".into(),
    ]);
    arguments.extend(start.map(ToOwned::to_owned));
    let mut graph = GraphProcess::start(ECHOGRID, arguments);
    // The driver and the mapper die on the way.
    graph.wait_for_progress("sensor", 60);
    graph.kill("mapper");
    graph.wait_for_progress("sensor", 160);
    graph.kill("sensor");
    robot.wait_for("the drive is over");
    graph.signal(Signal::SIGTERM);
    let ended = graph.wait();
    let mapped = ended.summary();
    assert_eq!(ended.restarts(), 2, "{mapped}");
    assert_eq!(mapped["lost_messages"], 0, "{mapped}");
    let scans = |summary: &serde_json::Value| summary["scans"].as_u64().unwrap();
    assert!(scans(&mapped) + 12 >= scans(&simulated), "{mapped}\n{simulated}");
    let (mapped, itself) = (bits(&at("maps/map.echogrid")), bits(&at("itself/map.echogrid")));
    eprintln!("{mapped} bits, and {itself} as the simulator itself");
    // What nobody heard while the driver was dead is not on the map.
    assert!(mapped <= itself + 0.08, "{mapped} bits, and {itself} as the simulator itself");
}

/// Nobody else drives it: without the planner it would stand where it began.
#[test]
fn a_planner_in_python_drives_an_emulated_pioneer() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| path(&folder.path().join(name));
    let mut robot = Emulated::start(&at("ttyUSB0"), &["simulator.route=commands", "simulator.duration_s=600"]);
    robot.wait_for("echogrid up");
    let planner = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/python/go_and_turn.py");
    let text = format!(
        "[run]\nrobot = \"pioneer3at\"\nout = {:?}\n[pioneer]\nport = {:?}\nmotors = true\n[services.sensor]\nkind = \"sensor\"\n\
         exec = \"builtin:pioneer\"\nreads = [\"drive/command\"]\n[services.planner]\nexec = {python:?}\nargs = [{planner:?}]\n\
         env = {{ PYTHONPATH = {MODULE:?} }}\nlooks_on = [\"odometry/estimate\"]\nwrites = [\"drive/command\"]\n",
        at("maps"),
        at("ttyUSB0")
    );
    let file = folder.path().join("graph.toml");
    std::fs::write(&file, text).unwrap();
    let mut graph = GraphProcess::start(ECHOGRID, ["up", &path(&file), "--json"]);
    graph.wait_for_progress("planner", 40);
    // Who plans anew goes on from where the robot is.
    graph.kill("planner");
    graph.wait_for_nth("planner started", 2);
    graph.wait_for_progress("planner", 40);
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!((ended.restarts(), ended.leftovers()), (1, Vec::<String>::new()), "{}", ended.stderr);
    let summary = ended.summary();
    assert!(summary["distance_m"].as_f64().unwrap() > 0.8, "it was not driven: {summary}");
    assert_eq!((&summary["lost_messages"], &summary["faulty_messages"]), (&0.into(), &0.into()), "{summary}");
}
