//! How straight the walls of a map are, where no world is known: the two walls of its longest corridor, and how many of the occupied
//! cells lie along them.
//!
//! A line is worth the way along which it is covered by occupied cells, less the way along which it is not, over the stretch
//! where that is most. So a broad patch counts no more than a thin one, a door is bridged, and single cells beyond its end don't make a
//! wall longer. All directions are tried, degree by degree; the best line is fitted by total least squares to the cells within
//! reach, the nearer the more they count (Tukey's weights), until it stays. The second wall faces the first and is about parallel to
//! it. Nothing is drawn by lot: the same map gives the same walls.

use core::f64::consts::{FRAC_PI_2, PI};

use echogrid_core::log_odds::{OCCUPIED_ABOVE, log_odds_of};
use echogrid_core::{CellIndex, Grid, TILE_SIDE, wrap_angle};
use serde::Serialize;

/// A cell this near to a wall belongs to it, unless said otherwise, metres.
pub const WITHIN_M: f64 = 0.15;
/// A line that is worth less is no wall, metres.
const SHORTEST_M: f64 = 1.0;
/// Walls that are nearer to each other are one: no robot drives between them, metres.
const NARROWEST_M: f64 = 0.5;
/// Directions of the first wall that are tried, half a turn in all.
const DIRECTIONS: u16 = 180;
/// So many degrees to either side of the first wall's direction are tried for the second.
const PARALLEL_DEG: i16 = 10;
/// A wall that is fitted is at most so far from parallel to the first, radians.
const PARALLEL_RAD: f64 = 0.2;
const FITS_MAX: usize = 20;

/// A straight wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Wall {
    /// One end, metres in the map.
    pub from: [f64; 2],
    /// The other end of the wall, metres in the map.
    pub to: [f64; 2],
    /// Way between the ends along which there are occupied cells, metres.
    pub covered_m: f64,
    /// Occupied cells near it.
    pub cells: u64,
    /// Root mean square of their distances from the line, metres.
    pub rms_m: f64,
}

impl Wall {
    /// The length of the wall, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        let [dx, dy] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        libm::hypot(dx, dy)
    }

    /// The direction from `from` to `to`, radians.
    #[must_use]
    pub fn direction_rad(&self) -> f64 {
        libm::atan2(self.to[1] - self.from[1], self.to[0] - self.from[0])
    }

    fn line(&self) -> Line {
        Line::through(self.from, self.direction_rad())
    }

    /// Whether a point is nearer than `within_m` to the wall between its ends.
    fn is_near(&self, point: [f64; 2], within_m: f64) -> bool {
        let (along, off) = self.line().seen(point);
        let beyond = (along - self.length_m()).max(-along).max(0.0);
        libm::hypot(beyond, off) <= within_m
    }

    /// Whether the foot of a point is between its ends.
    fn is_beside(&self, point: [f64; 2]) -> bool {
        (0.0..=self.length_m()).contains(&self.line().seen(point).0)
    }
}

/// The walls of a map's longest corridor, and what of the map lies along them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Walls {
    /// The walls: none, one or two; the first is worth most.
    pub walls: Vec<Wall>,
    /// What near means, metres.
    pub within_m: f64,
    /// Occupied cells of the map: p > 0.65.
    pub occupied: u64,
    /// Those near a wall.
    pub near: u64,
    /// Those whose foot lies between the ends of a wall, near or far.
    pub beside: u64,
}

impl Walls {
    /// The walls of a map.
    #[must_use]
    pub fn of(grid: &Grid, within_m: f64) -> Self {
        let occupied_above = log_odds_of(OCCUPIED_ABOVE) as f32;
        let resolution_m = grid.resolution_m();
        let mut cells = Vec::new();
        for (index, tile) in grid.tiles() {
            let first = index.first_cell();
            for (offset, _) in tile.log_odds.iter().enumerate().filter(|(_, value)| **value > occupied_above) {
                let cell =
                    CellIndex { i: first.i + (offset % TILE_SIDE) as i32, j: first.j + (offset / TILE_SIDE) as i32 };
                cells.push([cell.i, cell.j].map(|index| (f64::from(index) + 0.5) * resolution_m));
            }
        }
        Self::of_points(&cells, resolution_m, within_m)
    }

