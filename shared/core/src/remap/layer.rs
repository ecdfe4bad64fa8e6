//! A layer of what a fix may change, and how it is saved: each time what is new of it, in a part of its own, until it is gone as a
//! whole.

use serde::{Deserialize, Serialize};

use crate::doubt::{Doubt, DoubtBefore};
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

/// Map and doubt as they had been.
#[derive(Debug, Clone, Default)]
pub(super) struct Before {
    pub(super) map: TilesBefore,
    pub(super) doubt: DoubtBefore,
}

impl Before {
    pub(super) fn begin(grid: &mut Grid, doubt: Option<&mut Doubt>) {
        grid.keep_before();
        if let Some(doubt) = doubt {
            doubt.keep_before();
        }
    }

    pub(super) fn take(grid: &mut Grid, doubt: Option<&mut Doubt>) -> Self {
        Self { map: grid.take_before(), doubt: doubt.map(Doubt::take_before).unwrap_or_default() }
    }

    /// Gives what [`Before::take`] took.
    pub(super) fn give(self, grid: &mut Grid, doubt: Option<&mut Doubt>) {
        grid.before = Some(self.map);
        if let Some(doubt) = doubt {
            doubt.give_before(self.doubt);
        }
    }

    /// With what a younger layer changed.
    pub(super) fn or(self, younger: Self) -> Self {
        Self { map: self.map.or(younger.map), doubt: self.doubt.or(younger.doubt) }
    }
}

#[derive(Debug, Clone, Default)]
pub(super) struct Layer {
    /// What this layer changed, as it had been before.
    pub(super) before: Before,
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
}

/// What a part of a layer begins with; the tiles that there were follow, in this order.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    estimates: Vec<Estimate>,
    readings: Vec<Kept>,
    /// Of the map, of the weights and of the means of the doubt; and whether there was one.
    tiles: [Vec<(TileIndex, bool)>; 3],
}

pub(super) fn name(layer: u64, part: u64) -> String {
    format!("remap/{layer}/{part}")
}

impl Layer {
    /// In how many parts it is saved.
    pub(super) fn parts(&self) -> u64 {
        self.saved.parts
    }

    /// Saves what is new of a layer that has what it changed.
    pub(super) fn save_closed(&mut self, parts: &mut Parts, number: u64) {
        let Before { map, doubt: DoubtBefore { weights, means } } = &mut self.before;
        let tiles = [map, weights, means].map(TilesBefore::take_unsaved);
        self.saved.save(parts, number, &self.estimates, &self.readings, tiles);
    }

    /// Saves what is new of a layer while the grids have what it changed.
    pub(super) fn save_open(&mut self, parts: &mut Parts, number: u64, grid: &mut Grid, doubt: Option<&mut Doubt>) {
        let [weights, means] = doubt.map(Doubt::before_mut).unwrap_or_default();
        fn new(tiles: Option<&mut TilesBefore>) -> Vec<(TileIndex, Option<&Tile>)> {
            tiles.map(TilesBefore::take_unsaved).unwrap_or_default()
        }
        let tiles = [new(grid.before.as_mut()), new(weights), new(means)];
        self.saved.save(parts, number, &self.estimates, &self.readings, tiles);
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
            let Before { map, doubt: DoubtBefore { weights, means } } = &mut layer.before;
            for (before, tiles) in [map, weights, means].into_iter().zip(head.tiles) {
                for (index, was_there) in tiles {
                    let mut tile = None;
                    if was_there {
                        let (taken, rest) = Tile::take_from(&name, bytes)?;
                        (tile, bytes) = (Some(taken), rest);
                    }
                    before.insert_saved(index, tile);
                }
            }
            if !bytes.is_empty() {
                return Err(SavedError::new(name, "longer than its tiles"));
            }
        }
        layer.saved = SavedSoFar { parts, estimates: layer.estimates.len(), readings: layer.readings.len() };
        Ok(layer)
    }
}

impl SavedSoFar {
    fn save(
        &mut self,
        parts: &mut Parts,
        number: u64,
        estimates: &[Estimate],
        readings: &[Kept],
        tiles: [Vec<(TileIndex, Option<&Tile>)>; 3],
    ) {
        let estimates_new = estimates.get(self.estimates..).unwrap_or_default();
        let readings_new = readings.get(self.readings..).unwrap_or_default();
        if estimates_new.is_empty() && readings_new.is_empty() && tiles.iter().all(Vec::is_empty) {
            return;
        }
        let head = Head {
            estimates: estimates_new.to_vec(),
            readings: readings_new.to_vec(),
            tiles: tiles.each_ref().map(|tiles| tiles.iter().map(|(index, tile)| (*index, tile.is_some())).collect()),
        };
        let there = tiles.into_iter().flatten().filter_map(|(_, tile)| tile);
        parts.put_checked(name(number, self.parts), there.fold(to_bytes(&head), |bytes, tile| tile.append_to(bytes)));
        *self = Self { parts: self.parts + 1, estimates: estimates.len(), readings: readings.len() };
    }
}
