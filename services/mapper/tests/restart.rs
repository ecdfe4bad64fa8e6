//! A mapper service that is killed at any time and restored sends the same messages as one that was left alone.

#![allow(clippy::panic, clippy::expect_used, clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use echogrid_core::config::{Filter, Fusion};
use echogrid_core::noise::Draws;
use echogrid_core::{
    Echo, Fix, Gate, Increment, MapperConfig, Odometry, OdometryConfig, Parts, Pose2, Reading, Robot, Saved, Sensor,
    SensorKind, move_by,
};
use echogrid_mapper::MapperService;
use echogrid_service::{Input, Outbox, Service};
use echogrid_topics::{Command, Layer, MapInfo, Message, PoseEstimate};
use proptest::prelude::*;

const SONARS: u16 = 8;
const SCANS: u64 = 160;
const READINGS: &str = "readings.echogrid";

fn robot() -> Robot {
    let sonars = Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.1, 0.0, 0.2),
        first_transducer: 0,
        transducers: SONARS,
        first_bearing_rad: 0.0,
        bearing_step_rad: core::f64::consts::TAU / f64::from(SONARS),
        aperture_rad: 0.9,
        range_min_m: 0.02,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { name: "ring".to_owned(), sensors: vec![sonars], ..Robot::default() }
}

#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages")]
enum Event {
    Take(u64, u64, Message),
    Order(Command),
}

/// In a circle in a room of 6 m by 4 m: estimates come late now and then, some hold, fixes rectify some, and a user pauses.
fn drive() -> Vec<Event> {
    let config = OdometryConfig { k_ll: 2e-3, k_tt: 4e-3, k_tl: 1e-3, ..OdometryConfig::default() };
    let (mut odometry, mut draws) = (Odometry::new(&config), Draws::new(3, "restart"));
    let mut truth = Pose2::new(0.0, -1.4, 0.0);
    let mut drive = truth;
    let (mut events, mut late) = (vec![Event::Take(1, 0, Message::Robot(robot()))], Vec::new());
    let mut estimates = 0;
    for sequence in 1..=SCANS {
        let stamp_ns = sequence * 130_000_000;
        let step = Increment { forward_m: 0.05, turn_rad: 0.035, lateral_m: 0.0 };
        truth = move_by(truth, step);
        drive = move_by(drive, Increment { turn_rad: 0.0355 + 0.002 * draws.normal(), ..step });
        let mut said = vec![odometry.step(drive)];
        if sequence % 50 == 35 {
            said.push(odometry.apply(&Fix::about(truth, 0.02, 0.01), Gate::open()).unwrap());
        }
        for estimate in said {
            let (distance_m, hold) = (0.05 * sequence as f64, sequence % 60 > 55);
            let estimate = PoseEstimate { degraded: hold, hold, ..PoseEstimate::plain(estimate, 0.9, distance_m) };
            estimates += 1;
            late.push(Event::Take(estimates, stamp_ns, Message::Estimate(estimate)));
        }
        if sequence % 20 > 4 {
            events.append(&mut late);
        }
        let reading = |transducer| {
            let range_m = to_the_wall(truth * robot().transducer(transducer).unwrap().base_from_transducer);
            let echo = match draws.uniform() {
                _ if transducer == 2 && sequence > SCANS / 2 => Echo::Hit { range_m: 0.4 },
                dice if dice < 0.05 => Echo::NoEcho,
                dice if dice < 0.1 => Echo::Hit { range_m: 20.0 * dice },
                dice => Echo::Hit { range_m: range_m + 0.02 * dice },
            };
            Reading { transducer, echo, offset_ns: i32::from(transducer) * 4_000_000 }
        };
        events.push(Event::Take(sequence, stamp_ns, Message::Scan((0..SONARS).map(reading).collect())));
        match sequence {
            70 => events.push(Event::Order(Command::Pause)),
            78 => events.push(Event::Order(Command::Resume)),
            _ => {}
        }
    }
    events
}

/// Of a room, from within, metres.
fn to_the_wall(sensor: Pose2) -> f64 {
    let (sin, cos) = libm::sincos(sensor.theta);
    let along = |from: f64, direction: f64, half: f64| {
        if direction.abs() < 1e-9 { f64::INFINITY } else { (half * direction.signum() - from) / direction }
    };
    along(sensor.x, cos, 3.0).min(along(sensor.y, sin, 2.0)).max(0.05)
}

/// The revision and the cells of each tile.
type Tiles = BTreeMap<(Layer, (i32, i32)), (u64, Vec<u32>)>;

/// A message, every bit of it.
#[expect(clippy::large_enum_variant, reason = "a test has few")]
#[derive(Debug, Clone, PartialEq)]
enum Said {
    Tile(Layer, (i32, i32), u64, Vec<u32>),
    Info(MapInfo),
    Other(String),
}

