//! Lidars whose beams are thinner than a cell, and maps far from the origin of their frame.

#![allow(clippy::expect_used, reason = "tests")]

use std::collections::BTreeSet;

use echogrid_core::config::{Fusion, Limit, Noise};
use echogrid_core::grid::{CellIndex, Grid};
use echogrid_core::log_odds::log_odds_of;
use echogrid_core::{Echo, Estimate, GridMapper, MapperConfig, Pose2, Reading, Robot, Sensor, SensorKind, Verdict};

/// Half of the sides of the room, metres.
const ROOM_M: (f64, f64) = (9.3, 6.2);

fn lidar(beams: u16, aperture_rad: f64) -> Robot {
    let sensor = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::new(0.1, -0.02, 0.05),
        first_transducer: 0,
        transducers: beams,
        first_bearing_rad: -core::f64::consts::PI,
        bearing_step_rad: core::f64::consts::TAU / f64::from(beams),
        aperture_rad,
        range_min_m: 0.02,
        range_max_m: 25.0,
        range_error_ratio: 0.005,
    };
    Robot { sensors: vec![sensor], ..Robot::default() }
}

/// To the walls of the room, along a beam from within.
fn range_m(beam: Pose2) -> f64 {
    let (sin, cos) = libm::sincos(beam.theta);
    let to = |direction: f64, at: f64, wall: f64| {
        if direction == 0.0 { f64::INFINITY } else { (wall * direction.signum() - at) / direction }
    };
    to(cos, beam.x, ROOM_M.0).min(to(sin, beam.y, ROOM_M.1))
}

/// A scan of the room from `pose`; where each beam begins, and how far it goes.
fn scan(robot: &Robot, pose: Pose2) -> Vec<(Pose2, f64)> {
    let beams = (0..robot.sensors[0].transducers).map(|beam| {
        let beam = pose * robot.transducer(beam).expect("a beam").base_from_transducer;
        (beam, range_m(beam))
    });
    beams.collect()
}

/// Moves what was measured from `scanned_from` as if the robot were at `pose`.
fn map(config: &MapperConfig, robot: &Robot, scanned_from: Pose2, pose: Pose2) -> GridMapper {
    let mut mapper = GridMapper::new(config, Noise::OneSigma, 1, robot.clone()).expect("valid");
    let readings = scan(robot, scanned_from).into_iter().enumerate().map(|(beam, (_, range_m))| {
        let reading = Reading { transducer: beam as u16, echo: Echo::Hit { range_m }, offset_ns: 0 };
        (reading, Some(Estimate::certain(pose)))
    });
    let verdicts = mapper.integrate_scan(1, &readings.collect::<Vec<_>>());
    assert!(verdicts.iter().all(|verdict| *verdict == Verdict::Accepted));
    mapper
}

/// Every cell that a ray goes through, but for corners that it only brushes.
fn crossed(grid: &Grid, (beam, range_m): (Pose2, f64)) -> Vec<CellIndex> {
    const STEP_M: f64 = 1e-3;
    let (sin, cos) = libm::sincos(beam.theta);
    let steps = (range_m / STEP_M) as u32;
    let mut cells: Vec<CellIndex> =
        (0..=steps).map(|n| f64::from(n) * STEP_M).map(|d| grid.cell_at(beam.x + d * cos, beam.y + d * sin)).collect();
    cells.dedup();
    cells
}

fn known(grid: &Grid) -> Vec<(CellIndex, f32)> {
    let cells = grid.tiles().flat_map(|(index, tile)| {
        let first = index.first_cell();
        tile.log_odds.iter().enumerate().map(move |(offset, value)| {
            (CellIndex { i: first.i + (offset % 64) as i32, j: first.j + (offset / 64) as i32 }, *value)
        })
    });
    cells.filter(|(_, value)| !value.is_nan()).collect()
}

