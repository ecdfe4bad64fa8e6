//! Recordings of whole runs: the map of one is that of the run, whoever was killed; a full disk ends it, and nothing else.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use echogrid_harness::GraphProcess;
use echogrid_harness::disk::fill;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, folder_in_a_namespace, in_a_namespace, path, said, summary};

/// The files of a map that do not name the log that it is of.
const FILES: [&str; 4] = ["map.png", "map.pgm", "map.npy", "map.yaml"];

fn assert_same_map(one: &Path, other: &Path) {
    for name in FILES {
        let [one, other] = [one, other].map(|folder| std::fs::read(folder.join(name)).unwrap());
        assert!(one == other, "{name} differs");
    }
}

/// What Python's `mcap` reads of a file, whole and cut; none, and said, without it.
fn read_by_python(recording: &Path, cuts: &[u64]) -> Option<Value> {
    let python = std::env::var("ECHOGRID_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/services/recorder/tests/read.py");
    let has_library = Command::new(&python).args(["-c", "import mcap"]).stderr(Stdio::null()).status();
    if !has_library.is_ok_and(|status| status.success()) {
        let _ = writeln!(std::io::stderr(), "skipped: no Python with mcap (name one in ECHOGRID_PYTHON)");
        return None;
    }
    let cuts = cuts.iter().map(u64::to_string);
    let output = Command::new(&python).arg(script).arg(recording).args(cuts).output().unwrap();
    Some(serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{}", said(&output))))
}

#[test]
fn the_map_of_a_recording_is_that_of_the_run_whoever_was_killed() {
    let drive = Drive::new(30.0);
    let run = drive.map("run", &["--json"]);
    let scans = summary(&run)["scans"].as_u64().unwrap();
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments("recorded", &["--rate", "40", "--record"]));
    for (kills, (service, at)) in [("recorder", 50), ("sensor", 150), ("recorder", 250)].into_iter().enumerate() {
        graph.wait_for_progress("recorder", at);
        graph.kill(service);
        graph.wait_for_nth("started (process", 6 + kills);
    }
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_same_map(&drive.out("run"), &drive.out("recorded"));

    let recording = drive.out("recorded").join("recording.mcap");
    let mapped = echogrid(["map", &path(&recording), "--out", &path(&drive.out("again")), "--json"]);
    assert_eq!(summary(&mapped)["scans"], scans);
    assert_same_map(&drive.out("run"), &drive.out("again"));
    let info: Value = serde_json::from_slice(&echogrid(["info", &path(&recording), "--json"]).stdout).unwrap();
    assert_eq!(info["survey"]["format"], "echogrid-recording", "{info}");

    let bytes = recording.metadata().unwrap().len();
    let cuts: Vec<u64> = (1..20).map(|part| part * bytes / 20 + part).collect();
    let Some(told) = read_by_python(&recording, &cuts) else { return };
    let count = |of: &Value, topic: &str| of["topics"][topic]["count"].as_u64().unwrap_or(0);
    let whole = &told["whole"];
    assert!(whole["error"].is_null() && count(whole, "range/scan") == scans, "{told}");
    assert!(["/map", "/pose", "/tf", "/path", "/log"].iter().all(|topic| count(whole, topic) > 0), "{told}");
    assert_eq!(whole["topics"]["/map"]["schema"], "foxglove.Grid");
    let mut last = 0;
    for cut in cuts {
        let scans = count(&told["cuts"][cut.to_string()], "range/scan");
        assert!(scans >= last, "{cut}: {told}");
        last = scans;
    }
    assert!(last > 0, "{told}");
}

