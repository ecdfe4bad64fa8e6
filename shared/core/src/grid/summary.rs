//! A grid in a few numbers.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::grid::{CellIndex, Grid, Mark, Tile, TileIndex, union};
use crate::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, entropy_bits, log_odds_of};

/// How much a grid knows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GridSummary {
    /// Cells that a reading touched: `occupied + free + undecided`.
    pub known: u64,
    /// How many of the known cells are occupied (p > 0.65).
    pub occupied: u64,
    /// How many of the known cells are free (p < 0.35).
    pub free: u64,
    /// How many of the known cells are neither.
    pub undecided: u64,
    /// Sum of the entropies of the known cells, bits.
    pub entropy_bits: f64,
    /// Lowest and highest column and row of the known cells, both included; none if none is known.
    pub bounds: Option<(CellIndex, CellIndex)>,
}

impl GridSummary {
    /// The summary of a grid.
    #[must_use]
    pub fn of(grid: &Grid) -> Self {
        grid.tiles().map(|(index, tile)| Self::of_tile(index, tile)).fold(Self::default(), Self::and)
    }

    fn of_tile(index: TileIndex, tile: &Tile) -> Self {
        let (occupied_above, free_below) = (log_odds_of(OCCUPIED_ABOVE), log_odds_of(FREE_BELOW));
        let mut summary = Self { bounds: tile.bounds(index), ..Self::default() };
        for log_odds in tile.log_odds.iter().filter(|value| !value.is_nan()).map(|value| f64::from(*value)) {
            summary.known += 1;
            if log_odds > occupied_above {
                summary.occupied += 1;
            } else if log_odds < free_below {
                summary.free += 1;
            } else {
                summary.undecided += 1;
            }
            summary.entropy_bits += entropy_bits(log_odds);
        }
        summary
    }

    /// The summary of two parts of a grid.
    fn and(self, other: Self) -> Self {
        Self {
            known: self.known + other.known,
            occupied: self.occupied + other.occupied,
            free: self.free + other.free,
            undecided: self.undecided + other.undecided,
            entropy_bits: self.entropy_bits + other.entropy_bits,
            bounds: union(self.bounds, other.bounds),
        }
    }
}

/// The summary of a grid that changes: only tiles that did are looked at again.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunningSummary {
    tiles: BTreeMap<TileIndex, GridSummary>,
    /// When the grid was looked at last.
    looked: Mark,
}

impl RunningSummary {
    /// When the grid was looked at last.
    pub(crate) fn looked(&self) -> Mark {
        self.looked
    }

    /// The summary of what is shown of a grid, always the same one: that of [`GridSummary::of`]. What is shown of these tiles may have
    /// `changed` since the grid was looked at last; now it is `mark`.
    pub(crate) fn of<'a>(
        &mut self,
        changed: &[TileIndex],
        shown: impl Fn(TileIndex) -> Option<Cow<'a, Tile>>,
        mark: Mark,
    ) -> GridSummary {
        for index in changed {
            if let Some(tile) = shown(*index) {
                self.tiles.insert(*index, GridSummary::of_tile(*index, &tile));
            }
        }
        self.looked = mark;
        self.tiles.values().copied().fold(GridSummary::default(), GridSummary::and)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_known() {
        let mut grid = Grid::new(0.05);
        assert_eq!(GridSummary::of(&grid), GridSummary::default());
        grid.tile_mut(CellIndex { i: 5, j: 5 }.tile());
        assert_eq!(GridSummary::of(&grid), GridSummary::default(), "a tile of unknown cells knows nothing");
    }

    #[test]
    fn each_kind_is_counted() {
        let mut grid = Grid::new(0.05);
        let cells = [(-70, 3, 2.0f32), (0, 0, -2.0), (5, 130, 0.0), (6, 1, 0.5), (7, 1, f32::INFINITY)];
        for (i, j, value) in cells {
            let cell = CellIndex { i, j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = value;
        }
        let summary = GridSummary::of(&grid);
        assert_eq!((summary.known, summary.occupied, summary.free, summary.undecided), (5, 2, 1, 2));
        assert_eq!(summary.bounds, Some((CellIndex { i: -70, j: 0 }, CellIndex { i: 7, j: 130 })));
        let expected = 2.0 * entropy_bits(2.0) + 1.0 + entropy_bits(0.5);
        assert!((summary.entropy_bits - expected).abs() < 1e-12);
    }

    #[test]
    fn a_running_summary_is_the_summary() {
        let mut grid = Grid::new(0.05);
        let mut running = RunningSummary::default();
        let summary_of = |running: &mut RunningSummary, grid: &mut Grid| {
            let (changed, mark) = (grid.changed_since(running.looked()), grid.mark());
            running.of(&changed, |index| grid.tile(index).map(Cow::Borrowed), mark)
        };
        for (i, j, value) in [(0, 0, 1.0f32), (100, -3, -2.0), (0, 1, 0.1), (100, -3, 0.3), (-500, 900, 4.0)] {
            let cell = CellIndex { i, j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = value;
            assert_eq!(summary_of(&mut running, &mut grid), GridSummary::of(&grid));
        }
        assert_eq!(summary_of(&mut running, &mut grid), GridSummary::of(&grid), "asking changes nothing");
    }
}
