//! Bad input gets one clear error, and no graph is started for nothing.

use std::io::Write as _;
use std::process::Output;

use echogrid_service::process::NO_GRAPH;

use crate::support::{Drive, echogrid, folder_in_a_namespace, in_a_namespace, mount_shared_memory, said, summary};

/// Runs with `arguments`; the one error must hold every one of `snippets`.
fn check(arguments: &[&str], snippets: &[&str]) {
    refused(&echogrid(arguments), snippets);
}

fn refused(output: &Output, snippets: &[&str]) {
    assert_eq!(output.status.code(), Some(1), "{}", said(output));
    let error = String::from_utf8_lossy(&output.stderr);
    for snippet in snippets {
        assert!(error.contains(snippet), "no {snippet:?} in:\n{error}");
    }
    assert!(!error.contains("panicked"), "{error}");
}

/// `echogrid map` of a log with this content.
fn map(content: &[u8]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("drive.log");
    std::fs::write(&log, content).unwrap();
    echogrid(["map", log.to_str().unwrap(), "--out", folder.path().join("maps").to_str().unwrap(), "--json", "-q"])
}

const FEW_LINES: &str = "\
ODOM 0 0 0 0 0 0 0.1 host 0.1
FLASER 3 1 2 1 0 0 0 0 0 0 0.1 host 0.1
ODOM 0.1 0 0 0 0 0 0.2 host 0.2
FLASER 3 1 2 1 0.1 0 0 0.1 0 0 0.2 host 0.2
";

#[test]
fn logs_from_which_nothing_can_be_mapped() {
    check(&["map", "/nowhere/drive.log"], &["/nowhere/drive.log"]);
    check(&["map", "/"], &["/"]);
    refused(&map(b""), &["drive.log", "empty"]);
    refused(&map(b"PNG\x89\x00\x01\x02 nothing of the kind \xff\xfe\x00"), &["drive.log", "CARMEN"]);
    refused(&map(b"RAWLASER1 0 -1.57 3.14 0.0174 80 0.01 0 3 1 2 1 0 0.1 h 0.1\n# no pose\n"), &["drive.log"]);
    refused(&map(b"ODOM 0 0 0 0 0 0 0.1 h 0.1\nODOM 0 0 0 0 0 0 0.2 h 0.2\n"), &["drive.log", "readings"]);
}

#[test]
fn damage_is_counted_and_the_rest_is_mapped() {
    let mut log = FEW_LINES.to_owned();
    log += "ODOM nan 0 0 0 0 0 0.3 host 0.3\n";
    log += "ODOM 1e99 0 0 0 0 0 0.3 host 0.3\n";
    log += "WOBBLE 1 2 3\n";
    log += "FLASER 3 1 2";
    let output = map(log.as_bytes());
    let summary = summary(&output);
    assert_eq!(summary["scans"], 2);
    assert_eq!(summary["odometry"], 2);
    let remarks = summary["log_faults"].to_string();
    for remark in ["nan", "1e99", "WOBBLE", "line"] {
        assert!(remarks.contains(remark), "no {remark:?} in {remarks}");
    }
}

#[test]
fn a_truncated_gzip_gives_the_map_so_far() {
    let drive = Drive::new(6.0);
    let text = std::fs::read(drive.log()).unwrap();
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&text).unwrap();
    let whole = encoder.finish().unwrap();
    let summary = summary(&map(&whole[..whole.len() / 2]));
    assert!(summary["scans"].as_u64().unwrap() > 10);
    assert!(summary["log_faults"].to_string().contains("compressed"), "{summary}");
}

#[test]
fn an_output_directory_that_cannot_be_written() {
    let drive = Drive::new(0.5);
    let output = drive.map("drive.log/maps", &[]);
    refused(&output, &["drive.log/maps"]);
}

