//! How good a map is, against a known world and the true path.
//!
//! Cells that count ([`Truth`]): those whose centre was seen from the true path by straight sight past the cells of walls, and the
//! cells of walls beside a seen one. A cell within one cell of a wall is neither: whether a wall fills it is a matter of rounding.
//!
//! The score is the cross-entropy in bits: −log₂ of the probability that the map gave to the truth, averaged over the free
//! cells and over the cells of walls, and the two averaged. A map that knows nothing scores 1 bit, a perfect one almost 0, a
//! map that is confidently wrong more than 1.

use serde::Serialize;

use crate::grid::{CellIndex, Grid};
use crate::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, log_odds_of, probability_of};
use crate::pose::Pose2;
use crate::world::{Segment, World, columns_of_rows};

/// How far a robot sees by straight sight, metres.
pub const SIGHT_M: f64 = 4.0;
/// A wall is found where the map has one within this distance, metres.
pub const WALL_TOLERANCE_M: f64 = 0.10;
/// Probabilities are kept within [this, 1 − this]: no cell costs more than 20 bits.
pub const PROBABILITY_MIN: f64 = 1e-6;
/// Most cells of the rectangle that is judged.
pub const CELLS_MAX: u64 = 1 << 27;
/// Probabilities are compared with what happened in so many classes of equal width.
const CALIBRATION_CLASSES: usize = 10;

/// How good a map is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quality {
    /// Balanced cross-entropy per cell, bits: the mean of the next two.
    pub bits: f64,
    /// Of the cells of walls; each is judged by the highest probability of the 3 × 3 cells around it.
    pub bits_occupied: f64,
    /// Of the free cells.
    pub bits_free: f64,
    /// How far off the probabilities are, 0 to 1: over ten classes of probability, the mean difference between what the
    /// map said and how many of the class are walls. Unknown cells say nothing; 0 if none is known.
    pub calibration_error: f64,
    /// Share of the cells that count whose p is below 0.35 or above 0.65.
    pub decided: f64,
    /// Share of the cells that count that are decided the wrong way.
    pub decided_wrong: f64,
    /// Share of the free cells that count that are called occupied (p > 0.65).
    pub free_called_occupied: f64,
    /// Share of the cells of walls that count with an occupied cell of the map (p > 0.65) within 10 cm.
    pub wall_recall_10cm: f64,
    /// Share of the occupied cells of the whole map within 10 cm of a wall; 0 if it has none.
    pub wall_precision_10cm: f64,
}

/// Why a map can't be judged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum QualityError {
    /// The path sees no wall: path and world don't belong together.
    #[error(
        "no wall of the world was seen from the path; expected the path of a robot in this world, in its coordinates"
    )]
    NoWallSeen,
    /// The path sees nothing but walls.
    #[error("no free cell was seen from the path; expected a path through free space, and cells smaller than it")]
    NoFreeSeen,
    /// Map and path span too much.
    #[error("map and path span {width} x {height} cells, more than the {CELLS_MAX} that can be judged")]
    TooLarge {
        /// Cells along x.
        width: u64,
        /// Cells along y.
        height: u64,
    },
}

/// What a cell really is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrueCell {
    /// Seen, and free.
    Free,
    /// Of a wall beside a seen cell.
    Wall,
    /// Does not count: never seen, or too near to a wall to say.
    Open,
}

/// What a map should have found, cell by cell.
#[derive(Debug, Clone)]
pub struct Truth {
    low: CellIndex,
    width: usize,
    height: usize,
    wall: Vec<bool>,
    seen: Vec<bool>,
}

impl Truth {
    /// What can be known of `world` by a robot that drove along `path` (poses that are not finite are passed over), on the
    /// cells of `grid`.
    ///
    /// # Errors
    /// When map and path span too many cells.
    pub fn of(world: &World, path: &[Pose2], grid: &Grid) -> Result<Self, QualityError> {
        let (low, [width, height]) = rectangle(path, grid)?;
        let cells = width * height;
        let mut truth = Self { low, width, height, wall: vec![false; cells], seen: vec![false; cells] };
        truth.mark_walls(world, grid);
        truth.mark_seen(path, grid);
        Ok(truth)
    }

