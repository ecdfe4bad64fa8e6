//! Drives of real robots, where the data is there.

use echogrid_formats::log;
use echogrid_formats::map::native;

use crate::support::{data, echogrid, summary};

/// Maps a log; its counts must be in the summary, and at least `cells` cells decided.
fn check(name: &str, cells: u64) {
    let Some(path) = data(name) else { return };
    let surveyed = log::survey(&path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("maps");
    let summary = summary(&echogrid(["map", path.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json", "-q"]));
    assert_eq!(summary["scans"], surveyed.scan_count, "{name}");
    assert_eq!(summary["odometry"], surveyed.odometry_count, "{name}");
    assert_eq!(summary["readings"], surveyed.reading_count, "{name}");
    assert_eq!(summary["lost_messages"], 0, "{name}");
    let decided = summary["cells"]["free"].as_u64().unwrap() + summary["cells"]["occupied"].as_u64().unwrap();
    assert!(decided > cells, "{name}: {decided} cells decided");
    let map = native::read(&out.join("map.echogrid")).unwrap();
    assert_eq!(map.provenance.log_sha256.as_deref(), Some(surveyed.sha256.as_str()));
}

#[test]
fn aces() {
    check("carmen/aces-raw.log.gz", 300_000);
}

#[test]
fn freiburg_101() {
    check("carmen/freiburg-101-raw.log.gz", 300_000);
}

#[test]
fn belgioioso_whose_stamps_are_of_no_use() {
    check("carmen/belgioioso-raw.log.gz", 200_000);
}

#[test]
fn udacity_sonar() {
    check("sonar/udacity", 10_000);
}