#[test]
fn a_folder_where_a_file_of_the_map_would_be() {
    let drive = Drive::new(0.5);
    for name in ["map.png", "map.yaml", "map.echogrid", "readings.echogrid"] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join(name)).unwrap();
        check(
            &["map", drive.log().to_str().unwrap(), "--out", folder.path().to_str().unwrap(), "-q"],
            &[name, "a folder of this name stands there"],
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was started");
    }
}

/// Who opens a pipe that nobody writes into waits for ever: these tests would hang.
#[test]
fn a_pipe_is_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (pipe, map) = (path("pipe"), path("map.yaml"));
    for name in ["pipe", "world.toml", "table.csv", "a.echogrid"] {
        assert!(std::process::Command::new("mkfifo").arg(path(name)).status().unwrap().success());
    }
    let yaml = "resolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
    std::fs::write(&map, format!("image: pipe\n{yaml}")).unwrap();
    let drive = Drive::new(0.5);
    let (log, out) = (drive.log(), path("maps"));
    let log = log.to_str().unwrap();
    check(&["map", &pipe, "--out", &out], &["pipe: not a regular file"]);
    for arguments in [
        ["map", log, "--config", &pipe, "--out", &out].as_slice(),
        &["map", log, "--fix", &pipe, "--out", &out],
        &["map", log, "--robot", &pipe, "--out", &out],
        &["demo", "--set", &format!("simulator.world={}", path("world.toml")), "--out", &out],
        &["up", &pipe],
        &["check", &pipe],
        &["calibrate", &path("table.csv")],
        &["convert", &map, &path("map.pgm")],
        &["convert", &pipe, &path("map.pgm")],
        &["score", &path("a.echogrid"), "--world", "room"],
        &["walls", &path("a.echogrid")],
    ] {
        check(arguments, &["a pipe; expected a regular file"]);
    }
    std::fs::write(&map, format!("image: /dev/zero\n{yaml}")).unwrap();
    check(&["convert", &map, &path("map.pgm")], &["/dev/zero: can't be read: a device; expected a regular file"]);
}

/// Who begins its texts with a mark of their encoding is not to suffer for it.
#[test]
fn settings_that_begin_with_a_byte_order_mark() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("config.toml");
    std::fs::write(&config, "\u{feff}[mapper]\nresolution_m = 0.1\n").unwrap();
    let output = echogrid(["check", config.to_str().unwrap(), "--sensor", "replay"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("resolution_m = 0.1"), "{}", said(&output));
    std::fs::write(&config, "\u{feff}[mapper]\nresolutoin_m = 0.1\n").unwrap();
    check(
        &["check", config.to_str().unwrap(), "--sensor", "replay"],
        &["config.toml:2", "resolutoin_m", "resolution_m"],
    );
}

/// What the machine lacks is told with its figures, beside what failed for it.
#[test]
fn limits_that_are_too_low_are_named_by_the_error() {
    let drive = Drive::new(0.5);
    let check = |limit: &str, snippets: &[&str]| {
        let script = format!("{limit} && exec \"$0\" map \"$1\" -q --out \"$2\"");
        let folder = tempfile::tempdir().unwrap();
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &script, crate::support::ECHOGRID]).arg(drive.log()).arg(folder.path());
        refused(&command.output().unwrap(), snippets);
    };
    check(
        "ulimit -n 48",
        &["`echogrid doctor` finds a problem with open files: at most 48 per process", "may be needed"],
    );
    check("ulimit -v 52000", &["address space: 50 MiB per process allowed", "may be needed", "`echogrid doctor`"]);
}

