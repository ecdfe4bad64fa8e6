//! What the map shows of the evidence: what lies along walls counts, where the rule of fusion knows of them.

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::GridMapper;
use crate::fusion::Fuser;
use crate::grid::{Grid, Mark, Tile, TileIndex};
use crate::summary::GridSummary;

impl GridMapper {
    /// What is shown of a tile: its log-odds, without planes. Its revision is the sequence number of the ring that changed it, or
    /// what lies around it, last.
    #[must_use]
    pub fn shown_tile(&self, index: TileIndex) -> Option<Cow<'_, Tile>> {
        tile(&self.grid, &self.fuser, index)
    }

    /// The map as it is shown; without planes where it is not the one that was fused.
    #[must_use]
    pub fn shown(&self) -> Cow<'_, Grid> {
        let is_shown = |(_, tile): (TileIndex, &Tile)| tile.shares.is_none();
        if self.fuser.along_walls.is_none() || self.grid.tiles().all(is_shown) {
            return Cow::Borrowed(&self.grid);
        }
        let mut shown = Grid::new(self.grid.resolution_m());
        for (index, _) in self.grid.tiles() {
            if let Some(tile) = self.shown_tile(index) {
                *shown.tile_mut(index) = tile.into_owned();
            }
        }
        Cow::Owned(shown)
    }

    /// The map so far in numbers: only tiles that changed since the last call are looked at again.
    pub fn summary(&mut self) -> GridSummary {
        let (changed, mark) = (changed_since(&self.grid, self.summary.looked()), self.grid.mark());
        let Self { summary, grid, fuser, .. } = self;
        summary.of(&changed, |index| self::tile(grid, fuser, index), mark)
    }

    /// The tiles of which something else is shown than at the last call, row by row.
    pub fn take_changed(&mut self) -> Vec<TileIndex> {
        let changed = changed_since(&self.grid, self.taken);
        self.taken = self.grid.mark();
        changed
    }
}

/// What is shown of a tile.
pub(super) fn tile<'a>(grid: &'a Grid, fuser: &Fuser, index: TileIndex) -> Option<Cow<'a, Tile>> {
    let shown = fuser.along_walls.as_ref().and_then(|along_walls| along_walls.shown(grid, index));
    let Some(shown) = shown else { return grid.tile(index).map(Cow::Borrowed) };
    let revision = around(index).filter_map(|near| Some(grid.tile(near)?.revision)).max().unwrap_or_default();
    Some(Cow::Owned(Tile::new(revision, shown)))
}

/// The tiles of which something else may be shown than at `mark`, row by row: also those around one that changed.
pub(super) fn changed_since(grid: &Grid, mark: Mark) -> Vec<TileIndex> {
    let has_states = |index: &TileIndex| grid.tile(*index).is_some_and(|tile| tile.shares.is_some());
    let mut changed = BTreeSet::new();
    for index in grid.changed_since(mark) {
        changed.insert(index);
        changed.extend(around(index).filter(has_states));
    }
    changed.into_iter().collect()
}

/// A tile and those around it.
fn around(index: TileIndex) -> impl Iterator<Item = TileIndex> {
    let near = move |(dx, dy)| Some(TileIndex { x: index.x.checked_add(dx)?, y: index.y.checked_add(dy)? });
    (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter_map(near)
}
