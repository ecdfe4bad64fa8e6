//! A layer of what a fix may change, and how it is saved: each time what is new of it, in a part of its own, until it is gone as a
//! whole.

use serde::{Deserialize, Serialize};

use crate::grid::{Grid, Tile, TileIndex, TilesBefore};
use crate::odometry::Estimate;
use crate::parts::{Parts, Saved, SavedError, take_value, to_bytes};
use crate::reading::Reading;
use crate::verdict::Verdict;

/// A reading that may be fused again.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Kept {
    pub(super) sequence: u64,
    pub(super) reading: Reading,
    /// How much of it was new, or why it was refused.
    pub(super) fused: Result<f64, Verdict>,
    /// Its estimate, of those of the layer.
    pub(super) at: usize,
    /// Its place among the kept readings, if these are kept.
    pub(super) place: u64,
    /// Where the robot had cleared its footprint last, before this one.
    pub(super) cleared_at: Option<[f64; 2]>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct Layer {
    /// What this layer changed, as it had been before.
    pub(super) before: TilesBefore,
    /// Readings of one moment share their estimate.
    pub(super) estimates: Vec<Estimate>,
    pub(super) readings: Vec<Kept>,
    saved: SavedSoFar,
}

/// How much of a layer is saved.
#[derive(Debug, Clone, Copy, Default)]
struct SavedSoFar {
    parts: u64,
    estimates: usize,
    readings: usize,
    tiles: usize,
}

/// What a part of a layer begins with; the tiles that there were follow, in this order.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    estimates: Vec<Estimate>,
    readings: Vec<Kept>,
    /// And whether there was one.
    tiles: Vec<(TileIndex, bool)>,
}

pub(super) fn name(layer: u64, part: u64) -> String {
    format!("remap/{layer}/{part}")
}

impl Layer {
    /// In how many parts it is saved.
    pub(super) fn parts(&self) -> u64 {
        self.saved.parts
    }

    /// Saves what is new of a layer. What it changed is in the layer or, while it is the last one, still with the grid.
    pub(super) fn save(&mut self, parts: &mut Parts, number: u64, grid: Option<&Grid>) {
        fn new<T>(all: &[T], saved: usize) -> &[T] {
            all.get(saved..).unwrap_or_default()
        }
        let before = grid.map_or(self.before.as_slice(), Grid::undo);
        let estimates = new(&self.estimates, self.saved.estimates);
        let readings = new(&self.readings, self.saved.readings);
        let tiles = new(before, self.saved.tiles);
        if estimates.is_empty() && readings.is_empty() && tiles.is_empty() {
            return;
        }
        let head = Head {
            estimates: estimates.to_vec(),
            readings: readings.to_vec(),
            tiles: tiles.iter().map(|(index, tile)| (*index, tile.is_some())).collect(),
        };
        let there = tiles.iter().filter_map(|(_, tile)| tile.as_ref());
        let bytes = there.fold(to_bytes(&head), |bytes, tile| tile.append_to(bytes));
        parts.put_checked(name(number, self.saved.parts), bytes);
        let (estimates, readings, tiles) = (self.estimates.len(), self.readings.len(), before.len());
        self.saved = SavedSoFar { parts: self.saved.parts + 1, estimates, readings, tiles };
    }

    /// A layer that was saved in so many parts, with what it changed.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(super) fn restore(saved: &Saved, number: u64, parts: u64) -> Result<Self, SavedError> {
        let mut layer = Self::default();
        for part in 0..parts {
            let name = name(number, part);
            let (head, mut bytes): (Head, _) = take_value(&name, saved.checked(&name)?)?;
            layer.estimates.extend(head.estimates);
            layer.readings.extend(head.readings);
            for (index, was_there) in head.tiles {
                let mut tile = None;
                if was_there {
                    let (taken, rest) = Tile::take_from(&name, bytes)?;
                    (tile, bytes) = (Some(taken), rest);
                }
                layer.before.push((index, tile));
            }
            if !bytes.is_empty() {
                return Err(SavedError::new(name, "longer than its tiles"));
            }
        }
        let (estimates, readings, tiles) = (layer.estimates.len(), layer.readings.len(), layer.before.len());
        layer.saved = SavedSoFar { parts, estimates, readings, tiles };
        Ok(layer)
    }
}
