//! Which cells lie in a cone, or on a ray: one stretch per row.
//!
//! All of it is in double precision, so that what belongs to a cone is exact.

use super::Apex;
use super::lanes::Doubles;

/// Rows that are computed together.
const LANES: usize = 8;
/// Columns are kept within this.
const COLUMN_LIMIT: f64 = 1e9;
/// Farther than any sector reaches, metres.
const NOWHERE_M: f64 = 1e9;

/// Cells of one row by column, counted from the column of the transducer; both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stretch {
    pub(super) low: i32,
    pub(super) high: i32,
}

impl Stretch {
    pub(super) const EMPTY: Self = Self { low: 0, high: -1 };

    pub(super) fn is_empty(self) -> bool {
        self.high < self.low
    }

    /// What both have.
    pub(super) fn and(self, other: Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }
}

/// Some rows, one below the other: those of a ray, then those of a cone.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// Of each, the first and the last cell of the sector.
    low: Vec<i32>,
    high: Vec<i32>,
    /// Of each, those nearer than the echo (region I); empty where there are none.
    free_low: Vec<i32>,
    free_high: Vec<i32>,
}

impl Rows {
    /// Of some rows the cells, and those of them that are nearer than the echo: one stretch, as a disc is convex. (That need not
    /// lie within the former.)
    #[inline(always)]
    pub(super) fn between(&self, from: usize, to: usize) -> impl Iterator<Item = (Stretch, Stretch)> {
        let stretch = |(low, high): (&i32, &i32)| Stretch { low: *low, high: *high };
        let cells = self.low[from..to].iter().zip(&self.high[from..to]).map(stretch);
        let free = self.free_low[from..to].iter().zip(&self.free_high[from..to]).map(stretch);
        cells.zip(free)
    }

    /// Likewise, number by number: first and last cells, and those that are nearer.
    #[inline(always)]
    pub(super) fn of(&self, from: usize, to: usize) -> [&[i32]; 4] {
        [&self.low, &self.high, &self.free_low, &self.free_high].map(|column| &column[from..to])
    }

    /// The lowest and the highest column of some rows; empty if all are.
    #[inline(always)]
    pub(super) fn columns(&self, from: usize, to: usize) -> Stretch {
        let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
        for (low, high) in self.low[from..to].iter().zip(&self.high[from..to]) {
            // An empty row is no row.
            lowest = lowest.min(if high < low { i32::MAX } else { *low });
            highest = highest.max(if high < low { i32::MIN } else { *high });
        }
        if highest < lowest { Stretch::EMPTY } else { Stretch { low: lowest, high: highest } }
    }

    /// So many rows without cells, in front of an echo or not.
    pub(super) fn clear(&mut self, rows: usize) {
        self.make_room(rows);
        self.low[..rows].fill(i32::MAX);
        self.high[..rows].fill(i32::MIN);
    }

    /// Makes rows from `first` on reach as far as so many of `others` do.
    #[inline(always)]
    pub(super) fn widen(&mut self, first: usize, others: &Self, count: usize) {
        let rows = self.low[first..first + count].iter_mut().zip(&mut self.high[first..first + count]);
        for ((low, high), (other_low, other_high)) in rows.zip(others.low[..count].iter().zip(&others.high[..count])) {
            let is_empty = other_high < other_low;
            *low = (*low).min(if is_empty { i32::MAX } else { *other_low });
            *high = (*high).max(if is_empty { i32::MIN } else { *other_high });
        }
    }

    fn make_room(&mut self, rows: usize) {
        let rows = rows.next_multiple_of(LANES);
        for column in [&mut self.low, &mut self.high, &mut self.free_low, &mut self.free_high] {
            if column.len() < rows {
                column.resize(rows, 0);
            }
        }
    }
}

/// A cone on the grid whose half aperture is less than a quarter turn: a disc cut by two half planes, so convex.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sector {
    resolution_m: f64,
    cells_per_m: f64,
    /// Of the transducer, from the centre of its own cell, metres.
    offset: [f64; 2],
    left: Edge,
    right: Edge,
    near_m: f64,
    far_m: f64,
}

/// An edge of the cone. On the inner side of it `from[0] dy + from[1]` <= dx <= `to[0] dy + to[1]`.
#[derive(Debug, Clone, Copy)]
struct Edge {
    sin: f64,
    cos: f64,
    from: [f64; 2],
    to: [f64; 2],
}

impl Edge {
    /// The left edge has the cone to its right and counts with `sign` 1, the right edge with -1.
    fn new(direction_rad: f64, sign: f64) -> Self {
        const STEEP: f64 = 1e200;
        let (sin, cos) = libm::sincos(direction_rad);
        let (mut from, mut to) = ([0.0, -NOWHERE_M], [0.0, NOWHERE_M]);
        if sign * sin > 0.0 {
            from = [cos / sin, 0.0];
        } else if sign * sin < 0.0 {
            to = [cos / sin, 0.0];
        } else {
            // Along the rows: those on one side of it are out.
            from = [sign * cos * STEEP, -NOWHERE_M];
        }
        Self { sin, cos, from, to }
    }
}

