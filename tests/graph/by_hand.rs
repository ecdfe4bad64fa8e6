//! Closures by hand: what SLAM recognised is forbidden or required by its name.

use serde_json::Value;

use crate::localization::simulated;
use crate::support::{echogrid, path, said, summary};

#[test]
fn closures_are_forbidden_and_required_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let there_and_back = "simulator.route=[[1.5,6],[8,6],[11,3],[8,6],[1.5,6],[8,6]]";
    let drive = ["--robot", "laser", "--fix", "none", "--set", there_and_back];
    let (log, _) = simulated(folder.path(), "drive", "office", 1, &drive);
    let out = |name: &str| path(&folder.path().join(name));
    let map =
        |name: &str, more: &[&str]| echogrid(["map", &log, "--slam", "-q", "--out", &out(name)].iter().chain(more));
    let closures = |name: &str| -> Vec<Value> {
        let report = summary(&echogrid(["closures", &out(name), "--json"]));
        report["closures"].as_array().unwrap().clone()
    };
    let name = |closure: &Value| format!("{},{}", closure["from"], closure["to"]);
    let standing = |closures: &[Value], of: &str| {
        let found = closures.iter().find(|closure| name(closure) == of);
        found.map(|closure| closure["standing"].as_str().unwrap().to_owned())
    };
    assert!(map("plain", &[]).status.success());
    let plain = closures("plain");
    let applied = name(plain.iter().find(|closure| closure["standing"] == "applied").unwrap());
    let table = echogrid(["closures", &out("plain")]);
    assert!(said(&table).contains(&applied), "{}", said(&table));
    // That one, and its neighbours that say the same.
    for twice in ["forbidden", "again"] {
        let output = map(twice, &["--forbid", &applied]);
        assert!(output.status.success(), "{}", said(&output));
    }
    let forbidden = closures("forbidden");
    assert_eq!(standing(&forbidden, &applied).as_deref(), Some("forbidden"));
    assert!(said(&echogrid(["closures", &out("forbidden")])).contains("forbidden by hand"));
    let bytes = |name: &str| std::fs::read(folder.path().join(name).join("path.tum")).unwrap();
    assert!(bytes("forbidden") == bytes("again") && bytes("forbidden") != bytes("plain"));
    // One that somebody vouches for counts, whether others agree or not.
    let alone = plain.iter().find(|closure| closure["standing"] == "alone").map_or(applied.clone(), name);
    let output = map("required", &["--require", &alone]);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(standing(&closures("required"), &alone).as_deref(), Some("required"));
    // What was not found is told, with what was.
    let (from, to) = applied.split_once(',').unwrap();
    let (from, to): (u32, u32) = (from.parse().unwrap(), to.parse().unwrap());
    for (flag, nodes) in [("--require", format!("{from},{}", to + 1)), ("--forbid", format!("{to},{}", to + 100_000))] {
        let output = map("unknown", &[flag, &nodes]);
        let told = said(&output);
        assert!(!output.status.success() && told.contains("no such closure was found; the nearest are"), "{told}");
    }
    for (arguments, expected) in [
        (&["--forbid", "12"][..], "as `echogrid closures` prints them: 12,345"),
        (&["--forbid", "12,3"], "the place first"),
        (&["--forbid", "1,9", "--require", "1,9"], "what is not in forbid"),
    ] {
        let output = map("wrong", arguments);
        assert!(!output.status.success() && said(&output).contains(expected), "{}", said(&output));
    }
    // What the path claims of its error is held against the truth.
    let map = path(&folder.path().join("plain/map.echogrid"));
    let score = summary(&echogrid(["score", &map, "--world", "office", "--path", &log, "--json"]));
    let claims = &score["claims"];
    assert!(claims["poses"].as_u64().unwrap() > 50, "{score}");
    assert!((0.01..30.0).contains(&claims["nees_mean"].as_f64().unwrap()), "{score}");
}
