//! The fast oriented kernel against the reference, cell by cell and state by state.

#![allow(clippy::expect_used, reason = "tests")]

use std::collections::BTreeMap;

use echogrid_core::grid::{CellIndex, Grid};
use echogrid_core::kernel::{CELL_LIMIT, ORIENTED_BOUND, OrientedCone, OrientedKernel};
use echogrid_core::noise::standard_normal_pair;
use echogrid_core::oriented::{DIRECTIONS, FacedCell, Oriented, Response, STATES, left_by_looks};
use echogrid_core::{Pose2, TileIndex, wrap_angle};
use proptest::prelude::*;

const LOG_ODDS_MAX: f64 = 8.0;
const DIFFUSE: f64 = 0.3;
const CRITICAL_RAD: f64 = 0.4;
/// ln of one step of a state's code, which a reading may round by.
const STEP: f64 = 4.9e-4;
/// Within what ln of a state stays.
const LIMITS: (f64, f64) = (-LOG_ODDS_MAX, LOG_ODDS_MAX + 2.436_116_486_4);

fn kernel() -> OrientedKernel {
    OrientedKernel::new(0.0, LOG_ODDS_MAX, DIFFUSE, CRITICAL_RAD)
}

fn prior(state: usize) -> f64 {
    if state == 0 { DIFFUSE } else { (1.0 - DIFFUSE) / DIRECTIONS as f64 }
}

/// A grid that some readings were told to; in one tile somebody else has moved the log-odds since.
fn some_grid(resolution_m: f64, around: Pose2, seed: u64) -> Grid {
    let (mut grid, mut kernel) = (Grid::new(resolution_m), kernel());
    for k in 0..40u16 {
        let (a, b) = standard_normal_pair(seed, 1, k);
        let (c, d) = standard_normal_pair(seed, 2, k);
        let cone = OrientedCone {
            reading: Oriented {
                range_m: (k % 6 > 0).then_some((25.0 + 8.0 * a).clamp(3.0, 50.0) * resolution_m),
                ..reading(resolution_m, 1.0)
            },
            ..cone_of(reading(resolution_m, 1.0), 30.0, 0.9, 1.0, resolution_m)
        };
        let (x, y) = (around.x + 10.0 * b * resolution_m, around.y + 10.0 * c * resolution_m);
        kernel.add(&mut grid, Pose2::new(x, y, d), &cone, 1).expect("on the map");
    }
    let centre = grid.cell_at(around.x, around.y).tile();
    for (offset, cell) in grid.tile_mut(TileIndex { ..centre }).log_odds.iter_mut().enumerate() {
        let (by, moved) = standard_normal_pair(seed, offset as u64, 3);
        if moved > 1.0 {
            *cell = (if cell.is_nan() { 0.0 } else { *cell } + by as f32).clamp(-8.0, 8.0);
        }
    }
    grid
}

fn reading(resolution_m: f64, sigma_z: f64) -> Oriented {
    Oriented {
        range_m: None,
        sigma_z_m: sigma_z * resolution_m,
        clutter: 0.4,
        range_cap_m: 55.0 * resolution_m,
        lost: 0.8,
    }
}

fn cone_of(reading: Oriented, aperture_deg: f64, detection: f64, weight: f64, resolution_m: f64) -> OrientedCone {
    OrientedCone {
        reading,
        detection,
        clear_m: 40.0 * resolution_m,
        aperture_rad: aperture_deg.to_radians(),
        prior_log_odds: -4.6,
        weight,
        looks: f64::INFINITY,
        leaves_gaps: false,
        draw: 1234,
    }
}

fn values(grid: &Grid, cell: CellIndex) -> [f64; STATES] {
    let shares = grid.tile(cell.tile()).and_then(|tile| tile.shares.as_ref());
    shares.map_or([1.0; STATES], |shares| shares.of(cell.offset_in_tile()).map(f64::from))
}

/// Log-odds that states come to.
fn log_odds(values: &[f64; STATES]) -> f64 {
    let sum: f64 = values.iter().enumerate().map(|(s, value)| prior(s) * value).sum();
    libm::log(sum).clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX)
}

