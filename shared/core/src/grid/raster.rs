//! A rectangle of the grid, dense: what pictures and map files are made of.

use crate::grid::{CellIndex, Grid, TILE_SIDE};

/// Dense log-odds of a rectangle of cells.
#[derive(Debug, Clone)]
pub struct Raster {
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
    /// The cell of column 0, row 0 (lowest x, lowest y).
    pub lower_left: CellIndex,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Log-odds `[row * width + column]`, row 0 at the lowest y; NaN is unknown.
    pub log_odds: Vec<f32>,
}

/// A grid whose known cells lie too far apart for a dense rectangle.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the map spans {width} x {height} cells, more than the {limit} that fit")]
pub struct TooLarge {
    /// Cells along x.
    pub width: u64,
    /// Cells along y.
    pub height: u64,
    /// How many there may be in all.
    pub limit: u64,
}

impl Raster {
    /// The smallest rectangle that holds every known cell of the grid; empty (0 × 0) if none is known.
    ///
    /// It takes four bytes per cell of the rectangle, known or not; [`Raster::within`] sets a limit.
    #[must_use]
    pub fn of(grid: &Grid) -> Self {
        match grid.bounds() {
            None => Self::empty(grid),
            Some((low, high)) => Self::between(grid, low, high),
        }
    }

    /// The raster of a grid as [`Raster::of`] makes it, if the rectangle has at most `limit` cells.
    ///
    /// # Errors
    /// When it has more.
    pub fn within(grid: &Grid, limit: u64) -> Result<Self, TooLarge> {
        let Some((low, high)) = grid.bounds() else {
            return Ok(Self::empty(grid));
        };
        let cells = |low: i32, high: i32| u64::from(high.abs_diff(low)) + 1;
        let (width, height) = (cells(low.i, high.i), cells(low.j, high.j));
        if u128::from(width) * u128::from(height) > u128::from(limit) {
            return Err(TooLarge { width, height, limit });
        }
        Ok(Self::between(grid, low, high))
    }

    /// Outer corner of the lower-left cell in the map frame, metres: the `origin` of map files.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 2] {
        [f64::from(self.lower_left.i) * self.resolution_m, f64::from(self.lower_left.j) * self.resolution_m]
    }

    fn empty(grid: &Grid) -> Self {
        Self {
            width: 0,
            height: 0,
            lower_left: CellIndex { i: 0, j: 0 },
            resolution_m: grid.resolution_m(),
            log_odds: Vec::new(),
        }
    }

    /// The cells from `low` to `high`, both included; every known cell must lie between them.
    fn between(grid: &Grid, low: CellIndex, high: CellIndex) -> Self {
        let width = high.i.abs_diff(low.i) as usize + 1;
        let height = high.j.abs_diff(low.j) as usize + 1;
        let mut log_odds = vec![f32::NAN; width * height];
        for (index, tile) in grid.tiles() {
            let first = index.first_cell();
            for (offset, value) in tile.log_odds.iter().enumerate().filter(|(_, value)| !value.is_nan()) {
                let column = first.i.saturating_add((offset % TILE_SIDE) as i32).abs_diff(low.i) as usize;
                let row = first.j.saturating_add((offset / TILE_SIDE) as i32).abs_diff(low.j) as usize;
                log_odds[row * width + column] = *value;
            }
        }
        Self { width, height, lower_left: low, resolution_m: grid.resolution_m(), log_odds }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_of(cells: &[(i32, i32, f32)]) -> Grid {
        let mut grid = Grid::new(0.1);
        for (i, j, value) in cells {
            let cell = CellIndex { i: *i, j: *j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = *value;
        }
        grid
    }

    #[test]
    fn smallest_rectangle_of_the_known() {
        let raster = Raster::of(&grid_of(&[(-2, 63, 1.0), (1, 64, -1.0), (0, 65, 0.0)]));
        assert_eq!((raster.width, raster.height), (4, 3));
        assert_eq!(raster.lower_left, CellIndex { i: -2, j: 63 });
        let known: Vec<(usize, f32)> =
            raster.log_odds.iter().copied().enumerate().filter(|(_, value)| !value.is_nan()).collect();
        assert_eq!(known, [(0, 1.0), (7, -1.0), (10, 0.0)]);
        let [x, y] = raster.origin_m();
        assert!((x + 0.2).abs() < 1e-12 && (y - 6.3).abs() < 1e-12);
    }

    #[test]
    fn nothing_known_is_empty() {
        let raster = Raster::of(&Grid::new(0.05));
        assert_eq!((raster.width, raster.height, raster.log_odds.len()), (0, 0, 0));
        assert!(Raster::within(&Grid::new(0.05), 0).is_ok());
    }

    #[test]
    fn cells_far_apart_are_refused_not_allocated() {
        let grid = grid_of(&[(-1_000_000_000, 0, 1.0), (1_000_000_000, 1_000_000_000, 1.0)]);
        let error = Raster::within(&grid, 1 << 30).unwrap_err();
        assert_eq!((error.width, error.height), (2_000_000_001, 1_000_000_001));
        assert!(Raster::within(&grid_of(&[(0, 0, 1.0), (1, 1, 1.0)]), 4).is_ok());
        assert!(Raster::within(&grid_of(&[(0, 0, 1.0), (1, 1, 1.0)]), 3).is_err());
    }
}