#[test]
fn configuration_that_is_typed_wrong() {
    let drive = Drive::new(0.5);
    let set = |assignment: &str, snippets: &[&str]| refused(&drive.map("maps", &["--set", assignment]), snippets);
    set("mapper.resolutoin_m=0.1", &["resolutoin_m", "did you mean", "resolution_m"]);
    set("mapper.resolution=0.1", &["resolution_m"]);
    set("mapper.resolution_m=5cm", &["resolution_m", "5cm"]);
    set("mapper.resolution_m=-1", &["resolution_m", "-1"]);
    set("mapper.p_occupied=0.2", &["p_occupied", "0.2"]);
    set("odometry.systematic=cary", &["systematic", "cary", "carry"]);
    set("mapper.fusion=bayes", &["fusion", "bayes", "paper"]);
    set("mapper.sonars=[0, 99]", &["sonars", "99"]);
    refused(&drive.map("maps", &["--rate", "fast"]), &["fast", "max"]);
    refused(&drive.map("maps", &["--robot", "pioneer3xt"]), &["pioneer3xt", "pioneer3at"]);
    refused(&drive.map("maps", &["--domain", "My Robot"]), &["My Robot"]);
}

#[test]
fn graph_files_that_are_wrong() {
    let drive = Drive::new(0.5);
    let graph = |text: &str, snippets: &[&str]| {
        let file = drive.out("graph.toml");
        std::fs::write(&file, text).unwrap();
        for command in ["up", "check"] {
            refused(&echogrid([command, file.to_str().unwrap()]), snippets);
        }
    };
    graph("[mapper]\nresolutoin_m = 0.1\n", &["graph.toml:2", "resolutoin_m", "did you mean `resolution_m`"]);
    graph("[mapper]\nresolution_m = \"5 cm\"\n", &["graph.toml:2", "resolution_m"]);
    graph(
        "[services.publisher]\nkind = \"publisher\"\nexec = \"./no-such-program\"\n",
        &["no-such-program", "publisher"],
    );
    graph("[mapper\n", &["graph.toml:1"]);
    check(&["up", "/nowhere/graph.toml"], &["/nowhere/graph.toml"]);
}

#[test]
fn a_command_line_that_makes_no_sense_is_wrong_usage() {
    for arguments in [&["mapp"][..], &["map"], &["map", "a", "b"], &["service", "cook"]] {
        let output = echogrid(arguments);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    }
}

#[test]
fn a_small_shared_memory_is_said_before_anything_is_started() {
    let folder = tempfile::tempdir().unwrap();
    let mount = "mount -t tmpfs -o size=8m tmpfs /dev/shm";
    in_a_namespace("bad_input::where_shared_memory_is_small", mount, folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn where_shared_memory_is_small() {
    if folder_in_a_namespace().is_none() {
        return;
    }
    let drive = Drive::new(0.5);
    let output = drive.map("maps", &[]);
    refused(&output, &["/dev/shm has 7 MiB free, this graph can need ", "--shm-size"]);
    assert_eq!(std::fs::read_dir("/dev/shm").unwrap().count(), 0);
    // The size that it names is enough, once there is room for so many files, too.
    let error = String::from_utf8_lossy(&output.stderr);
    let size = error.split("--shm-size=").nth(1).and_then(|rest| rest.split(')').next()).unwrap();
    mount_shared_memory(&format!("size={size},nr_inodes=100"));
    refused(&drive.map("maps", &[]), &["/dev/shm has room for ", " more files", "nr_inodes=64k"]);
    mount_shared_memory(&format!("size={size},nr_inodes=64k"));
    summary(&drive.map("maps", &["--json", "-q"]));
}

/// The code tells the launcher that it may not be the service's own fault.
#[test]
fn a_service_that_finds_no_graph_says_so_with_a_code_of_its_own() {
    for (arguments, expected) in [
        (&["service", "mapper"][..], "name the domain of a running graph (--domain)"),
        (&["service", "mapper", "--domain", "nowhere"], "domain \"nowhere\": no echogrid runs there"),
    ] {
        let refused = echogrid(arguments);
        assert_eq!(refused.status.code(), Some(i32::from(NO_GRAPH)), "{arguments:?}: {}", said(&refused));
        assert!(said(&refused).contains(expected), "{arguments:?}: {}", said(&refused));
    }
}
