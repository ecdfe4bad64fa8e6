//! Which surfaces are near: a uniform grid of buckets over the world, and the way of a ray through it.

use super::surface::{Segment, Surface};

/// Most buckets of a world.
const BUCKETS_MAX: f64 = 1_048_576.0;
/// Surfaces are listed in buckets at most this often for each surface, or this often in all.
const LISTED_PER_SURFACE: f64 = 8.0;
const LISTED: f64 = 4_194_304.0;
/// A surface is listed in every bucket that it comes near by this share of the bucket's side: more than rounding can
/// move a ray.
const MARGIN: f64 = 1e-3;

/// Lists of surfaces by place.
#[derive(Debug, Clone)]
pub(super) struct Buckets {
    low_m: [f64; 2],
    high_m: [f64; 2],
    side_m: f64,
    counts: [usize; 2],
    /// Where the list of each bucket begins in `listed`; one more at the end.
    starts: Vec<u32>,
    listed: Vec<u32>,
}

impl Buckets {
    pub(super) fn of(surfaces: &[Surface]) -> Self {
        let (mut low_m, mut high_m) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut way_m = 0.0;
        for surface in surfaces {
            let [low, high] = surface.bounds_m();
            way_m += high[0] - low[0] + high[1] - low[1];
            for axis in 0..2 {
                low_m[axis] = low_m[axis].min(low[axis]);
                high_m[axis] = high_m[axis].max(high[axis]);
            }
        }
        let count = surfaces.len() as f64;
        let [width, height] = [high_m[0] - low_m[0], high_m[1] - low_m[1]];
        let listed_max = (LISTED_PER_SURFACE * count).max(LISTED);
        let side_m = (width * height / (8.0 * count))
            .sqrt()
            .max((width * height / BUCKETS_MAX).sqrt())
            .max((width.max(height)) * 4.0 / BUCKETS_MAX)
            .max(2.0 * way_m / listed_max)
            .max(0.01);
        let counts = [(width / side_m) as usize + 1, (height / side_m) as usize + 1];
        let mut buckets = Self { low_m, high_m, side_m, counts, starts: Vec::new(), listed: Vec::new() };
        buckets.list(surfaces);
        buckets
    }

    fn list(&mut self, surfaces: &[Surface]) {
        // Count, sum, fill.
        let mut ends = vec![0u32; self.counts[0] * self.counts[1] + 1];
        for surface in surfaces {
            self.near(surface, |bucket| ends[bucket] += 1);
        }
        let mut total = 0;
        for end in &mut ends {
            total += *end;
            *end = total;
        }
        let mut listed = vec![0u32; total as usize];
        for (index, surface) in surfaces.iter().enumerate().rev() {
            self.near(surface, |bucket| {
                ends[bucket] -= 1;
                listed[ends[bucket] as usize] = index as u32;
            });
        }
        self.starts = ends;
        self.listed = listed;
    }

    /// Every bucket that a surface is in, or all but in.
    fn near(&self, surface: &Surface, mut visit: impl FnMut(usize)) {
        let segment = match surface {
            Surface::Wall(segment) => *segment,
            Surface::Point { centre, .. } => Segment { from: *centre, to: *centre },
        };
        let reach = match surface {
            Surface::Wall(_) => 0.0,
            Surface::Point { radius_m, .. } => radius_m / self.side_m,
        };
        let scaled =
            |point: [f64; 2]| [(point[0] - self.low_m[0]) / self.side_m, (point[1] - self.low_m[1]) / self.side_m];
        let scaled = Segment { from: scaled(segment.from), to: scaled(segment.to) };
        columns_of_rows(scaled, MARGIN + reach, self.counts, |row, columns| {
            columns.for_each(|column| visit(row * self.counts[0] + column));
        });
    }

    pub(super) fn bounds_m(&self) -> [[f64; 2]; 2] {
        [self.low_m, self.high_m]
    }

    /// Every bucket that comes as near to a point as `reach_m`, and some more.
    pub(super) fn around(&self, point: [f64; 2], reach_m: f64) -> impl Iterator<Item = usize> + use<> {
        let reach_m = reach_m + MARGIN * self.side_m;
        let span = |axis: usize| {
            let index = |place: f64| ((place - self.low_m[axis]) / self.side_m).floor();
            let (low, high) = (index(point[axis] - reach_m), index(point[axis] + reach_m));
            let last = (self.counts[axis] - 1) as f64;
            // Beyond an end, or nowhere: an empty span.
            if low <= last && high >= 0.0 { low.max(0.0) as usize..high.min(last) as usize + 1 } else { 0..0 }
        };
        let (columns, rows, width) = (span(0), span(1), self.counts[0]);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    pub(super) fn surfaces(&self, bucket: usize) -> &[u32] {
        match (self.starts.get(bucket), self.starts.get(bucket + 1)) {
            (Some(start), Some(end)) => self.listed.get(*start as usize..*end as usize).unwrap_or(&[]),
            _ => &[],
        }
    }
}

/// For each row of unit squares that a line crosses, widened by `margin` to all sides, the columns that it crosses there:
/// within `counts` columns and rows.
pub fn columns_of_rows(
    line: Segment,
    margin: f64,
    counts: [usize; 2],
    mut visit: impl FnMut(usize, core::ops::RangeInclusive<usize>),
) {
    let [[x1, y1], [x2, y2]] = if line.from[1] <= line.to[1] { [line.from, line.to] } else { [line.to, line.from] };
    let index = |value: f64, count: usize| (value.floor() as usize).min(count.saturating_sub(1));
    if y2 + margin < 0.0 || y1 - margin >= counts[1] as f64 || counts[0] == 0 {
        return;
    }
    for row in index(y1 - margin, counts[1])..=index(y2 + margin, counts[1]) {
        // Where the line enters and leaves the row.
        let x_at = |y: f64| if y2 > y1 { x1 + (x2 - x1) * ((y - y1) / (y2 - y1)).clamp(0.0, 1.0) } else { x1 };
        let (mut a, mut b) = (x_at(row as f64 - margin), x_at(row as f64 + 1.0 + margin));
        if y1 == y2 {
            (a, b) = (x1, x2);
        }
        let (low, high) = (a.min(b) - margin, a.max(b) + margin);
        if high >= 0.0 && low < counts[0] as f64 {
            visit(row, index(low, counts[0])..=index(high, counts[0]));
        }
    }
}

/// A ray on its way from bucket to bucket.
pub(super) struct Walk<'a> {
    buckets: &'a Buckets,
    /// Column and row; outside means that the way is over.
    at: [i64; 2],
    step: [i64; 2],
    /// How far along the ray the next bucket begins, by axis, metres.
    next_m: [f64; 2],
    /// From one bucket to the next, by axis, metres along the ray.
    each_m: [f64; 2],
    max_m: f64,
    over: bool,
}

