//! The occupancy grid (paper section 3.2): log-odds in tiles of 64 × 64 cells.
//!
//! The grid grows in every direction by adding tiles; no cell is ever copied. Unknown is a state
//! of its own: a cell that no reading touched is NaN, never 0 (which is evidence that cancelled).

use std::collections::{BTreeMap, btree_map};

use serde::{Deserialize, Serialize};

use crate::parts::{Parts, Saved, SavedError};
use crate::shares::Shares;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
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

impl TileIndex {
    /// Its cell of lowest column and row. (Of a tile beyond what cells can number: the nearest that there is.)
    #[must_use]
    pub fn first_cell(self) -> CellIndex {
        CellIndex { i: self.x.saturating_mul(TILE_SIDE as i32), j: self.y.saturating_mul(TILE_SIDE as i32) }
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
    /// What its cells would be if they are occupied; none: nothing but the log-odds is known.
    pub shares: Option<Shares>,
}

impl Tile {
    /// Bounds of the known cells of this tile, which is the one at `index`.
    pub(crate) fn bounds(&self, index: TileIndex) -> Bounds {
        let first = index.first_cell();
        let known = |cells: &[f32]| cells.iter().any(|value| !value.is_nan());
        let rows = || self.log_odds.chunks_exact(TILE_SIDE);
        let low_row = rows().position(known)?;
        let high_row = rows().rposition(known)?;
        let columns = |row: &[f32]| {
            let low = row.iter().position(|value| !value.is_nan())?;
            Some((low, row.iter().rposition(|value| !value.is_nan())?))
        };
        let (low_column, high_column) = rows().filter_map(columns).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let cell = |column: usize, row: usize| CellIndex {
            i: first.i.saturating_add(column as i32),
            j: first.j.saturating_add(row as i32),
        };
        Some((cell(low_column, low_row), cell(high_column, high_row)))
    }
}

/// Of a saved tile: its revision, its cells as they are, and whether their states follow.
const CELLS_BYTES: usize = TILE_CELLS * size_of::<f32>();
const TILE_BYTES: usize = size_of::<u64>() + CELLS_BYTES + 1;

impl Tile {
    /// `bytes` with this tile after them, every bit of it.
    pub(crate) fn append_to(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        bytes.reserve(TILE_BYTES);
        bytes.extend_from_slice(&self.revision.to_le_bytes());
        bytes.extend(self.log_odds.iter().flat_map(|value| value.to_le_bytes()));
        bytes.push(u8::from(self.shares.is_some()));
        if let Some(shares) = &self.shares {
            shares.append_to(&mut bytes);
        }
        bytes
    }

    /// The tile that `bytes`, of this part, begin with, and what comes after it.
    pub(crate) fn take_from<'a>(part: &str, bytes: &'a [u8]) -> Result<(Self, &'a [u8]), SavedError> {
        let short = || SavedError::new(part, "shorter than a tile");
        let (revision, rest) = bytes.split_first_chunk().ok_or_else(short)?;
        let (cells, rest) = rest.split_at_checked(CELLS_BYTES).ok_or_else(short)?;
        let (has_shares, mut rest) = rest.split_first().ok_or_else(short)?;
        let mut tile = Self { revision: u64::from_le_bytes(*revision), ..Self::default() };
        for (value, bytes) in tile.log_odds.iter_mut().zip(cells.as_chunks().0) {
            *value = f32::from_le_bytes(*bytes);
        }
        if *has_shares != 0 {
            let (shares, behind) = Shares::take_from(part, rest)?;
            (tile.shares, rest) = (Some(shares), behind);
        }
        Ok((tile, rest))
    }
}

impl Default for Tile {
    fn default() -> Self {
        Self { revision: 0, log_odds: Box::new([UNKNOWN; TILE_CELLS]), shares: None }
    }
}

/// Tiles as they had been before they were first written to.
#[derive(Debug, Clone, Default)]
pub(crate) struct TilesBefore {
    /// None: there was none.
    tiles: BTreeMap<TileIndex, Option<Tile>>,
    /// Those that are not saved yet, once each.
    unsaved: Vec<TileIndex>,
}

impl TilesBefore {
    fn keep(&mut self, index: TileIndex, tile: impl FnOnce() -> Option<Tile>) {
        if let btree_map::Entry::Vacant(vacant) = self.tiles.entry(index) {
            vacant.insert(tile());
            self.unsaved.push(index);
        }
    }

