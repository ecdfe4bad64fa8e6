//! The occupancy grid (paper section 3.2): log-odds in tiles of 64 × 64 cells.
//!
//! The grid grows in every direction by adding tiles; no cell is ever copied. Unknown is a state
//! of its own: a cell that no reading touched is NaN, never 0 (which is evidence that cancelled).

use std::collections::BTreeMap;

/// Cells along the side of a tile.
pub const TILE_SIDE: usize = 64;
/// Cells in a tile.
pub const TILE_CELLS: usize = TILE_SIDE * TILE_SIDE;
/// Log-odds of a cell that no reading touched. Ask with `is_nan`, NaN never equals itself.
pub const UNKNOWN: f32 = f32::NAN;

/// A cell of the whole grid: cell (i, j) covers [i, i+1) × [j, j+1) resolutions from the origin of
/// the map frame; its centre is at ((i + ½) res, (j + ½) res).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Along x.
    pub i: i32,
    /// Along y.
    pub j: i32,
}

/// A tile: covers the cells i in [64 x, 64 x + 63], j in [64 y, 64 y + 63]. Ordered by row (y), then x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TileIndex {
    /// Along x.
    pub x: i32,
    /// Along y.
    pub y: i32,
}

impl Ord for TileIndex {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        (self.y, self.x).cmp(&(other.y, other.x))
    }
}

impl PartialOrd for TileIndex {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl CellIndex {
    /// The tile that holds this cell.
    #[must_use]
    pub fn tile(self) -> TileIndex {
        TileIndex { x: self.i.div_euclid(TILE_SIDE as i32), y: self.j.div_euclid(TILE_SIDE as i32) }
    }

    /// Its place within the tile, row by row (row 0 at the lowest y).
    #[must_use]
    pub fn offset_in_tile(self) -> usize {
        let column = self.i.rem_euclid(TILE_SIDE as i32) as usize;
        let row = self.j.rem_euclid(TILE_SIDE as i32) as usize;
        row * TILE_SIDE + column
    }
}

/// 64 × 64 cells.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Changes whenever a cell changes: the number of the scan that changed it last.
    pub revision: u64,
    /// Log-odds, row by row, row 0 at the lowest y; NaN is unknown.
    pub log_odds: Box<[f32; TILE_CELLS]>,
}

impl Default for Tile {
    fn default() -> Self {
        Self { revision: 0, log_odds: Box::new([UNKNOWN; TILE_CELLS]) }
    }
}

/// An unbounded grid of log-odds.
#[derive(Debug, Clone)]
pub struct Grid {
    resolution_m: f64,
    tiles: BTreeMap<TileIndex, Tile>,
}

impl Grid {
    /// An empty grid: every cell unknown. `resolution_m` is the side of a cell.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        Self { resolution_m, tiles: BTreeMap::new() }
    }

    /// Side of a cell, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The cell that holds the point (x, y) of the map frame, metres.
    #[must_use]
    pub fn cell_at(&self, x: f64, y: f64) -> CellIndex {
        CellIndex { i: (x / self.resolution_m).floor() as i32, j: (y / self.resolution_m).floor() as i32 }
    }

    /// Centre of a cell, metres in the map frame.
    #[must_use]
    pub fn centre(&self, cell: CellIndex) -> [f64; 2] {
        [(f64::from(cell.i) + 0.5) * self.resolution_m, (f64::from(cell.j) + 0.5) * self.resolution_m]
    }

    /// Log-odds of a cell; none where no reading touched it.
    #[must_use]
    pub fn log_odds(&self, cell: CellIndex) -> Option<f32> {
        let value = self.tiles.get(&cell.tile())?.log_odds[cell.offset_in_tile()];
        (!value.is_nan()).then_some(value)
    }

    /// All tiles, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = (TileIndex, &Tile)> {
        self.tiles.iter().map(|(index, tile)| (*index, tile))
    }

    /// One tile.
    #[must_use]
    pub fn tile(&self, index: TileIndex) -> Option<&Tile> {
        self.tiles.get(&index)
    }

    /// One tile to write to; created unknown if absent.
    pub fn tile_mut(&mut self, index: TileIndex) -> &mut Tile {
        self.tiles.entry(index).or_default()
    }

    /// How many tiles there are.
    #[must_use]
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }
}
