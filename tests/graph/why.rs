//! Why a cell is what it is, as the program tells it.

use std::time::{Duration, Instant};

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;
use serde_json::Value;

use crate::support::{Drive, ECHOGRID, echogrid, path, said, summary};

const KEEP: [&str; 2] = ["--set", "mapper.keep_readings=true"];

fn why(drive: &Drive, map: &str, [x, y]: [f64; 2], more: &[&str]) -> std::process::Output {
    let place = [x.to_string(), y.to_string(), path(&drive.out(map).join("map.echogrid"))];
    echogrid(["why".to_owned()].into_iter().chain(place).chain(more.iter().map(|word| (*word).to_owned())))
}

#[test]
fn readings_of_an_earlier_run_do_not_speak_for_another_map() {
    let drive = Drive::new(2.0);
    let more = ["--json", "-q"];
    assert!(drive.map("maps", &[&KEEP[..], &["--set", "mapper.doubt=true"], &more].concat()).status.success());
    let mine = drive.out("maps/notes.txt");
    std::fs::write(&mine, "mine").unwrap();
    let again = drive.map("maps", &more);
    assert!(summary(&again)["log_faults"].to_string().contains("readings.echogrid"), "{}", said(&again));
    let is_there = |name: &str| drive.out("maps").join(name).exists();
    assert_eq!(["readings.echogrid", "doubt.png", "doubt.npy"].map(is_there), [false; 3]);
    assert!(mine.exists() && is_there("map.echogrid") && is_there("map.yaml"));
    assert!(!why(&drive, "maps", [1.0, 6.0], &[]).status.success());
    // A map in another format may be somebody's: it is named.
    let picture = drive.map("maps", &["--json", "-q", "--set", "publisher.formats=[\"png\"]"]);
    assert!(
        summary(&picture)["log_faults"].to_string().contains("not of this run: map.echogrid"),
        "{}",
        said(&picture)
    );
    assert!(is_there("map.echogrid"));
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn the_readings_of_a_cell_come_to_what_the_map_says() {
    let drive = Drive::new(8.0);
    for fusion in ["paper", "covariance", "first_echo", "oriented"] {
        let fusion_is = format!("mapper.fusion={fusion}");
        let sets = [
            &KEEP[..],
            &["--set", &fusion_is, "--fix", "truth", "--fix-every", "3m", "--set", "mapper.remap=true", "--json", "-q"],
        ];
        let files = summary(&drive.map(fusion, &sets.concat()))["files"].to_string();
        assert!(files.contains("readings.echogrid"), "{files}");
        let map = native::read(&drive.out(fusion).join("map.echogrid")).unwrap();
        // The surest wall, the surest free cell, and some others.
        let mut cells: Vec<(f32, [f64; 2])> = map
            .grid
            .tiles()
            .flat_map(|(index, tile)| tile.log_odds.iter().enumerate().map(move |(at, value)| (index, at, *value)))
            .filter(|(_, _, value)| !value.is_nan())
            .map(|(index, at, value)| {
                let (i, j) = (index.first_cell().i + (at % 64) as i32, index.first_cell().j + (at / 64) as i32);
                (value, map.grid.centre(echogrid_core::CellIndex { i, j }))
            })
            .collect();
        cells.sort_by(|a, b| a.0.total_cmp(&b.0));
        for place in [0, cells.len() / 3, cells.len() - 1] {
            let (log_odds, at) = cells[place];
            let answer = summary(&why(&drive, fusion, at, &["--json"]));
            assert_eq!(answer["exact"], true, "{fusion}: {answer}");
            assert_eq!(number(&answer["log_odds"]) as f32, log_odds);
            let readings = answer["readings"].as_array().unwrap();
            let added: f64 = readings.iter().map(|reading| number(&reading["added"])).sum();
            let all = added + number(&answer["driven_added"]) + number(&answer["along_walls_added"]);
            assert!((all - f64::from(log_odds)).abs() < 1e-4, "{fusion}: {added} {all} {log_odds}");
            let by_sensor: f64 = answer["sensors"].as_array().unwrap().iter().map(|of| number(&of["added"])).sum();
            assert!((by_sensor - added).abs() < 1e-9);
            assert!(readings.is_sorted_by_key(|reading| reading["scan"].as_u64().unwrap()), "{answer}");
            assert!(readings.iter().all(|reading| reading["time_s"].is_number()), "{answer}");
        }
    }
    // A wall, in words.
    let (log_odds, at) = {
        let map = native::read(&drive.out("paper/map.echogrid")).unwrap();
        let cell = map.grid.cell_at(4.0, 5.0);
        let near = (-2..=2).map(|row| echogrid_core::CellIndex { j: cell.j + row, ..cell });
        let best = near.max_by(|a, b| {
            let of = |cell: &echogrid_core::CellIndex| map.grid.log_odds(*cell).unwrap_or(-9.0);
            of(a).total_cmp(&of(b))
        });
        (map.grid.log_odds(best.unwrap()).unwrap(), map.grid.centre(best.unwrap()))
    };
    assert!(log_odds > 0.7, "{log_odds}");
    let output = why(&drive, "paper", at, &["--limit", "2"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains(": occupied, probability") && text.contains(" others (--limit)"), "{text}");
    assert!(text.lines().any(|line| line.starts_with("sonar ") && line.contains(" readings")), "{text}");
    let lines = text.lines().filter(|line| line.contains(" -> ") || line.contains("refused: ")).count();
    assert_eq!(lines, 2, "{text}");
    // Where nothing is known.
    let text = String::from_utf8(why(&drive, "paper", [-900.0, 3.0], &[]).stdout).unwrap();
    assert!(text.contains("outside of what the map knows") && !text.contains("note"), "{text}");
}

#[test]
fn a_map_without_its_readings_says_how_to_get_them() {
    let drive = Drive::new(3.0);
    drive.native_map("plain", &[]);
    assert!(!drive.out("plain/readings.echogrid").exists());
    let output = why(&drive, "plain", [1.0, 6.0], &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("--set mapper.keep_readings=true"), "{}", said(&output));
    let output = why(&drive, "plain", [f64::NAN, 6.0], &[]);
    assert!(said(&output).contains("expected metres"), "{}", said(&output));
    // Readings that there is no room for are told; the map itself is none the worse.
    let few = [&KEEP[..], &["--set", "mapper.keep_readings_max=50"]].concat();
    drive.native_map("few", &few);
    let answer = summary(&why(&drive, "few", [1.5, 5.5], &["--json"]));
    assert!(answer["given_up"].as_u64().unwrap() > 50, "{answer}");
    let cells = |out: &str| {
        let map = native::read(&drive.out(out).join("map.echogrid")).unwrap();
        map.grid.tiles().flat_map(|(_, tile)| tile.log_odds.map(f32::to_bits)).collect::<Vec<_>>()
    };
    assert!(cells("few") == cells("plain"));
}

#[test]
fn a_running_graph_answers() {
    let drive = Drive::new(f64::INFINITY);
    let name = format!("why-{}", std::process::id());
    let arguments = drive.map_arguments("maps", &[&["--rate", "10"], &KEEP[..]].concat());
    let mut graph = GraphProcess::start_in(&name, ECHOGRID, arguments);
    graph.wait_for_progress("mapper", 100);
    let ask = || echogrid(["why", "1.5", "5.5", "--domain", &name, "--json"]);
    let deadline = Instant::now() + Duration::from_secs(30);
    let answer = loop {
        let output = ask();
        if output.status.success() {
            let answer = summary(&output);
            if answer["readings_used"] != 0 {
                break answer;
            }
        }
        // Each question takes a while of its own: the map is saved for it.
        assert!(Instant::now() < deadline, "{}", said(&output));
    };
    assert_eq!((&answer["exact"], &answer["state"]), (&true.into(), &"free".into()), "{answer}");
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
}
