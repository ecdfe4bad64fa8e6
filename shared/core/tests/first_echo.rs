//! The fast first-echo kernel against the reference, cell by cell.

#![allow(clippy::expect_used, reason = "tests")]

use std::collections::BTreeMap;

use echogrid_core::first_echo::{FirstEcho, SeenCell};
use echogrid_core::grid::{CellIndex, Grid};
use echogrid_core::kernel::{BOUND, CELL_LIMIT, EchoCone, FirstEchoKernel};
use echogrid_core::log_odds::probability_of;
use echogrid_core::noise::standard_normal_pair;
use echogrid_core::{Pose2, TileIndex, wrap_angle};
use proptest::prelude::*;

const LOG_ODDS_MAX: f64 = 8.0;

/// A grid in which some cells are known, some are not.
fn some_grid(resolution_m: f64, around: Pose2, seed: u64) -> Grid {
    let mut grid = Grid::new(resolution_m);
    let centre = grid.cell_at(around.x, around.y).tile();
    for (x, y) in [(0, 0), (-1, 0), (0, -1), (1, 1)] {
        let index = TileIndex { x: centre.x + x, y: centre.y + y };
        for (offset, cell) in grid.tile_mut(index).log_odds.iter_mut().enumerate() {
            let (value, known) = standard_normal_pair(seed, offset as u64, (x + 2 * y + 3) as u16);
            if known > -0.5 {
                *cell = (4.0 * value).clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX) as f32;
            }
        }
    }
    grid
}

/// What the reference says each cell gains; none where rounding decides whether a cell belongs, on which all others depend.
fn expected(grid: &Grid, pose: Pose2, cone: &EchoCone) -> Option<BTreeMap<CellIndex, f64>> {
    let (mut cells, mut seen) = (Vec::new(), Vec::new());
    let reach = cone.far_m() + 2.0 * grid.resolution_m();
    let (low, high) = (grid.cell_at(pose.x - reach, pose.y - reach), grid.cell_at(pose.x + reach, pose.y + reach));
    let is_close = |a: f64, b: f64| (a - b).abs() < 1e-8;
    for j in low.j..=high.j {
        for i in low.i..=high.i {
            let cell = CellIndex { i, j };
            let [x, y] = grid.centre(cell);
            let (dx, dy) = (x - pose.x, y - pose.y);
            let distance_m = libm::hypot(dx, dy);
            let bearing_rad = wrap_angle(libm::atan2(dy, dx) - pose.theta);
            if is_close(distance_m, cone.far_m()) || is_close(bearing_rad.abs(), 0.5 * cone.aperture_rad) {
                return None;
            }
            if distance_m > 0.0 && distance_m < cone.far_m() && bearing_rad.abs() < 0.5 * cone.aperture_rad {
                let log_odds = grid.log_odds(cell).map_or(0.0, f64::from) + cone.prior_log_odds;
                cells.push(cell);
                seen.push(SeenCell { distance_m, bearing_rad, probability: probability_of(log_odds) });
            }
        }
    }
    Some(cells.into_iter().zip(cone.reading.gains(&seen).into_iter().map(|gain| cone.weight * gain)).collect())
}

fn cone(resolution_m: f64) -> impl Strategy<Value = EchoCone> {
    let aperture = prop_oneof![4 => Just(30.0), 2 => 0.5..60.0f64, 1 => 60.0..200.0f64];
    let range = prop_oneof![6 => (1.0..60.0f64).prop_map(Some), 1 => Just(None)];
    let prior = prop_oneof![Just(-4.6), -6.0..1.0f64];
    (range, 0.3..20.0f64, aperture, 1.0..3.0f64, 0.02..0.9f64, 0.02..0.9f64, prior, 0.0..1.0f64).prop_map(
        move |(range, sigma_z, aperture_deg, wider, detection, clutter, prior_log_odds, weight)| {
            let aperture_rad = aperture_deg.to_radians();
            EchoCone {
                reading: FirstEcho {
                    range_m: range.map(|cells| cells * resolution_m),
                    sigma_z_m: sigma_z * resolution_m,
                    sigma_theta_rad: 0.5 * wider * aperture_rad,
                    detection,
                    clutter,
                    range_cap_m: 55.0 * resolution_m,
                    lost: clutter,
                },
                aperture_rad,
                prior_log_odds,
                weight,
                leaves_gaps: false,
            }
        },
    )
}

