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

impl Raster {
    /// The smallest rectangle that holds every known cell of the grid; empty (0 × 0) if none is known.
    #[must_use]
    pub fn of(grid: &Grid) -> Self {
        let mut bounds: Option<(i32, i32, i32, i32)> = None;
        for (index, tile) in grid.tiles() {
            for (offset, value) in tile.log_odds.iter().enumerate() {
                if value.is_nan() {
                    continue;
                }
                let i = index.x * TILE_SIDE as i32 + (offset % TILE_SIDE) as i32;
                let j = index.y * TILE_SIDE as i32 + (offset / TILE_SIDE) as i32;
                bounds = Some(bounds.map_or((i, i, j, j), |b| (b.0.min(i), b.1.max(i), b.2.min(j), b.3.max(j))));
            }
        }
        let Some((i_min, i_max, j_min, j_max)) = bounds else {
            return Self {
                width: 0,
                height: 0,
                lower_left: CellIndex { i: 0, j: 0 },
                resolution_m: grid.resolution_m(),
                log_odds: Vec::new(),
            };
        };
        let (width, height) = ((i_max - i_min + 1) as usize, (j_max - j_min + 1) as usize);
        let mut log_odds = Vec::with_capacity(width * height);
        for j in j_min..=j_max {
            for i in i_min..=i_max {
                log_odds.push(grid.log_odds(CellIndex { i, j }).unwrap_or(f32::NAN));
            }
        }
        Self {
            width,
            height,
            lower_left: CellIndex { i: i_min, j: j_min },
            resolution_m: grid.resolution_m(),
            log_odds,
        }
    }

    /// Outer corner of the lower-left cell in the map frame, metres: the `origin` of map files.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 2] {
        [f64::from(self.lower_left.i) * self.resolution_m, f64::from(self.lower_left.j) * self.resolution_m]
    }
}
