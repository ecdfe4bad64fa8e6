//! Sonars that break on the way: they show, and they stay out of the map.

use anyhow::Result;
use echogrid::config::{Config, LoadRequest};
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Grid, Pose2, Tile, Verdict, VerdictCounts};
use echogrid_judge::Quality;
use echogrid_service::{Input, Outbox, Service};
use echogrid_simulator::world_of;
use echogrid_topics::{Layer, Message, Topic};

use echogrid_formats::map::native;

use crate::support::{Drive, echogrid, path, summary};

/// What a publisher sees, and the true path.
struct Seen {
    grid: Grid,
    path: Vec<Pose2>,
    sonars: Vec<VerdictCounts>,
}

impl Service for Seen {
    fn inputs(&self) -> &'static [Topic] {
        &[Topic::TruePose, Topic::MapTiles, Topic::MapInfo]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { message: Message::Tile(tile), .. } => {
                assert_eq!(tile.layer, Layer::Map, "nobody asked for maps of the sonars");
                *self.grid.tile_mut(tile.index) = Tile::new(tile.revision, tile.log_odds);
            }
            Input::Message { message: Message::TruePose(pose), .. } => self.path.extend(pose.map_from_base),
            Input::Message { message: Message::Info(info), .. } => self.sonars = info.sonars,
            _ => {}
        }
        Ok(())
    }
}

/// Selection last: all sonars are witnesses.
const CHAIN: &str = "mapper.filters=[\"range\", \"stuck\", \"lone\", \"bubble\", \"selection\"]";
const NO_CHAIN: &str = "mapper.filters=[\"range\", \"selection\"]";

/// A drive through the office whose place is told every metre: bits of its map (1: knows nothing), and the readings.
fn drive(sets: &[&str]) -> (f64, Vec<VerdictCounts>) {
    let common = [
        // It adds up what a broken sonar says; first_echo hardly believes it in the first place.
        "mapper.fusion=paper",
        "mapper.sonars=corridor",
        "simulator.world=office",
        "simulator.duration_s=120",
        "localizer.source=truth",
        "localization.ask=schedule",
        "localization.every_m=1",
    ];
    let request = LoadRequest {
        sensor: Some("simulator".into()),
        robot: Some("pioneer3at".into()),
        sets: common.iter().chain(sets).map(|set| (*set).to_owned()).collect(),
        ..LoadRequest::default()
    };
    let config = Config::load(&request).unwrap().into_config();
    let mut seen = Seen { grid: Grid::new(config.mapper.resolution_m), path: Vec::new(), sonars: Vec::new() };
    echogrid::in_process::run(&config, &mut seen).unwrap();
    let world = world_of(&config.simulator).unwrap();
    (Quality::of(&seen.grid, &world, &seen.path).unwrap().bits, seen.sonars)
}

#[test]
fn broken_sonars_show_and_stay_out_of_the_map() {
    let stuck = "simulator.faults=[{ sonar = 7, kind = \"stuck\", range_m = 3.0, from_s = 10 }]";
    let (sound_bits, sound) = drive(&[CHAIN]);
    let (filtered_bits, _) = drive(&[CHAIN, stuck]);
    let (raw_bits, raw) = drive(&[NO_CHAIN, stuck]);
    assert!(filtered_bits < sound_bits + 0.05, "sound {sound_bits}, filtered {filtered_bits}");
    assert!(filtered_bits < raw_bits - 0.1, "raw {raw_bits}, filtered {filtered_bits}");
    let broken = "simulator.faults=[{ sonar = 7, kind = \"stuck\", range_m = 3.0, from_s = 10 }, \
                  { sonar = 0, kind = \"short\", range_m = 0.4, from_s = 10 }, { sonar = 12, kind = \"silent\" }]";
    // With all sonars, and the filters that are on by default.
    let (_, filtered) = drive(&["mapper.sonars=all", broken]);
    // Each by its number.
    let share = |counts: &VerdictCounts, verdict| counts.get(verdict) as f64 / counts.total() as f64;
    for (number, counts) in filtered.iter().enumerate() {
        let stuck = share(counts, Verdict::Stuck);
        assert!(if [0, 7].contains(&number) { stuck > 0.1 } else { stuck < 0.05 }, "sonar {number}: {counts:?}");
    }
    assert_eq!(filtered[12].get(Verdict::NoEcho), filtered[12].total());
    assert!(filtered[12].total() > 100 && raw[7].get(Verdict::Stuck) == 0);
    assert!(sound.iter().all(|counts| share(counts, Verdict::Stuck) < 0.02), "{sound:?}");
}

