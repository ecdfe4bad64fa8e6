//! Beams that stand side by side, added in one pass: against the reference model, and against the same beams one by one.

#![allow(clippy::expect_used, reason = "tests")]

use std::collections::BTreeMap;

use echogrid_core::config::{Fusion, Noise};
use echogrid_core::grid::{CellIndex, Grid};
use echogrid_core::kernel::{BOUND, FanKernel};
use echogrid_core::log_odds::log_odds_of;
use echogrid_core::noise::NoiseTerms;
use echogrid_core::sensor_model::{Cone, Deviations};
use echogrid_core::{
    Echo, Estimate, GridMapper, MapperConfig, OdometryErrors, Pose2, Reading, Robot, Sensor, SensorKind, why,
    wrap_angle,
};
use proptest::prelude::*;

const LOG_ODDS_MAX: f64 = 8.0;

#[derive(Debug, Clone)]
struct Case {
    resolution_m: f64,
    map_from_first: Pose2,
    step_rad: f64,
    beams: Vec<(u16, Cone)>,
}

fn case() -> impl Strategy<Value = Case> {
    let step = prop_oneof![Just(1.0), Just(0.5), Just(0.25), Just(2.0), 0.06..2.2f64];
    let step = (step, any::<bool>()).prop_map(|(degrees, mirrored)| {
        let step_rad = degrees * core::f64::consts::PI / 180.0;
        if mirrored { -step_rad } else { step_rad }
    });
    let place = prop_oneof![3 => -3.0..3.0f64, 1 => (-100..100i32).prop_map(|n| f64::from(n) * 0.025)];
    let axis = prop_oneof![3 => -3.1..3.1f64, 1 => (-12..=12i32).prop_map(|n| f64::from(n) * 0.261_799_387_799_149_4)];
    let errors = prop_oneof![Just((0.0, 0.0)), (0.0..0.3f64, 0.0..0.1f64)];
    let peaks = prop_oneof![2 => Just((0.85, 0.30)), 1 => (0.501..0.999f64, 0.001..0.499f64)];
    let resolution = prop_oneof![Just(0.05), Just(0.02), 0.01..0.3f64];
    let beams = prop::collection::vec(prop_oneof![1 => Just(None), 6 => (0.5..90.0f64).prop_map(Some)], 1..120);
    (step, place.clone(), place, axis, errors, peaks, resolution, (beams, 0..300u16, 20.0..120.0f64)).prop_map(
        |(step_rad, x, y, axis, (e_lin_m, e_ang_rad), (p_occupied, p_free), resolution_m, (cells, first, cap))| {
            let errors = OdometryErrors { e_lin_m, e_ang_rad, ..OdometryErrors::default() };
            let cone = |(at, cells): (usize, Option<f64>)| {
                let (range_m, aperture_rad) = (cells? * resolution_m, step_rad.abs());
                // As beams of different directions have different deviations
                let noise = NoiseTerms { lin_m: 0.001 * at as f64, ang_rad: 0.0002 * at as f64 };
                let deviations = Deviations::of(range_m, aperture_rad, 0.01, resolution_m, &errors, noise);
                let range_cap_m = cap * resolution_m;
                let cone =
                    Cone { range_m, aperture_rad, range_cap_m, deviations, p_occupied, p_free, leaves_gaps: false };
                Some((first + at as u16, cone))
            };
            let beams = cells.into_iter().enumerate().filter_map(cone).collect();
            Case { resolution_m, map_from_first: Pose2::new(x, y, axis), step_rad, beams }
        },
    )
}

fn known(grid: &Grid) -> BTreeMap<CellIndex, f32> {
    let cells = grid.tiles().flat_map(|(index, tile)| {
        let first = index.first_cell();
        tile.log_odds.iter().enumerate().map(move |(offset, value)| {
            (CellIndex { i: first.i + (offset % 64) as i32, j: first.j + (offset / 64) as i32 }, *value)
        })
    });
    cells.filter(|(_, value)| !value.is_nan()).collect()
}

fn bits(grid: &Grid) -> Vec<(CellIndex, u32)> {
    known(grid).into_iter().map(|(cell, value)| (cell, value.to_bits())).collect()
}

