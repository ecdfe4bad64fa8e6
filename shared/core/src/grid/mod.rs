//! The occupancy grid (paper section 3.2): log-odds in tiles of 64 × 64 cells.
//!
//! The grid grows in every direction by adding tiles; no cell is ever copied. Unknown is a state
//! of its own: a cell that no reading touched is NaN, never 0 (which is evidence that cancelled).

mod changes;
pub mod log_odds;
mod plane;
pub mod raster;
pub mod summary;
mod tile;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

pub use changes::Mark;
pub(crate) use changes::TilesBefore;
use changes::{Changes, Undo};
pub use plane::Plane;
use serde::{Deserialize, Serialize};
pub use tile::Tile;

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
    /// The column: the number of the cell along x.
    pub i: i32,
    /// The row: the number of the cell along y.
    pub j: i32,
}

/// A tile: covers the cells i in [64 x, 64 x + 63], j in [64 y, 64 y + 63]. Ordered by row (y), then x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TileIndex {
    /// The number of the tile along x.
    pub x: i32,
    /// The number of the tile along y.
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
    /// The cell of lowest column and row. (Of a tile beyond what cells can number: the nearest that there is.)
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

    /// The place of the cell within its tile, row by row (row 0 at the lowest y).
    #[must_use]
    pub fn offset_in_tile(self) -> usize {
        let column = self.i.rem_euclid(TILE_SIDE as i32) as usize;
        let row = self.j.rem_euclid(TILE_SIDE as i32) as usize;
        row * TILE_SIDE + column
    }
}

/// An unbounded grid of log-odds.
#[derive(Debug, Clone)]
pub struct Grid {
    resolution_m: f64,
    tiles: BTreeMap<TileIndex, Slot>,
    changes: Changes,
    /// When it was saved last.
    saved: Mark,
    /// None: nothing is to be undone.
    undo: Option<Undo>,
}

#[derive(Debug, Clone)]
struct Slot {
    tile: Tile,
    /// When it was written to last.
    written: Mark,
}