    /// The walls of points of a grid of this resolution.
    fn of_points(points: &[[f64; 2]], resolution_m: f64, within_m: f64) -> Self {
        // Wide enough for a wall along a diagonal of the grid to have no holes.
        let search = Search { step_m: 2.0 * resolution_m, within_m };
        let anywhere = |degree: u16| PI * f64::from(degree) / f64::from(DIRECTIONS);
        let mut walls = Vec::new();
        if let Some(first) = search.wall(points, points, (0..DIRECTIONS).map(anywhere)) {
            let line = first.line();
            let apart_m = NARROWEST_M.max(2.0 * within_m);
            let others: Vec<_> = points.iter().copied().filter(|point| line.seen(*point).1.abs() > apart_m).collect();
            let facing: Vec<_> = others.iter().copied().filter(|point| first.is_beside(*point)).collect();
            let parallel = |degree: i16| first.direction_rad() + PI * f64::from(degree) / f64::from(DIRECTIONS);
            let second = search.wall(&others, &facing, (-PARALLEL_DEG..=PARALLEL_DEG).map(parallel));
            walls.push(first);
            walls.extend(second.filter(|second| angle_between(&first, second) <= PARALLEL_RAD));
        }
        let count = |holds: &dyn Fn(&Wall, [f64; 2]) -> bool| {
            points.iter().filter(|point| walls.iter().any(|wall| holds(wall, **point))).count() as u64
        };
        let near = count(&|wall, point| wall.is_near(point, within_m));
        let beside = count(&|wall, point| wall.is_beside(point) || wall.is_near(point, within_m));
        Self { occupied: points.len() as u64, near, beside, within_m, walls }
    }

    /// Share of the occupied cells that are near a wall; 0 where there is none.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.near as f64 / self.occupied.max(1) as f64
    }

    /// Share near a wall of those occupied cells that lie beside one: of the corridor, however much else there is.
    #[must_use]
    pub fn share_beside(&self) -> f64 {
        self.near as f64 / self.beside.max(1) as f64
    }

    /// The angle between the two walls, radians in [0, π/2]; none unless there are two.
    #[must_use]
    pub fn angle_rad(&self) -> Option<f64> {
        let [a, b] = self.walls.as_slice() else { return None };
        Some(angle_between(a, b))
    }

    /// The distance from the middle of the second wall to the line of the first, metres; none unless there are two.
    #[must_use]
    pub fn distance_m(&self) -> Option<f64> {
        let [a, b] = self.walls.as_slice() else { return None };
        let middle = [0, 1].map(|axis| 0.5 * (b.from[axis] + b.to[axis]));
        Some(a.line().seen(middle).1.abs())
    }
}

/// Of two walls, radians in [0, π/2].
fn angle_between(a: &Wall, b: &Wall) -> f64 {
    let angle = wrap_angle(a.direction_rad() - b.direction_rad()).abs();
    if angle > FRAC_PI_2 { PI - angle } else { angle }
}

/// A straight line.
#[derive(Debug, Clone, Copy)]
struct Line {
    through: [f64; 2],
    along: [f64; 2],
}

impl Line {
    fn through(through: [f64; 2], direction_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(direction_rad);
        Self { through, along: [cos, sin] }
    }

    /// How far along the line the foot of a point is, and how far to the left of the line the point, metres.
    fn seen(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        let ([dx, dy], [cos, sin]) = ([x - self.through[0], y - self.through[1]], self.along);
        (dx * cos + dy * sin, dy * cos - dx * sin)
    }

    fn at(&self, along: f64) -> [f64; 2] {
        [self.through[0] + along * self.along[0], self.through[1] + along * self.along[1]]
    }