fn said(mut out: Outbox) -> Vec<(u64, Said)> {
    let said = |message| match message {
        Message::Tile(tile) => {
            let cells = tile.log_odds.iter().map(|value| value.to_bits()).collect();
            Said::Tile(tile.layer, (tile.index.x, tile.index.y), tile.revision, cells)
        }
        Message::Info(info) => Said::Info(info),
        message => Said::Other(format!("{message:?}")),
    };
    std::iter::from_fn(|| out.pop()).map(|(stamp_ns, message)| (stamp_ns, said(message))).collect()
}

fn take(mapper: &mut MapperService, event: &Event) -> Vec<(u64, Said)> {
    let mut out = Outbox::default();
    match event.clone() {
        Event::Take(sequence, stamp_ns, message) => {
            mapper.step(Input::Message { sequence, stamp_ns, message }, &mut out).unwrap();
        }
        Event::Order(command) => drop(mapper.command(command, &mut out).unwrap()),
    }
    said(out)
}

fn finish(mapper: &mut MapperService) -> Vec<(u64, Said)> {
    let mut out = Outbox::default();
    mapper.step(Input::Finish, &mut out).unwrap();
    said(out)
}

fn snapshot(mapper: &mut MapperService) -> Vec<(u64, Said)> {
    let mut out = Outbox::default();
    mapper.snapshot(&mut out);
    said(out)
}

fn everything(fusion: Fusion) -> MapperConfig {
    MapperConfig {
        fusion,
        filters: vec![Filter::Range, Filter::Selection, Filter::Stuck, Filter::Lone, Filter::Bubble],
        min_trust: 0.6,
        remap: true,
        remap_readings_max: 100,
        doubt: true,
        sonar_maps: true,
        keep_readings: true,
        keep_readings_max: 500,
        ..MapperConfig::default()
    }
}

fn fresh(config: &MapperConfig, folder: &Path) -> MapperService {
    MapperService::new(config, &OdometryConfig::default()).unwrap().saving_readings_in(folder.to_owned())
}

fn save(mapper: &mut MapperService, saved: &mut Saved) {
    let mut parts = Parts::default();
    mapper.save(&mut parts);
    saved.apply(parts.into_changes());
}

/// `kills`: after how many events it is saved, and how many it takes before it is killed.
fn check(config: &MapperConfig, kills: &BTreeMap<usize, usize>) {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (mut undisturbed, mut killed) = (fresh(config, folder.path()), fresh(config, other.path()));
    let mut saved = Saved::default();
    let mut behind = BTreeMap::new();
    let events = drive();
    for (number, event) in events.iter().enumerate() {
        let expected = take(&mut undisturbed, event);
        assert!(take(&mut killed, event) == expected, "event {number}");
        if let Some(further) = kills.get(&number) {
            save(&mut killed, &mut saved);
            // What it takes then is forgotten with it.
            events.iter().skip(number + 1).take(*further).for_each(|event| drop(take(&mut killed, event)));
            killed = fresh(config, other.path());
            killed.restore(&saved).unwrap();
            behind.insert(number, snapshot(&mut killed));
            assert!(behind[&number] == snapshot(&mut undisturbed), "snapshot after event {number}");
        }
    }
    save(&mut killed, &mut saved);
    killed = fresh(config, other.path());
    killed.restore(&saved).unwrap();
    assert!(finish(&mut killed) == finish(&mut undisturbed));
    let file = |folder: &tempfile::TempDir| std::fs::read(folder.path().join(READINGS)).ok();
    assert_eq!(file(&folder).is_some(), config.keep_readings);
    assert!(file(&folder) == file(&other), "the kept readings differ");
    // Finished is finished.
    save(&mut killed, &mut saved);
    killed = fresh(config, other.path());
    killed.restore(&saved).unwrap();
    let at_last = snapshot(&mut killed);
    assert!(at_last == snapshot(&mut undisturbed));
    assert!(matches!(at_last.last(), Some((_, Said::Info(info))) if info.finished));
}

fn every_event_of(step: usize) -> BTreeMap<usize, usize> {
    (0..drive().len()).step_by(step).map(|number| (number, number % 7)).collect()
}

#[test]
fn whatever_fuses() {
    for fusion in [Fusion::Auto, Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
        check(&everything(fusion), &every_event_of(17));
        check(&MapperConfig { fusion, ..MapperConfig::default() }, &every_event_of(29));
    }
}

/// The drive has what the tests are about.
#[test]
fn the_drive_is_not_dull() {
    let folder = tempfile::tempdir().unwrap();
    let mut mapper = fresh(&everything(Fusion::FirstEcho), folder.path());
    let mut all: Vec<_> = drive().iter().flat_map(|event| take(&mut mapper, event)).collect();
    all.extend(finish(&mut mapper));
    let Some((_, Said::Info(info))) = all.last() else { panic!() };
    assert!(info.finished && info.remapped > 100 && info.remap_left > 0 && info.fixes == 3, "{info:?}");
    for verdict in ["accepted", "held", "stuck", "lone", "multiple_reflection", "no_echo", "untrusted"] {
        assert!(info.verdicts.iter().any(|(of, count)| of.name() == verdict && count > 0), "{verdict}");
    }
    let layers: BTreeSet<Layer> =
        all.iter().filter_map(|(_, said)| if let Said::Tile(layer, ..) = said { Some(*layer) } else { None }).collect();
    assert_eq!(layers.len(), 2 + usize::from(SONARS));
}