impl Sector {
    /// Of a cone along `direction_rad` whose echo lies from `near_m` to `far_m`.
    pub(super) fn new(
        aperture_rad: f64,
        (near_m, far_m): (f64, f64),
        direction_rad: f64,
        apex: &Apex,
        resolution_m: f64,
    ) -> Self {
        let half = 0.5 * aperture_rad;
        Self::between(direction_rad + half, direction_rad - half, (near_m, far_m), apex, resolution_m)
    }

    /// Between two directions. Of two sectors that share one, a cell is in one, or on the line in both.
    pub(super) fn between(
        left_rad: f64,
        right_rad: f64,
        (near_m, far_m): (f64, f64),
        apex: &Apex,
        resolution_m: f64,
    ) -> Self {
        Self {
            resolution_m,
            cells_per_m: 1.0 / resolution_m,
            offset: [apex.offset_x, apex.offset_y],
            left: Edge::new(left_rad, 1.0),
            right: Edge::new(right_rad, -1.0),
            near_m,
            far_m,
        }
    }

    /// The rows that the sector may have cells in, counted from the transducer's.
    pub(super) fn extent(&self) -> (i32, i32) {
        let (a, b) = (self.far_m * self.left.sin, self.far_m * self.right.sin);
        // The arc rises above its ends where the cone looks straight up, falls below them straight down.
        let up = self.left.cos <= 0.0 && self.right.cos >= 0.0;
        let down = self.left.cos >= 0.0 && self.right.cos <= 0.0;
        let high = if up { self.far_m } else { a.max(b).max(0.0) };
        let low = if down { -self.far_m } else { a.min(b).min(0.0) };
        let row = |y: f64| (y + self.offset[1]) / self.resolution_m;
        (row(low).floor() as i32, row(high).ceil() as i32)
    }

    /// The cells of so many rows from `first_row` on.
    #[inline(always)]
    pub(super) fn fill<D: Doubles>(&self, rows: &mut Rows, first_row: i32, count: usize) {
        rows.make_room(count);
        let (lows, _) = rows.low.as_chunks_mut::<LANES>();
        let (highs, _) = rows.high.as_chunks_mut::<LANES>();
        let (free_lows, _) = rows.free_low.as_chunks_mut::<LANES>();
        let (free_highs, _) = rows.free_high.as_chunks_mut::<LANES>();
        let chunks = lows.iter_mut().zip(highs).zip(free_lows.iter_mut().zip(free_highs));
        for (chunk, ((low, high), (free_low, free_high))) in chunks.take(count.div_ceil(LANES)).enumerate() {
            self.fill_chunk::<D>(first_row + (chunk * LANES) as i32, [low, high, free_low, free_high]);
        }
        if self.offset == [0.0, 0.0] && (first_row..first_row + count as i32).contains(&0) {
            // The transducer is on the centre of a cell, and 0 < d leaves that out. It can only be at an end.
            let row = first_row.unsigned_abs() as usize;
            rows.low[row] += i32::from(rows.low[row] == 0);
            rows.high[row] -= i32::from(rows.high[row] == 0);
            rows.free_low[row] = rows.free_low[row].max(rows.low[row]);
            rows.free_high[row] = rows.free_high[row].min(rows.high[row]);
        }
    }

    /// The cells of [`LANES`] rows. What is empty ends before it begins.
    #[inline(always)]
    fn fill_chunk<D: Doubles>(&self, first_row: i32, [low, high, free_low, free_high]: [&mut [i32; LANES]; 4]) {
        let [offset_x, offset_y] = self.offset;
        let dy = D::counting_from(first_row).mul(D::splat(self.resolution_m)).sub(D::splat(offset_y));
        let edge = |[slope, at_0]: [f64; 2]| (D::splat(slope), D::splat(at_0));
        let half = half_chord(self.far_m, dy);
        let mut from = D::splat(0.0).sub(half);
        let mut to = half;
        for side in [&self.left, &self.right] {
            let ((from_slope, from_0), (to_slope, to_0)) = (edge(side.from), edge(side.to));
            from = dy.mul(from_slope).add(from_0).at_least(from);
            to = dy.mul(to_slope).add(to_0).at_most(to);
        }
        let free_half = half_chord(self.near_m, dy);
        let (scale, offset) = (D::splat(self.cells_per_m), D::splat(offset_x * self.cells_per_m));
        // The first column whose centre is not left of `from`, the last whose is not right of `to`
        let first = |from: D| D::splat(0.0).sub(from.mul(scale)).sub(offset);
        let (limit, low_limit) = (D::splat(COLUMN_LIMIT), D::splat(-COLUMN_LIMIT));
        let within = |column: D| column.at_least(low_limit).at_most(limit);
        within(first(from)).floor(low);
        within(to.mul(scale).add(offset)).floor(high);
        within(free_half.mul(scale).sub(offset)).floor(free_low);
        within(free_half.mul(scale).add(offset)).floor(free_high);
        for lane in 0..LANES {
            (low[lane], free_low[lane]) = (-low[lane], -free_low[lane]);
        }
    }
}