    /// By total least squares, the nearer the points the more they count; none where they have no direction.
    fn fitted(points: impl Iterator<Item = ([f64; 2], f64)> + Clone) -> Option<Self> {
        let sum = |of: &dyn Fn([f64; 2]) -> f64| points.clone().map(|(point, weight)| weight * of(point)).sum::<f64>();
        let weight = sum(&|_| 1.0);
        if weight <= 0.0 {
            return None;
        }
        let mean = [sum(&|p| p[0]) / weight, sum(&|p| p[1]) / weight];
        let xx = sum(&|p| (p[0] - mean[0]) * (p[0] - mean[0]));
        let yy = sum(&|p| (p[1] - mean[1]) * (p[1] - mean[1]));
        let xy = sum(&|p| (p[0] - mean[0]) * (p[1] - mean[1]));
        (xx + yy > 0.0).then(|| Self::through(mean, 0.5 * libm::atan2(2.0 * xy, xx - yy)))
    }
}

/// A stretch of a line: from step to step, and what it is worth, in steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stretch {
    worth: i64,
    covered: i64,
    first: i64,
    last: i64,
}

/// The stretch that is worth most, of steps in ascending order that are covered.
fn best_stretch(covered: impl Iterator<Item = i64>) -> Option<Stretch> {
    let (mut best, mut here): (Option<Stretch>, Option<Stretch>) = (None, None);
    for step in covered {
        let alone = Stretch { worth: 1, covered: 1, first: step, last: step };
        let longer = |before: Stretch| Stretch {
            worth: before.worth + 1 - (step - before.last - 1),
            covered: before.covered + 1,
            last: step,
            ..before
        };
        let now = here.map(longer).filter(|longer| longer.worth > 1).unwrap_or(alone);
        if best.is_none_or(|best| now.worth > best.worth) {
            best = Some(now);
        }
        here = Some(now);
    }
    best
}

/// How walls are looked for.
#[derive(Debug, Clone, Copy)]
struct Search {
    step_m: f64,
    within_m: f64,
}

impl Search {
    /// The wall that is worth most: found in `among`, in one of these directions (radians), then fitted to `points`.
    fn wall(&self, points: &[[f64; 2]], among: &[[f64; 2]], directions: impl Iterator<Item = f64>) -> Option<Wall> {
        let middle = among.first().copied()?;
        let found = directions.filter_map(|direction_rad| self.best_along(among, Line::through(middle, direction_rad)));
        // Of equals the first.
        let (line, stretch) = found.reduce(|best, next| if next.1.worth > best.1.worth { next } else { best })?;
        self.fitted(points, line, stretch)
    }

    fn step(&self, along: f64) -> i64 {
        (along / self.step_m).floor() as i64
    }

    /// The best of all lines parallel to `line`.
    fn best_along(&self, points: &[[f64; 2]], line: Line) -> Option<(Line, Stretch)> {
        // Bands overlap by half: whatever lies within reach of a line lies in the band of one that is tried.
        let mut covered = Vec::with_capacity(2 * points.len());
        for point in points {
            let (along, off) = line.seen(*point);
            let band = (off / self.within_m).floor() as i64;
            covered.extend([(band, self.step(along)), (band + 1, self.step(along))]);
        }
        covered.sort_unstable();
        covered.dedup();
        let mut best: Option<(i64, Stretch)> = None;
        for band in covered.chunk_by(|a, b| a.0 == b.0) {
            let Some(stretch) = best_stretch(band.iter().map(|(_, step)| *step)) else { continue };
            if best.is_none_or(|(_, best)| stretch.worth > best.worth) {
                best = Some((band[0].0, stretch));
            }
        }
        let (band, stretch) = best?;
        let off = band as f64 * self.within_m;
        let [x, y] = line.through;
        let through = [x - off * line.along[1], y + off * line.along[0]];
        Some((Line { through, ..line }, stretch))
    }