/// Who begins with a snapshot has, in the end, what those have who saw it all.
#[test]
fn a_snapshot_is_all_there_is() {
    let folder = tempfile::tempdir().unwrap();
    let mut mapper = fresh(&everything(Fusion::Auto), folder.path());
    assert_eq!(snapshot(&mut mapper), []);
    let keep = |map: &mut Tiles, all: Vec<(u64, Said)>| {
        for (_, said) in all {
            if let Said::Tile(layer, index, revision, cells) = said {
                map.insert((layer, index), (revision, cells));
            }
        }
    };
    let (mut from_the_start, mut from_a_snapshot) = (Tiles::new(), Tiles::new());
    for (number, event) in drive().iter().enumerate() {
        if number == 200 {
            let all = snapshot(&mut mapper);
            assert!(matches!(all.last(), Some((_, Said::Info(_)))));
            keep(&mut from_a_snapshot, all);
        }
        let all = take(&mut mapper, event);
        keep(&mut from_the_start, all.clone());
        if number >= 200 {
            keep(&mut from_a_snapshot, all);
        }
    }
    let all = finish(&mut mapper);
    keep(&mut from_the_start, all.clone());
    keep(&mut from_a_snapshot, all);
    assert!(from_the_start == from_a_snapshot);
}

#[test]
fn who_knows_no_robot_yet_goes_on_too() {
    let folder = tempfile::tempdir().unwrap();
    let config = everything(Fusion::Auto);
    let mut saved = Saved::default();
    save(&mut fresh(&config, folder.path()), &mut saved);
    let mut mapper = fresh(&config, folder.path());
    mapper.restore(&saved).unwrap();
    assert!(take(&mut mapper, &drive()[0]).is_empty());
    let without = MapperConfig { keep_readings: false, ..config };
    let refused = fresh(&without, folder.path()).restore(&saved).unwrap_err();
    assert!(refused.to_string().contains("service"), "{refused}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(16) })]

    #[test]
    fn killed_at_any_time(kills in prop::collection::btree_map(0..2 * SCANS as usize, 0..40_usize, 0..10)) {
        check(&everything(Fusion::Auto), &kills);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damage_is_an_error_that_names_the_part(
        part in any::<prop::sample::Index>(),
        at in any::<prop::sample::Index>(),
        flip in any::<u8>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let saved = some_saved();
        let mut parts: BTreeMap<String, Vec<u8>> =
            saved.under("").map(|(name, bytes)| (name.to_owned(), bytes.to_vec())).collect();
        let name = part.get(&parts.keys().cloned().collect::<Vec<_>>()).clone();
        let bytes = parts.get_mut(&name).unwrap();
        let at = at.index(bytes.len());
        if flip == 0 { bytes.truncate(at) } else { bytes[at] ^= flip }
        let mut mapper = fresh(&everything(Fusion::Auto), folder.path());
        let error = mapper.restore(&Saved::from_parts(parts)).unwrap_err();
        prop_assert!(error.to_string().starts_with(&format!("saved state: {name}: ")), "{}", error);
        // It is as new.
        prop_assert!(mapper.restore(saved).is_ok());
    }
}

fn some_saved() -> &'static Saved {
    static SAVED: std::sync::OnceLock<Saved> = std::sync::OnceLock::new();
    SAVED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut mapper = fresh(&everything(Fusion::Auto), folder.path());
        let mut saved = Saved::default();
        for (number, event) in drive().iter().take(250).enumerate() {
            take(&mut mapper, event);
            if number % 40 == 39 {
                save(&mut mapper, &mut saved);
            }
        }
        saved
    })
}

#[test]
fn in_real_time_each_scan_tells_its_tiles() {
    let told = |rate: Option<f64>| {
        let config = MapperConfig::default();
        let mut mapper = MapperService::new(&config, &OdometryConfig::default()).unwrap().at_rate(rate);
        let mut told = BTreeSet::new();
        for said in drive().iter().flat_map(|event| take(&mut mapper, event)) {
            if let (stamp_ns, Said::Tile(..)) = said {
                told.insert(stamp_ns);
            }
        }
        told.len()
    };
    // A scan comes every 0.13 s; some are held.
    assert!(told(Some(1.0)) > 100, "{}", told(Some(1.0)));
    assert!(told(None) <= 160 * 13 / 50 + 1 && told(Some(50.0)) <= 160 * 13 / 100 + 1);
}
