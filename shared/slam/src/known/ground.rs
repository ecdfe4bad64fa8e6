//! A known map as an array: what of it answers, and which way its walls face.

use echogrid_core::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, log_odds_of, probability_of};
use echogrid_core::{CellIndex, Grid, TILE_SIDE};

/// The most cells of a map that is localized in: 256 MB.
const CELLS_MAX: u64 = 32 << 20;
/// The coarsest map, metres a cell: walls of coarser ones lie too inexactly.
const RESOLUTION_MAX_M: f64 = 0.2;
/// The least wall that a map must have, metres.
const WALLS_MIN_M: f64 = 4.0;
/// Directions of normals that are told apart.
pub(super) const FACINGS: usize = 240;
/// Of a cell that is no part of a straight wall.
pub(super) const DIFFUSE: u8 = u8::MAX;
/// Neighbours within this tell how a wall lies, metres.
const NEIGHBOURS_M: f64 = 0.25;
/// A wall is longer than it is thick by this ratio of variances.
const LONG: f64 = 4.0;
/// Below, a cell does not matter.
pub(super) const LEAST: f32 = 0.02;

/// How readings were fused into a map, as far as it matters to who reads it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapModel {
    /// How probably a cell is occupied where the log-odds are 0, in (0, 1).
    pub prior: f64,
}

/// What keeps a map from being localized in.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GroundError {
    /// The cells are too large.
    #[error("cells of {0} m: walls must be known to 0.2 m or better to localize by them")]
    Coarse(f64),
    /// It is too large.
    #[error("{columns} × {rows} cells; expected at most {CELLS_MAX} to localize in")]
    Large {
        /// Along x.
        columns: u64,
        /// Along y.
        rows: u64,
    },
    /// Hardly anything is in it.
    #[error(
        "{walls_m:.1} m of wall and {free_m2:.1} m² of free floor are known; it takes {WALLS_MIN_M} m of wall to localize by"
    )]
    Small {
        /// Metres of wall.
        walls_m: f64,
        /// Square metres of floor.
        free_m2: f64,
    },
}

/// A map as an array of cells.
#[derive(Debug, Clone)]
pub struct Ground {
    pub(super) resolution_m: f64,
    /// The corner of lowest x and y, metres.
    pub(super) low: [f64; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// How probably each cell is occupied, row by row.
    pub(super) occupied: Vec<f32>,
    /// Which way each faces: a multiple of π / [`FACINGS`], or [`DIFFUSE`].
    pub(super) facing: Vec<u8>,
    /// Whether it is known to be free.
    pub(super) free: Vec<bool>,
}

impl Ground {
    /// The cells of a grid that was made by `model`, as an array.
    ///
    /// # Errors
    /// It is too coarse, too large, or too little is in it.
    pub fn of(grid: &Grid, model: MapModel) -> Result<Self, GroundError> {
        let resolution_m = grid.resolution_m();
        if resolution_m > RESOLUTION_MAX_M {
            return Err(GroundError::Coarse(resolution_m));
        }
        let nothing = GroundError::Small { walls_m: 0.0, free_m2: 0.0 };
        let (low, high) = grid.bounds().ok_or(nothing)?;
        let cells = |low: i32, high: i32| (i64::from(high) - i64::from(low) + 1) as u64;
        let (columns, rows) = (cells(low.i, high.i), cells(low.j, high.j));
        if columns.saturating_mul(rows) > CELLS_MAX {
            return Err(GroundError::Large { columns, rows });
        }
        let mut ground = Self::empty(resolution_m, low, columns as usize, rows as usize, model);
        let prior = log_odds_of(model.prior);
        for (index, tile) in grid.tiles() {
            let first = index.first_cell();
            for (offset, log_odds) in tile.log_odds.iter().enumerate().filter(|(_, log_odds)| !log_odds.is_nan()) {
                let (i, j) = (first.i + (offset % TILE_SIDE) as i32, first.j + (offset / TILE_SIDE) as i32);
                let place = (j - low.j) as usize * ground.columns + (i - low.i) as usize;
                let log_odds = f64::from(*log_odds);
                ground.occupied[place] = probability_of(log_odds + prior) as f32;
                ground.free[place] = probability_of(log_odds) < FREE_BELOW;
                if probability_of(log_odds) > OCCUPIED_ABOVE {
                    ground.facing[place] = 0;
                }
            }
        }
        let walls = ground.facing.iter().filter(|facing| **facing != DIFFUSE).count();
        let free = ground.free.iter().filter(|free| **free).count();
        let (walls_m, free_m2) = (walls as f64 * resolution_m, free as f64 * resolution_m * resolution_m);
        if walls_m < WALLS_MIN_M || free == 0 {
            return Err(GroundError::Small { walls_m, free_m2 });
        }
        ground.face();
        Ok(ground)
    }

