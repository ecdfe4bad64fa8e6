//! Points of several scans in one frame, found by place.

use echogrid_core::Pose2;

use crate::scan::Points;

/// Side of the cells that points are sorted into, metres.
const CELL_M: f64 = 0.25;
/// More cells than this would be empty memory: what lies farther out is left out.
const HALF_SIDE_M: f64 = 45.0;

/// Points with normals, sorted by the cell that they lie in.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    at: Vec<[f64; 2]>,
    normals: Vec<[f64; 2]>,
    low: [f64; 2],
    columns: usize,
    rows: usize,
    /// Where in `at` each cell begins, row by row, and where the last ends.
    starts: Vec<u32>,
}

/// The point nearest to another.
#[derive(Debug, Clone, Copy)]
pub struct Nearest {
    /// Metres.
    pub at: [f64; 2],
    /// Zero where there is no telling.
    pub normal: [f64; 2],
}

impl Cloud {
    /// The points of scans that were taken at these poses, seen from `origin`.
    #[must_use]
    pub fn of<'a>(origin: Pose2, scans: impl IntoIterator<Item = (Pose2, &'a Points)>) -> Self {
        let origin_from_map = origin.inverse();
        let (mut at, mut normals) = (Vec::new(), Vec::new());
        for (pose, points) in scans {
            let Pose2 { x, y, theta } = origin_from_map * pose;
            let (s, c) = libm::sincos(theta);
            for (point, normal) in points.iter() {
                let placed = [x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]];
                if placed[0].abs() < HALF_SIDE_M && placed[1].abs() < HALF_SIDE_M {
                    at.push(placed);
                    normals.push([c * normal[0] - s * normal[1], s * normal[0] + c * normal[1]]);
                }
            }
        }
        Self::sorted(&at, &normals)
    }

    fn sorted(at: &[[f64; 2]], normals: &[[f64; 2]]) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for point in at {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if at.is_empty() {
            return Self::default();
        }
        let cells = |axis: usize| ((high[axis] - low[axis]) / CELL_M) as usize + 1;
        let (columns, rows) = (cells(0), cells(1));
        let cell = |point: &[f64; 2]| {
            let (x, y) = (((point[0] - low[0]) / CELL_M) as usize, ((point[1] - low[1]) / CELL_M) as usize);
            y.min(rows - 1) * columns + x.min(columns - 1)
        };
        let mut starts = vec![0u32; columns * rows + 1];
        for point in at {
            starts[cell(point) + 1] += 1;
        }
        for index in 1..starts.len() {
            starts[index] += starts[index - 1];
        }
        let mut next = starts.clone();
        let mut sorted =
            Self { at: vec![[0.0; 2]; at.len()], normals: vec![[0.0; 2]; at.len()], low, columns, rows, starts };
        for (point, normal) in at.iter().zip(normals) {
            let place = &mut next[cell(point)];
            sorted.at[*place as usize] = *point;
            sorted.normals[*place as usize] = *normal;
            *place += 1;
        }
        sorted
    }

    /// All points, in order of cells.
    #[must_use]
    pub fn points(&self) -> &[[f64; 2]] {
        &self.at
    }

    /// The nearest point within `radius_m`; of equally near ones the first.
    #[must_use]
    pub fn nearest(&self, to: [f64; 2], radius_m: f64) -> Option<Nearest> {
        let (x, y) = ((to[0] - self.low[0]) / CELL_M, (to[1] - self.low[1]) / CELL_M);
        let reach = radius_m / CELL_M;
        let (columns, rows) = (self.columns as f64, self.rows as f64);
        if self.at.is_empty() || x + reach < 0.0 || y + reach < 0.0 || x - reach >= columns || y - reach >= rows {
            return None;
        }
        let (first, last) = ((x - reach).max(0.0) as usize, ((x + reach).min(columns - 1.0)) as usize);
        let (bottom, top) = ((y - reach).max(0.0) as usize, ((y + reach).min(rows - 1.0)) as usize);
        let (mut best, mut found) = (radius_m * radius_m, None);
        for row in bottom..=top {
            let line = row * self.columns;
            let (start, end) = (self.starts[line + first] as usize, self.starts[line + last + 1] as usize);
            for (index, point) in (start..).zip(&self.at[start..end]) {
                let (dx, dy) = (point[0] - to[0], point[1] - to[1]);
                let squared = dx * dx + dy * dy;
                if squared < best {
                    (best, found) = (squared, Some(index));
                }
            }
        }
        found.map(|index| Nearest { at: self.at[index], normal: self.normals[index] })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_nearest_is_what_a_search_through_all_finds(
            points in prop::collection::vec(prop::array::uniform2(-5.0..5.0f64), 1..60),
            to in prop::array::uniform2(-7.0..7.0f64), radius_m in 0.05..1.5f64,
        ) {
            let mut scan = Points::default();
            points.iter().for_each(|at| scan.push(*at, [1.0, 0.0]));
            let points: Vec<[f64; 2]> = scan.iter().map(|(at, _)| at).collect();
            let cloud = Cloud::of(Pose2::IDENTITY, [(Pose2::IDENTITY, &scan)]);
            let squared = |p: &[f64; 2]| (p[0] - to[0]) * (p[0] - to[0]) + (p[1] - to[1]) * (p[1] - to[1]);
            let expected = points.iter().map(squared).fold(f64::INFINITY, f64::min);
            match cloud.nearest(to, radius_m) {
                Some(nearest) => prop_assert_eq!(squared(&nearest.at), expected),
                None => prop_assert!(expected >= radius_m * radius_m),
            }
        }
    }
}