/// A cell of a cone, as the reference is told of it.
struct Told {
    cell: CellIndex,
    distance_m: f64,
    logs: [f64; STATES],
    weights: Vec<f64>,
    answers: Vec<f64>,
}

/// What ln of each state was before (what others moved it by, too), what it gains, and what looks leave of the state at least.
type Gain = (f64, f64, f64);

/// What each state of each cell gains; none where rounding decides whether a cell belongs, on which all others depend.
fn expected(grid: &Grid, pose: Pose2, cone: &OrientedCone) -> Option<BTreeMap<CellIndex, Vec<Gain>>> {
    let response = Response::new(CRITICAL_RAD, DIRECTIONS);
    let mut cells = Vec::new();
    let reach = cone.far_m() + 2.0 * grid.resolution_m();
    let (low, high) = (grid.cell_at(pose.x - reach, pose.y - reach), grid.cell_at(pose.x + reach, pose.y + reach));
    let is_close = |a: f64, b: f64| (a - b).abs() < 1e-8;
    for j in low.j..=high.j {
        for i in low.i..=high.i {
            let cell = CellIndex { i, j };
            let [x, y] = grid.centre(cell);
            let (dx, dy) = (x - pose.x, y - pose.y);
            let distance_m = libm::hypot(dx, dy);
            let ray_rad = libm::atan2(dy, dx);
            let bearing_rad = wrap_angle(ray_rad - pose.theta);
            if is_close(distance_m, cone.far_m()) || is_close(bearing_rad.abs(), 0.5 * cone.aperture_rad) {
                return None;
            }
            if distance_m > 0.0 && distance_m < cone.far_m() && bearing_rad.abs() < 0.5 * cone.aperture_rad {
                let before = values(grid, cell);
                let moved = grid.log_odds(cell).map_or(0.0, |known| f64::from(known) - log_odds(&before));
                let logs = before.map(|value| (libm::log(value) + moved).clamp(LIMITS.0, LIMITS.1));
                let weights: Vec<f64> =
                    (0..STATES).map(|s| logs[s] + libm::log(prior(s)) + cone.prior_log_odds).collect();
                let answers: Vec<f64> = (0..STATES)
                    .map(|s| cone.detection * if s == 0 { 1.0 } else { response.share(s - 1, ray_rad) })
                    .collect();
                cells.push(Told { cell, distance_m, logs, weights, answers });
            }
        }
    }
    let faced: Vec<FacedCell<'_>> = cells
        .iter()
        .map(|told| FacedCell { distance_m: told.distance_m, log_weights: &told.weights, responses: &told.answers })
        .collect();
    let gains = cone.reading.gains(&faced);
    let of = |(told, gains): (&Told, Vec<f64>)| {
        let left = |s: usize| if s == 0 { 0.0 } else { left_by_looks(told.answers[s], cone.looks) };
        (told.cell, gains.iter().enumerate().map(|(s, gain)| (told.logs[s], cone.weight * gain, left(s))).collect())
    };
    Some(cells.iter().zip(gains).map(of).collect())
}

