//! Correlative search: where in a window of poses a scan lies best on other points, by branch and bound (Olson 2009; Hess et al. 2016).

use echogrid_core::Pose2;

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.05;
/// How exactly a point must hit, metres, one standard deviation.
const SIGMA_M: f64 = 0.07;
/// Cells around a point's that it counts in.
const HALO: i32 = 3;
/// Levels of the pyramid: windows of 1 to 32 cells.
const LEVELS: usize = 6;
/// The largest field, cells a side: what lies farther from the middle is left out.
const SIDE_MAX: usize = 1600;

/// How likely each place is that of a surface, 0 to 255; and the greatest of it in windows of 2, 4, 8 … cells.
#[derive(Debug, Clone)]
pub struct Field {
    low: [f64; 2],
    columns: usize,
    rows: usize,
    levels: Vec<Vec<u8>>,
}

/// A pose that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// In the frame of the field.
    pub pose: Pose2,
    /// Mean over all points: 1 where each hits a surface.
    pub score: f64,
}

/// Where is looked: about a guess, so far each way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The middle.
    pub guess: Pose2,
    /// Each way in x and in y, metres.
    pub half_side_m: f64,
    /// Each way round, radians.
    pub half_turn_rad: f64,
}

/// A pose and its neighbourhood that do not count, for the second best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Except {
    /// The middle.
    pub pose: Pose2,
    /// In a square of this half side, metres, at whatever heading.
    pub half_side_m: f64,
}

impl Field {
    /// The field of the points within `reach_m` of the origin.
    #[must_use]
    pub fn of(points: &[[f64; 2]], reach_m: f64) -> Self {
        let reach_m = reach_m.min(0.45 * CELL_M * SIDE_MAX as f64);
        let near: Vec<&[f64; 2]> = points.iter().filter(|p| p[0] * p[0] + p[1] * p[1] < reach_m * reach_m).collect();
        let (mut low, mut high) = ([0.0_f64; 2], [0.0_f64; 2]);
        for (index, point) in near.iter().enumerate() {
            for axis in 0..2 {
                let first = index == 0;
                low[axis] = if first { point[axis] } else { low[axis].min(point[axis]) };
                high[axis] = if first { point[axis] } else { high[axis].max(point[axis]) };
            }
        }
        let low = low.map(|value| value - 0.5);
        let cells = |axis: usize| ((high[axis] - low[axis] + 0.5) / CELL_M) as usize + 1;
        let (columns, rows) = (cells(0), cells(1));
        let falloff = falloff();
        let mut finest = vec![0u8; columns * rows];
        for point in near {
            let (x, y) = ((point[0] - low[0]) / CELL_M, (point[1] - low[1]) / CELL_M);
            let (column, row) = (x as i32, y as i32);
            for v in row - HALO..=row + HALO {
                for u in column - HALO..=column + HALO {
                    if u < 0 || v < 0 || u >= columns as i32 || v >= rows as i32 {
                        continue;
                    }
                    let (dx, dy) = (f64::from(u) + 0.5 - x, f64::from(v) + 0.5 - y);
                    let value = falloff[((dx * dx + dy * dy) * PER_CELL_SQUARED) as usize];
                    let cell = &mut finest[v as usize * columns + u as usize];
                    *cell = (*cell).max(value);
                }
            }
        }
        Self { low, columns, rows, levels: vec![finest] }
    }

    /// With levels enough for windows of so many cells.
    fn with_levels(&mut self, levels: usize) {
        let (columns, rows) = (self.columns, self.rows);
        while self.levels.len() < levels.min(LEVELS) {
            let level = self.levels.len();
            let half = 1usize << (level - 1);
            let finer = &self.levels[level - 1];
            let mut coarser = vec![0u8; columns * rows];
            for row in 0..rows {
                let upper = (row + half < rows).then(|| &finer[(row + half) * columns..(row + half + 1) * columns]);
                let lower = &finer[row * columns..(row + 1) * columns];
                let line = &mut coarser[row * columns..(row + 1) * columns];
                for (column, cell) in line.iter_mut().enumerate() {
                    let of = |line: &[u8]| line[column].max(line.get(column + half).copied().unwrap_or(0));
                    *cell = of(lower).max(upper.map_or(0, of));
                }
            }
            self.levels.push(coarser);
        }
    }