    /// The lowest cell of all that is known or can be seen, and how many columns and rows there are.
    #[must_use]
    pub fn rectangle(&self) -> (CellIndex, [usize; 2]) {
        (self.low, [self.width, self.height])
    }

    /// What a cell really is.
    #[must_use]
    pub fn at(&self, cell: CellIndex) -> TrueCell {
        let Some(index) = self.index(cell) else { return TrueCell::Open };
        let around = |marks: &[bool]| around(cell).any(|near| self.index(near).is_some_and(|index| marks[index]));
        match (self.wall[index], self.seen[index]) {
            (true, _) if around(&self.seen) => TrueCell::Wall,
            (false, true) if !around(&self.wall) => TrueCell::Free,
            _ => TrueCell::Open,
        }
    }

    /// Every cell that counts, row by row.
    pub fn cells(&self) -> impl Iterator<Item = (CellIndex, TrueCell)> {
        (0..self.wall.len()).map(|index| self.cell(index)).filter_map(|cell| match self.at(cell) {
            TrueCell::Open => None,
            kind => Some((cell, kind)),
        })
    }

    fn is_wall(&self, cell: CellIndex) -> bool {
        self.index(cell).is_some_and(|index| self.wall[index])
    }

    fn index(&self, cell: CellIndex) -> Option<usize> {
        let column = usize::try_from(i64::from(cell.i) - i64::from(self.low.i)).ok()?;
        let row = usize::try_from(i64::from(cell.j) - i64::from(self.low.j)).ok()?;
        (column < self.width && row < self.height).then_some(row * self.width + column)
    }

    fn cell(&self, index: usize) -> CellIndex {
        CellIndex { i: self.low.i + (index % self.width) as i32, j: self.low.j + (index / self.width) as i32 }
    }

    /// Every cell that a wall, a point or a part of what is solid lies in.
    fn mark_walls(&mut self, world: &World, grid: &Grid) {
        let parts = world.parts();
        let resolution_m = grid.resolution_m();
        let scaled =
            |[x, y]: [f64; 2]| [x / resolution_m - f64::from(self.low.i), y / resolution_m - f64::from(self.low.j)];
        let points = parts.points.iter().map(|point| Segment { from: *point, to: *point });
        for line in parts.walls.iter().copied().chain(points) {
            let line = Segment { from: scaled(line.from), to: scaled(line.to) };
            columns_of_rows(line, 0.0, [self.width, self.height], |row, columns| {
                columns.for_each(|column| self.wall[row * self.width + column] = true);
            });
        }
        for [x, y] in parts.solid.iter().flat_map(|solid| solid.samples(resolution_m)) {
            if let Some(index) = self.index(grid.cell_at(x, y)) {
                self.wall[index] = true;
            }
        }
    }

    /// Every cell that is no wall and whose centre is seen from some point of the path.
    fn mark_seen(&mut self, path: &[Pose2], grid: &Grid) {
        let resolution_m = grid.resolution_m();
        let reach = (SIGHT_M / resolution_m) as i32 + 1;
        let mut last: Option<Pose2> = None;
        for pose in path.iter().filter(|pose| pose.is_finite()) {
            // From half a cell further on, nothing else is seen.
            if last.is_some_and(|last| last.distance_m(*pose) < 0.5 * resolution_m) {
                continue;
            }
            last = Some(*pose);
            let here = grid.cell_at(pose.x, pose.y);
            for j in here.j - reach..=here.j + reach {
                for i in here.i - reach..=here.i + reach {
                    let cell = CellIndex { i, j };
                    let Some(index) = self.index(cell).filter(|index| !self.wall[*index] && !self.seen[*index]) else {
                        continue;
                    };
                    let [x, y] = grid.centre(cell);
                    let (dx, dy) = (x - pose.x, y - pose.y);
                    self.seen[index] = dx * dx + dy * dy <= SIGHT_M * SIGHT_M
                        && self.sees([pose.x / resolution_m, pose.y / resolution_m], cell);
                }
            }
        }
    }