    /// Of a tile that both changed the elder knows how it was before both.
    pub(crate) fn or(mut self, younger: Self) -> Self {
        for (index, tile) in younger.tiles {
            self.tiles.entry(index).or_insert(tile);
        }
        self
    }

    /// Row by row.
    pub(crate) fn into_tiles(self) -> impl Iterator<Item = (TileIndex, Option<Tile>)> {
        self.tiles.into_iter()
    }

    /// Those that were not saved yet.
    pub(crate) fn take_unsaved(&mut self) -> Vec<(TileIndex, Option<&Tile>)> {
        let unsaved = std::mem::take(&mut self.unsaved).into_iter();
        unsaved.map(|index| (index, self.tiles.get(&index).and_then(Option::as_ref))).collect()
    }

    /// One that was saved.
    pub(crate) fn insert_saved(&mut self, index: TileIndex, tile: Option<Tile>) {
        self.tiles.insert(index, tile);
    }
}

/// An unbounded grid of log-odds.
#[derive(Debug, Clone)]
pub struct Grid {
    resolution_m: f64,
    tiles: BTreeMap<TileIndex, Slot>,
    /// Tiles that were written to since the grid was saved, once each.
    unsaved: Vec<TileIndex>,
    /// What a fix may take the grid back to; none: it may not.
    pub(crate) before: Option<TilesBefore>,
}

#[derive(Debug, Clone, Default)]
struct Slot {
    tile: Tile,
    /// It is among those to be saved.
    is_listed: bool,
}

impl Grid {
    /// An empty grid: every cell unknown. `resolution_m` is the side of a cell.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        Self { resolution_m, tiles: BTreeMap::new(), unsaved: Vec::new(), before: None }
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
        let value = self.tile(cell.tile())?.log_odds[cell.offset_in_tile()];
        (!value.is_nan()).then_some(value)
    }

    /// All tiles, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = (TileIndex, &Tile)> {
        self.tiles.iter().map(|(index, slot)| (*index, &slot.tile))
    }

    /// One tile.
    #[must_use]
    pub fn tile(&self, index: TileIndex) -> Option<&Tile> {
        self.tiles.get(&index).map(|slot| &slot.tile)
    }

    /// One tile to write to; created unknown if absent.
    pub fn tile_mut(&mut self, index: TileIndex) -> &mut Tile {
        if let Some(before) = &mut self.before {
            before.keep(index, || self.tiles.get(&index).map(|slot| slot.tile.clone()));
        }
        let slot = self.tiles.entry(index).or_default();
        if !slot.is_listed {
            slot.is_listed = true;
            self.unsaved.push(index);
        }
        &mut slot.tile
    }

    /// From now on each tile is kept as it is before it is written to for the first time; what was kept so far is forgotten.
    pub(crate) fn keep_before(&mut self) {
        self.before = Some(TilesBefore::default());
    }

    /// What was kept: each tile that changed, as it had been. Nothing more is kept.
    pub(crate) fn take_before(&mut self) -> TilesBefore {
        self.before.take().unwrap_or_default()
    }

    /// Saves the tiles that were written to since the last time, under names that begin with `prefix`.
    pub(crate) fn save(&mut self, parts: &mut Parts, prefix: &str) {
        for index in std::mem::take(&mut self.unsaved) {
            if let Some(slot) = self.tiles.get_mut(&index) {
                slot.is_listed = false;
                parts.put_checked(format!("{prefix}{}/{}", index.x, index.y), slot.tile.append_to(Vec::new()));
            }
        }
    }

    /// The grid of `tiles` tiles that was saved under such names.
    ///
    /// # Errors
    /// A tile is missing, damaged, or not one.
    pub(crate) fn restore(resolution_m: f64, saved: &Saved, prefix: &str, tiles: u64) -> Result<Self, SavedError> {
        let mut grid = Self::new(resolution_m);
        for (name, _) in saved.under(prefix) {
            let of_name = || {
                let (x, y) = name.strip_prefix(prefix)?.split_once('/')?;
                Some(TileIndex { x: x.parse().ok()?, y: y.parse().ok()? })
            };
            let index = of_name().ok_or_else(|| SavedError::new(name, "not the name of a tile"))?;
            let (tile, rest) = Tile::take_from(name, saved.checked(name)?)?;
            if !rest.is_empty() {
                return Err(SavedError::new(name, "longer than a tile"));
            }
            grid.tiles.insert(index, Slot { tile, is_listed: false });
        }
        let found = grid.tiles.len() as u64;
        if found == tiles { Ok(grid) } else { Err(SavedError::new(prefix, format!("{found} tiles of {tiles}"))) }
    }

    /// How many tiles there are.
    #[must_use]
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }

    /// Lowest and highest column and row of the known cells, both included; none if no cell is known.
    #[must_use]
    pub fn bounds(&self) -> Option<(CellIndex, CellIndex)> {
        self.tiles().fold(None, |bounds, (index, tile)| union(bounds, tile.bounds(index)))
    }
}

