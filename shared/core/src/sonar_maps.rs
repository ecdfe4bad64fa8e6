//! A map of each sonar: what it alone says (section 3.4 of the paper). They show a sonar that lies.
//!
//! Where nothing clamps and fusion adds, their sum is the map of all of them, up to rounding: if nothing was filtered.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::grid::{DirtyTiles, Grid, TileIndex};
use crate::parts::{Parts, Saved, SavedError};

/// A grid per sonar, by its number.
#[derive(Debug, Clone)]
pub(crate) struct SonarMaps {
    resolution_m: f64,
    maps: BTreeMap<u16, (Grid, DirtyTiles)>,
}

/// What is saved of a sonar besides the tiles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SonarState {
    sonar: u16,
    tiles: u64,
    dirty: DirtyTiles,
}

fn prefix(sonar: u16) -> String {
    format!("sonar/{sonar}/")
}

impl SonarMaps {
    /// None yet; with cells of `resolution_m`.
    pub(crate) fn new(resolution_m: f64) -> Self {
        Self { resolution_m, maps: BTreeMap::new() }
    }

    /// The map of a sonar, and which of its tiles changed.
    pub(crate) fn of(&mut self, sonar: u16) -> (&mut Grid, &mut DirtyTiles) {
        let empty = || (Grid::new(self.resolution_m), DirtyTiles::default());
        let (grid, dirty) = self.maps.entry(sonar).or_insert_with(empty);
        (grid, dirty)
    }

    /// The map of a sonar that has one.
    pub(crate) fn get(&self, sonar: u16) -> Option<&Grid> {
        self.maps.get(&sonar).map(|(grid, _)| grid)
    }

    /// The tiles that changed since the last call, by sonar, row by row.
    pub(crate) fn take_dirty(&mut self) -> Vec<(u16, TileIndex)> {
        let tiles = |(sonar, (_, dirty)): (&u16, &mut (Grid, DirtyTiles))| {
            let sonar = *sonar;
            dirty.take().into_iter().map(move |tile| (sonar, tile))
        };
        self.maps.iter_mut().flat_map(tiles).collect()
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> Vec<SonarState> {
        let state = |(sonar, (grid, dirty)): (&u16, &mut (Grid, DirtyTiles))| {
            grid.save(parts, &prefix(*sonar));
            SonarState { sonar: *sonar, tiles: grid.tile_count() as u64, dirty: dirty.clone() }
        };
        self.maps.iter_mut().map(state).collect()
    }

    /// What was saved, with cells of `resolution_m`.
    ///
    /// # Errors
    /// A tile is missing, or damaged.
    pub(crate) fn restore(resolution_m: f64, saved: &Saved, states: Vec<SonarState>) -> Result<Self, SavedError> {
        let map = |SonarState { sonar, tiles, dirty }| {
            Ok((sonar, (Grid::restore(resolution_m, saved, &prefix(sonar), tiles)?, dirty)))
        };
        Ok(Self { resolution_m, maps: states.into_iter().map(map).collect::<Result<_, SavedError>>()? })
    }
}