    /// Whether no wall lies in the cells between a point, in cells, and the centre of a cell. (Not whether no wall lies between
    /// them: through a gap that no map of such cells can show, none is expected to see.)
    fn sees(&self, [x, y]: [f64; 2], cell: CellIndex) -> bool {
        let (mut i, mut j) = (x.floor() as i32, y.floor() as i32);
        let (dx, dy) = (f64::from(cell.i) + 0.5 - x, f64::from(cell.j) + 0.5 - y);
        let (step_i, step_j) = (if dx > 0.0 { 1 } else { -1 }, if dy > 0.0 { 1 } else { -1 });
        // Shares of the way from border to border, and to the next one.
        let (each_i, each_j) = ((1.0 / dx).abs(), (1.0 / dy).abs());
        let to_border = |at: f64, index: i32, step: i32| (f64::from(index) + f64::from(step.max(0)) - at).abs();
        let (mut next_i, mut next_j) = (to_border(x, i, step_i) * each_i, to_border(y, j, step_j) * each_j);
        let steps = (cell.i - i).abs() + (cell.j - j).abs();
        for _ in 0..steps {
            if next_i < next_j {
                i += step_i;
                next_i += each_i;
            } else {
                j += step_j;
                next_j += each_j;
            }
            if self.is_wall(CellIndex { i, j }) {
                return false;
            }
        }
        true
    }
}

/// The rectangle of all that is known and all that can be seen.
fn rectangle(path: &[Pose2], grid: &Grid) -> Result<(CellIndex, [usize; 2]), QualityError> {
    let resolution_m = grid.resolution_m();
    let mut bounds = grid.bounds().map(|(low, high)| [low.i, low.j, high.i, high.j].map(f64::from));
    for pose in path.iter().filter(|pose| pose.is_finite()) {
        let [x, y, reach] = [pose.x / resolution_m, pose.y / resolution_m, SIGHT_M / resolution_m + 2.0];
        let [x0, y0, x1, y1] = bounds.unwrap_or([x, y, x, y]);
        bounds = Some([x0.min(x - reach), y0.min(y - reach), x1.max(x + reach), y1.max(y + reach)]);
    }
    let [x0, y0, x1, y1] = bounds.ok_or(QualityError::NoWallSeen)?.map(f64::floor);
    let (width, height) = (((x1 - x0) as u64).saturating_add(1), ((y1 - y0) as u64).saturating_add(1));
    let numbered = [x0, y0, x1, y1].into_iter().all(|index| index.abs() < f64::from(1 << 30));
    if !numbered || width.saturating_mul(height) > CELLS_MAX {
        return Err(QualityError::TooLarge { width, height });
    }
    Ok((CellIndex { i: x0 as i32, j: y0 as i32 }, [width as usize, height as usize]))
}

/// The 3 × 3 cells around a cell, itself among them.
fn around(cell: CellIndex) -> impl Iterator<Item = CellIndex> {
    within(cell, 1)
}

fn within(cell: CellIndex, reach: i32) -> impl Iterator<Item = CellIndex> {
    (-reach..=reach).flat_map(move |dj| {
        (-reach..=reach).map(move |di| CellIndex { i: cell.i.saturating_add(di), j: cell.j.saturating_add(dj) })
    })
}

/// The log-odds by which a cell is judged; none if it is unknown.
#[must_use]
pub fn judged_log_odds(grid: &Grid, cell: CellIndex, kind: TrueCell) -> Option<f64> {
    let log_odds = match kind {
        TrueCell::Wall => around(cell).filter_map(|near| grid.log_odds(near)).reduce(f32::max),
        TrueCell::Free | TrueCell::Open => grid.log_odds(cell),
    };
    log_odds.map(f64::from)
}

impl Quality {
    /// How good a map of a world is, by what could be seen from the true path.
    ///
    /// # Errors
    /// When the path sees no wall or nothing free, or map and path span too much.
    pub fn of(grid: &Grid, world: &World, path: &[Pose2]) -> Result<Self, QualityError> {
        Self::against(grid, &Truth::of(world, path, grid)?)
    }

