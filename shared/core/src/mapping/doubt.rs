//! The uncertainty on the map: how much odometry error the evidence of each cell carried.
//!
//! Of each cell the mean of √(σ_z² − σ_z0²), the part of a reading's deviation that the odometry is to blame for (metres; eq 22, or
//! its likeness from the covariance), weighted by how far each reading moved the cell's log-odds. A wall that is known from readings
//! of a robot that knew where it was has little; what was drawn by a lost one shows. Whatever rule fuses, what it did to a cell is
//! seen by comparing the map before and after.

use crate::grid::{Grid, Mark, Plane, Tile};

/// Keeps, in planes of the map, the mean odometry error of the evidence of each cell.
#[derive(Debug, Clone)]
pub(crate) struct Doubt {
    /// l0: where a cell starts.
    start: f32,
    /// When the reading at hand began.
    begun: Mark,
}

impl Doubt {
    /// Of a map with cells that start at l0 = `log_odds_prior`.
    pub(crate) fn new(log_odds_prior: f64) -> Self {
        Self { start: log_odds_prior as f32, begun: Mark::default() }
    }

    /// A reading is about to change `grid`.
    pub(crate) fn begin_reading(&mut self, grid: &mut Grid) {
        self.begun = grid.mark();
    }

    /// A reading with an odometry error of `doubt_m` has changed `grid`.
    pub(crate) fn end_reading(&self, grid: &mut Grid, doubt_m: f64) {
        for index in grid.changed_since(self.begun) {
            self.gather(grid.tile_mut(index), doubt_m);
        }
    }

    fn gather(&self, tile: &mut Tile, doubt_m: f64) {
        // What is sent must be finite.
        let doubt_m = doubt_m.min(f64::from(f32::MAX));
        let planes = [Plane::LogOddsBefore, Plane::DoubtWeight, Plane::Doubt];
        let (log_odds, [seen, weights, means]) = tile.with_planes_mut(planes);
        let sums = weights.iter_mut().zip(means);
        for ((seen, now), (weight, mean)) in seen.iter_mut().zip(log_odds).zip(sums) {
            if seen.to_bits() == now.to_bits() {
                continue;
            }
            let before = if seen.is_nan() { self.start } else { *seen };
            let moved = f64::from((*now - before).abs());
            *seen = *now;
            if moved > 0.0 {
                let total = moved + if weight.is_nan() { 0.0 } else { f64::from(*weight) };
                let so_far = if mean.is_nan() { doubt_m } else { f64::from(*mean) };
                *mean = (so_far + moved / total * (doubt_m - so_far)) as f32;
                *weight = total as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::TileIndex;

    #[test]
    fn weighted_by_how_far_the_cell_was_moved() {
        let mut doubt = Doubt::new(0.5);
        let index = TileIndex { x: -1, y: 2 };
        let mut grid = Grid::new(0.05);
        let mut say = |log_odds: f32, doubt_m: f64| {
            doubt.begin_reading(&mut grid);
            grid.tile_mut(index).log_odds[7] = log_odds;
            doubt.end_reading(&mut grid, doubt_m);
            let means = grid.tile(index).unwrap().plane(Plane::Doubt).unwrap();
            assert!(means[8].is_nan());
            means[7]
        };
        // It starts at 0.5: moved by 1, then down by 3, then not at all, then by 4.
        assert_eq!(say(1.5, 0.2), 0.2);
        assert_eq!(say(-1.5, 0.6), 0.5);
        assert_eq!(say(-1.5, 9.0), 0.5);
        assert_eq!(say(-5.5, 0.1), 0.3);
    }

    #[test]
    fn what_moves_nothing_says_nothing_and_what_is_sent_is_finite() {
        let doubt = Doubt::new(0.0);
        let mut tile = Tile::default();
        tile.log_odds[0] = 0.0;
        doubt.gather(&mut tile, 1.0);
        assert!(tile.plane(Plane::Doubt).unwrap()[0].is_nan());
        tile.log_odds[0] = 1.0;
        doubt.gather(&mut tile, 1e300);
        assert!(tile.plane(Plane::Doubt).unwrap()[0].is_finite());
    }
}
