//! The fast kernel against the reference model, cell by cell.

#![allow(clippy::expect_used, reason = "tests")]

use std::collections::BTreeMap;

use echogrid_core::grid::{CellIndex, Grid, TileIndex};
use echogrid_core::kernel::{BOUND, CELL_LIMIT, Kernel};
use echogrid_core::log_odds::log_odds_of;
use echogrid_core::noise::NoiseTerms;
use echogrid_core::sensor_model::{Cone, Deviations};
use echogrid_core::{OdometryErrors, Pose2, wrap_angle};
use proptest::prelude::*;

const LOG_ODDS_MAX: f64 = 8.0;

/// What the reference says a cone adds, and the cells that lie on a border, where rounding decides.
struct Expected {
    gains: BTreeMap<CellIndex, f64>,
    on_a_border: Vec<CellIndex>,
}

fn expected(grid: &Grid, pose: Pose2, cone: &Cone, prior: f64) -> Expected {
    let mut expected = Expected { gains: BTreeMap::new(), on_a_border: Vec::new() };
    let reach = cone.far_m() + 2.0 * grid.resolution_m();
    let (low, high) = (grid.cell_at(pose.x - reach, pose.y - reach), grid.cell_at(pose.x + reach, pose.y + reach));
    let slack_m = 1e-9 + 1e-15 * (pose.x.abs() + pose.y.abs());
    for j in low.j..=high.j {
        for i in low.i..=high.i {
            let cell = CellIndex { i, j };
            let [x, y] = grid.centre(cell);
            let (dx, dy) = (x - pose.x, y - pose.y);
            let d = libm::hypot(dx, dy);
            let bearing = wrap_angle(libm::atan2(dy, dx) - pose.theta);
            let close = |a: f64, b: f64, slack: f64| (a - b).abs() < slack;
            if close(d, cone.near_m(), slack_m)
                || close(d, cone.far_m(), slack_m)
                || d < slack_m
                || close(bearing.abs(), 0.5 * cone.aperture_rad, 1e-9 + slack_m / d)
            {
                expected.on_a_border.push(cell);
            } else if let Some(p) = cone.probability(d, bearing) {
                expected.gains.insert(cell, log_odds_of(p) - prior);
            }
        }
    }
    expected
}

fn known_cells(grid: &Grid) -> Vec<CellIndex> {
    let mut cells = Vec::new();
    for (index, tile) in grid.tiles() {
        let first = index.first_cell();
        for (offset, value) in tile.log_odds.iter().enumerate() {
            if !value.is_nan() {
                cells.push(CellIndex { i: first.i + (offset % 64) as i32, j: first.j + (offset / 64) as i32 });
            }
        }
    }
    cells
}

#[derive(Debug, Clone)]
struct Case {
    resolution_m: f64,
    prior: f64,
    readings: Vec<(Pose2, Cone)>,
}