/// A recording alone makes the run's map: it carries the settings, which are told, and give way to those that are said.
#[test]
fn a_recording_is_mapped_with_the_settings_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let run = path(&out("run"));
    let mut arguments = vec!["demo", "--fix", "truth", "--out", &run, "--record"];
    let settings = ["mapper.resolution_m=0.15", "mapper.sonars=[0, 3, 4, 7]", "publisher.draw_legend=true"];
    for setting in settings.into_iter().chain(["simulator.duration_s=15"]) {
        arguments.extend(["--set", setting]);
    }
    let recorded = echogrid(arguments);
    assert!(recorded.status.success(), "{}", said(&recorded));
    let recording = path(&out("run/recording.mcap"));

    let again = echogrid(["map", &recording, "--out", &path(&out("again"))]);
    let told = said(&again);
    assert!(again.status.success() && told.contains("mapper.resolution_m = 0.15"), "{told}");
    assert_same_map(&out("run"), &out("again"));
    let info = echogrid(["info", &recording, "--json"]);
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["settings"]["mapper.resolution_m"], 0.15, "{info}");
    assert_eq!(info["settings"]["localizer.source"], "truth", "{info}");

    // What is said counts, and no fix is asked for by who says that there is none.
    let finer = ["--set", "mapper.resolution_m=0.1", "--fix", "none"];
    let finer = echogrid([&["map", &recording, "--json", "--out", &path(&out("finer"))], &finer[..]].concat());
    assert_eq!(summary(&finer)["fixes"], 0, "{}", said(&finer));
    let defaults = ["map", &recording, "--set", "replay.use_settings=false", "--out", &path(&out("defaults"))];
    let defaults = echogrid(defaults);
    assert!(defaults.status.success() && !said(&defaults).contains("as in the run"), "{}", said(&defaults));
    assert_ne!(std::fs::read(out("run/map.npy")).unwrap(), std::fs::read(out("defaults/map.npy")).unwrap());
}

/// A disk, and shared memory apart from that of other tests.
const MOUNT: &str = "mount -t tmpfs -o size=4m tmpfs \"$1\" && mount -t tmpfs -o size=256m tmpfs /dev/shm";

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    in_a_namespace("recorder::recording_onto_a_full_disk", MOUNT, folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn recording_onto_a_full_disk() {
    let Some(disk) = folder_in_a_namespace() else { return };
    let drive = Drive::new(10.0);
    let run = drive.map("run", &[]);
    assert!(run.status.success(), "{}", said(&run));
    fill(&disk, 64 << 10);
    let record = format!("--record={}", disk.join("run.mcap").display());
    let recorded = drive.map("recorded", &[&record]);
    let said = said(&recorded);
    assert!(said.contains("the recording ends here") && said.contains("No space left on device"), "{said}");
    // The map is there, and nobody takes the part for the whole.
    assert_eq!(recorded.status.code(), Some(1), "{said}");
    assert!(said.contains("run.mcap: the recording ended before the run did"), "{said}");
    assert_same_map(&drive.out("run"), &drive.out("recorded"));
}

#[test]
fn a_recording_is_never_replaced() {
    let drive = Drive::new(1.0);
    let file = drive.out("run.mcap");
    std::fs::write(&file, "the drive of a day").unwrap();
    let refused = drive.map("run", &[&format!("--record={}", file.display())]);
    assert!(!refused.status.success() && said(&refused).contains("never replaced"), "{}", said(&refused));
    assert_eq!(std::fs::read(&file).unwrap(), b"the drive of a day");
}

#[test]
fn a_graph_that_runs_is_recorded_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (folder.path().join("maps"), folder.path().join("run.mcap"));
    let mut graph = GraphProcess::start(ECHOGRID, ["demo", "--rate", "8", "--out", &path(&out)]);
    graph.wait_for_progress("mapper", 100);
    let domain = graph.domain().name().to_owned();
    let recorder = Command::new(ECHOGRID)
        .args(["record", &path(&file), "--domain", &domain])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    graph.wait_for_progress("mapper", 400);
    kill(Pid::from_raw(recorder.id() as i32), Signal::SIGINT).unwrap();
    let recorded = recorder.wait_with_output().unwrap();
    assert!(recorded.status.success() && said(&recorded).contains(" messages, "), "{}", said(&recorded));
    graph.signal(Signal::SIGINT);
    assert!(graph.wait().status.success());
    let info: Value = serde_json::from_slice(&echogrid(["info", &path(&file), "--json"]).stdout).unwrap();
    assert!(info["survey"]["scan_count"].as_u64().is_some_and(|scans| scans > 0), "{info}");
}