impl Grid {
    /// An empty grid: every cell unknown. `resolution_m` is the side of a cell.
    #[must_use]
    pub fn new(resolution_m: f64) -> Self {
        let (tiles, changes) = (BTreeMap::new(), Changes::default());
        Self { resolution_m, tiles, changes, saved: Mark::default(), undo: None }
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
    pub fn tiles(&self) -> impl DoubleEndedIterator<Item = (TileIndex, &Tile)> {
        self.tiles.iter().map(|(index, slot)| (*index, &slot.tile))
    }

    /// The tile at this place, if it holds anything.
    #[must_use]
    pub fn tile(&self, index: TileIndex) -> Option<&Tile> {
        self.tiles.get(&index).map(|slot| &slot.tile)
    }

    /// One tile to write to; created unknown if absent.
    pub fn tile_mut(&mut self, index: TileIndex) -> &mut Tile {
        let tile = self.noted_mut(index);
        if let Some(shares) = &mut tile.shares {
            shares.unsettle(u64::MAX);
            shares.touch(u32::MAX);
        }
        tile
    }

    /// The log-odds of one cell to write to, NaN if unknown.
    pub(crate) fn log_odds_mut(&mut self, cell: CellIndex, revision: u64) -> &mut f32 {
        let (tile, offset) = (self.noted_mut(cell.tile()), cell.offset_in_tile());
        tile.revision = revision;
        if let Some(shares) = &mut tile.shares {
            shares.unsettle(1 << (offset / TILE_SIDE));
            shares.touch(Shares::blocks(offset, 1));
        }
        &mut tile.log_odds[offset]
    }

    /// The blocks of a tile that may have been written to since this was asked last; all, where there are no states.
    pub(crate) fn take_touched(&mut self, index: TileIndex) -> u32 {
        let shares = self.tiles.get_mut(&index).and_then(|slot| slot.tile.shares.as_mut());
        shares.map_or(u32::MAX, Shares::take_touched)
    }

    /// The states of the cells of a tile to write to, and their log-odds, which must be written to as the states say; what is written to
    /// must be [touched](Shares::touch).
    pub(crate) fn states_mut(&mut self, index: TileIndex, revision: u64) -> (&mut Shares, &mut [f32; TILE_CELLS]) {
        let tile = self.noted_mut(index);
        tile.revision = revision;
        (tile.shares.get_or_insert_default(), &mut tile.log_odds)
    }

    fn noted_mut(&mut self, index: TileIndex) -> &mut Tile {
        let now = self.changes.now();
        match self.tiles.entry(index) {
            Entry::Occupied(entry) => {
                let slot = entry.into_mut();
                if slot.written != now {
                    if let Some(undo) = &mut self.undo {
                        undo.keep(index, Some(&slot.tile));
                    }
                    self.changes.note(index, Some(slot.written));
                    slot.written = now;
                }
                &mut slot.tile
            }
            Entry::Vacant(entry) => {
                if let Some(undo) = &mut self.undo {
                    undo.keep(index, None);
                }
                self.changes.note(index, None);
                &mut entry.insert(Slot { tile: Tile::default(), written: now }).tile
            }
        }
    }

    /// Marks this moment: [`Grid::changed_since`] tells the tiles that are written to after it.
    pub fn mark(&mut self) -> Mark {
        self.changes.mark()
    }

    /// The tiles that were written to since `mark`, row by row; all, since the first mark.
    #[must_use]
    pub fn changed_since(&self, mark: Mark) -> Vec<TileIndex> {
        self.changes.since(mark)
    }

    /// Whether nothing was written to since `mark`.
    #[must_use]
    pub(crate) fn is_as_at(&self, mark: Mark) -> bool {
        self.changes.are_none_since(mark)
    }

    /// Marks a moment after which these tiles count as written to.
    pub(crate) fn mark_changed(&mut self, tiles: &[TileIndex]) -> Mark {
        let mark = self.mark();
        for index in tiles {
            if let Some(slot) = self.tiles.get_mut(index) {
                self.changes.note(*index, Some(slot.written));
                slot.written = mark;
            }
        }
        // They are not: what is written to them now is still to be noted.
        self.mark();
        mark
    }

    /// From now on each tile is kept as it is before it is written to for the first time; what was kept so far is forgotten.
    pub(crate) fn begin_undo(&mut self) {
        self.resume_undo(TilesBefore::new());
    }

    /// Goes on keeping tiles where `before` were kept.
    pub(crate) fn resume_undo(&mut self, before: TilesBefore) {
        // What is written to from now on is noted, whenever it was before.
        self.mark();
        self.undo = Some(Undo::new(before));
    }

    /// What is kept so far.
    pub(crate) fn undo(&self) -> &[(TileIndex, Option<Tile>)] {
        self.undo.as_ref().map(|undo| undo.before.as_slice()).unwrap_or_default()
    }

    /// What was kept: each tile that changed, as it had been. Nothing more is kept.
    pub(crate) fn end_undo(&mut self) -> TilesBefore {
        self.undo.take().map(|undo| undo.before).unwrap_or_default()
    }

    /// Makes a tile what it had been; none: nothing was known of it.
    pub(crate) fn take_back(&mut self, index: TileIndex, before: Option<Tile>) {
        let tile = self.tile_mut(index);
        match before {
            Some(before) => *tile = before,
            None => tile.forget(),
        }
    }

    /// Saves the tiles that were written to since the last time, under names that begin with `prefix`.
    pub(crate) fn save(&mut self, parts: &mut Parts, prefix: &str) {
        for index in self.changed_since(self.saved) {
            if let Some(tile) = self.tile(index) {
                parts.put_checked(format!("{prefix}{}/{}", index.x, index.y), tile.append_to(Vec::new()));
            }
        }
        self.saved = self.mark();
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
            *grid.tile_mut(index) = tile;
        }
        grid.saved = grid.mark();
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
    fn changes_are_told_once_and_in_order_to_each_who_asks() {
        let tile = |x, y| TileIndex { x, y };
        let mut grid = Grid::new(0.05);
        let write = |grid: &mut Grid, tiles: &[(i32, i32)]| {
            tiles.iter().for_each(|(x, y)| grid.tile_mut(tile(*x, *y)).revision += 1);
        };
        write(&mut grid, &[(5, 1), (-2, 1), (9, -3), (5, 1)]);
        let first = grid.mark();
        assert!(grid.changed_since(first).is_empty());
        write(&mut grid, &[(5, 1), (0, 0)]);
        let second = grid.mark();
        write(&mut grid, &[(5, 1)]);
        assert_eq!(grid.changed_since(second), [tile(5, 1)]);
        assert_eq!(grid.changed_since(first), [tile(0, 0), tile(5, 1)]);
        assert_eq!(grid.changed_since(Mark::default()), [tile(9, -3), tile(0, 0), tile(-2, 1), tile(5, 1)]);
        assert_eq!(grid.tile(tile(5, 1)).unwrap().revision, 4);
    }

    #[test]
    fn what_is_taken_back_is_as_it_was() {
        let tile = |x| TileIndex { x, y: 0 };
        let mut grid = Grid::new(0.05);
        grid.tile_mut(tile(0)).log_odds[0] = 1.0;
        grid.begin_undo();
        for value in [2.0, 3.0] {
            grid.tile_mut(tile(0)).log_odds[0] = value;
            grid.tile_mut(tile(1)).log_odds[0] = value;
            grid.mark();
        }
        let before = grid.end_undo();
        assert_eq!(
            before.iter().map(|(index, tile)| (index.x, tile.is_some())).collect::<Vec<_>>(),
            [(0, true), (1, false)]
        );
        before.into_iter().for_each(|(index, tile)| grid.take_back(index, tile));
        assert_eq!(grid.tile(tile(0)).unwrap().log_odds[0], 1.0);
        assert!(grid.tile(tile(1)).unwrap().log_odds[0].is_nan());
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