    /// The greatest value in the window of 2^level cells a side that begins at this cell.
    fn at(&self, level: usize, column: i32, row: i32) -> u8 {
        let side = 1i32 << level;
        if column >= self.columns as i32 || row >= self.rows as i32 || column + side <= 0 || row + side <= 0 {
            return 0;
        }
        self.levels[level][row.max(0) as usize * self.columns + column.max(0) as usize]
    }

    /// What `points` score at a pose, however small.
    #[must_use]
    pub fn score(&self, points: &[[f64; 2]], pose: Pose2) -> f64 {
        let (s, c) = libm::sincos(pose.theta);
        let value = |p: &[f64; 2]| {
            let at = [pose.x + c * p[0] - s * p[1], pose.y + s * p[0] + c * p[1]];
            let [x, y] = [0, 1].map(|axis| ((at[axis] - self.low[axis]) / CELL_M).floor() as i32);
            u32::from(self.at(0, x, y))
        };
        f64::from(points.iter().map(value).sum::<u32>()) / (255.0 * points.len().max(1) as f64)
    }

    /// The pose in the window at which `points` lie best on the field; none where no score is above `score_min`.
    #[must_use]
    pub fn search(
        &mut self,
        points: &[[f64; 2]],
        window: &Window,
        score_min: f64,
        except: Option<&Except>,
    ) -> Option<Found> {
        if points.is_empty() {
            return None;
        }
        let half = (window.half_side_m / CELL_M).ceil() as i32;
        let mut top = 0;
        while top + 1 < LEVELS && (1i32 << top) < half {
            top += 1;
        }
        self.with_levels(top + 1);
        let search = Search::new(self, points, window, half, except);
        let mut open = Vec::new();
        let step = 1usize << top;
        for turn in 0..search.turns.len() {
            for dx in (-half..=half).step_by(step) {
                for dy in (-half..=half).step_by(step) {
                    let score = search.score(turn, top, dx, dy);
                    if score > score_min {
                        open.push((score, turn, dx, dy));
                    }
                }
            }
        }
        open.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2, a.3).cmp(&(b.1, b.2, b.3))));
        let mut best = Best { score: score_min, at: None };
        for (score, turn, dx, dy) in open {
            if score <= best.score {
                break;
            }
            search.refine(top, turn, (dx, dy), score, &mut best);
        }
        let (turn, dx, dy) = best.at?;
        let Pose2 { x, y, .. } = window.guess;
        let pose = Pose2::new(x + f64::from(dx) * CELL_M, y + f64::from(dy) * CELL_M, search.turns[turn].0);
        Some(Found { pose, score: best.score })
    }
}

/// Entries of the table of squared distances, in cells, for each unit.
const PER_CELL_SQUARED: f64 = 16.0;

/// 255 exp(−d²/2σ²) by squared distance.
fn falloff() -> [u8; 512] {
    let mut table = [0; 512];
    for (index, value) in table.iter_mut().enumerate() {
        let squared = (index as f64 + 0.5) / PER_CELL_SQUARED * CELL_M * CELL_M;
        *value = (255.0 * libm::exp(-squared / (2.0 * SIGMA_M * SIGMA_M))) as u8;
    }
    table
}

struct Best {
    score: f64,
    at: Option<(usize, i32, i32)>,
}

struct Search<'a> {
    field: &'a Field,
    /// Heading, and the cell of each point at that heading and the guessed place.
    turns: Vec<(f64, Vec<(i32, i32)>)>,
    half: i32,
    /// 1 / (255 × points).
    unit: f64,
    /// The cells that do not count, relative to the guess: from, to.
    except: Option<[(i32, i32); 2]>,
}

impl<'a> Search<'a> {
    fn new(field: &'a Field, points: &[[f64; 2]], window: &Window, half: i32, except: Option<&Except>) -> Self {
        let guess = window.guess;
        let farthest = points.iter().map(|p| libm::hypot(p[0], p[1])).fold(3.0, f64::max).min(15.0);
        let step_rad = libm::acos(1.0 - CELL_M * CELL_M / (2.0 * farthest * farthest));
        let steps = (window.half_turn_rad / step_rad).ceil() as i32;
        let turns = (-steps..=steps).map(|step| {
            let theta = guess.theta + f64::from(step) * step_rad;
            let (s, c) = libm::sincos(theta);
            let cell = |p: &[f64; 2]| {
                let (x, y) = (guess.x + c * p[0] - s * p[1], guess.y + s * p[0] + c * p[1]);
                (((x - field.low[0]) / CELL_M).floor() as i32, ((y - field.low[1]) / CELL_M).floor() as i32)
            };
            (theta, points.iter().map(cell).collect())
        });
        let except = except.map(|except| {
            let cell = |at: f64, origin: f64, side: f64| ((at - origin + side) / CELL_M).round() as i32;
            let (pose, side) = (except.pose, except.half_side_m);
            [
                (cell(pose.x, guess.x, -side), cell(pose.y, guess.y, -side)),
                (cell(pose.x, guess.x, side), cell(pose.y, guess.y, side)),
            ]
        });
        Self { field, turns: turns.collect(), half, unit: 1.0 / (255.0 * points.len() as f64), except }
    }

