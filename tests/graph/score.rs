//! How good a map is, as the program tells it.

use crate::drive::OFFICE;
use crate::support::{Drive, data, echogrid, path, said, summary};

const FIGURES: [&str; 8] = [
    "bits",
    "bits_occupied",
    "bits_free",
    "calibration_error",
    "decided",
    "decided_wrong",
    "wall_recall_10cm",
    "wall_precision_10cm",
];

#[test]
fn a_drive_in_the_office_is_judged() {
    let drive = Drive::new(8.0);
    drive.native_map("maps", &[]);
    let (map, log, picture) =
        (path(&drive.out("maps/map.echogrid")), path(&drive.log()), path(&drive.out("score.png")));
    let score = |more: &[&str]| echogrid([&["score", &map, "--world", OFFICE][..], more].concat());
    let judged = summary(&score(&["--path", &log, "--json", "--picture", &picture]));
    for figure in FIGURES {
        assert!(judged[figure].as_f64().is_some_and(|value| (0.0..20.0).contains(&value)), "{figure}: {judged}");
    }
    // Most of what can be seen from the way was found, and hardly any of it wrong.
    assert!(judged["bits"].as_f64().unwrap() < 0.9, "{judged}");
    assert!(judged["wall_recall_10cm"].as_f64().unwrap() > 0.5, "{judged}");
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    let in_folder = echogrid(["score", &path(&drive.out("maps")), "--world", OFFICE, "--path", &log, "--json"]);
    assert_eq!(summary(&in_folder)["bits"], judged["bits"]);
    let elsewhere = said(&echogrid(["score", &map, "--world", "floor-5"]));
    assert!(elsewhere.contains("worse than a map that knows nothing: is this its world"), "{elsewhere}");
    let table = said(&score(&["--path", &log]));
    assert!(!table.contains("knows nothing:"), "{table}");
    assert!(table.contains("map.echogrid in office.toml, along the true path of drive.log"), "{table}");
    let table = said(&score(&[]));
    assert!(table.contains("along the map's own path, taken for true"), "{table}");
    // What belongs to another place.
    let check = |arguments: &[&str], snippets: &[&str]| {
        let output = echogrid(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        assert!(snippets.iter().all(|snippet| said(&output).contains(snippet)), "{}", said(&output));
    };
    let elsewhere = path(&drive.out("far.toml"));
    std::fs::write(&elsewhere, "[[wall]]\nfrom = [900, 900]\nto = [910, 900]\n").unwrap();
    check(&["score", &map, "--world", &elsewhere], &["far.toml", "no wall of the world was seen from the path"]);
    let typo = path(&drive.out("typo.toml"));
    std::fs::write(&typo, "[[wall]]\nfrom = [0, 0]\ntoo = [9, 0]\n").unwrap();
    check(&["score", &map, "--world", &typo], &["typo.toml: line 3", "\"too\"", "did you mean to?"]);
    check(&["score", &log, "--world", OFFICE], &["drive.log", "not a native map"]);
    check(&["score", &map, "--world", "/nowhere/a.map"], &["/nowhere/a.map: no such file"]);
    let blind = path(&drive.out("blind.log"));
    let lines = std::fs::read_to_string(drive.log()).unwrap();
    let lines: Vec<&str> = lines.lines().filter(|line| !line.starts_with("TRUEPOS")).collect();
    std::fs::write(&blind, lines.join("\n")).unwrap();
    check(&["score", &map, "--world", OFFICE, "--path", &blind], &["blind.log", "TRUEPOS"]);
}

/// A robot that drifts by 6 m: a map that ignores odometry error is worse than none, the paper's is about as good as none.
#[test]
fn the_papers_claim_holds_on_a_recorded_drive() {
    let (Some(log), Some(world)) = (data("sonar/columbia-sonar.log.gz"), data("worlds/columbia.map")) else { return };
    let (log, world) = (path(&log), path(&world));
    let folder = tempfile::tempdir().unwrap();
    let bits = |sets: &[&str]| {
        let out = path(folder.path());
        let unfiltered = "mapper.filters=[\"range\", \"selection\"]";
        let sets: Vec<&str> = sets
            .iter()
            .chain([&unfiltered, &"mapper.fusion=paper", &"mapper.footprint_m=0"])
            .flat_map(|set| ["--set", set])
            .collect();
        let output = echogrid([&["map", &log, "--out", &out, "-q"][..], &sets].concat());
        assert!(output.status.success(), "{}", said(&output));
        let map = path(&folder.path().join("map.echogrid"));
        summary(&echogrid(["score", &map, "--world", &world, "--path", &log, "--json"]))["bits"].as_f64().unwrap()
    };
    let paper = bits(&["odometry.systematic=carry", "odometry.lin_scale=0.03", "odometry.ang_scale=0.03"]);
    assert!((paper - 1.04).abs() < 0.05, "{paper}");
    let none = ["odometry.k_ll=0", "odometry.k_lt=0", "odometry.k_tt=0", "odometry.k_tl=0"];
    let fixed = bits(&none);
    assert!((fixed - 1.97).abs() < 0.05, "{fixed}");
}

/// The default beats the paper and a robot that believes its odometry, however often it is told where it is.
#[test]
fn the_default_rule_wins_on_floors_that_nobody_saw() {
    let floors = ["evaluate", "--worlds", "floor-201", "--json"];
    let methods = ["fixed σ", "paper", "first_echo"].into_iter().flat_map(|method| ["--method", method]);
    let report = summary(&echogrid(floors.into_iter().chain(methods)));
    let rows = report["tables"][0]["rows"].as_array().unwrap();
    let bits = |method: &str| -> Vec<f64> {
        let row = rows.iter().find(|row| row["method"] == method).unwrap();
        row["columns"].as_array().unwrap().iter().map(|column| column["bits"].as_f64().unwrap()).collect()
    };
    let ours = bits("first_echo");
    for other in ["fixed σ", "paper"] {
        for (ours, theirs) in ours.iter().zip(bits(other)) {
            assert!(*ours < theirs - 0.05, "{other}: {ours} {theirs}");
        }
    }
    let refused = echogrid(["evaluate", "--worlds", "floor-9..1"]);
    assert!(said(&refused).contains("the lower number first"), "{}", said(&refused));
    let refused = echogrid(["evaluate", "--worlds", "room", "--log", "drive.log"]);
    assert!(said(&refused).contains("LOG=WORLD"), "{}", said(&refused));
    let refused = echogrid(["evaluate", "--worlds", "room", "--fix", "5m"]);
    assert!(said(&refused).contains("did you mean \"5 m\"?"), "{}", said(&refused));
}

/// The rings that other mappers were measured on, with what was learnt on floors of that kind (docs/map-quality.md).
#[test]
fn more_walls_and_fewer_false_ones_than_other_mappers() {
    let Some(workload) = data("workload/workload_s.bin") else { return };
    let folder = workload.parent().unwrap().to_str().unwrap();
    let learnt =
        ["echo_detection=0.9", "echo_clutter=0.01", "echo_prior=0.00005", "tempering=0.25", "max_range_m=4.99"];
    let sets = learnt.map(|set| format!("--set=mapper.{set}"));
    let method = ["evaluate", "--worlds", "room", "--fix", "never", "--method", "first_echo, no filter", "--json"];
    let asked = method.into_iter().chain(["--workload", folder]).chain(sets.iter().map(String::as_str));
    let report = summary(&echogrid(asked));
    let quality = &report["workload"][0][1];
    let share = |figure: &str| quality[figure].as_f64().unwrap();
    assert!(share("wall_recall_10cm") >= 0.88, "{quality}");
    assert!(share("free_called_occupied") <= 0.05, "{quality}");
    assert!(share("wall_precision_10cm") >= 0.7, "{quality}");
}

#[test]
fn relations_are_of_the_sensor_where_it_sits() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        path(&file)
    };
    // Half a turn on the spot, by a robot whose laser sits 4 cm behind its middle.
    let poses = file("path.txt", "1 0 0 0\n2 0 0 3.141592653589793\n");
    let relations = file("relations.txt", "1 2 0.08 0 0 0 0 3.141592653589793\n");
    let off_m = |more: &[&str]| {
        let found = summary(&echogrid(["relations", &relations, &poses, "--json"].iter().chain(more)));
        found["translation_m"]["mean"].as_f64().unwrap()
    };
    assert!((off_m(&[]) - 0.08).abs() < 1e-9 && off_m(&["--mount", "-0.04", "0", "0deg"]) < 1e-9);
}
