//! The uncertainty on the map: how much odometry error the evidence of each cell carried.
//!
//! Of each cell the mean of √(σ_z² − σ_z0²), the part of a reading's deviation that the odometry is to blame for (metres; eq 22, or
//! its likeness from the covariance), weighted by how far each reading moved the cell's log-odds. A wall that is known from readings
//! of a robot that knew where it was has little; what was drawn by a lost one shows. Whatever rule fuses, what it did to a cell is
//! seen by comparing the map before and after.

use std::collections::BTreeMap;

use crate::grid::{Grid, Tile, TileIndex};

/// Tiles as they had been; none: there was none.
pub(crate) type SavedTiles = BTreeMap<TileIndex, Option<Tile>>;

/// Of a tile that both changed the elder knows how it was before both.
pub(crate) fn elder_first(elder: &mut SavedTiles, younger: SavedTiles) {
    for (index, tile) in younger {
        elder.entry(index).or_insert(tile);
    }
}

/// What [`Doubt`] can be taken back to.
#[derive(Debug, Clone, Default)]
pub(crate) struct SavedDoubt {
    weights: SavedTiles,
    means: SavedTiles,
}

impl SavedDoubt {
    /// With what an elder one knows, which goes before.
    pub(crate) fn or(mut self, younger: Self) -> Self {
        elder_first(&mut self.weights, younger.weights);
        elder_first(&mut self.means, younger.means);
        self
    }
}

/// The mean odometry error of the evidence, by cell.
#[derive(Debug, Clone)]
pub(crate) struct Doubt {
    /// l0: where a cell starts.
    start: f32,
    /// The map as it was looked at last.
    seen: Grid,
    /// How far readings moved each cell in all.
    weights: Grid,
    /// Metres; NaN where nothing moved the cell.
    means: Grid,
}

impl Doubt {
    /// Of a map with cells of `resolution_m` that start at l0 = `log_odds_prior`.
    pub(crate) fn new(resolution_m: f64, log_odds_prior: f64) -> Self {
        let empty = || Grid::new(resolution_m);
        Self { start: log_odds_prior as f32, seen: empty(), weights: empty(), means: empty() }
    }

    /// Metres in the cells.
    pub(crate) fn means(&self) -> &Grid {
        &self.means
    }

    /// A reading with an odometry error of `doubt_m` has made `tile` of what was seen last.
    pub(crate) fn gather(&mut self, index: TileIndex, tile: &Tile, doubt_m: f64) {
        // What is sent must be finite.
        let doubt_m = doubt_m.min(f64::from(f32::MAX));
        let seen = self.seen.tile_mut(index).log_odds.iter_mut();
        let (weights, means) = (self.weights.tile_mut(index), self.means.tile_mut(index));
        let sums = weights.log_odds.iter_mut().zip(means.log_odds.iter_mut());
        for ((seen, now), (weight, mean)) in seen.zip(tile.log_odds.iter()).zip(sums) {
            if seen.to_bits() == now.to_bits() {
                continue;
            }
            let before = if seen.is_nan() { self.start } else { *seen };
            let moved = f64::from((now - before).abs());
            *seen = *now;
            if moved > 0.0 {
                let total = moved + if weight.is_nan() { 0.0 } else { f64::from(*weight) };
                let so_far = if mean.is_nan() { doubt_m } else { f64::from(*mean) };
                *mean = (so_far + moved / total * (doubt_m - so_far)) as f32;
                *weight = total as f32;
            }
        }
    }

    /// From now on what changes can be taken back.
    pub(crate) fn save_changes(&mut self) {
        self.weights.save_changes();
        self.means.save_changes();
    }

    /// What changed since, as it had been.
    pub(crate) fn take_saved(&mut self) -> SavedDoubt {
        SavedDoubt { weights: self.weights.take_saved(), means: self.means.take_saved() }
    }

    /// Takes back what was saved, now that the map is `grid` again.
    pub(crate) fn restore(&mut self, saved: SavedDoubt, grid: &Grid) {
        for (index, tile) in saved.weights {
            *self.weights.tile_mut(index) = tile.unwrap_or_default();
            *self.seen.tile_mut(index) = grid.tile(index).cloned().unwrap_or_default();
        }
        for (index, tile) in saved.means {
            *self.means.tile_mut(index) = tile.unwrap_or_default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weighted_by_how_far_the_cell_was_moved() {
        let index = TileIndex { x: -1, y: 2 };
        let mut doubt = Doubt::new(0.05, 0.5);
        let mut map = Tile::default();
        let mut say = |log_odds: f32, doubt_m: f64| {
            map.log_odds[7] = log_odds;
            doubt.gather(index, &map, doubt_m);
            doubt.means().tile(index).map(|tile| tile.log_odds[7])
        };
        // It starts at 0.5: moved by 1, then down by 3, then not at all, then by 4.
        assert_eq!(say(1.5, 0.2), Some(0.2));
        assert_eq!(say(-1.5, 0.6), Some(0.5));
        assert_eq!(say(-1.5, 9.0), Some(0.5));
        assert_eq!(say(-5.5, 0.1), Some(0.3));
        assert!(doubt.means().tile(index).is_some_and(|tile| tile.log_odds[8].is_nan()));
    }

    #[test]
    fn what_moves_nothing_says_nothing_and_what_is_sent_is_finite() {
        let index = TileIndex { x: 0, y: 0 };
        let mut doubt = Doubt::new(0.05, 0.0);
        let mut map = Tile::default();
        map.log_odds[0] = 0.0;
        doubt.gather(index, &map, 1.0);
        assert!(doubt.means().tile(index).is_some_and(|tile| tile.log_odds[0].is_nan()));
        map.log_odds[0] = 1.0;
        doubt.gather(index, &map, 1e300);
        assert!(doubt.means().tile(index).is_some_and(|tile| tile.log_odds[0].is_finite()));
    }
}
