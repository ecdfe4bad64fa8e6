//! Maps that are good, and maps that are not.

use super::*;
use echogrid_core::world::WorldParts;

/// A room of 3 × 2 m with a cupboard that hides a corner.
fn room() -> World {
    let corners = [[0.012, 0.012], [3.012, 0.012], [3.012, 2.012], [0.012, 2.012]];
    let mut walls: Vec<Segment> = (0..4).map(|i| Segment { from: corners[i], to: corners[(i + 1) % 4] }).collect();
    walls.push(Segment { from: [2.012, 0.012], to: [2.012, 1.012] });
    World::new(WorldParts { walls, ..WorldParts::default() }).unwrap()
}

const PATH: [Pose2; 2] = [Pose2 { x: 0.5, y: 0.5, theta: 0.0 }, Pose2 { x: 1.0, y: 0.5, theta: 1.0 }];

fn put(grid: &mut Grid, cell: CellIndex, log_odds: f32) {
    grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
}

/// A map that says of every cell that counts what `said` makes of the truth.
fn map(said: impl Fn(TrueCell) -> Option<f32>) -> Grid {
    let mut grid = Grid::new(0.05);
    let truth = Truth::of(&room(), &PATH, &grid).unwrap();
    for (cell, kind) in truth.cells() {
        if let Some(log_odds) = said(kind) {
            put(&mut grid, cell, log_odds);
        }
    }
    grid
}

fn judge(grid: &Grid) -> Quality {
    Quality::of(grid, &room(), &PATH).unwrap()
}

#[test]
fn a_map_that_knows_nothing_scores_one_bit() {
    let nothing = Quality {
        bits: 1.0,
        bits_occupied: 1.0,
        bits_free: 1.0,
        calibration_error: 0.0,
        decided: 0.0,
        decided_wrong: 0.0,
        free_called_occupied: 0.0,
        wall_recall_10cm: 0.0,
        wall_precision_10cm: 0.0,
    };
    assert_eq!(judge(&Grid::new(0.05)), nothing);
    let even = judge(&map(|_| Some(0.0)));
    assert_eq!((even.bits, even.bits_occupied, even.bits_free), (1.0, 1.0, 1.0));
    assert!(even.calibration_error > 0.3, "even odds of free cells are a wrong claim: {even:?}");
}

#[test]
fn perfect_wrong_and_between() {
    let check = |wall: f64, free: f64, bits: f64, decided: f64, wrong: f64, recall: Option<f64>| {
        let said = |kind| Some(log_odds_of(if kind == TrueCell::Wall { wall } else { free }) as f32);
        let quality = judge(&map(said));
        assert!((quality.bits - bits).abs() < 1e-4, "{quality:?}");
        assert_eq!((quality.decided, quality.decided_wrong), (decided, wrong), "{quality:?}");
        assert_eq!(quality.wall_recall_10cm, recall.unwrap_or(quality.wall_recall_10cm), "{quality:?}");
    };
    check(1.0, 0.0, 1.4e-6, 1.0, 0.0, Some(1.0));
    check(0.0, 1.0, 19.9316, 1.0, 1.0, None);
    check(0.8, 0.2, 0.321_93, 1.0, 0.0, Some(1.0));
    check(0.2, 0.8, 2.321_93, 1.0, 1.0, None);
    check(0.6, 0.4, 0.736_97, 0.0, 0.0, Some(0.0));
}

#[test]
fn a_wall_one_cell_off_is_found_and_three_cells_off_is_not() {
    let truth = Truth::of(&room(), &PATH, &Grid::new(0.05)).unwrap();
    let shifted = |cells: i32| {
        let mut grid = Grid::new(0.05);
        for (cell, kind) in truth.cells() {
            if kind == TrueCell::Wall {
                put(&mut grid, CellIndex { i: cell.i - cells, j: cell.j - cells }, 8.0);
            }
        }
        judge(&grid)
    };
    let (one, three) = (shifted(1), shifted(3));
    assert!(one.bits_occupied < 0.01 && one.wall_recall_10cm == 1.0 && one.wall_precision_10cm == 1.0, "{one:?}");
    assert!(three.bits_occupied > 0.8 && three.wall_recall_10cm < 0.2, "{three:?}");
    assert!(three.wall_precision_10cm < 0.2, "{three:?}");
}