/// Lowest and highest column and row, both included.
pub(crate) type Bounds = Option<(CellIndex, CellIndex)>;

/// The smallest bounds that hold both.
pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    let (Some((a_low, a_high)), Some((b_low, b_high))) = (a, b) else { return a.or(b) };
    Some((
        CellIndex { i: a_low.i.min(b_low.i), j: a_low.j.min(b_low.j) },
        CellIndex { i: a_high.i.max(b_high.i), j: a_high.j.max(b_high.j) },
    ))
}

/// The tiles that changed since somebody last asked: a set, kept in the order of [`TileIndex`].
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct DirtyTiles {
    sorted: Vec<TileIndex>,
}

impl DirtyTiles {
    /// This tile has changed.
    pub fn insert(&mut self, index: TileIndex) {
        if let Err(place) = self.sorted.binary_search(&index) {
            self.sorted.insert(place, index);
        }
    }

    /// All tiles that changed since the last call, row by row.
    pub fn take(&mut self) -> Vec<TileIndex> {
        core::mem::take(&mut self.sorted)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn cells_on_both_sides_of_zero() {
        let cell = CellIndex { i: -1, j: -64 };
        assert_eq!(cell.tile(), TileIndex { x: -1, y: -1 });
        assert_eq!(cell.offset_in_tile(), 63);
        assert_eq!(CellIndex { i: 64, j: 0 }.tile(), TileIndex { x: 1, y: 0 });
        let grid = Grid::new(0.05);
        assert_eq!(grid.cell_at(-0.01, 0.01), CellIndex { i: -1, j: 0 });
        assert_eq!(grid.cell_at(f64::NAN, 1e300), CellIndex { i: 0, j: i32::MAX });
    }

    #[test]
    fn a_tile_knows_nothing_at_first() {
        let mut grid = Grid::new(0.05);
        let cell = CellIndex { i: 3, j: 4 };
        assert!(grid.tile_mut(cell.tile()).log_odds.iter().all(|value| value.is_nan()));
        assert_eq!(grid.log_odds(cell), None);
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 0.0;
        assert_eq!(grid.log_odds(cell), Some(0.0), "evidence that cancelled is not the same as none");
        assert_eq!(grid.log_odds(CellIndex { i: 4, j: 4 }), None);
        assert_eq!(grid.bounds(), Some((cell, cell)));
    }

    #[test]
    fn dirty_tiles_come_once_and_in_order() {
        let mut dirty = DirtyTiles::default();
        let tile = |x, y| TileIndex { x, y };
        for index in [tile(5, 1), tile(-2, 1), tile(9, -3), tile(5, 1)] {
            dirty.insert(index);
        }
        assert_eq!(dirty.take(), [tile(9, -3), tile(-2, 1), tile(5, 1)]);
        assert!(dirty.take().is_empty());
    }

    proptest! {
        #[test]
        fn tile_and_offset_name_the_cell(i in any::<i32>(), j in any::<i32>()) {
            let cell = CellIndex { i, j };
            let first = cell.tile().first_cell();
            let offset = cell.offset_in_tile();
            prop_assert_eq!(first.i + (offset % TILE_SIDE) as i32, i);
            prop_assert_eq!(first.j + (offset / TILE_SIDE) as i32, j);
        }

        #[test]
        fn a_centre_lies_in_its_cell(i in -1_000_000..1_000_000i32, j in -1_000_000..1_000_000i32, res in 0.001..10.0f64) {
            let grid = Grid::new(res);
            let [x, y] = grid.centre(CellIndex { i, j });
            prop_assert_eq!(grid.cell_at(x, y), CellIndex { i, j });
        }
    }
}
