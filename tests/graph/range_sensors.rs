//! Range sensors of every kind, through the whole graph: the room that was driven in is mapped, and nothing outside of it.

use crate::support::{data, echogrid, said, summary};

/// Maps a recording of the room of 8 × 6 m without odometry error; the extent, metres, and what was said of the log.
fn map(name: &str) -> Option<([f64; 2], String)> {
    let log = data(&format!("faults/{name}.log"))?;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("maps");
    let exact = ["k_ll", "k_lt", "k_tt", "k_tl"].map(|key| ["--set".to_owned(), format!("odometry.{key}=0")]);
    let arguments = ["map", log.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json", "-q"].map(str::to_owned);
    let summary = summary(&echogrid(arguments.into_iter().chain(exact.into_iter().flatten())));
    assert_eq!((&summary["faulty_messages"], &summary["lost_messages"]), (&0.into(), &0.into()), "{name}: {summary}");
    let extent_m = [0, 1].map(|side| summary["extent_m"][side].as_f64().unwrap());
    Some((extent_m, summary["log_faults"].to_string()))
}

#[test]
fn the_room_is_mapped_whatever_the_lidar() {
    for (name, least, told) in [
        ("B1-beam-count-varies", [8.0, 6.0], "60 to 121"),
        ("B2-four-beams", [8.0, 6.0], "1° wide"),
        ("B3-negative-step", [8.0, 6.0], "[]"),
        ("B4-rear-as-FLASER", [8.0, 6.0], "180.0°"),
        ("C1-max-1e6", [8.0, 6.0], "1000000 m (line 2)"),
        ("D3-range-in-mm", [8.0, 4.5], "millimetres"),
        ("E1-utm", [8.0, 5.5], ""),
    ] {
        let Some((extent_m, remarks)) = map(name) else { continue };
        let is_the_room = (0..2).all(|side| extent_m[side] >= least[side] && extent_m[side] <= [8.3, 6.3][side]);
        assert!(is_the_room, "{name}: {extent_m:?}");
        assert!(told == "[]" || remarks.contains(told), "{name}: {remarks}");
    }
}

#[test]
fn odd_cones_and_many_sonars_are_mapped() {
    for (name, told) in [
        ("C2-cone-6.2832", "wider than 90°"),
        ("C3-cone-0", "one of 30°"),
        ("C4-cone-in-degrees-5", "read as degrees"),
        ("C5-33-sonars", ""),
    ] {
        let Some((extent_m, remarks)) = map(name) else { continue };
        assert!(extent_m[0] > 5.0 && extent_m[1] > 6.0, "{name}: {extent_m:?}");
        assert!(remarks.contains(told), "{name}: {remarks}");
    }
}

/// One error, before anything starts.
#[track_caller]
fn refused(log: &str, more: &[&str], snippets: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log");
    std::fs::write(&path, log).unwrap();
    let out = folder.path().join("maps");
    let arguments = ["map", path.to_str().unwrap(), "--out", out.to_str().unwrap(), "-q"];
    let output = echogrid(arguments.iter().chain(more));
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(snippets.iter().all(|snippet| error.contains(snippet)), "{snippets:?}: {error}");
    assert_eq!(error.trim().lines().count(), 1, "{error}");
}

#[test]
fn what_no_map_can_be_made_of_is_refused_before_anything_starts() {
    let far = " 3000 4000 5000 6000".repeat(5);
    let lines = format!("ODOM 0 0 0 0 0 0 1.0 h 1\nFLASER 20{far} 0 0 0 0 0 0 1.0 h 1\n");
    refused(&lines, &[], &["drive.log:2", "FLASER", "replay.range_unit=mm"]);
    let sonars = format!("ODOM 0 0 0 0 0 0 1.0 h 1\nSONAR 0.3 300{} 1.0 h 1\n", " 1".repeat(4 * 300));
    refused(&sonars, &[], &["drive.log:2", "300 sonars", "256"]);
    let beams = format!("ODOM 0 0 0 0 0 0 1.0 h 1\nFLASER 90{} 0 0 0 0 0 0 1.0 h 1\n", " 1.5".repeat(90));
    refused(&beams, &["--robot", "pioneer3at"], &["16 transducers", "readings of 90"]);
}

/// Codes and glitches of kilometres fill no memory.
#[test]
fn rays_of_kilometres_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log");
    let line = |n: u32| {
        let ranges: String = (0..181).map(|beam| if beam % 20 == n % 20 { " 9000" } else { " 2.5" }).collect();
        format!(
            "ODOM 0 0 0 0 0 0 {n}.0 h 1\nROBOTLASER1 0 -1.5708 3.14159 0.0174533 1e6 0 0 181{ranges} 0 0 0 0 0 0 0 0 0 0 0 0 {n}.0 h 1\n"
        )
    };
    std::fs::write(&path, (1..30).map(line).collect::<String>()).unwrap();
    let out = folder.path().join("maps");
    let more = ["--json", "-q", "--set", "mapper.no_echo=clear"];
    let summary =
        summary(&echogrid(["map", path.to_str().unwrap(), "--out", out.to_str().unwrap()].iter().chain(&more)));
    let extent_m = [0, 1].map(|side| summary["extent_m"][side].as_f64().unwrap());
    assert!(extent_m.iter().all(|side_m| *side_m < 201.0), "{summary}");
}
