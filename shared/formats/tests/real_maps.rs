//! Maps that other programs wrote, read where they lie: `$ECHOGRID_DATA`, or `../shared/data` beside the workspace.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use echogrid_formats::map::map_server;

fn check(name: &str, width: usize, height: usize, has_unknown: bool) {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join("map_server").join(name);
    if !path.exists() {
        println!("skipped: {name} is not there");
        return;
    }
    let (yaml, map) = map_server::read(&path).unwrap();
    assert_eq!((map.width, map.height), (width, height));
    let count = |is: fn(f32) -> bool| map.probability.iter().filter(|p| is(**p)).count();
    let (occupied, free, unknown) = (count(|p| p == 1.0), count(|p| p == 0.0), count(f32::is_nan));
    println!("{name}: {occupied} occupied, {free} free, {unknown} unknown; {yaml:?}");
    assert_eq!(occupied + free + unknown, width * height);
    assert!(occupied > 1000 && free > 1000);
    assert_eq!(unknown > 0, has_unknown);
}

#[test]
fn ac109_is_a_colour_image() {
    check("ac109_1.yaml", 1088, 1088, true);
}

/// YAML as many tools write it; a map of one and the same room.
#[test]
fn yaml_of_every_kind() {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let names = ["maps/folded", "maps/json", "maps/originml", "maps/tab", "pass/bom", "pass/crlf", "pass/p2"];
    let mut maps = Vec::new();
    for name in names {
        let path = root.join("faults").join(name).with_extension("yaml");
        if !path.exists() {
            println!("skipped: {name} is not there");
            return;
        }
        let (yaml, map) = map_server::read(&path).unwrap();
        assert_eq!((yaml.resolution_m, yaml.origin), (0.05, [-4.1, -3.1, 0.0]), "{name}");
        maps.push(map.probability.iter().map(|p| p.to_bits()).collect::<Vec<_>>());
    }
    assert!(maps.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn depot() {
    // Its free_thresh, 0.25, makes 205 free: what map_server does with it, too.
    check("depot.yaml", 604, 307, false);
}

#[test]
fn meeting() {
    check("meeting.yaml", 602, 602, true);
}