fn reading(resolution_m: f64, p_occupied: f64, p_free: f64) -> impl Strategy<Value = (Pose2, Cone)> {
    let degrees = core::f64::consts::PI / 180.0;
    let far_off = prop_oneof![4 => Just(0.0), 1 => -1e5..1e5f64];
    // Axes along the rows and columns, and transducers on centres and corners, are where spans go wrong.
    let axis = prop_oneof![
        3 => -core::f64::consts::PI..core::f64::consts::PI,
        1 => (-12..=12i32).prop_map(move |step| f64::from(step) * 15.0 * degrees),
    ];
    let place = move || {
        prop_oneof![
            3 => -3.0..3.0f64,
            1 => (-100..100i32).prop_map(move |half_cells| f64::from(half_cells) * 0.5 * resolution_m),
        ]
    };
    let aperture = prop_oneof![
        4 => Just(30.0),
        2 => 0.1..60.0f64,
        1 => prop_oneof![Just(0.25), Just(60.0), Just(120.0), Just(180.0), Just(270.0), Just(360.0)],
    ];
    let errors = prop_oneof![
        1 => Just(OdometryErrors::default()),
        2 => (0.0..0.3f64, 0.0..0.3f64, 0.0..0.02f64, 0.0..0.02f64).prop_map(|(a, b, c, d)| OdometryErrors {
            e_lin_m: a, e_ang_rad: b, eps_lin_m2: c, eps_ang_rad2: d,
        }),
        1 => (0.0..5.0f64, 0.0..5.0f64).prop_map(|(a, b)| OdometryErrors {
            e_lin_m: a, e_ang_rad: b, ..OdometryErrors::default()
        }),
    ];
    // A few tens of cells, whatever the resolution.
    let range = (0.3..70.0f64).prop_map(move |cells| cells * resolution_m);
    let cap = prop_oneof![3 => Just(100.0), 1 => 1.0..60.0f64];
    (place(), place(), far_off, axis, aperture, errors, range, cap).prop_map(
        move |(x, y, far_off, axis, aperture, errors, range_m, cap)| {
            let aperture_rad = aperture * degrees;
            let noise = NoiseTerms::one_sigma(&errors);
            let cone = Cone {
                range_m,
                aperture_rad,
                range_cap_m: cap * resolution_m,
                deviations: Deviations::of(range_m, aperture_rad, 0.01, resolution_m, &errors, noise),
                p_occupied,
                p_free,
                leaves_gaps: false,
            };
            (Pose2::new(x + far_off, y - far_off, axis), cone)
        },
    )
}