#[test]
fn what_counts() {
    let truth = Truth::of(&room(), &PATH, &Grid::new(0.05)).unwrap();
    let check = |x: f64, y: f64, expected: TrueCell| {
        assert_eq!(truth.at(Grid::new(0.05).cell_at(x, y)), expected, "{x} {y}");
    };
    check(0.5, 0.5, TrueCell::Free);
    check(1.9, 1.9, TrueCell::Free);
    // Behind the cupboard; seen over it.
    check(2.8, 0.3, TrueCell::Open);
    check(2.8, 1.8, TrueCell::Free);
    check(0.01, 0.5, TrueCell::Wall);
    check(2.01, 0.5, TrueCell::Wall);
    // Beside the wall; behind it; its unseen stretch.
    check(0.06, 0.5, TrueCell::Open);
    check(0.11, 0.5, TrueCell::Free);
    check(-0.03, 0.5, TrueCell::Open);
    check(3.01, 0.3, TrueCell::Open);
    check(3.01, 1.8, TrueCell::Wall);
    check(900.0, 900.0, TrueCell::Open);
}

#[test]
fn sight_ends_at_four_metres() {
    let walls = vec![Segment { from: [-20.0, -1.0], to: [20.0, -1.0] }];
    let world = World::new(WorldParts { walls, ..WorldParts::default() }).unwrap();
    let truth = Truth::of(&world, &[Pose2::IDENTITY], &Grid::new(0.05)).unwrap();
    assert_eq!(truth.at(CellIndex { i: 79, j: 0 }), TrueCell::Free);
    assert_eq!(truth.at(CellIndex { i: 80, j: 0 }), TrueCell::Open);
}

#[test]
fn what_is_solid_is_wall() {
    let solid = echogrid_core::world::Solid::new(Pose2::new(1.0, -1.0, 0.0), 0.5, 4, vec![true; 16]);
    let world = World::new(WorldParts { solid, ..WorldParts::default() }).unwrap();
    let mut grid = Grid::new(0.05);
    // Deep in it.
    put(&mut grid, CellIndex { i: 40, j: 0 }, 8.0);
    let truth = Truth::of(&world, &[Pose2::IDENTITY], &grid).unwrap();
    let in_row: Vec<i32> = (-10..100).filter(|i| truth.is_wall(CellIndex { i: *i, j: 0 })).collect();
    assert_eq!(in_row, (20..60).collect::<Vec<_>>(), "neither less nor more than the 2 m that are solid");
    let quality = Quality::of(&grid, &world, &[Pose2::IDENTITY]).unwrap();
    assert_eq!((quality.wall_precision_10cm, quality.wall_recall_10cm), (1.0, 0.0));
}

#[test]
fn calibrated_is_what_comes_true() {
    let mut calibration = Calibration::default();
    for k in 0..10 {
        calibration.add(0.8, k < 8);
    }
    assert!(calibration.error() < 1e-12);
    for _ in 0..10 {
        calibration.add(0.05, true);
    }
    assert!((calibration.error() - 0.475).abs() < 1e-12);
}

#[test]
fn what_can_not_be_judged() {
    let far = [Pose2::new(500.0, 500.0, 0.0)];
    assert_eq!(Quality::of(&Grid::new(0.05), &room(), &far), Err(QualityError::NoWallSeen));
    assert_eq!(Quality::of(&Grid::new(0.05), &room(), &[]), Err(QualityError::NoWallSeen));
    let nowhere = [Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 }];
    assert_eq!(Quality::of(&Grid::new(0.05), &room(), &nowhere), Err(QualityError::NoWallSeen));
    let apart = [PATH[0], Pose2::new(9e4, 9e4, 0.0)];
    assert!(matches!(Quality::of(&Grid::new(0.05), &room(), &apart), Err(QualityError::TooLarge { .. })));
    for far in [&[Pose2::new(1e300, 0.0, 0.0)][..], &[Pose2::new(-1e300, 0.0, 0.0), Pose2::new(1e300, 0.0, 0.0)]] {
        assert!(matches!(Quality::of(&Grid::new(0.05), &room(), far), Err(QualityError::TooLarge { .. })));
    }
}
