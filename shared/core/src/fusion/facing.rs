//! Which way the walls of a map face, as far as [`crate::oriented`] has found it out.
//!
//! Of a cell that is rather occupied the walls of each direction have weights. A normal has no sign, so directions are averaged as
//! angles of twice their size: Σ w_k e^{2i n_k} points along twice the mean normal, and its length, compared with the weight of all
//! that the cell may be if it is occupied, tells how far they agree. Where they hardly do, or the cell is rather diffuse, it faces no way.

use core::f64::consts::{PI, TAU};

use crate::grid::{TILE_CELLS, Tile, TileIndex};
use crate::mapping::GridMapper;
use crate::oriented::DIRECTIONS;

/// Directions agree so far, at least, where a cell is said to face one.
const AGREE_MIN: f64 = 0.5;

impl GridMapper {
    /// The normal of the wall in each cell of a tile, radians in [0, π) from the x axis of the map; NaN where no wall faces one way.
    ///
    /// None where the tile is not there, or no rule of fusion knows of directions.
    #[must_use]
    pub fn facings(&self, index: TileIndex) -> Option<Box<[f32; TILE_CELLS]>> {
        facings_of(self.grid.tile(index)?, self.shown_tile(index)?.as_ref(), self.fuser.diffuse())
    }
}

/// The normal of the wall in each cell, radians in [0, π) from the x axis of the map; NaN where there is none that faces one way.
/// Occupied is what `shown` says; of that the share `diffuse` is no smooth wall before any reading. None where nothing but log-odds is
/// known.
fn facings_of(tile: &Tile, shown: &Tile, diffuse: f64) -> Option<Box<[f32; TILE_CELLS]>> {
    let shares = tile.shares.as_ref()?;
    let turned: [(f64, f64); DIRECTIONS] = core::array::from_fn(|k| libm::sincos(TAU * k as f64 / DIRECTIONS as f64));
    let mut facings = Box::new([f32::NAN; TILE_CELLS]);
    let occupied = shown.log_odds.iter().enumerate().filter(|(_, log_odds)| **log_odds > 0.0);
    for (offset, _) in occupied {
        let [no_wall, walls @ ..] = shares.of(offset).map(f64::from);
        let smooth = (1.0 - diffuse) / DIRECTIONS as f64;
        let (mut sine, mut cosine, mut all) = (0.0, 0.0, diffuse * no_wall);
        for (weight, (s, c)) in walls.into_iter().zip(turned) {
            (sine, cosine, all) = (sine + smooth * weight * s, cosine + smooth * weight * c, all + smooth * weight);
        }
        if libm::hypot(sine, cosine) >= AGREE_MIN * all {
            facings[offset] = within_half_a_turn(0.5 * libm::atan2(sine, cosine));
        }
    }
    Some(facings)
}

/// An angle of a normal from −π/2 to π/2 as one in [0, π), in single precision, too.
fn within_half_a_turn(angle_rad: f64) -> f32 {
    let angle = (if angle_rad < 0.0 { angle_rad + PI } else { angle_rad }) as f32;
    if angle < PI as f32 { angle } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shares::Shares;

    fn facing_of(log_odds: f32, states: [f32; 1 + DIRECTIONS]) -> f32 {
        let mut tile = Tile::default();
        tile.log_odds[70] = log_odds;
        let mut shares = Shares::default();
        shares.set(70, &states, 0);
        tile.shares = Some(shares);
        facings_of(&tile, &tile, 0.3).unwrap()[70]
    }

    #[test]
    fn a_wall_faces_the_way_that_its_readings_agree_on() {
        let eighth = core::f32::consts::PI / 8.0;
        let states = |walls: &[(usize, f32)]| {
            let mut states = [0.01; 1 + DIRECTIONS];
            walls.iter().for_each(|(k, weight)| states[1 + k] = *weight);
            states
        };
        let near = |found: f32, expected: f32| assert!((found - expected).abs() < 0.02, "{found} {expected}");
        near(facing_of(3.0, states(&[(2, 50.0)])), 2.0 * eighth);
        near(facing_of(3.0, states(&[(2, 50.0), (3, 50.0)])), 2.5 * eighth);
        near(facing_of(3.0, states(&[(7, 50.0), (0, 50.0)])), 7.5 * eighth);
        assert!(facing_of(3.0, states(&[(0, 50.0), (4, 50.0)])).is_nan(), "a corner faces both ways");
        assert!(facing_of(-3.0, states(&[(2, 50.0)])).is_nan(), "nothing is there");
        let mut post = states(&[(2, 50.0)]);
        post[0] = 500.0;
        assert!(facing_of(3.0, post).is_nan(), "it answers from everywhere");
    }

    #[test]
    fn every_facing_is_within_half_a_turn() {
        for step in 0..=1000 {
            let angle = within_half_a_turn(PI * (f64::from(step) / 1000.0 - 0.5));
            assert!((0.0..PI as f32).contains(&angle), "{angle}");
        }
        assert_eq!(within_half_a_turn(-1e-12), 0.0);
        assert!(facings_of(&Tile::default(), &Tile::default(), 0.3).is_none());
    }
}