fn case() -> impl Strategy<Value = Case> {
    let resolution = prop_oneof![Just(0.05), Just(0.02), Just(0.1), Just(0.25), 0.01..0.5f64];
    let peaks = prop_oneof![2 => Just((0.85, 0.30)), 1 => (0.501..0.999f64, 0.001..0.499f64)];
    let prior = prop_oneof![3 => Just(0.0), 1 => -2.0..2.0f64];
    (resolution, peaks, prior).prop_flat_map(|(resolution_m, (p_occupied, p_free), prior)| {
        prop::collection::vec(reading(resolution_m, p_occupied, p_free), 1..4).prop_map(move |readings| Case {
            resolution_m,
            prior,
            readings,
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn agrees_with_the_reference(case in case()) {
        let mut grid = Grid::new(case.resolution_m);
        let mut kernel = Kernel::new(case.prior, LOG_ODDS_MAX);
        for (sequence, (pose, cone)) in case.readings.iter().enumerate() {
            let before = grid.clone();
            let Expected { gains, on_a_border } = expected(&grid, *pose, cone, case.prior);
            let begun = grid.mark();
            kernel.add(&mut grid, *pose, cone, sequence as u64 + 1).expect("on the map");
            let changed = grid.changed_since(begun);
            for cell in known_cells(&grid) {
                if on_a_border.contains(&cell) {
                    continue;
                }
                let (now, was) = (grid.log_odds(cell).expect("known"), before.log_odds(cell));
                let Some(gain) = gains.get(&cell) else {
                    prop_assert_eq!(Some(now), was, "{:?} is not in the cone", cell);
                    continue;
                };
                let start = was.map_or(case.prior, f64::from);
                let wanted = (start + gain).clamp(-LOG_ODDS_MAX, LOG_ODDS_MAX);
                let rounding = 2.0 * f64::from(f32::EPSILON) * (wanted.abs() + case.prior.abs());
                prop_assert!((f64::from(now) - wanted).abs() <= BOUND + rounding, "{cell:?}: {now} not {wanted}");
                prop_assert!(now.abs() <= LOG_ODDS_MAX as f32);
                prop_assert!(changed.contains(&cell.tile()));
                prop_assert_eq!(grid.tile(cell.tile()).expect("there").revision, sequence as u64 + 1);
            }
            for cell in gains.keys() {
                prop_assert!(grid.log_odds(*cell).is_some(), "{cell:?} was left out");
            }
            // No tile was made, or called changed, for nothing.
            let border_tiles: Vec<TileIndex> = on_a_border.iter().map(|cell| cell.tile()).collect();
            for tile in &changed {
                prop_assert!(gains.keys().any(|cell| cell.tile() == *tile) || border_tiles.contains(tile));
            }
        }
    }

    /// Moving everything by whole cells (a power of two of metres, so that it is exact) moves the map.
    #[test]
    fn whole_cells_do_not_matter((pose, cone) in reading(0.0625, 0.85, 0.3), di in -200..200i32, dj in -200..200i32) {
        // So that the shifted coordinates are exact too.
        let exact = |x: f64| (x * 1_048_576.0).round() / 1_048_576.0;
        let pose = Pose2 { x: exact(pose.x), y: exact(pose.y), ..pose };
        let moved = Pose2 { x: pose.x + f64::from(di) * 0.0625, y: pose.y + f64::from(dj) * 0.0625, ..pose };
        let map = |pose| {
            let mut grid = Grid::new(0.0625);
            Kernel::new(0.0, LOG_ODDS_MAX).add(&mut grid, pose, &cone, 1).expect("on the map");
            grid
        };
        let (here, there) = (map(pose), map(moved));
        let here_cells = known_cells(&here);
        prop_assert_eq!(here_cells.len(), known_cells(&there).len());
        for cell in here_cells {
            let shifted = CellIndex { i: cell.i + di, j: cell.j + dj };
            let (here, there) = (here.log_odds(cell).expect("known"), there.log_odds(shifted).expect("known"));
            prop_assert!(f64::from((here - there).abs()) <= 2.0 * BOUND, "{here} {there}");
        }
    }

    /// The order of readings matters only to rounding, as long as no cell is clamped.
    #[test]
    fn order_does_not_matter(readings in prop::collection::vec(reading(0.1, 0.85, 0.3), 2..6)) {
        let map = |readings: &mut dyn Iterator<Item = &(Pose2, Cone)>| {
            let (mut grid, mut kernel) = (Grid::new(0.1), Kernel::new(0.0, 50.0));
            for (pose, cone) in readings {
                kernel.add(&mut grid, *pose, cone, 1).expect("on the map");
            }
            grid
        };
        let (forth, back) = (map(&mut readings.iter()), map(&mut readings.iter().rev()));
        prop_assert_eq!(known_cells(&forth), known_cells(&back));
        for cell in known_cells(&forth) {
            let (a, b) = (forth.log_odds(cell).expect("known"), back.log_odds(cell).expect("known"));
            prop_assert!((a - b).abs() < 1e-5);
        }
    }

    /// Whatever the numbers, it neither panics nor leaves the bounds.
    #[test]
    fn refuses_or_survives_anything(
        x in prop::num::f64::ANY, y in prop::num::f64::ANY, theta in prop::num::f64::ANY,
        range_m in prop_oneof![prop::num::f64::ANY, 0.1..3.0f64],
        sigma_z_m in prop_oneof![prop::num::f64::ANY, 0.01..3.0f64],
        aperture_rad in prop_oneof![prop::num::f64::ANY, 0.01..7.0f64],
        range_cap_m in prop_oneof![prop::num::f64::ANY, 0.01..3.0f64],
        at_home in any::<bool>(),
    ) {
        let pose = if at_home { Pose2::new(0.1, 0.2, 0.3) } else { Pose2 { x, y, theta } };
        let cone = Cone {
            range_m,
            aperture_rad,
            // Large cones are right but slow; the limit is tested apart.
            range_cap_m: if range_cap_m > 3.0 { 3.0 } else { range_cap_m },
            deviations: Deviations { sigma_z_m, sigma_theta_rad: aperture_rad, trust: 0.5 },
            p_occupied: 0.85,
            p_free: 0.3,
            leaves_gaps: false,
        };
        let mut grid = Grid::new(0.1);
        if Kernel::new(0.0, 8.0).add(&mut grid, pose, &cone, 1).is_ok() {
            for cell in known_cells(&grid) {
                prop_assert!(grid.log_odds(cell).expect("known").abs() <= 8.0);
            }
        } else {
            prop_assert_eq!(grid.tile_count(), 0);
        }
    }
}

fn sonar(range_m: f64) -> Cone {
    let aperture_rad = core::f64::consts::PI / 6.0;
    let errors = OdometryErrors::default();
    Cone {
        range_m,
        aperture_rad,
        range_cap_m: 5.0,
        deviations: Deviations::of(range_m, aperture_rad, 0.01, 0.05, &errors, NoiseTerms::default()),
        p_occupied: 0.85,
        p_free: 0.3,
        leaves_gaps: false,
    }
}

fn add(grid: &mut Grid, pose: Pose2, cone: &Cone) -> bool {
    Kernel::new(0.0, 8.0).add(grid, pose, cone, 1).is_ok()
}

#[test]
fn cells_stay_clamped_and_can_be_relearned() {
    let mut grid = Grid::new(0.05);
    let wall = grid.cell_at(2.0, 0.01);
    for _ in 0..100 {
        assert!(add(&mut grid, Pose2::IDENTITY, &sonar(2.0)));
    }
    assert_eq!(grid.log_odds(wall), Some(8.0));
    for _ in 0..100 {
        assert!(add(&mut grid, Pose2::IDENTITY, &sonar(3.0)));
    }
    assert!(grid.log_odds(wall).expect("known") < 0.0);
}

#[test]
fn small_increments_are_not_lost() {
    // A reading whose trust is so low that a cell gains some 1e-4; a thousand of them onto a cell that is nearly sure.
    let mut cone = sonar(2.0);
    cone.deviations.trust = 1e-4;
    let mut grid = Grid::new(0.05);
    let cell = grid.cell_at(2.0, 0.01);
    grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 7.0;
    let [x, y] = grid.centre(cell);
    let p = cone.probability(libm::hypot(x, y), libm::atan2(y, x)).expect("in the cone");
    for _ in 0..1000 {
        assert!(add(&mut grid, Pose2::IDENTITY, &cone));
    }
    let gained = f64::from(grid.log_odds(cell).expect("known")) - 7.0;
    assert!((gained / (1000.0 * log_odds_of(p)) - 1.0).abs() < 5e-3, "{gained}");
}

#[test]
fn the_ends_of_the_map_refuse() {
    let edge = f64::from(CELL_LIMIT) * 0.05;
    for (x, y) in [(edge, 0.0), (0.0, -edge), (edge - 2.0, 0.0), (1e300, 0.0), (f64::NAN, 0.0), (0.0, f64::INFINITY)] {
        let mut grid = Grid::new(0.05);
        assert!(!add(&mut grid, Pose2 { x, y, theta: 0.0 }, &sonar(2.0)), "({x}, {y})");
        assert_eq!(grid.tile_count(), 0);
    }
    let mut grid = Grid::new(0.05);
    assert!(add(&mut grid, Pose2 { x: edge - 10.0, y: 10.0 - edge, theta: 0.0 }, &sonar(2.0)));
    assert!(grid.tile_count() > 0);
}

#[test]
fn a_cone_larger_than_any_sensors_is_refused() {
    for range_m in [1e4, 1e9, 1e300] {
        let cone = Cone { range_cap_m: f64::MAX, ..sonar(range_m) };
        assert!(!add(&mut Grid::new(0.05), Pose2::IDENTITY, &cone), "{range_m}");
    }
    // A lidar's beam may be long, for it is narrow.
    let cone = Cone { range_cap_m: 300.0, aperture_rad: 0.005, ..sonar(250.0) };
    let cone = Cone { deviations: Deviations { sigma_theta_rad: 0.0025, ..cone.deviations }, ..cone };
    assert!(add(&mut Grid::new(0.05), Pose2::IDENTITY, &cone));
}
