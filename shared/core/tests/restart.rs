//! A mapper that was saved, killed and restored goes on as if nothing had happened: every bit that comes of it is the same.

#![allow(clippy::panic, clippy::expect_used, clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};

use echogrid_core::config::{Filter, Fusion, NoEcho, Noise, Systematic};
use echogrid_core::localization::{Ask, Asking};
use echogrid_core::noise::Draws;
use echogrid_core::{
    Echo, Estimate, Fix, Gate, Grid, GridMapper, Increment, LocalizationConfig, MapperConfig, Odometry, OdometryConfig,
    Parts, Plane, Pose2, Reading, RestoreError, Robot, Saved, Sensor, SensorKind, Tile, TileIndex, move_by,
};
use proptest::prelude::*;

const SCANS: u64 = 240;
const SONARS: u16 = 8;
const BEAMS: u16 = 3;
const SEED: u64 = 7;

fn robot() -> Robot {
    let sensor = |kind, first_transducer, transducers, bearing_step_rad, aperture_rad| Sensor {
        kind,
        base_from_sensor: Pose2::new(0.1, 0.0, 0.2),
        first_transducer,
        transducers,
        first_bearing_rad: 0.0,
        bearing_step_rad,
        aperture_rad,
        range_min_m: 0.02,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    let around = core::f64::consts::TAU / f64::from(SONARS);
    Robot {
        sensors: vec![
            sensor(SensorKind::Sonar, 0, SONARS, around, 0.9),
            sensor(SensorKind::Lidar, SONARS, BEAMS, 0.3, 0.01),
        ],
        ..Robot::default()
    }
}

#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "a few hundred of them")]
enum Event {
    Scan(u64, Vec<(Reading, Option<Estimate>)>),
    Fix(u64, Estimate, Estimate),
    Publish,
}

/// In a circle in a room of 6 m by 4 m, with a sonar that sticks, echoes that are nobody's, and a fix now and then.
fn drive() -> Vec<Event> {
    let odometry = OdometryConfig { k_ll: 2e-3, k_tt: 4e-3, k_tl: 1e-3, ..OdometryConfig::default() };
    let (mut odometry, mut draws) = (Odometry::new(&odometry), Draws::new(3, "restart"));
    let (mut truth, mut drive) = (Pose2::new(0.0, -1.4, 0.0), Pose2::new(0.0, -1.4, 0.0));
    let mut before = odometry.step(drive);
    let mut events = Vec::new();
    for sequence in 1..=SCANS {
        let step = Increment { forward_m: 0.05, turn_rad: 0.035, lateral_m: 0.0 };
        truth = move_by(truth, step);
        drive = move_by(drive, Increment { turn_rad: 0.0355 + 0.002 * draws.normal(), ..step });
        let now = odometry.step(drive);
        let transducers = (0..SONARS + BEAMS).map(|transducer| {
            let robot = robot();
            let sensor = truth * robot.transducer(transducer).unwrap().base_from_transducer;
            let range_m = to_the_wall(sensor) + 0.01 * draws.normal();
            let echo = match draws.uniform() {
                _ if transducer == 2 && sequence > SCANS / 2 => Echo::Hit { range_m: 0.4 },
                dice if dice < 0.05 => Echo::Hit { range_m: 0.3 + 2.0 * dice / 0.05 },
                dice if dice < 0.1 => Echo::NoEcho,
                dice if dice < 0.11 => Echo::Invalid,
                _ => Echo::Hit { range_m },
            };
            // Sonars fire in turn: between two estimates, and the last few after all there are.
            let estimate = (sequence % 50 != 0).then(|| before.interpolate(&now, f64::from(transducer / 4) / 3.0));
            (Reading { transducer, echo, offset_ns: i32::from(transducer) * 1000 }, estimate)
        });
        events.push(Event::Scan(sequence, transducers.collect()));
        before = now;
        if sequence.is_multiple_of(7) {
            events.push(Event::Publish);
        }
        if sequence % 60 == 45 {
            let fix = Fix::about(truth, 0.02, 0.01);
            let after = odometry.apply(&fix, Gate::open()).unwrap();
            events.push(Event::Fix(sequence + 1, before, after));
            before = after;
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

fn new_mapper(config: &MapperConfig, noise: Noise) -> GridMapper {
    GridMapper::new(config, noise, SEED, robot()).unwrap()
}

/// What comes of an event, in words.
fn take(mapper: &mut GridMapper, event: &Event) -> String {
    match event {
        Event::Scan(sequence, scan) if sequence % 9 == 0 => {
            let verdict = |(reading, estimate): &(Reading, Option<Estimate>)| {
                mapper.integrate(*sequence, reading, estimate.as_ref())
            };
            format!("{:?}", scan.iter().map(verdict).collect::<Vec<_>>())
        }
        Event::Scan(sequence, scan) => format!("{:?}", mapper.integrate_scan(*sequence, scan)),
        Event::Fix(revision, before, after) => format!("{:?}", mapper.rectify(*revision, before, after)),
        Event::Publish => format!("{:?} {:?}", mapper.take_changed(), mapper.take_changed_of_sonars()),
    }
}

type Tiles = BTreeMap<TileIndex, (u64, Vec<u32>)>;

fn bits(grid: &Grid) -> Tiles {
    let tile = |log_odds: &[f32]| log_odds.iter().map(|value| value.to_bits()).collect();
    grid.tiles().map(|(index, t)| (index, (t.revision, tile(&t.log_odds[..])))).collect()
}

/// All that can be asked of a mapper.
fn all(mapper: &mut GridMapper) -> (Vec<Option<Tiles>>, String) {
    let sonars = (0..SONARS).map(|sonar| mapper.sonar_grid(sonar).map(bits));
    let mut grids: Vec<Option<Tiles>> = sonars.collect();
    grids.push(Some(bits(mapper.grid())));
    let doubt = |tile: &Tile| tile.plane(Plane::Doubt).map(|doubt| doubt.iter().map(|v| v.to_bits()).collect());
    let doubts: Option<Tiles> =
        mapper.grid().tiles().map(|(index, tile)| Some((index, (tile.revision, doubt(tile)?)))).collect();
    grids.push(doubts);
    let kept = mapper.kept_readings().map(|kept| (kept.given_up(), kept.iter().copied().collect::<Vec<_>>()));
    (grids, format!("{kept:?} {:?} {:?}", mapper.take_changed(), mapper.take_changed_of_sonars()))
}

fn save(mapper: &mut GridMapper, saved: &mut Saved) -> usize {
    let mut parts = Parts::default();
    mapper.save(&mut parts);
    let changes = parts.into_changes();
    let count = changes.len();
    saved.apply(changes);
    count
}

/// As a fresh process has it.
fn restore(config: &MapperConfig, noise: Noise, saved: &Saved) -> GridMapper {
    GridMapper::restore(config, noise, SEED, robot(), saved).unwrap()
}

/// `saves`: after how many events it is saved, and whether it is killed then.
fn check(config: &MapperConfig, noise: Noise, saves: &BTreeMap<usize, bool>) {
    let (mut undisturbed, mut killed, mut saved) =
        (new_mapper(config, noise), new_mapper(config, noise), Saved::default());
    let mut undone: Vec<&Event> = Vec::new();
    let events = drive();
    for (number, event) in events.iter().enumerate() {
        assert_eq!(take(&mut killed, event), take(&mut undisturbed, event), "event {number}");
        undone.push(event);
        if let Some(kill) = saves.get(&number) {
            if *kill && saved.get("mapper").is_some() {
                // Killed before it could save: what came since comes again.
                killed = restore(config, noise, &saved);
                undone.iter().for_each(|event| drop(take(&mut killed, event)));
            }
            save(&mut killed, &mut saved);
            undone.clear();
            if *kill {
                killed = restore(config, noise, &saved);
            }
        }
    }
    save(&mut killed, &mut saved);
    let mut at_once = Saved::default();
    save(&mut undisturbed, &mut at_once);
    // In how many parts a layer of what a fix may change is saved is up to how often.
    let name = |name: &str| match name.rsplit_once('/') {
        Some((layer, _)) if name.starts_with("remap/") => layer.to_owned(),
        _ => name.to_owned(),
    };
    let names = |saved: &Saved| -> BTreeSet<String> { saved.under("").map(|(part, _)| name(part)).collect() };
    assert_eq!(names(&saved), names(&at_once), "nothing is left behind");
    let mut again = restore(config, noise, &saved);
    let expected = all(&mut undisturbed);
    assert!(all(&mut killed) == expected && all(&mut again) == expected);
}

fn every_event_of(step: usize) -> BTreeMap<usize, bool> {
    (0..drive().len()).step_by(step).map(|number| (number, true)).collect()
}

fn everything(fusion: Fusion) -> MapperConfig {
    MapperConfig {
        fusion,
        filters: vec![Filter::Range, Filter::Selection, Filter::Stuck, Filter::Lone, Filter::Bubble],
        min_trust: 0.3,
        remap: true,
        remap_readings_max: 300,
        doubt: true,
        sonar_maps: true,
        keep_readings: true,
        keep_readings_max: 1300,
        ..MapperConfig::default()
    }
}

#[test]
fn whatever_fuses() {
    for fusion in [Fusion::Auto, Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
        check(&everything(fusion), Noise::Sampled, &every_event_of(23));
        check(&MapperConfig { fusion, ..MapperConfig::default() }, Noise::OneSigma, &every_event_of(41));
    }
}

#[test]
fn a_restart_after_every_scan() {
    check(&everything(Fusion::Auto), Noise::Sampled, &every_event_of(1));
}

/// The drive has what the tests are about.
#[test]
fn the_drive_is_not_dull() {
    let config = everything(Fusion::Auto);
    let mut mapper = new_mapper(&config, Noise::Sampled);
    let said: String = drive().iter().map(|event| take(&mut mapper, event)).collect();
    for verdict in ["Accepted", "NoEcho", "Invalid", "NoPose", "Untrusted", "Stuck", "Lone", "MultipleReflection"] {
        assert!(said.contains(verdict), "{verdict}");
    }
    assert!(said.contains("verdicts: [("), "no reading had a second chance");
    assert!(said.matches("left: ").count() > said.matches("left: 0").count(), "no layer was given up");
    assert!(mapper.kept_readings().unwrap().given_up() > 1024, "no chunk was dropped");
}

#[test]
fn only_what_changed_is_saved_again() {
    let mut mapper = new_mapper(&everything(Fusion::Auto), Noise::Sampled);
    let (events, mut saved) = (drive(), Saved::default());
    events.iter().for_each(|event| drop(take(&mut mapper, event)));
    assert!(save(&mut mapper, &mut saved) > 20);
    assert_eq!(save(&mut mapper, &mut saved), 2, "its state, and what is new");
    let Some(Event::Scan(_, scan)) = events.iter().find(|event| matches!(event, Event::Scan(..))) else { panic!() };
    let (reading, estimate) = scan.iter().find(|(reading, _)| matches!(reading.echo, Echo::Hit { .. })).unwrap();
    mapper.integrate(SCANS + 1, reading, estimate.as_ref());
    let changed = save(&mut mapper, &mut saved);
    assert!((3..30).contains(&changed), "{changed}");
}

#[test]
fn what_was_saved_of_another_mapper_is_refused() {
    let config = everything(Fusion::Auto);
    let mut saved = Saved::default();
    save(&mut new_mapper(&config, Noise::Sampled), &mut saved);
    let refused = |config: &MapperConfig, noise, seed, robot| {
        let error = GridMapper::restore(config, noise, seed, robot, &saved).map(drop).unwrap_err();
        error.to_string().contains("mapper: saved with other settings")
    };
    let other = MapperConfig { novelty_m: 0.07, ..config.clone() };
    assert!(refused(&other, Noise::Sampled, SEED, robot()) && refused(&config, Noise::OneSigma, SEED, robot()));
    let renamed = Robot { name: "other".to_owned(), ..robot() };
    assert!(refused(&config, Noise::Sampled, 8, robot()) && refused(&config, Noise::Sampled, SEED, renamed));
    assert!(GridMapper::restore(&config, Noise::Sampled, SEED, robot(), &saved).is_ok());
}

/// With fixes that are refused, and one that is believed after all.
#[test]
fn the_odometry_and_what_it_asks_go_on() {
    let config = LocalizationConfig { ask: Ask::Both, every_m: 0.9, every_s: 7.0, ..LocalizationConfig::default() };
    let fresh = || {
        (Odometry::new(&OdometryConfig { systematic: Systematic::Carry, ..Default::default() }), Asking::new(&config))
    };
    let (mut undisturbed, mut killed) = (fresh(), fresh());
    let gate = Gate::closed(Gate::DEFAULT_SIGMAS);
    let mut drive = Pose2::new(1.0, 2.0, 3.0);
    let (mut believed, mut refused) = (0, 0);
    for step in 0..200_u64 {
        let mut saved = Saved::default();
        let mut parts = Parts::default();
        parts.put_value("odometry", &killed);
        saved.apply(parts.into_changes());
        killed = saved.value("odometry").unwrap();
        drive = move_by(drive, Increment { forward_m: 0.1, lateral_m: 0.001, turn_rad: 0.07 });
        let off_m = if step / 50 == 1 { 3.0 } else { 0.03 };
        let mut take = |(odometry, asking): &mut (Odometry, Asking)| {
            let estimate = odometry.step(drive);
            let asked = asking.reason(step * 300_000_000, 0.1 * step as f64, step % 13 == 5);
            let applied =
                asked.map(|_| odometry.apply(&Fix::about(drive * Pose2::new(off_m, 0.0, 0.0), 0.02, 0.01), gate));
            match applied {
                Some(Ok(_)) => {
                    believed += 1;
                    asking.fixed(step * 300_000_000, 0.1 * step as f64);
                }
                Some(Err(_)) => {
                    refused += 1;
                    asking.failed(step * 300_000_000);
                }
                None => {}
            }
            format!("{estimate:?} {asked:?} {applied:?}")
        };
        assert_eq!(take(&mut killed), take(&mut undisturbed), "step {step}");
    }
    assert!(believed > 10 && refused > 3, "{believed} {refused}");
}

#[derive(Debug, Clone)]
enum Damage {
    Flip(prop::sample::Index, u8),
    Cut(prop::sample::Index),
    Remove,
    /// As a part that is sound, and another.
    Swap(prop::sample::Index),
}

fn damage() -> impl Strategy<Value = Damage> {
    let at = any::<prop::sample::Index>;
    prop_oneof![
        (at(), 1..=255_u8).prop_map(|(at, flip)| Damage::Flip(at, flip)),
        at().prop_map(Damage::Cut),
        Just(Damage::Remove),
        at().prop_map(Damage::Swap),
    ]
}

fn config() -> impl Strategy<Value = MapperConfig> {
    let fusion = prop::sample::select(vec![
        Fusion::Auto,
        Fusion::Paper,
        Fusion::Covariance,
        Fusion::FirstEcho,
        Fusion::Oriented,
    ]);
    let filters = prop::sample::subsequence(everything(Fusion::Auto).filters, 0..=5).prop_shuffle();
    let readings = (4..4000_u32, 1..4000_u32);
    let clears = any::<bool>().prop_map(|clears| if clears { NoEcho::Clear } else { NoEcho::Ignore });
    (fusion, filters, readings, any::<[bool; 4]>(), clears, 0.0..0.3f64).prop_map(
        |(fusion, filters, (remap_max, keep_max), [remap, doubt, sonar_maps, keep_readings], no_echo, novelty_m)| {
            MapperConfig {
                filters,
                remap,
                remap_readings_max: remap_max,
                doubt,
                sonar_maps,
                keep_readings,
                keep_readings_max: keep_max,
                no_echo,
                novelty_m,
                ..everything(fusion)
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn whatever_is_set(
        config in config(),
        sampled in any::<bool>(),
        saves in prop::collection::btree_map(0..SCANS as usize, any::<bool>(), 0..12),
    ) {
        check(&config, if sampled { Noise::Sampled } else { Noise::OneSigma }, &saves);
    }
}

proptest! {
    #[test]
    fn damage_is_named_and_never_a_panic(part in any::<prop::sample::Index>(), damage in damage()) {
        let saved = some_saved();
        let mut parts: BTreeMap<String, Vec<u8>> =
            saved.under("").map(|(name, bytes)| (name.to_owned(), bytes.to_vec())).collect();
        let names: Vec<String> = parts.keys().cloned().collect();
        let name = part.get(&names).clone();
        let bytes = parts.get_mut(&name).unwrap();
        match damage {
            Damage::Flip(at, flip) => {
                let at = at.index(bytes.len());
                bytes[at] ^= flip;
            }
            Damage::Cut(at) => bytes.truncate(at.index(bytes.len())),
            Damage::Remove => drop(parts.remove(&name)),
            Damage::Swap(other) => {
                let other = other.get(&names);
                prop_assume!(*other != name);
                let bytes = parts[other].clone();
                parts.insert(name.clone(), bytes);
            }
        }
        let restored =
            GridMapper::restore(&everything(Fusion::Auto), Noise::Sampled, SEED, robot(), &Saved::from_parts(parts));
        let Err(RestoreError::Saved(error)) = restored else { panic!("{name}: {restored:?}") };
        // Of a tile that is not there its map is named.
        prop_assert!(error.part == name || name.starts_with(&error.part), "{name}: {error}");
    }
}

/// Half-way through the drive, with everything on.
fn some_saved() -> &'static Saved {
    static SAVED: std::sync::OnceLock<Saved> = std::sync::OnceLock::new();
    SAVED.get_or_init(|| {
        let mut mapper = new_mapper(&everything(Fusion::Auto), Noise::Sampled);
        let mut saved = Saved::default();
        for (number, event) in drive().iter().take(200).enumerate() {
            take(&mut mapper, event);
            if number % 20 == 19 {
                save(&mut mapper, &mut saved);
            }
        }
        saved
    })
}
