//! `echogrid doctor` on this machine, and on one with little shared memory.

use std::path::PathBuf;
use std::process::{Command, Output};

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;
use nix::unistd::Uid;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, folder_in_a_namespace, in_a_namespace, mount_shared_memory, said};

/// The findings of one check.
fn findings(output: &Output, check: &str) -> Vec<Value> {
    let report: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{}", said(output)));
    assert_eq!(report["fit"].as_bool(), Some(output.status.success()), "{}", said(output));
    let all = report["findings"].as_array().unwrap().clone();
    all.into_iter().filter(|finding| finding["check"] == check).collect()
}

fn finding(output: &Output, check: &str) -> Value {
    findings(output, check).into_iter().next().unwrap_or_else(|| panic!("no {check}: {}", said(output)))
}

#[test]
fn a_machine_that_runs_the_tests_is_fit() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("maps");
    let doctor = |more: &[&str]| echogrid(["doctor", "--out", out.to_str().unwrap()].iter().chain(more));
    let output = doctor(&["--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let memory = finding(&output, "shared memory");
    assert!(memory["figures"]["free_bytes"].as_u64() > memory["figures"]["needed_bytes"].as_u64(), "{memory}");
    assert_eq!(finding(&output, "output")["verdict"], "ok");
    // It looks, and makes nothing.
    assert!(!out.exists());
    let text = doctor(&[]);
    assert!(String::from_utf8_lossy(&text.stdout).starts_with("ok       shared memory"), "{}", said(&text));
}

#[test]
fn what_would_fail_is_a_problem_with_what_mends_it() {
    let folder = tempfile::tempdir().unwrap();
    let graph = folder.path().join("graph.toml");
    std::fs::write(
        &graph,
        "[run]\nout = \"graph.toml/maps\"\n[services.mine]\nkind = \"sensor\"\nexec = \"sleep\"\nargs = [\"/dev/ttyUSB987\"]\n",
    )
    .unwrap();
    // With fewer files than connections.
    let script = "ulimit -n 64 && exec \"$0\" doctor \"$1\" --json";
    let output = Command::new("sh").args(["-c", script, ECHOGRID]).arg(&graph).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(String::from_utf8_lossy(&output.stderr).contains("not fit: 3 problems"), "{}", said(&output));
    for (check, mend) in [("open files", "nofile"), ("serial ports", "plug it in"), ("output", "--out DIR")] {
        let finding = finding(&output, check);
        assert_eq!(finding["verdict"], "problem", "{finding}");
        assert!(finding["mend"].as_str().unwrap().contains(mend), "{finding}");
    }
    let output = echogrid(["doctor", "/nowhere/graph.toml"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/graph.toml"), "{}", said(&output));
}

#[test]
fn a_low_limit_of_open_files_is_raised() {
    let drive = Drive::new(0.5);
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -S -n 100 && exec \"$0\" \"$@\"", ECHOGRID]);
    let output = command.args(drive.map_arguments("maps", &["-q"])).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
}

#[test]
fn leftovers_are_told_and_cleaned_and_what_runs_is_not() {
    // Where no other test's launcher sweeps them first.
    let folder = tempfile::tempdir().unwrap();
    in_a_namespace("doctor::where_a_graph_died", "mount -t tmpfs -o size=256m tmpfs /dev/shm", folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn where_a_graph_died() {
    if folder_in_a_namespace().is_none() {
        return;
    }
    let drive = Drive::new(f64::INFINITY);
    let mut running = GraphProcess::start_in("alive", ECHOGRID, drive.map_arguments("alive", &["--rate", "10"]));
    running.wait_for("messages");
    let mut dying = GraphProcess::start_in("dying", ECHOGRID, drive.map_arguments("dying", &["--rate", "10"]));
    dying.wait_for("messages");
    dying.signal(Signal::SIGKILL);
    assert_eq!(dying.survivors_after(std::time::Duration::from_secs(60)), Vec::<String>::new());
    let uid = Uid::current();
    // Of no domain that is known.
    let stray = PathBuf::from(format!("/dev/shm/eg{uid}_stray_1.data"));
    std::fs::write(&stray, [0; 5000]).unwrap();
    let foreign = PathBuf::from("/dev/shm/of-another-program");
    std::fs::write(&foreign, "x").unwrap();

    let out = drive.out("maps").display().to_string();
    let doctor = |more: &[&str]| echogrid(["doctor", "--json", "--out", &out].iter().chain(more));
    let output = doctor(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let left = finding(&output, "leftovers");
    assert_eq!((&left["verdict"], &left["figures"]["domains"]), (&"warning".into(), &2.into()), "{left}");
    let text = left["text"].as_str().unwrap();
    assert!(text.contains("dying (") && text.contains("stray (1 files, 8 KiB)") && !text.contains("alive"), "{text}");
    assert_eq!(left["mend"], "echogrid doctor --clean");
    let listed = finding(&output, "running")["text"].as_str().unwrap().to_owned();
    assert_eq!(listed, format!("alive (launcher: process {})", running.pid()));
    let same = doctor(&["--domain", "alive"]);
    assert_eq!(finding(&same, "running")["verdict"], "warning");

    let output = doctor(&["--clean"]);
    let text = finding(&output, "leftovers")["text"].as_str().unwrap().to_owned();
    assert!(text.starts_with("removed dying (") && text.contains("stray"), "{text}");
    assert!(!stray.exists() && foreign.exists());
    let names: Vec<String> = std::fs::read_dir(format!("/dev/shm/echogrid-{uid}"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert!(names.len() == 3 && names.iter().all(|name| name.starts_with("alive")), "{names:?}");
    let status = echogrid(["status", "--domain", "alive"]);
    assert!(String::from_utf8_lossy(&status.stdout).contains("running"), "{}", said(&status));
    running.signal(Signal::SIGINT);
    let ended = running.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}

#[test]
fn enormous_scans_need_more_memory_than_there_is() {
    let folder = tempfile::tempdir().unwrap();
    in_a_namespace("doctor::where_memory_is_small", "mount -t tmpfs -o size=64m tmpfs /dev/shm", folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn where_memory_is_small() {
    let Some(folder) = folder_in_a_namespace() else { return };
    std::fs::write(
        folder.join("robot.toml"),
        "name = \"eyes\"\n[lidar]\nx_m = 0\ny_m = 0\nheading_deg = 0\nbeams = 10000\nfirst_bearing_deg = -90\n\
         field_of_view_deg = 180\nrange_min_m = 0\nrange_max_m = 30\nrange_error_ratio = 0.01\n",
    )
    .unwrap();
    let graph = folder.join("graph.toml");
    std::fs::write(&graph, "[run]\nrobot = \"robot.toml\"\n").unwrap();
    let doctor = || echogrid(["doctor", graph.to_str().unwrap(), "--json"]);
    let output = doctor();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let memory = finding(&output, "shared memory");
    assert_eq!(memory["verdict"], "problem", "{memory}");
    // What mends it does mend it.
    let size =
        memory["mend"].as_str().unwrap().split("remount,").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    assert!(size.starts_with("size="), "{memory}");
    mount_shared_memory(size);
    let output = doctor();
    assert_eq!(finding(&output, "shared memory")["verdict"], "ok", "{}", said(&output));
}