    fn fitted(&self, points: &[[f64; 2]], mut line: Line, mut stretch: Stretch) -> Option<Wall> {
        for _ in 0..FITS_MAX {
            let weighed = points.iter().filter_map(|point| {
                let (along, off) = line.seen(*point);
                let share = off / self.within_m;
                let within = (stretch.first - 1..=stretch.last + 1).contains(&self.step(along)) && share.abs() < 1.0;
                within.then_some((*point, (1.0 - share * share) * (1.0 - share * share)))
            });
            let better = Line::fitted(weighed)?;
            let moved = {
                let sin = line.along[0] * better.along[1] - line.along[1] * better.along[0];
                sin.abs() + line.seen(better.through).1.abs()
            };
            let mut covered: Vec<i64> =
                near(points, better, self.within_m).map(|(along, _)| self.step(along)).collect();
            covered.sort_unstable();
            covered.dedup();
            (line, stretch) = (better, best_stretch(covered.into_iter())?);
            if moved < 1e-9 {
                break;
            }
        }
        if stretch.worth as f64 * self.step_m < SHORTEST_M {
            return None;
        }
        let own = near(points, line, self.within_m)
            .filter(|(along, _)| (stretch.first..=stretch.last).contains(&self.step(*along)));
        let (mut from, mut to, mut cells, mut squares) = (f64::INFINITY, f64::NEG_INFINITY, 0_u64, 0.0);
        for (along, off) in own {
            (from, to) = (from.min(along), to.max(along));
            cells += 1;
            squares += off * off;
        }
        let rms_m = (squares / cells as f64).sqrt();
        // Steps are wider than the cells at the ends.
        let covered_m = (stretch.covered as f64 * self.step_m).min(to - from);
        Some(Wall { from: line.at(from), to: line.at(to), covered_m, cells, rms_m })
    }
}

