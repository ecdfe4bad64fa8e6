//! The paper's experiment, as one command.

use serde_json::Value;

use crate::support::{echogrid, path, said, summary};

const VARIANTS: [&str; 8] =
    ["ignored", "carried", "localized", "corrected-alone", "corrected", "all-sonars", "exact", "exact-all-sonars"];

/// The figures of one way of mapping.
fn variant<'a>(report: &'a Value, name: &str) -> &'a Value {
    let mut variants = report["variants"].as_array().unwrap().iter();
    variants.find(|variant| variant["name"] == name).unwrap_or_else(|| panic!("no {name}: {report}"))
}

#[test]
fn pictures_maps_scores_and_a_table_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let (out, again) = (folder.path().join("out"), folder.path().join("again"));
    let output = echogrid(["experiment", "paper", "--world", "room", "--out", &path(&out)]);
    assert!(output.status.success(), "{}", said(&output));
    let report: Value = serde_json::from_slice(&std::fs::read(out.join("scores.json")).unwrap()).unwrap();
    assert_eq!((report["world"].as_str(), report["seed"].as_u64()), (Some("room"), Some(1)), "{report}");
    assert_eq!(report["moments"].as_array().unwrap().len(), 4);
    let is_png = |file: &str| std::fs::read(out.join(file)).unwrap().starts_with(b"\x89PNG");
    assert!(is_png("experiment.png"));
    for name in VARIANTS {
        let figures = variant(&report, name);
        for share in ["decided", "decided_wrong", "wall_recall_10cm", "wall_precision_10cm", "false_walls"] {
            assert!(figures[share].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share)), "{share}: {figures}");
        }
        for figure in ["bits", "bits_occupied", "bits_free", "walls_behind_m2", "free_behind_m2"] {
            assert!(figures[figure].as_f64().is_some_and(|value| (0.0..20.0).contains(&value)), "{figure}: {figures}");
        }
        assert!(figures["readings_used"].as_u64().unwrap() > 100, "{figures}");
        assert_eq!((figures["trust"].as_array().unwrap().len(), figures["off_m"].as_array().unwrap().len()), (4, 4));
        assert!(is_png(&format!("{name}/map.png")) && out.join(name).join("map.echogrid").is_file());
        assert!(String::from_utf8_lossy(&output.stdout).contains(name), "{}", said(&output));
    }
    // Repeatable to the byte; another seed is another drive.
    let once_more = |seed: &str| {
        summary(&echogrid(["experiment", "paper", "--world", "room", "--json", "--seed", seed, "--out", &path(&again)]))
    };
    assert_eq!(once_more("1")["variants"], report["variants"]);
    let sheet = |folder: &std::path::Path| std::fs::read(folder.join("experiment.png")).unwrap();
    assert!(sheet(&out) == sheet(&again), "the sheets differ");
    assert_ne!(once_more("2")["variants"], report["variants"]);
}

/// Section 4 of the paper, in the corridor of the office.
#[test]
fn the_papers_claims_hold_in_the_office() {
    let folder = tempfile::tempdir().unwrap();
    let report =
        summary(&echogrid(["experiment", "paper", "--world", "office", "--json", "--out", &path(folder.path())]));
    let figure = |name: &str, key: &str| variant(&report, name)[key].as_f64().unwrap();
    let trust_at_the_end = |name: &str| variant(&report, name)["trust"][3].as_f64().unwrap();
    // Figs 11, 12: what is doubtful fades; what is believed is wrong.
    assert!(trust_at_the_end("ignored") > 0.99 && trust_at_the_end("carried") < 0.01, "{report}");
    assert!(figure("carried", "decided") < 0.25 * figure("ignored", "decided"), "{report}");
    assert!(figure("carried", "bits") < 1.0 && figure("ignored", "bits") > 1.5, "{report}");
    // Figs 9, 13 to 15: localized now and then, it is a map again.
    assert!(figure("localized", "fixes") >= 3.0);
    assert!(figure("localized", "bits") < figure("carried", "bits") - 0.1, "{report}");
    assert!(figure("localized", "wall_recall_10cm") > 0.6, "{report}");
    // Fig. 16: better still where the systematic error is taken out.
    assert!(figure("corrected", "bits") < figure("localized", "bits"), "{report}");
    // Fig. 10: oblique sonars hear walls behind the walls.
    for (side, all) in [("corrected", "all-sonars"), ("exact", "exact-all-sonars")] {
        assert!(figure(all, "false_walls") > 1.1 * figure(side, "false_walls"), "{report}");
        assert!(figure(all, "bits") > figure(side, "bits") + 0.1, "{report}");
    }
}

#[test]
fn what_is_wrong_is_told_and_nothing_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let check = |arguments: &[&str], code: i32, snippets: &[&str]| {
        let output = echogrid([&["experiment"], arguments, &["--out", &path(&out)]].concat());
        assert_eq!(output.status.code(), Some(code), "{}", said(&output));
        assert!(snippets.iter().all(|snippet| said(&output).contains(snippet)), "{}", said(&output));
        assert!(!out.exists(), "something was made");
    };
    check(&["paper", "--world", "rom"], 1, &["rom", "did you mean room?"]);
    check(&["paper", "--world", "/nowhere/a.map"], 1, &["/nowhere/a.map: no such file"]);
    check(&["papre"], 2, &["papre", "paper"]);
    check(&["paper", "--seed=-1"], 2, &["--seed"]);
}