impl<'a> Walk<'a> {
    /// None if the ray never comes near a bucket.
    pub(super) fn new(buckets: &'a Buckets, origin: [f64; 2], direction: [f64; 2], max_m: f64) -> Option<Self> {
        let finite = origin.into_iter().chain(direction).all(f64::is_finite);
        if !finite || max_m.is_nan() || max_m < 0.0 {
            return None;
        }
        // Where the ray is within the buckets, with room for rounding.
        let (mut enters, mut leaves) = (0.0f64, max_m);
        for axis in 0..2 {
            let room = MARGIN * buckets.side_m;
            let [low, high] = [buckets.low_m[axis] - room, buckets.high_m[axis] + room];
            if direction[axis] == 0.0 {
                if origin[axis] < low || origin[axis] > high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin[axis]) / direction[axis], (high - origin[axis]) / direction[axis]);
            enters = enters.max(a.min(b));
            leaves = leaves.min(a.max(b));
        }
        if enters > leaves {
            return None;
        }
        let mut walk = Self {
            buckets,
            at: [0; 2],
            step: [0; 2],
            next_m: [f64::INFINITY; 2],
            each_m: [0.0; 2],
            max_m: leaves,
            over: false,
        };
        for axis in 0..2 {
            let place = (origin[axis] + enters * direction[axis] - buckets.low_m[axis]) / buckets.side_m;
            let at = place.floor().clamp(0.0, (buckets.counts[axis] - 1) as f64);
            walk.at[axis] = at as i64;
            if direction[axis] != 0.0 {
                let ahead = if direction[axis] > 0.0 { at + 1.0 } else { at };
                walk.step[axis] = if direction[axis] > 0.0 { 1 } else { -1 };
                walk.each_m[axis] = buckets.side_m / direction[axis].abs();
                walk.next_m[axis] = (buckets.low_m[axis] + ahead * buckets.side_m - origin[axis]) / direction[axis];
            }
        }
        Some(walk)
    }

    /// The next bucket, and how far along the ray it is left.
    pub(super) fn next(&mut self) -> Option<(usize, f64)> {
        let [column, row] = self.at;
        let inside = |at: i64, count: usize| at >= 0 && at < count as i64;
        if self.over || !inside(column, self.buckets.counts[0]) || !inside(row, self.buckets.counts[1]) {
            return None;
        }
        let axis = usize::from(self.next_m[1] < self.next_m[0]);
        let leaves_at_m = self.next_m[axis];
        self.over = leaves_at_m.is_nan() || leaves_at_m > self.max_m;
        self.at[axis] += self.step[axis];
        self.next_m[axis] += self.each_m[axis];
        Some((row as usize * self.buckets.counts[0] + column as usize, leaves_at_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crossed(from: [f64; 2], to: [f64; 2], margin: f64) -> Vec<(usize, usize)> {
        let mut cells = Vec::new();
        columns_of_rows(Segment { from, to }, margin, [4, 3], |row, columns| {
            cells.extend(columns.map(|column| (column, row)));
        });
        cells
    }

    #[test]
    fn squares_that_a_line_crosses() {
        assert_eq!(crossed([0.5, 0.5], [2.5, 0.5], 0.0), [(0, 0), (1, 0), (2, 0)]);
        assert_eq!(crossed([0.5, 2.5], [0.5, 0.5], 0.0), [(0, 0), (0, 1), (0, 2)]);
        assert_eq!(crossed([0.2, 0.5], [1.2, 1.5], 0.0), [(0, 0), (0, 1), (1, 1)]);
        assert_eq!(crossed([1.5, 1.0], [1.5, 1.0], 0.0), [(1, 1)]);
        assert_eq!(crossed([1.5, 1.0], [1.5, 1.0], 0.1), [(1, 0), (1, 1)]);
        assert_eq!(crossed([-5.0, 1.5], [-1.0, 1.5], 0.0), []);
        assert_eq!(crossed([1.5, -5.0], [1.5, 50.0], 0.0), [(1, 0), (1, 1), (1, 2)]);
        assert_eq!(crossed([7.0, 9.0], [7.0, 9.0], 0.0), []);
    }
}