/// Half of what a disc leaves of a row `dy` above its centre; less than nothing where it leaves nothing.
#[inline(always)]
fn half_chord<D: Doubles>(radius_m: f64, dy: D) -> D {
    const STEEP: f64 = 1e150;
    let square = if radius_m > 0.0 { radius_m * radius_m } else { -1.0 };
    let square = D::splat(square).sub(dy.mul(dy));
    let zero = D::splat(0.0);
    square.at_least(zero).sqrt().add(square.at_most(zero).mul(D::splat(STEEP)))
}

/// The axis of a beam that is thinner than a cell: all cells that it crosses, as far as their centres are near enough.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    resolution_m: f64,
    /// Of the transducer, from the centre of its own cell, metres.
    offset: [f64; 2],
    sin: f64,
    cos: f64,
    near_m: f64,
    far_m: f64,
}

impl Ray {
    /// Along `direction_rad`, through cells nearer than `far_m`; those nearer than `near_m` are free.
    pub(super) fn new((near_m, far_m): (f64, f64), direction_rad: f64, apex: &Apex, resolution_m: f64) -> Self {
        let (sin, cos) = libm::sincos(direction_rad);
        Self { resolution_m, offset: [apex.offset_x, apex.offset_y], sin, cos, near_m, far_m }
    }

    /// How far its axis is followed: what it crosses farther on has no centre within reach.
    fn length_m(&self) -> f64 {
        self.far_m + self.resolution_m
    }

    /// The rows that it crosses, counted from the transducer's.
    pub(super) fn extent(&self) -> (i32, i32) {
        let row = |y: f64| floor((y + self.offset[1]) / self.resolution_m + 0.5);
        let end = row(self.length_m() * self.sin);
        (end.min(0), end.max(0))
    }

    /// The cells of so many rows from `first_row` on.
    pub(super) fn fill(&self, rows: &mut Rows, first_row: i32, count: usize) {
        rows.make_room(count);
        for n in 0..count {
            let (cells, free) = self.row(first_row + n as i32);
            (rows.low[n], rows.high[n]) = (cells.low, cells.high);
            (rows.free_low[n], rows.free_high[n]) = (free.low, free.high);
        }
    }

    /// The cells of a row, and those of them that are free.
    fn row(&self, row: i32) -> (Stretch, Stretch) {
        let dy = f64::from(row) * self.resolution_m - self.offset[1];
        let (low_y, high_y) = (dy - 0.5 * self.resolution_m, dy + 0.5 * self.resolution_m);
        // From where to where the axis is in this row, metres along it
        let (enters, leaves) = if self.sin > 0.0 {
            (low_y / self.sin, high_y / self.sin)
        } else if self.sin < 0.0 {
            (high_y / self.sin, low_y / self.sin)
        } else if row == 0 {
            (0.0, self.length_m())
        } else {
            return (Stretch::EMPTY, Stretch::EMPTY);
        };
        let (enters, leaves) = (at_least(enters, 0.0), at_most(leaves, self.length_m()));
        if enters > leaves {
            return (Stretch::EMPTY, Stretch::EMPTY);
        }
        let column = |x: f64| floor((x + self.offset[0]) / self.resolution_m + 0.5);
        let (a, b) = (column(enters * self.cos), column(leaves * self.cos));
        let crossed = Stretch { low: a.min(b), high: a.max(b) };
        let cells = crossed.and(self.disc(self.far_m, dy));
        (cells, cells.and(self.disc(self.near_m, dy)))
    }

    /// The columns whose centres are nearer than `radius_m`.
    fn disc(&self, radius_m: f64, dy: f64) -> Stretch {
        disc(radius_m, dy, self.offset[0], self.resolution_m)
    }
}

/// The columns of a row, `dy` metres above the transducer, whose centres lie within `radius_m` of it.
pub(super) fn disc(radius_m: f64, dy: f64, offset_x: f64, resolution_m: f64) -> Stretch {
    let square = radius_m * radius_m - dy * dy;
    if radius_m <= 0.0 || square < 0.0 {
        return Stretch::EMPTY;
    }
    let half = square.sqrt();
    Stretch { low: -floor((half - offset_x) / resolution_m), high: floor((half + offset_x) / resolution_m) }
}

#[inline(always)]
fn at_least(x: f64, floor: f64) -> f64 {
    if x > floor { x } else { floor }
}

#[inline(always)]
fn at_most(x: f64, ceiling: f64) -> f64 {
    if x < ceiling { x } else { ceiling }
}

/// The whole number below, within ± [`COLUMN_LIMIT`].
fn floor(x: f64) -> i32 {
    at_most(at_least(x, -COLUMN_LIMIT), COLUMN_LIMIT).floor() as i32
}