/// What the reference says a cell gains of a scan, in order; none where it lies on a border.
fn expected(case: &Case, grid: &Grid, cell: CellIndex) -> Option<Vec<f64>> {
    let [x, y] = grid.centre(cell);
    let (dx, dy) = (x - case.map_from_first.x, y - case.map_from_first.y);
    let (d, direction) = (libm::hypot(dx, dy), libm::atan2(dy, dx));
    let mut gains = Vec::new();
    for (beam, cone) in &case.beams {
        let bearing = wrap_angle(direction - case.map_from_first.theta - f64::from(*beam) * case.step_rad);
        let off_edge = (bearing.abs() - 0.5 * cone.aperture_rad).abs();
        let close = |border: f64| (d - border).abs() < 1e-6 * d + 1e-9;
        if d < 1e-6 || off_edge < 2e-4 * cone.aperture_rad || close(cone.near_m()) || close(cone.far_m()) {
            return None;
        }
        gains.extend(cone.probability(d, bearing).map(log_odds_of));
    }
    Some(gains)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn agrees_with_the_reference(case in case()) {
        let mut grid = Grid::new(case.resolution_m);
        let mut kernel = FanKernel::new(0.0, LOG_ODDS_MAX);
        kernel.add(&mut grid, case.map_from_first, case.step_rad, &case.beams, 7).expect("on the map");
        let found = known(&grid);
        let reach = (case.beams.iter().fold(0.0, |far: f64, (_, cone)| far.max(cone.far_m())) / case.resolution_m) as i32 + 2;
        let middle = grid.cell_at(case.map_from_first.x, case.map_from_first.y);
        for j in middle.j - reach..=middle.j + reach {
            for i in middle.i - reach..=middle.i + reach {
                let cell = CellIndex { i, j };
                let Some(gains) = expected(&case, &grid, cell) else { continue };
                let got = found.get(&cell).map(|value| f64::from(*value));
                prop_assert_eq!(got.is_some(), !gains.is_empty(), "{:?}", cell);
                let wanted: f64 = gains.iter().sum();
                let off = (got.unwrap_or(0.0) - wanted.clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX)).abs();
                prop_assert!(off <= BOUND * gains.len() as f64, "{cell:?}: {got:?} not {wanted}");
            }
        }
        for (_, tile) in grid.tiles() {
            prop_assert!(tile.revision == 7 && tile.log_odds.iter().any(|value| !value.is_nan()));
        }
    }

    /// Whoever looks at a beam alone, sees what it did among all.
    #[test]
    fn one_by_one_gives_the_same_bits(case in case(), again in any::<bool>()) {
        let (mut together, mut apart) = (Grid::new(case.resolution_m), Grid::new(case.resolution_m));
        let mut kernel = FanKernel::new(0.0, LOG_ODDS_MAX);
        for _ in 0..=u8::from(again) {
            kernel.add(&mut together, case.map_from_first, case.step_rad, &case.beams, 1).expect("on the map");
            for beam in &case.beams {
                kernel.add(&mut apart, case.map_from_first, case.step_rad, &[*beam], 1).expect("on the map");
            }
        }
        prop_assert!(bits(&together) == bits(&apart));
    }
}

#[test]
fn what_is_no_fan_is_refused() {
    let deviations = Deviations { sigma_z_m: 0.05, sigma_theta_rad: 0.01, trust: 1.0 };
    let cone = |range_m| Cone {
        range_m,
        aperture_rad: 0.02,
        range_cap_m: 1e9,
        deviations,
        p_occupied: 0.85,
        p_free: 0.3,
        leaves_gaps: false,
    };
    let mut grid = Grid::new(0.05);
    let mut refused = |step_rad: f64, beams: &[(u16, Cone)]| {
        let added = FanKernel::new(0.0, 8.0).add(&mut grid, Pose2::IDENTITY, step_rad, beams, 1);
        added.is_err() && grid.tile_count() == 0
    };
    assert!(refused(0.0, &[(0, cone(1.0))]));
    assert!(refused(f64::NAN, &[(0, cone(1.0))]));
    assert!(refused(0.5, &[(0, cone(1.0))]));
    assert!(refused(0.02, &[(1, cone(1.0)), (0, cone(1.0))]));
    assert!(refused(0.02, &[(0, cone(1.0)), (1, cone(1e8))]));
    assert!(refused(0.02, &[(0, cone(f64::NAN))]));
    assert!(!refused(0.02, &[(0, cone(1.0))]));
}

