//! Before anybody knows where the map lies scans wait, and there is not room for all: which are held depends on stamps alone.

#![allow(clippy::panic, clippy::expect_used, clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;

use echogrid_core::{Echo, Estimate, MapperConfig, OdometryConfig, Pose2, Reading, Robot, Sensor, SensorKind, Verdict};
use echogrid_mapper::MapperService;
use echogrid_service::{Input, Outbox, Service};
use echogrid_topics::{Message, PoseEstimate};

const SONARS: u16 = 4;
/// Estimates at i · 100 ms, scans 50 ms later; from `PLACED` on it is known where the map lies.
const STEPS: u64 = 60;
const PLACED: u64 = 40;
/// Scans that there is room for.
const ROOM: u64 = 10;

fn robot() -> Robot {
    let ring = Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: SONARS,
        first_bearing_rad: 0.0,
        bearing_step_rad: core::f64::consts::FRAC_PI_2,
        aperture_rad: 0.4,
        range_min_m: 0.1,
        range_max_m: 4.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: vec![ring], ..Robot::default() }
}

fn estimate(step: u64) -> (u64, Message) {
    let is_placed = step >= PLACED;
    let pose = Pose2::new(0.03 * step as f64 + if is_placed { 2.0 } else { 0.0 }, 0.0, 0.0);
    let estimate = Estimate { fixes: u32::from(is_placed), ..Estimate::certain(pose) };
    let told = PoseEstimate { unplaced: !is_placed, ..PoseEstimate::plain(estimate, 1.0, 0.0) };
    (step * 100_000_000, Message::Estimate(told))
}

fn scan(step: u64) -> (u64, Message) {
    let echo = |transducer| Echo::Hit { range_m: 1.5 + 0.01 * step as f64 + 0.2 * f64::from(transducer) };
    let readings = (0..SONARS).map(|transducer| Reading { transducer, echo: echo(transducer), offset_ns: 0 });
    (step * 100_000_000 + 50_000_000, Message::Scan(readings.collect()))
}

/// The log-odds of each tile, as bits, and what became of the readings.
type Mapped = (BTreeMap<(i32, i32), Vec<u32>>, Vec<(Verdict, u64)>);

/// What comes of it where scans come `ahead` steps before the estimates of their time (negative: after).
fn mapped(ahead: i64) -> Mapped {
    let config = MapperConfig { remap_readings_max: (ROOM * u64::from(SONARS)) as u32, ..MapperConfig::default() };
    let mut mapper = MapperService::new(&config, &OdometryConfig::default()).unwrap();
    let mut messages: Vec<(i64, u64, (u64, Message))> =
        (0..STEPS).map(|step| (2 * step as i64, step + 1, estimate(step))).collect();
    messages.extend((0..STEPS - 1).map(|step| (2 * (step as i64 - ahead) + 1, step + 1, scan(step))));
    messages.sort_by_key(|(when, ..)| *when);
    let mut out = Outbox::default();
    mapper.step(Input::Message { sequence: 1, stamp_ns: 0, message: Message::Robot(robot()) }, &mut out).unwrap();
    for (_, sequence, (stamp_ns, message)) in messages {
        mapper.step(Input::Message { sequence, stamp_ns, message }, &mut out).unwrap();
    }
    mapper.step(Input::Finish, &mut out).unwrap();
    let (mut tiles, mut verdicts) = (BTreeMap::new(), Vec::new());
    while let Some((_, message)) = out.pop() {
        match message {
            Message::Tile(tile) => {
                tiles.insert((tile.index.x, tile.index.y), tile.log_odds.iter().map(|cell| cell.to_bits()).collect());
            }
            Message::Info(info) => verdicts = info.verdicts.iter().collect(),
            _ => {}
        }
    }
    (tiles, verdicts)
}

#[test]
fn what_is_held_does_not_depend_on_what_comes_first() {
    let (tiles, verdicts) = mapped(0);
    let held = verdicts.iter().find(|(verdict, _)| *verdict == Verdict::Held).map(|(_, count)| *count);
    assert_eq!(held, Some((PLACED - ROOM) * u64::from(SONARS)), "those before the last that there is room for");
    for ahead in [-25, -7, 1, 6, 25, 60] {
        let other = mapped(ahead);
        assert_eq!(other.1, verdicts, "scans {ahead} steps ahead");
        assert!(other.0 == tiles, "scans {ahead} steps ahead: another map");
    }
}