fn case() -> impl Strategy<Value = (f64, Pose2, EchoCone, u64)> {
    prop_oneof![Just(0.05), Just(0.1), 0.02..0.3f64].prop_flat_map(|resolution_m| {
        let pose = (-9.0..9.0f64, -9.0..9.0f64, -3.1..3.1f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta));
        (Just(resolution_m), pose, cone(resolution_m), any::<u64>())
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn agrees_with_the_reference((resolution_m, pose, cone, seed) in case()) {
        let before = some_grid(resolution_m, pose, seed);
        let Some(gains) = expected(&before, pose, &cone) else { return Ok(()) };
        let mut grid = before.clone();
        let begun = grid.mark();
        let mut kernel = FirstEchoKernel::new(0.0, LOG_ODDS_MAX);
        prop_assert!(kernel.add(&mut grid, pose, &cone, 7).is_ok());
        let changed = grid.changed_since(begun);
        for (index, tile) in grid.tiles() {
            let first = index.first_cell();
            for (offset, now) in tile.log_odds.iter().enumerate() {
                let cell = CellIndex { i: first.i + (offset % 64) as i32, j: first.j + (offset / 64) as i32 };
                let was = before.log_odds(cell);
                let Some(gain) = gains.get(&cell) else {
                    prop_assert_eq!((!now.is_nan()).then_some(*now), was, "{:?} is not in the cone", cell);
                    continue;
                };
                let wanted = (was.map_or(0.0, f64::from) + gain).clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX);
                let rounding = 2.0 * f64::from(f32::EPSILON) * wanted.abs();
                prop_assert!((f64::from(*now) - wanted).abs() <= BOUND + rounding, "{cell:?}: {now} not {wanted}");
                prop_assert!(now.abs() <= LOG_ODDS_MAX as f32);
                prop_assert!(changed.contains(&index) && tile.revision == 7);
            }
        }
        for cell in gains.keys() {
            prop_assert!(grid.log_odds(*cell).is_some(), "{cell:?} was left out");
        }
    }

    /// Whatever the numbers, it neither panics nor leaves the bounds.
    #[test]
    fn refuses_or_survives_anything(
        range_m in prop_oneof![prop::num::f64::ANY, 0.1..3.0f64],
        sigma_z_m in prop_oneof![prop::num::f64::ANY, 0.01..3.0f64],
        sigma_theta_rad in prop_oneof![prop::num::f64::ANY, 0.3..3.0f64],
        detection in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        clutter in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        weight in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        prior_log_odds in prop_oneof![prop::num::f64::ANY, -99.0..99.0f64],
        has_echo in any::<bool>(),
    ) {
        let reading = FirstEcho {
            range_m: has_echo.then_some(range_m),
            sigma_z_m,
            sigma_theta_rad,
            detection,
            clutter,
            range_cap_m: 3.0,
            lost: clutter,
        };
        let cone = EchoCone { reading, aperture_rad: 0.5, prior_log_odds, weight, leaves_gaps: false };
        let mut grid = Grid::new(0.1);
        let mut kernel = FirstEchoKernel::new(0.0, 8.0);
        if kernel.add(&mut grid, Pose2::new(0.1, 0.2, 0.3), &cone, 1).is_ok() {
            for (_, tile) in grid.tiles() {
                prop_assert!(tile.log_odds.iter().all(|cell| cell.is_nan() || cell.abs() <= 8.0));
            }
        } else {
            prop_assert_eq!(grid.tile_count(), 0);
        }
    }
}

#[test]
fn the_ends_of_the_map_refuse() {
    let edge = f64::from(CELL_LIMIT) * 0.05;
    let reading = FirstEcho {
        range_m: Some(2.0),
        sigma_z_m: 0.03,
        sigma_theta_rad: 0.3,
        detection: 0.2,
        clutter: 0.4,
        range_cap_m: 5.0,
        lost: 0.9,
    };
    let cone = EchoCone { reading, aperture_rad: 0.5, prior_log_odds: -4.6, weight: 1.0, leaves_gaps: false };
    let add = |pose: Pose2| {
        let mut grid = Grid::new(0.05);
        FirstEchoKernel::new(0.0, 8.0).add(&mut grid, pose, &cone, 1).is_ok()
    };
    for (x, y) in [(edge, 0.0), (0.0, -edge), (1e300, 0.0), (f64::NAN, 0.0), (0.0, f64::INFINITY)] {
        assert!(!add(Pose2 { x, y, theta: 0.0 }), "({x}, {y})");
    }
    assert!(add(Pose2::new(edge - 10.0, 10.0 - edge, 0.0)));
}