#[test]
fn the_summary_names_a_broken_sonar() {
    let out = tempfile::tempdir().unwrap();
    let arguments =
        ["up", "launch/graphs/map.toml", "--sensor", "simulator", "--robot", "pioneer3at", "--json", "--quiet"];
    let folder = path(out.path());
    let sets = [
        "--out",
        &folder,
        "--set",
        "simulator.duration_s=60",
        "--set",
        "simulator.faults=[{ sonar = 12, kind = \"silent\" }]",
    ];
    let summary = summary(&echogrid(arguments.iter().chain(&sets)));
    assert_eq!(summary["conspicuous"].as_array().unwrap().len(), 1, "{summary}");
    assert!(summary["conspicuous"][0].as_str().unwrap().starts_with("sonar 12 hears hardly anything"), "{summary}");
    assert_eq!(summary["sonars"].as_array().unwrap().len(), 16);
    assert!(summary["sonars"][12]["no_echo"].as_u64().unwrap() > 50, "{summary}");
}

#[test]
fn each_sonar_has_a_picture_on_demand() {
    let drive = Drive::new(6.0);
    drive.native_map("plain", &[]);
    assert!(!drive.out("plain/sonars.png").exists());
    let asked = ["--set", "mapper.sonar_maps=true", "--json", "--quiet"];
    let summary = summary(&drive.map("asked", &asked));
    let files: Vec<&str> = summary["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap()).collect();
    assert!(files.iter().any(|file| file.ends_with("sonars.png")), "{files:?}");
    assert!(std::fs::read(drive.out("asked/sonars.png")).unwrap().starts_with(b"\x89PNG"));
    // The map itself is none the worse for it.
    let cells = |out: &str| {
        let map = native::read(&drive.out(out).join("map.echogrid")).unwrap();
        map.grid.tiles().flat_map(|(_, tile)| tile.log_odds.map(f32::to_bits)).collect::<Vec<_>>()
    };
    assert!(cells("asked") == cells("plain"));
}

#[test]
fn the_doubt_of_each_cell_has_a_picture_on_demand() {
    let drive = Drive::new(8.0);
    drive.native_map("plain", &[]);
    assert!(!drive.out("plain/doubt.png").exists());
    let sets = ["--fix", "truth", "--fix-every", "3m", "--set", "mapper.remap=true", "--set", "mapper.doubt=true"];
    let summary = summary(&drive.map("asked", &[&sets[..], &["--json", "--quiet"]].concat()));
    let files: Vec<&str> = summary["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap()).collect();
    assert!(["doubt.png", "doubt.npy"].iter().all(|name| files.iter().any(|file| file.ends_with(name))), "{files:?}");
    drive.native_map("without", &sets[..6]);
    let map = |out: &str| native::read(&drive.out(out).join("map.echogrid")).unwrap();
    let cells = |grid: &Grid| grid.tiles().flat_map(|(_, tile)| tile.log_odds.map(f32::to_bits)).collect::<Vec<_>>();
    let (asked, without) = (map("asked"), map("without"));
    assert!(cells(&asked.grid) == cells(&without.grid) && without.doubt.is_none());
    let doubt = asked.doubt.unwrap();
    let metres: Vec<f32> =
        doubt.tiles().flat_map(|(_, tile)| *tile.log_odds).filter(|metres| !metres.is_nan()).collect();
    let most = metres.iter().copied().fold(0.0, f32::max);
    assert!(metres.len() > 1000 && (0.001..1.0).contains(&most), "{} cells, up to {most} m", metres.len());
    let sets = [
        "localizer.source=truth",
        "localization.ask=schedule",
        "localization.every_m=3",
        "mapper.remap=true",
        "mapper.doubt=true",
    ];
    let in_processes = std::fs::read(drive.out("asked/map.echogrid")).unwrap();
    assert!(crate::maps::in_one_process(&drive.log(), &drive.out("local"), &sets) == in_processes);
}
