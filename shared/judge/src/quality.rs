//! How good a map is, against a known world and the true path.
//!
//! Cells that count ([`Truth`]): those whose centre was seen from the true path by straight sight past the cells of walls, and the
//! cells of walls beside a seen one. A cell within one cell of a wall is neither: whether a wall fills it is a matter of rounding.
//!
//! The score is the cross-entropy in bits: −log₂ of the probability that the map gave to the truth, averaged over the free
//! cells and over the cells of walls, and the two averaged. A map that knows nothing scores 1 bit, a perfect one almost 0, a
//! map that is confidently wrong more than 1.

use echogrid_core::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, log_odds_of, probability_of};
use echogrid_core::world::{Segment, World, columns_of_rows};
use echogrid_core::{CellIndex, Grid, Pose2, TILE_SIDE};
use serde::Serialize;

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
    /// The score of the cells of walls, bits; each is judged by the highest probability of the 3 × 3 cells around it.
    pub bits_occupied: f64,
    /// The score of the free cells, bits.
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
    /// A part of a wall, beside a seen cell.
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
                let (column, row) = (offset % TILE_SIDE, offset / TILE_SIDE);
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
mod tests;