/// Where along a line the points within reach of it are, and how far off.
fn near(points: &[[f64; 2]], line: Line, within_m: f64) -> impl Iterator<Item = (f64, f64)> {
    points.iter().map(move |point| line.seen(*point)).filter(move |(_, off)| off.abs() <= within_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use echogrid_core::noise::Draws;

    const RESOLUTION_M: f64 = 0.05;

    /// The cells that a straight line from end to end runs through, shaken by `sigma_m` to either side.
    fn wall(grid: &mut Grid, draws: &mut Draws, from: [f64; 2], to: [f64; 2], sigma_m: f64) {
        let length = libm::hypot(to[0] - from[0], to[1] - from[1]);
        let normal = [-(to[1] - from[1]) / length, (to[0] - from[0]) / length];
        for n in 0..=(length / 0.02) as i32 {
            let (share, off) = (f64::from(n) * 0.02 / length, sigma_m * draws.normal());
            let at = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]) + off * normal[axis]);
            occupy(grid, at);
        }
    }

    fn occupy(grid: &mut Grid, [x, y]: [f64; 2]) {
        let cell = grid.cell_at(x, y);
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 3.0;
    }

    fn outliers(grid: &mut Grid, draws: &mut Draws, count: u32) {
        for _ in 0..count {
            let at = [20.0 * draws.uniform() - 4.0, 16.0 * draws.uniform() - 6.0];
            occupy(grid, at);
        }
    }

    /// A corridor of 10 m, 2.4 m wide, turned by `turn_rad`.
    fn corridor(turn_rad: f64, sigma_m: f64, strays: u32) -> Grid {
        let (mut grid, mut draws) = (Grid::new(RESOLUTION_M), Draws::new(5, "walls"));
        let (s, c) = libm::sincos(turn_rad);
        let turned = |[x, y]: [f64; 2]| [c * x - s * y, s * x + c * y];
        wall(&mut grid, &mut draws, turned([0.0, 0.0]), turned([10.0, 0.0]), sigma_m);
        wall(&mut grid, &mut draws, turned([1.0, 2.4]), turned([8.0, 2.4]), sigma_m);
        outliers(&mut grid, &mut draws, strays);
        grid
    }

    #[test]
    fn two_walls_are_found_in_any_direction() {
        for turn_rad in [0.0, 0.3, 0.785, 1.57, 2.5, -1.0] {
            for (sigma_m, strays) in [(0.0, 0), (0.03, 0), (0.03, 800)] {
                let found = Walls::of(&corridor(turn_rad, sigma_m, strays), WITHIN_M);
                let [a, b] = found.walls.as_slice() else { panic!("{turn_rad} {strays}: {found:?}") };
                assert!((a.length_m() - 10.0).abs() < 0.5 && (b.length_m() - 7.0).abs() < 0.5, "{turn_rad} {found:?}");
                assert!((found.distance_m().unwrap() - 2.4).abs() < 0.06, "{turn_rad} {found:?}");
                assert!(found.angle_rad().unwrap() < 0.01, "{turn_rad} {found:?}");
                let off = wrap_angle(2.0 * (a.direction_rad() - turn_rad)).abs();
                assert!(off < 0.01 && a.rms_m < 0.08, "{turn_rad} {found:?}");
                if strays == 0 {
                    assert!(found.share() > 0.99, "{turn_rad} {found:?}");
                }
            }
        }
    }

    #[test]
    fn strays_are_counted_and_move_nothing() {
        let (clean, strewn) =
            (Walls::of(&corridor(0.3, 0.0, 0), WITHIN_M), Walls::of(&corridor(0.3, 0.0, 800), WITHIN_M));
        for (clean, strewn) in clean.walls.iter().zip(&strewn.walls) {
            for (end, other) in [(clean.from, strewn.from), (clean.to, strewn.to)] {
                assert!(libm::hypot(end[0] - other[0], end[1] - other[1]) < 0.3, "{clean:?} {strewn:?}");
            }
        }
        // 800 strays over 320 m², of which 3 m² are near.
        let expected = clean.occupied as f64 / strewn.occupied as f64;
        assert!((strewn.share() - expected).abs() < 0.03, "{strewn:?}");
        assert!(strewn.share_beside() > strewn.share() + 0.05, "{strewn:?}");
    }

    #[test]
    fn a_door_is_bridged_and_a_patch_is_no_wall() {
        let (mut grid, mut draws) = (Grid::new(RESOLUTION_M), Draws::new(5, "door"));
        wall(&mut grid, &mut draws, [0.0, 0.0], [4.0, 0.0], 0.0);
        wall(&mut grid, &mut draws, [5.2, 0.0], [9.0, 0.0], 0.0);
        // As many cells as the wall has, in one place.
        for (x, y) in (0..16).flat_map(|x| (0..16).map(move |y| (x, y))) {
            occupy(&mut grid, [3.025 + 0.05 * f64::from(x), 2.025 + 0.05 * f64::from(y)]);
        }
        let found = Walls::of(&grid, WITHIN_M);
        let [only] = found.walls.as_slice() else { panic!("{found:?}") };
        assert!((only.length_m() - 9.0).abs() < 0.1 && (only.covered_m - 7.8).abs() < 0.3, "{only:?}");
        assert_eq!((found.angle_rad(), found.distance_m()), (None, None));
        assert!((found.share() - 0.38).abs() < 0.03 && found.beside == found.occupied, "{found:?}");
    }

    #[test]
    fn one_wall_among_strays_stays_alone() {
        let (mut grid, mut draws) = (Grid::new(RESOLUTION_M), Draws::new(5, "one wall"));
        wall(&mut grid, &mut draws, [0.0, 0.0], [8.0, 1.0], 0.02);
        outliers(&mut grid, &mut draws, 1500);
        let found = Walls::of(&grid, WITHIN_M);
        let [only] = found.walls.as_slice() else { panic!("{found:?}") };
        assert!((only.length_m() - 8.06).abs() < 0.6, "{only:?}");
    }

    #[test]
    fn walls_that_do_not_face_each_other_are_no_corridor() {
        let (mut grid, mut draws) = (Grid::new(RESOLUTION_M), Draws::new(5, "corner"));
        wall(&mut grid, &mut draws, [0.0, 0.0], [8.0, 0.0], 0.0);
        wall(&mut grid, &mut draws, [8.0, 0.0], [8.0, 6.0], 0.0);
        wall(&mut grid, &mut draws, [9.0, 3.0], [14.0, 3.0], 0.0);
        let found = Walls::of(&grid, WITHIN_M);
        assert_eq!(found.walls.len(), 1, "{found:?}");
        assert!((found.walls[0].length_m() - 8.0).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn where_there_is_no_wall_none_is_found() {
        let (mut grid, mut draws) = (Grid::new(RESOLUTION_M), Draws::new(5, "none"));
        let empty = Walls::of(&grid, WITHIN_M);
        assert_eq!((empty.walls.len(), empty.occupied, empty.share(), empty.share_beside()), (0, 0, 0.0, 0.0));
        outliers(&mut grid, &mut draws, 1500);
        assert_eq!(Walls::of(&grid, WITHIN_M).walls, []);
    }
}
