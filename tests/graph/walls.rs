//! How straight the walls of a map are, as the program tells it.

use serde_json::Value;

use crate::support::{Drive, data, echogrid, path, said, summary};

#[test]
fn the_walls_of_a_map_are_told() {
    let drive = Drive::new(8.0);
    drive.native_map("maps", &[]);
    let (map, picture) = (path(&drive.out("maps/map.echogrid")), path(&drive.out("walls.png")));
    let found = summary(&echogrid(["walls", &map, "--json", "--picture", &picture]));
    assert!(found["walls"].as_array().is_some_and(|walls| !walls.is_empty()), "{found}");
    assert!(found["share"].as_f64().is_some_and(|share| (0.05..1.0).contains(&share)), "{found}");
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    let wider = summary(&echogrid(["walls", &map, "--json", "--within", "0.3"]));
    assert_ne!(wider["near"], found["near"], "other cells belong to a wall: {wider} {found}");
    let table = said(&echogrid(["walls", &map]));
    assert!(table.contains("map.echogrid: ") && table.contains("occupied cells within 0.15 m"), "{table}");
    let refused = echogrid(["walls", &path(&drive.log())]);
    assert!(refused.status.code() == Some(1) && said(&refused).contains("not a native map"), "{}", said(&refused));
    assert_eq!(echogrid(["walls", &map, "--within", "0"]).status.code(), Some(2));
}

/// A corridor that is 2.1 m wide, by a real ring of sonars: its walls are straight, by every rule.
#[test]
fn a_real_corridor_has_straight_walls() {
    let Some(log) = data("sonar/udacity") else { return };
    let folder = tempfile::tempdir().unwrap();
    let walls = |fusion: &str, more: &[&str]| -> Value {
        let (log, out, rule) = (path(&log), folder.path().join(fusion), format!("mapper.fusion={fusion}"));
        let mapped = echogrid([&["map", &log, "--out", &path(&out), "-q", "--set", &rule], more].concat());
        assert!(mapped.status.success(), "{}", said(&mapped));
        summary(&echogrid(["walls", &path(&out.join("map.echogrid")), "--json"]))
    };
    let bubble = "mapper.filters=[\"range\", \"selection\", \"stuck\", \"bubble\"]";
    let without_mirrors = ["--set", "mapper.sonars=corridor", "--set", bubble];
    for (fusion, share, share_beside, sets) in [
        ("paper", 0.28, 0.45, &without_mirrors[..]),
        ("covariance", 0.24, 0.60, &without_mirrors),
        ("first_echo", 0.40, 0.60, &without_mirrors),
        ("oriented", 0.40, 0.70, &without_mirrors[..2]),
    ] {
        let found = walls(fusion, sets);
        let figure = |name: &str| found[name].as_f64().unwrap();
        assert!((2.0..2.3).contains(&figure("distance_m")) && figure("angle_rad") < 0.05, "{fusion}: {found}");
        assert!(figure("share") > share && figure("share_beside") > share_beside, "{fusion}: {found}");
    }
}