fn case() -> impl Strategy<Value = (f64, Pose2, OrientedCone, u64)> {
    prop_oneof![Just(0.05), Just(0.1), 0.02..0.3f64].prop_flat_map(|resolution_m| {
        let pose = (-9.0..9.0f64, -9.0..9.0f64, -3.1..3.1f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta));
        let aperture = prop_oneof![4 => Just(30.0), 2 => 0.5..40.0f64, 1 => 40.0..120.0f64];
        let range = prop_oneof![4 => (1.0..50.0f64).prop_map(Some), 1 => Just(None)];
        let weight = prop_oneof![Just(1.0), 0.0..1.0f64];
        let looks = prop_oneof![Just(f64::INFINITY), 1.0..20.0f64];
        let cone = (range, 0.5..8.0f64, aperture, 0.1..0.95f64, weight, looks).prop_map(
            move |(range, sigma_z, aperture_deg, detection, weight, looks)| {
                let range_m = range.map(|cells| cells * resolution_m);
                let reading = Oriented { range_m, ..reading(resolution_m, sigma_z) };
                OrientedCone { looks, ..cone_of(reading, aperture_deg, detection, weight, resolution_m) }
            },
        );
        (Just(resolution_m), pose, cone, any::<u64>())
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn agrees_with_the_reference((resolution_m, pose, cone, seed) in case()) {
        let before = some_grid(resolution_m, pose, seed);
        let Some(gains) = expected(&before, pose, &cone) else { return Ok(()) };
        let mut grid = before.clone();
        let begun = grid.mark();
        prop_assert!(kernel().add(&mut grid, pose, &cone, 7).is_ok());
        let changed = grid.changed_since(begun);
        for (index, tile) in grid.tiles() {
            let first = index.first_cell();
            for (offset, now) in tile.log_odds.iter().enumerate() {
                let cell = CellIndex { i: first.i + (offset % 64) as i32, j: first.j + (offset / 64) as i32 };
                let states = values(&grid, cell);
                let Some(gains) = gains.get(&cell) else {
                    // Its states may have been moved to where somebody else has moved the log-odds, as far as they go.
                    let (was, known) = (values(&before, cell), before.log_odds(cell));
                    let moved = known.map_or(0.0, |known| f64::from(known) - log_odds(&was));
                    let is_as_it_was = (!now.is_nan()).then_some(*now) == known;
                    let is_settled = moved.abs() > STEP && (f64::from(*now) - log_odds(&states)).abs() < 1e-5;
                    prop_assert!(is_as_it_was || is_settled, "{cell:?} is not in the cone: {known:?} {now}");
                    let alike = |(was, is): (&f64, &f64)| {
                        let wanted = (libm::log(*was) + moved).clamp(LIMITS.0, LIMITS.1);
                        (libm::log(*is) - wanted).abs() < STEP
                    };
                    prop_assert!(states == was || was.iter().zip(&states).all(alike), "{cell:?}: {was:?} {states:?}");
                    continue;
                };
                prop_assert!((f64::from(*now) - log_odds(&states)).abs() < 1e-5, "{now} is not what the states come to");
                for (s, (was, gain, left)) in gains.iter().enumerate() {
                        let kept = was.min(libm::log(*left));
                    let wanted = (was + gain).max(kept).clamp(LIMITS.0, LIMITS.1);
                    let off = (libm::log(states[s]) - wanted).abs();
                    // What is left of a wall near 0 hangs on the last digit of r.
                    let is_left = kept > was + gain && (states[s] - libm::exp(wanted)).abs() < 1e-3;
                    prop_assert!(is_left || off <= ORIENTED_BOUND + STEP, "{cell:?} {s}: {} not {wanted}", libm::log(states[s]));
                }
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
        detection in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        clutter in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        clear_m in prop_oneof![prop::num::f64::ANY, 0.0..9.0f64],
        weight in prop_oneof![prop::num::f64::ANY, 0.0..1.0f64],
        prior_log_odds in prop_oneof![prop::num::f64::ANY, -99.0..99.0f64],
        looks in prop_oneof![prop::num::f64::ANY, 1.0..99.0f64],
        has_echo in any::<bool>(),
    ) {
        let reading =
            Oriented { range_m: has_echo.then_some(range_m), sigma_z_m, clutter, range_cap_m: 3.0, lost: clutter };
        let cone = OrientedCone { detection, clear_m, weight, looks, prior_log_odds, ..cone_of(reading, 28.0, 0.5, 1.0, 0.1) };
        let mut grid = Grid::new(0.1);
        if kernel().add(&mut grid, Pose2::new(0.1, 0.2, 0.3), &cone, 1).is_ok() {
            for (_, tile) in grid.tiles() {
                prop_assert!(tile.log_odds.iter().all(|cell| cell.is_nan() || cell.abs() <= 8.0));
                let shares = tile.shares.as_ref().expect("states");
                prop_assert!((0..4096).all(|cell| shares.of(cell).iter().all(|value| *value > 0.0 && value.is_finite())));
            }
        }
        prop_assert!(cone.far_m().is_nan() || cone.far_m() < f64::from(CELL_LIMIT));
    }
}