    /// The best that any cell of this window can score; 0 where all of it is excepted, or lies outside.
    fn score(&self, turn: usize, level: usize, dx: i32, dy: i32) -> f64 {
        let side = 1i32 << level;
        let is_within = |[from, to]: [(i32, i32); 2]| {
            dx >= from.0 && dy >= from.1 && dx + side - 1 <= to.0 && dy + side - 1 <= to.1
        };
        if self.except.is_some_and(is_within) || dx > self.half || dy > self.half {
            return 0.0;
        }
        let sum: u32 = self.turns[turn].1.iter().map(|(x, y)| u32::from(self.field.at(level, x + dx, y + dy))).sum();
        f64::from(sum) * self.unit
    }

    fn refine(&self, level: usize, turn: usize, (dx, dy): (i32, i32), score: f64, best: &mut Best) {
        if score <= best.score {
            return;
        }
        if level == 0 {
            *best = Best { score, at: Some((turn, dx, dy)) };
            return;
        }
        let half = 1i32 << (level - 1);
        let mut parts = [(dx, dy), (dx + half, dy), (dx, dy + half), (dx + half, dy + half)]
            .map(|(dx, dy)| (self.score(turn, level - 1, dx, dy), dx, dy));
        parts.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (score, dx, dy) in parts {
            self.refine(level - 1, turn, (dx, dy), score, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// An L of two walls, seen from different places.
    fn corner() -> Vec<[f64; 2]> {
        let along = (0..80).map(|i| [-2.0 + 0.05 * f64::from(i), 1.5]);
        let across = (0..50).map(|i| [2.0, 1.5 - 0.05 * f64::from(i)]);
        along.chain(across).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn what_is_found_is_what_a_search_of_all_poses_finds(
            x in -0.5..0.5f64, y in -0.5..0.5f64, theta in -0.2..0.2f64,
        ) {
            let walls = corner();
            let mut field = Field::of(&walls, 20.0);
            let truth = Pose2::new(x, y, theta);
            let seen: Vec<[f64; 2]> = walls.iter().step_by(3).map(|p| truth.inverse().transform(*p)).collect();
            let window = Window { guess: Pose2::IDENTITY, half_side_m: 0.8, half_turn_rad: 0.3 };
            let found = field.search(&seen, &window, 0.3, None).unwrap();
            prop_assert!(found.pose.distance_m(truth) < 0.12 && (found.pose.theta - theta).abs() < 0.05, "{:?}", found);
            // All poses of the window, one by one.
            let search = Search::new(&field, &seen, &window, 16, None);
            let mut best = 0.0_f64;
            for turn in 0..search.turns.len() {
                for dx in -16..=16 {
                    for dy in -16..=16 {
                        best = best.max(search.score(turn, 0, dx, dy));
                    }
                }
            }
            prop_assert_eq!(best, found.score);
        }
    }

    #[test]
    fn the_second_best_is_elsewhere() {
        // The same corner twice, 4 m apart.
        let mut walls = corner();
        walls.extend(corner().iter().map(|p| [p[0] + 4.5, p[1]]));
        let mut field = Field::of(&walls, 20.0);
        let window = Window { guess: Pose2::new(2.0, 0.0, 0.0), half_side_m: 4.0, half_turn_rad: 0.1 };
        let best = field.search(&corner(), &window, 0.3, None).unwrap();
        let except = Except { pose: best.pose, half_side_m: 0.8 };
        let second = field.search(&corner(), &window, 0.3, Some(&except)).unwrap();
        assert!(second.pose.distance_m(best.pose) > 0.8 && second.score > 0.9 * best.score, "{best:?} {second:?}");
    }
}