#[test]
fn a_thin_beam_leaves_no_cell_that_it_crosses_unknown() {
    for fusion in [Fusion::Paper, Fusion::FirstEcho, Fusion::Oriented] {
        for (beams, aperture_rad) in [(360, 0.001), (360, 0.003), (180, 0.006), (720, 0.002), (16, 0.0045)] {
            for pose in [Pose2::new(-6.0, 1.0, 0.3), Pose2::IDENTITY, Pose2::new(0.025, 0.075, -1.6)] {
                let robot = lidar(beams, aperture_rad);
                let config = MapperConfig { fusion, ..MapperConfig::default() };
                let mapper = map(&config, &robot, pose, pose);
                let grid = mapper.grid();
                let mut seen = BTreeSet::new();
                for ray in scan(&robot, pose) {
                    for cell in crossed(grid, ray) {
                        assert!(grid.log_odds(cell).is_some(), "{beams} {aperture_rad} {pose:?}: {cell:?} is a hole");
                        seen.insert(cell);
                    }
                }
                // No work for what no beam comes near: a cell behind the wall, and what the cones have wider than a ray
                let touched = known(grid).len();
                assert!(touched < seen.len() * 13 / 10, "{beams} {aperture_rad}: {touched} cells of {}", seen.len());
                // Walls are thin: no thicker than 2 σ_z of the longest beam, and a cell
                for (cell, log_odds) in known(grid).into_iter().filter(|(_, log_odds)| *log_odds > 0.6) {
                    let [x, y] = grid.centre(cell);
                    let off_m = (ROOM_M.0 - x.abs()).abs().min((ROOM_M.1 - y.abs()).abs());
                    assert!(off_m < 0.2, "{beams} {aperture_rad}: {log_odds} {off_m} m from a wall");
                }
            }
        }
    }
}

#[test]
fn a_ray_counts_once_in_each_cell() {
    let robot = lidar(1, 0.002);
    let footprint_m = Limit::Metres(0.0);
    let config = MapperConfig { fusion: Fusion::Paper, footprint_m, ..MapperConfig::default() };
    let mapper = map(&config, &robot, Pose2::IDENTITY, Pose2::IDENTITY);
    let (beam, range_m) = scan(&robot, Pose2::IDENTITY)[0];
    for cell in crossed(mapper.grid(), (beam, 0.7 * range_m)) {
        let [x, y] = mapper.grid().centre(cell);
        let d = libm::hypot(x - beam.x, y - beam.y);
        // Region I on the axis, w = 1
        let near_m = range_m - 2.0 * (0.005 * range_m).max(0.025);
        let p = 0.5 - (0.5 - config.p_free) * (1.0 - d * d / (near_m * near_m));
        let gained = f64::from(mapper.grid().log_odds(cell).expect("known"));
        assert!((gained - log_odds_of(p)).abs() < 2e-4, "{cell:?}: {gained}");
    }
}

/// A number that stays itself when whole cells are added to it.
fn exact(x: f64) -> f64 {
    (x * 16_777_216.0).round() / 16_777_216.0
}

#[test]
fn as_far_off_as_utm_the_map_is_the_same_to_the_last_bit() {
    const CELL_M: f64 = 0.0625;
    let (i, j) = (8_000_000, 86_400_000);
    for fusion in [Fusion::Paper, Fusion::FirstEcho, Fusion::Oriented] {
        for (beams, aperture_rad) in [(360, 0.003), (360, core::f64::consts::TAU / 360.0), (12, 0.5)] {
            let robot = lidar(beams, aperture_rad);
            let robot = Robot {
                // A mount that turns the numbers would round them.
                sensors: vec![Sensor { base_from_sensor: Pose2::IDENTITY, ..robot.sensors[0].clone() }],
                ..robot
            };
            let config = MapperConfig { fusion, resolution_m: CELL_M, ..MapperConfig::default() };
            let here = Pose2::new(exact(1.2345), exact(-2.3456), 0.7);
            let there = Pose2 { x: here.x + f64::from(i) * CELL_M, y: here.y + f64::from(j) * CELL_M, ..here };
            assert!(there.y > 5.3e6);
            let bits = |mapper: &GridMapper, i: i32, j: i32| -> Vec<(i32, i32, u32)> {
                let cells = known(mapper.grid()).into_iter();
                let mut cells: Vec<_> = cells.map(|(cell, l)| (cell.i - i, cell.j - j, l.to_bits())).collect();
                cells.sort_unstable();
                cells
            };
            let (near, far) = (map(&config, &robot, here, here), map(&config, &robot, here, there));
            assert!(bits(&near, 0, 0) == bits(&far, i, j), "{fusion:?} {beams}");
        }
    }
}