    /// How good a map is, by the truth of its cells.
    ///
    /// # Errors
    /// When the truth has no wall or nothing free.
    pub fn against(grid: &Grid, truth: &Truth) -> Result<Self, QualityError> {
        let (occupied_above, free_below) = (log_odds_of(OCCUPIED_ABOVE), log_odds_of(FREE_BELOW));
        let is_occupied = |cell| grid.log_odds(cell).is_some_and(|log_odds| f64::from(log_odds) > occupied_above);
        let (mut walls, mut free) = (Mean::default(), Mean::default());
        let (mut decided, mut decided_wrong) = (Mean::default(), Mean::default());
        let (mut recall, mut false_occupied) = (Mean::default(), Mean::default());
        let mut calibration = Calibration::default();
        for (cell, kind) in truth.cells() {
            let judged = judged_log_odds(grid, cell, kind);
            let is_wall = kind == TrueCell::Wall;
            let log_odds = judged.unwrap_or(0.0);
            let p = probability_of(log_odds).clamp(PROBABILITY_MIN, 1.0 - PROBABILITY_MIN);
            if is_wall {
                walls.add(-libm::log2(p));
                recall.count(near(cell, grid.resolution_m()).any(is_occupied));
            } else {
                free.add(-libm::log2(1.0 - p));
                false_occupied.count(log_odds > occupied_above);
            }
            let (says_wall, says_free) = (log_odds > occupied_above, log_odds < free_below);
            decided.count(says_wall || says_free);
            decided_wrong.count((says_wall && !is_wall) || (says_free && is_wall));
            if judged.is_some() {
                calibration.add(p, is_wall);
            }
        }
        let bits_occupied = walls.value().ok_or(QualityError::NoWallSeen)?;
        let bits_free = free.value().ok_or(QualityError::NoFreeSeen)?;
        Ok(Self {
            bits: 0.5 * (bits_occupied + bits_free),
            bits_occupied,
            bits_free,
            calibration_error: calibration.error(),
            decided: decided.value().unwrap_or(0.0),
            decided_wrong: decided_wrong.value().unwrap_or(0.0),
            free_called_occupied: false_occupied.value().unwrap_or(0.0),
            wall_recall_10cm: recall.value().unwrap_or(0.0),
            wall_precision_10cm: wall_precision(grid, truth, occupied_above),
        })
    }
}

fn wall_precision(grid: &Grid, truth: &Truth, occupied_above: f64) -> f64 {
    let mut precision = Mean::default();
    for (index, tile) in grid.tiles() {
        let first = index.first_cell();
        for (offset, log_odds) in tile.log_odds.iter().enumerate() {
            if f64::from(*log_odds) > occupied_above {
                let (column, row) = (offset % crate::TILE_SIDE, offset / crate::TILE_SIDE);
                let cell =
                    CellIndex { i: first.i.saturating_add(column as i32), j: first.j.saturating_add(row as i32) };
                precision.count(near(cell, grid.resolution_m()).any(|near| truth.is_wall(near)));
            }
        }
    }
    precision.value().unwrap_or(0.0)
}

/// Every cell whose centre lies within [`WALL_TOLERANCE_M`] of that of `cell`.
fn near(cell: CellIndex, resolution_m: f64) -> impl Iterator<Item = CellIndex> {
    // Two cells of 5 cm are 10 cm, whatever rounding says.
    let reach = WALL_TOLERANCE_M / resolution_m + 1e-9;
    within(cell, reach as i32).filter(move |near| {
        let (di, dj) = (f64::from(near.i) - f64::from(cell.i), f64::from(near.j) - f64::from(cell.j));
        di * di + dj * dj <= reach * reach
    })
}

/// A mean in the making.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn count(&mut self, holds: bool) {
        self.add(if holds { 1.0 } else { 0.0 });
    }

    fn value(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// What was said and what is, by class of probability.
#[derive(Debug, Default)]
struct Calibration {
    said: [Mean; CALIBRATION_CLASSES],
    is: [Mean; CALIBRATION_CLASSES],
}

impl Calibration {
    fn add(&mut self, p: f64, is_wall: bool) {
        let class = ((p * CALIBRATION_CLASSES as f64) as usize).min(CALIBRATION_CLASSES - 1);
        self.said[class].add(p);
        self.is[class].count(is_wall);
    }

    /// Mean over all cells of the difference in their class.
    fn error(&self) -> f64 {
        let classes = self.said.iter().zip(&self.is);
        let total: u64 = self.said.iter().map(|class| class.count).sum();
        let off: f64 = classes.map(|(said, is)| (said.sum - is.sum).abs()).sum();
        if total == 0 { 0.0 } else { off / total as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::WorldParts;

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
        let solid = crate::world::Solid::new(Pose2::new(1.0, -1.0, 0.0), 0.5, 4, vec![true; 16]);
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
}
