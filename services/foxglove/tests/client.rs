//! A client of Foxglove's protocol receives map and pose of a running graph. Skipped, and said, without Python's `websockets`
//! (`ECHOGRID_PYTHON` names a Python that has it) or without `echogrid` (built beside this, or named in `ECHOGRID`).

#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used)] // a test that can not go on has failed

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use echogrid_harness::GraphProcess;
use serde_json::Value;

#[test]
fn a_client_receives_the_map_and_the_pose_of_a_running_demo() {
    let python = std::env::var("ECHOGRID_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_library = Command::new(&python).args(["-c", "import websockets"]).stderr(Stdio::null()).status();
    if !has_library.is_ok_and(|status| status.success()) {
        let _ = writeln!(std::io::stderr(), "skipped: no Python with websockets (name one in ECHOGRID_PYTHON)");
        return;
    }
    let echogrid = echogrid_harness::echogrid();
    if Command::new(&echogrid).arg("--version").stdout(Stdio::null()).status().is_err() {
        let _ =
            writeln!(std::io::stderr(), "skipped: no echogrid (cargo build --bin echogrid, or name it in ECHOGRID)");
        return;
    }
    let out = tempfile::tempdir().unwrap();
    let arguments = ["demo", "--rate", "8", "--out", out.path().to_str().unwrap()];
    let mut graph = GraphProcess::start(&echogrid, arguments);
    graph.wait_for_progress("mapper", 100);
    let mut shown = Command::new(env!("CARGO_BIN_EXE_echogrid-foxglove"))
        .args(["--listen", "127.0.0.1:0", "--domain", graph.domain().name()])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut address = String::new();
    BufReader::new(shown.stdout.take().unwrap()).read_line(&mut address).unwrap();
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/client.py");
    let output = Command::new(&python).args([client, address.trim(), "30"]).output().unwrap();
    let told: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)));
    let bytes = |topic: &str| told["seen"][topic].as_u64().unwrap_or(0);
    // A tile, and a map of at least as many cells, 8 bytes each.
    assert!(bytes("/map") > 64 * 64 * 8 && bytes("/map/tiles") > 64 * 64 * 8, "{told}");
    assert!(["/pose", "/tf", "/path", "/health"].iter().all(|topic| bytes(topic) > 0), "{told}");
    assert_eq!(told["schemas"]["/map"], "foxglove.Grid");
    let estimate = &told["seen"]["estimate"];
    assert!(
        estimate["x"].is_number() && estimate["covariance"].as_array().is_some_and(|rows| rows.len() == 9),
        "{told}"
    );
    graph.signal(nix::sys::signal::Signal::SIGINT);
    assert!(graph.wait().status.success());
    // It leaves with its graph.
    assert!(shown.wait().unwrap().success());
}