    fn empty(resolution_m: f64, low: CellIndex, columns: usize, rows: usize, model: MapModel) -> Self {
        Self {
            resolution_m,
            low: [f64::from(low.i) * resolution_m, f64::from(low.j) * resolution_m],
            columns,
            rows,
            occupied: vec![model.prior as f32; columns * rows],
            facing: vec![DIFFUSE; columns * rows],
            free: vec![false; columns * rows],
        }
    }

    /// Finds which way the walls face, by how their neighbours lie.
    fn face(&mut self) {
        let reach = (NEIGHBOURS_M / self.resolution_m).ceil() as isize;
        let mut facing = vec![DIFFUSE; self.facing.len()];
        for row in 0..self.rows {
            for column in 0..self.columns {
                let place = row * self.columns + column;
                if self.occupied[place] < LEAST {
                    continue;
                }
                let mut sums = [0.0_f64; 6];
                for v in -reach..=reach {
                    for u in -reach..=reach {
                        let Some(weight) = self.weight(column as isize + u, row as isize + v) else { continue };
                        let (x, y) = (u as f64, v as f64);
                        let terms = [1.0, x, y, x * x, x * y, y * y];
                        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
                    }
                }
                facing[place] = facing_of(sums);
            }
        }
        self.facing = facing;
    }

    fn weight(&self, column: isize, row: isize) -> Option<f64> {
        let place = self.place(column, row)?;
        let occupied = self.occupied[place];
        (occupied >= LEAST).then_some(f64::from(occupied))
    }

    /// Where a cell lies in the arrays; none outside.
    #[inline]
    pub(super) fn place(&self, column: isize, row: isize) -> Option<usize> {
        let is_in = column >= 0 && row >= 0 && (column as usize) < self.columns && (row as usize) < self.rows;
        is_in.then(|| row as usize * self.columns + column as usize)
    }

    /// The column and row of a point.
    #[inline]
    pub(super) fn cell(&self, x: f64, y: f64) -> (isize, isize) {
        let inverse = 1.0 / self.resolution_m;
        (((x - self.low[0]) * inverse).floor() as isize, ((y - self.low[1]) * inverse).floor() as isize)
    }

    /// The middle of a cell, metres.
    pub(super) fn centre(&self, place: usize) -> [f64; 2] {
        let (column, row) = (place % self.columns, place / self.columns);
        [self.low[0] + (column as f64 + 0.5) * self.resolution_m, self.low[1] + (row as f64 + 0.5) * self.resolution_m]
    }
}

/// Which way a wall faces: by the weight of its neighbours, their weighted places, and the squares and products of these.
fn facing_of([weight, x, y, xx, xy, yy]: [f64; 6]) -> u8 {
    if weight < 2.0 {
        return DIFFUSE;
    }
    let (x, y) = (x / weight, y / weight);
    let (xx, xy, yy) = (xx / weight - x * x, xy / weight - x * y, yy / weight - y * y);
    let root = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
    // A cell is as thick as it is.
    let (thick, long) = (((xx + yy - root) / 2.0).max(1.0 / 12.0), (xx + yy + root) / 2.0);
    if long < LONG * thick {
        return DIFFUSE;
    }
    let along = 0.5 * libm::atan2(2.0 * xy, xx - yy);
    let turns = (along + core::f64::consts::FRAC_PI_2) / core::f64::consts::PI;
    ((turns - turns.floor()) * FACINGS as f64).round() as u8 % FACINGS as u8
}
