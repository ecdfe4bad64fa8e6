//! A second drive goes on with the map of the first (`--continue`).

use std::path::Path;

use echogrid_core::Grid;
use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;

use crate::localization::simulated;
use crate::support::{ECHOGRID, echogrid, path, said, summary};

fn known(grid: &Grid) -> usize {
    grid.tiles().map(|(_, tile)| tile.log_odds.iter().filter(|value| !value.is_nan()).count()).sum()
}

fn goes_on(folder: &Path, robot: &str) {
    let robot_is = ["--robot", robot];
    let simulate = |name: &str, seed: u32, more: &[&str]| {
        simulated(folder, &format!("{robot}-{name}"), "office", seed, &[&robot_is[..], more].concat())
    };
    let (_, first) = simulate("first", 1, &["--fix-every", "0.3m"]);
    let (log, _) = simulate("second", 5, &["--fix", "none"]);
    let out = |name: &str| folder.join(format!("{robot}-{name}"));
    // The folder of a map is it.
    let earlier = path(&out("first"));
    let arguments = |name: &str| {
        let arguments = ["map", &log, "--continue", &earlier, "--json", "-q", "--out", &path(&out(name))];
        arguments.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let untouched = std::fs::read(&first).unwrap();
    let found = summary(&echogrid(arguments("both")));
    assert!(found["fixes"].as_u64().unwrap() >= 5, "{found}");
    assert!(std::fs::read(&first).unwrap() == untouched, "the first map is left alone");
    let read = |name: &str| native::read(&out(name).join("map.echogrid")).unwrap();
    let (before, both) = (read("first"), read("both"));
    // The path is that of both, and what the first drive knew is known still, and more certainly.
    assert_eq!(both.path[..before.path.len()], before.path[..]);
    assert!(both.path.len() > before.path.len() + 50 && both.last_drive().len() == both.path.len() - before.path.len());
    assert_eq!(both.provenance.earlier, ["live"]);
    let is_known = |grid: &Grid, cell| grid.log_odds(cell).is_some();
    for (index, tile) in before.grid.tiles() {
        let first_cell = index.first_cell();
        let cells = (0..64 * 64).filter(|offset: &usize| !tile.log_odds[*offset].is_nan());
        for offset in cells {
            let (i, j) = (first_cell.i + (offset % 64) as i32, first_cell.j + (offset / 64) as i32);
            assert!(is_known(&both.grid, echogrid_core::CellIndex { i, j }));
        }
    }
    assert!(known(&both.grid) >= known(&before.grid));
    let info = summary(&echogrid(["info", &path(&out("both").join("map.echogrid")), "--json"]));
    assert_eq!(info["provenance"]["earlier"].as_array().unwrap().len(), 1, "{info}");
    // Killed on the way, it is the same map, which a third drive can go on with.
    let mut graph = GraphProcess::start(ECHOGRID, arguments("killed"));
    for (service, messages) in [("mapper", 100), ("publisher", 200), ("mapper", 300)] {
        graph.wait_for_progress(service, messages);
        graph.kill(service);
    }
    let ended = graph.wait();
    assert!(ended.restarts() >= 1, "{:?}", ended.summary());
    let bytes = |name: &str| std::fs::read(out(name).join("map.echogrid")).unwrap();
    assert!(bytes("killed") == bytes("both"), "the maps differ");
    // So is that of its recording.
    let recorded = echogrid(arguments("recorded").into_iter().chain(["--record".to_owned()]));
    assert!(recorded.status.success(), "{}", said(&recorded));
    let recording = path(&out("recorded").join("recording.mcap"));
    let played = echogrid(["map", &recording, "-q", "--out", &path(&out("played"))]);
    assert!(played.status.success() && said(&played).contains("run.continue = "), "{}", said(&played));
    let cells = |name: &str| std::fs::read(out(name).join("map.npy")).unwrap();
    assert!(cells("played") == cells("both") && cells("recorded") == cells("both"));
    let both = path(&out("both"));
    let third = summary(&echogrid(["map", &log, "--continue", &both, "--json", "-q", "--out", &path(&out("third"))]));
    assert!(third["fixes"].as_u64().unwrap() >= 5 && read("third").provenance.earlier.len() == 2, "{third}");
}

#[test]
fn sonars_go_on_with_the_map_of_an_earlier_drive() {
    goes_on(tempfile::tempdir().unwrap().path(), "pioneer3at");
}

#[test]
fn a_lidar_goes_on_with_the_map_of_an_earlier_drive() {
    goes_on(tempfile::tempdir().unwrap().path(), "laser");
}

#[test]
fn a_map_that_can_not_be_gone_on_with_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (log, map) = simulated(folder.path(), "first", "office", 1, &["--fix-every", "0.3m"]);
    let (elsewhere, _) = simulated(folder.path(), "elsewhere", "room", 1, &["--set", "simulator.route=\"tour\""]);
    let other = folder.path().join("other");
    let out = path(&other);
    let refused = |log: &str, map: &str, more: &[&str], why: &str| {
        let output = echogrid(["map", log, "--continue", map, "--out", &out, "-q"].iter().chain(more));
        assert!(!output.status.success() && said(&output).contains(why), "{more:?}: {}", said(&output));
        assert!(!other.join("map.echogrid").exists(), "{more:?}");
    };
    refused(&log, &map, &["--set", "mapper.resolution_m=0.1"], "mapper.resolution_m is 0.1 now and was 0.05");
    refused(&log, &map, &["--set", "mapper.fusion=paper"], "mapper.fusion is \"paper\" now and was \"auto\"");
    refused(&log, &map, &["--set", "mapper.doubt=true"], "mapper.doubt: of the drives that are gone on with");
    refused(&log, &map, &["--set", "odometry.start=odometry"], "begins where the map shows it to be");
    refused(&log, &map, &["--slam"], "cannot be used with");
    refused(&log, &map, &["--forbid", "1,2"], "cannot be used with");
    refused(&log, &map, &["--set", "localizer.source=none"], "localizer.source: a drive that goes on with a map");
    refused(&log, "", &[], "a value is required for '--continue <MAP>'");
    refused(&log, "no/such.echogrid", &[], "no/such.echogrid");
    refused(&log, &log, &[], "not a native map");
    // Of another building.
    refused(&elsewhere, &map, &[], "not recognised in");
    let there = folder.path().join("elsewhere");
    let before = std::fs::read(there.join("map.echogrid")).unwrap();
    let output = echogrid(["map", &elsewhere, "--continue", &map, "--out", &path(&there), "-q"]);
    assert!(!output.status.success() && said(&output).contains("is of an earlier run"), "{}", said(&output));
    assert!(std::fs::read(there.join("map.echogrid")).unwrap() == before);
    // As an earlier version saved it.
    let mut stateless = native::read(Path::new(&map)).unwrap();
    let indices: Vec<_> = stateless.grid.tiles().map(|(index, _)| index).collect();
    indices.into_iter().for_each(|index| stateless.grid.tile_mut(index).shares = None);
    let file = folder.path().join("stateless.echogrid");
    native::write(&file, &stateless).unwrap();
    refused(&log, &path(&file), &[], "it lacks the states of its cells");
    // Nobody's own map is replaced.
    let before = std::fs::read(&map).unwrap();
    let into_itself = echogrid(["map", &log, "--continue", &map, "--out", &path(&folder.path().join("first"))]);
    assert!(!into_itself.status.success() && said(&into_itself).contains("name another folder with --out"));
    assert!(std::fs::read(&map).unwrap() == before);
}