/// A lidar that looks around in more than a circle, off the middle of the robot.
fn robot(step_degrees: f64) -> Robot {
    let step_rad = step_degrees.to_radians();
    let sensor = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::new(0.11, -0.03, 0.4),
        first_transducer: 0,
        transducers: (361.0 / step_degrees.abs()) as u16,
        first_bearing_rad: -1.0,
        bearing_step_rad: step_rad,
        aperture_rad: step_rad.abs(),
        range_min_m: 0.02,
        range_max_m: 8.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: vec![sensor], ..Robot::default() }
}

/// Where the robot is at a scan, less and less surely.
fn estimate(scan: u32) -> Estimate {
    let t = f64::from(scan);
    let mut estimate = Estimate::certain(Pose2::new(0.07 * t, 0.02 * t, 0.1 * t));
    estimate.errors = OdometryErrors { eps_lin_m2: 1e-5 * t, eps_ang_rad2: 1e-8 * t, ..OdometryErrors::default() };
    (estimate.covariance[(0, 0)], estimate.covariance[(1, 1)]) = (2e-4 * t, 2e-4 * t);
    estimate.covariance[(2, 2)] = 1e-9 * t;
    estimate
}

fn scan(robot: &Robot, number: u32) -> Vec<(Reading, Option<Estimate>)> {
    let reading = |beam: u16| {
        let range_m = 1.0 + f64::from((u32::from(beam) * 7919 + number * 104_729) % 1000) * 0.004;
        let echo = match (u32::from(beam) + number) % 41 {
            0 => Echo::NoEcho,
            1 => Echo::Invalid,
            2 => Echo::Hit { range_m: 30.0 },
            _ => Echo::Hit { range_m },
        };
        (Reading { transducer: beam, echo, offset_ns: 0 }, Some(estimate(number)))
    };
    (0..robot.sensors[0].transducers).map(reading).collect()
}

#[test]
fn a_scan_is_its_readings_one_after_the_other() {
    for (fusion, step_degrees) in [(Fusion::Paper, 1.0), (Fusion::Paper, -0.5), (Fusion::Covariance, 0.25)] {
        let robot = robot(step_degrees);
        let config = MapperConfig { fusion, min_trust: 0.0, ..MapperConfig::default() };
        let new = |config| GridMapper::new(config, Noise::Sampled, 3, robot.clone()).expect("valid");
        let doubtful = MapperConfig { doubt: true, ..config.clone() };
        let (mut together, mut apart, mut watched) = (new(&config), new(&config), new(&doubtful));
        for number in 0..8 {
            let scan = scan(&robot, number);
            let verdicts = together.integrate_scan(u64::from(number), &scan);
            assert_eq!(watched.integrate_scan(u64::from(number), &scan), verdicts);
            let one_by_one = scan.iter().map(|(reading, at)| apart.integrate(u64::from(number), reading, at.as_ref()));
            assert_eq!(one_by_one.collect::<Vec<_>>(), verdicts);
        }
        assert!(known(together.grid()).len() > 5000);
        assert!(bits(together.grid()) == bits(apart.grid()), "{fusion:?} {step_degrees}");
        assert!(bits(together.grid()) == bits(watched.grid()), "{fusion:?} {step_degrees}: doubt changes the map");
    }
}

#[test]
fn a_fix_and_the_kept_readings_tell_the_same() {
    let robot = robot(1.0);
    for (fusion, log_odds_max) in [(Fusion::Paper, 8.0), (Fusion::Covariance, 1.0)] {
        let config =
            MapperConfig { fusion, log_odds_max, keep_readings: true, min_trust: 0.1, ..MapperConfig::default() };
        let mut mapper = GridMapper::new(&config, Noise::Sampled, 3, robot.clone()).expect("valid");
        for number in 0..6 {
            mapper.integrate_scan(u64::from(number), &scan(&robot, number));
        }
        let check = |mapper: &GridMapper| {
            let cells = known(mapper.grid());
            for (cell, value) in cells.iter().step_by(cells.len() / 5) {
                let kept = mapper.kept_readings().expect("kept").iter();
                let told = why::why(&config, &robot, kept, mapper.grid().centre(*cell)).expect("valid");
                assert_eq!(told.log_odds.map(f32::to_bits), Some(value.to_bits()), "{fusion:?} {cell:?}");
            }
        };
        check(&mapper);
        let before = bits(mapper.grid());
        let after = Estimate { fixes: 1, ..Estimate::certain(Pose2::new(0.36, 0.11, 0.5)) };
        let told = mapper.rectify(100, &estimate(5), &after);
        assert!(told.readings > 1500 && before != bits(mapper.grid()), "{told:?}");
        check(&mapper);
    }
}
