//! The uncertainty on the map: how much odometry error the evidence of each cell carried.
//!
//! Of each cell the mean of √(σ_z² − σ_z0²), the part of a reading's deviation that the odometry is to blame for (metres; eq 22, or
//! its likeness from the covariance), weighted by how far each reading moved the cell's log-odds. A wall that is known from readings
//! of a robot that knew where it was has little; what was drawn by a lost one shows. Whatever rule fuses, what it did to a cell is
//! seen by comparing the map before and after.

use serde::{Deserialize, Serialize};

use crate::grid::{Grid, Tile, TileIndex, TilesBefore};
use crate::parts::{Parts, Saved, SavedError};

/// What [`Doubt`] can be taken back to.
#[derive(Debug, Clone, Default)]
pub(crate) struct DoubtBefore {
    pub(crate) weights: TilesBefore,
    pub(crate) means: TilesBefore,
}

impl DoubtBefore {
    /// With what a younger one changed.
    pub(crate) fn or(self, younger: Self) -> Self {
        Self { weights: self.weights.or(younger.weights), means: self.means.or(younger.means) }
    }
}

/// Under what the doubt is saved.
const WEIGHTS: &str = "doubt/weights/";
const MEANS: &str = "doubt/means/";

/// How many tiles are saved.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct DoubtTiles {
    weights: u64,
    means: u64,
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
    pub(crate) fn keep_before(&mut self) {
        self.weights.keep_before();
        self.means.keep_before();
    }

    /// What changed since, as it had been.
    pub(crate) fn take_before(&mut self) -> DoubtBefore {
        DoubtBefore { weights: self.weights.take_before(), means: self.means.take_before() }
    }

    /// The same, while it is still kept.
    pub(crate) fn before_mut(&mut self) -> [Option<&mut TilesBefore>; 2] {
        [self.weights.before.as_mut(), self.means.before.as_mut()]
    }

    /// Gives what [`Doubt::take_before`] took.
    pub(crate) fn give_before(&mut self, before: DoubtBefore) {
        (self.weights.before, self.means.before) = (Some(before.weights), Some(before.means));
    }

    /// Takes back what changed, now that the map is `grid` again.
    pub(crate) fn take_back(&mut self, before: DoubtBefore, grid: &Grid) {
        for (index, tile) in before.weights.into_tiles() {
            *self.weights.tile_mut(index) = tile.unwrap_or_default();
            *self.seen.tile_mut(index) = grid.tile(index).cloned().unwrap_or_default();
        }
        for (index, tile) in before.means.into_tiles() {
            *self.means.tile_mut(index) = tile.unwrap_or_default();
        }
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> DoubtTiles {
        self.weights.save(parts, WEIGHTS);
        self.means.save(parts, MEANS);
        DoubtTiles { weights: self.weights.tile_count() as u64, means: self.means.tile_count() as u64 }
    }

    /// What was saved, of the map `grid`: between readings the map was looked at last as it is.
    ///
    /// # Errors
    /// A tile is missing, or damaged.
    pub(crate) fn restore(
        log_odds_prior: f64,
        saved: &Saved,
        tiles: DoubtTiles,
        grid: &Grid,
    ) -> Result<Self, SavedError> {
        let resolution_m = grid.resolution_m();
        let mut seen = Grid::new(resolution_m);
        grid.tiles().for_each(|(index, tile)| *seen.tile_mut(index) = tile.clone());
        Ok(Self {
            seen,
            weights: Grid::restore(resolution_m, saved, WEIGHTS, tiles.weights)?,
            means: Grid::restore(resolution_m, saved, MEANS, tiles.means)?,
            ..Self::new(resolution_m, log_odds_prior)
        })
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
