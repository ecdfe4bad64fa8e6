//! What is solid all through: the occupied pixels of a map image.

use super::surface::Segment;
use crate::pose::Pose2;

/// A bitmap of solid squares.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    map_from_corner: Pose2,
    resolution_m: f64,
    width: usize,
    /// `[row * width + column]`, row 0 at the lowest y of the bitmap's own frame.
    cells: Vec<bool>,
}

impl Solid {
    /// A bitmap of rows of `width` squares of `resolution_m`; row 0, column 0 has its lower-left corner at
    /// `map_from_corner`, whose heading turns the whole. None if the rows don't come out even, or a square has no size.
    #[must_use]
    pub fn new(map_from_corner: Pose2, resolution_m: f64, width: usize, cells: Vec<bool>) -> Option<Self> {
        let even = width > 0 && cells.len().is_multiple_of(width);
        (even && resolution_m > 0.0 && resolution_m.is_finite()).then_some(Self {
            map_from_corner,
            resolution_m,
            width,
            cells,
        })
    }

    /// The same in another frame.
    pub(super) fn moved(&self, map_from_world: Pose2) -> Self {
        Self { map_from_corner: map_from_world * self.map_from_corner, ..self.clone() }
    }

    /// Whether a point of the map frame is within it.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        let [x, y] = self.map_from_corner.inverse().transform(point);
        let (column, row) = ((x / self.resolution_m).floor(), (y / self.resolution_m).floor());
        column >= 0.0 && row >= 0.0 && self.at(column as usize, row as usize)
    }

    /// Points of the map frame that lie in what is solid: at least one in each cell of `cell_m` that has a part of it.
    pub fn samples(&self, cell_m: f64) -> impl Iterator<Item = [f64; 2]> {
        // From just within one side of a square to just within the other.
        let steps = (self.resolution_m / cell_m).ceil().clamp(1.0, 1e4) as usize;
        let within = move |step: usize| 1e-3 + (1.0 - 2e-3) * step as f64 / steps as f64;
        let solid = self.cells.iter().enumerate().filter(|(_, solid)| **solid);
        solid.map(|(index, _)| (index % self.width, index / self.width)).flat_map(move |(column, row)| {
            (0..=steps).flat_map(move |up| {
                (0..=steps).map(move |along| {
                    let (x, y) = (column as f64 + within(along), row as f64 + within(up));
                    self.map_from_corner.transform([x * self.resolution_m, y * self.resolution_m])
                })
            })
        })
    }

    fn height(&self) -> usize {
        self.cells.len() / self.width
    }

    fn at(&self, column: usize, row: usize) -> bool {
        column < self.width && row < self.height() && self.cells[row * self.width + column]
    }

    /// A corner of a square, in the map frame.
    fn corner(&self, column: usize, row: usize) -> [f64; 2] {
        self.map_from_corner.transform([column as f64 * self.resolution_m, row as f64 * self.resolution_m])
    }

    /// The four corners of the whole, in the map frame.
    pub(super) fn corners(&self) -> [[f64; 2]; 4] {
        let (width, height) = (self.width, self.height());
        [self.corner(0, 0), self.corner(width, 0), self.corner(0, height), self.corner(width, height)]
    }

    /// The lines between what is solid and what is not, as long as they are straight. Stops when there are more than
    /// `limit`.
    pub(super) fn outline(&self, limit: usize) -> Vec<Segment> {
        let mut lines = Vec::new();
        let (width, height) = (self.width, self.height());
        let edge = |before: Option<usize>, here: usize, at: &dyn Fn(usize) -> bool| before.is_some_and(at) != at(here);
        // Lines along x below each row, then lines along y left of each column.
        for row in 0..=height {
            let is_edge = |column: usize| edge(row.checked_sub(1), row, &|row| self.at(column, row));
            runs(width, is_edge, |from, to| {
                lines.push(Segment { from: self.corner(from, row), to: self.corner(to, row) });
            });
            if lines.len() > limit {
                return lines;
            }
        }
        for column in 0..=width {
            let is_edge = |row: usize| edge(column.checked_sub(1), column, &|column| self.at(column, row));
            runs(height, is_edge, |from, to| {
                lines.push(Segment { from: self.corner(column, from), to: self.corner(column, to) });
            });
            if lines.len() > limit {
                return lines;
            }
        }
        lines
    }
}

/// Every unbroken run from..to of numbers below `end` for which `holds`.
fn runs(end: usize, holds: impl Fn(usize) -> bool, mut run: impl FnMut(usize, usize)) {
    let mut start = None;
    for at in 0..=end {
        match (start, at < end && holds(at)) {
            (None, true) => start = Some(at),
            (Some(from), false) => {
                run(from, at);
                start = None;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_l_has_six_sides() {
        let solid = Solid::new(Pose2::new(10.0, 0.0, 0.0), 0.5, 2, vec![true, true, true, false]).unwrap();
        let lines = solid.outline(100);
        assert_eq!(lines.len(), 6, "{lines:?}");
        assert!(lines.contains(&Segment { from: [10.0, 0.0], to: [11.0, 0.0] }));
        assert!(solid.contains([10.2, 0.7]) && !solid.contains([10.7, 0.7]) && !solid.contains([9.9, 0.1]));
        assert_eq!(solid.outline(0).len(), 1, "no more than it takes to see that there are too many");
    }

    #[test]
    fn turned() {
        let solid = Solid::new(Pose2::new(0.0, 0.0, core::f64::consts::FRAC_PI_2), 1.0, 3, vec![true; 3]).unwrap();
        assert!(solid.contains([-0.5, 2.5]) && !solid.contains([0.5, 2.5]));
    }

    #[test]
    fn rows_come_out_even() {
        assert_eq!(Solid::new(Pose2::IDENTITY, 0.5, 2, vec![true; 3]), None);
        assert_eq!(Solid::new(Pose2::IDENTITY, 0.0, 1, vec![true; 3]), None);
        assert_eq!(Solid::new(Pose2::IDENTITY, 0.5, 0, vec![]), None);
    }
}
