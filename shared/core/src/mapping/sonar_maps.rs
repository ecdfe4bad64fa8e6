//! A map of each sonar: what it alone says (section 3.4 of the paper). They show a sonar that lies.
//!
//! Where nothing clamps and fusion adds, their sum is the map of all of them, up to rounding: if nothing was filtered.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fusion::{Fuser, Sounding, Weighed};
use crate::grid::{Grid, Mark, TileIndex};
use crate::parts::{Parts, Saved, SavedError};
use crate::verdict::Verdict;

/// Keeps a map of each sonar, by its number.
#[derive(Debug, Clone)]
pub(crate) struct SonarMaps {
    resolution_m: f64,
    /// Whether what is out of range is filtered.
    is_limited: bool,
    maps: BTreeMap<u16, SonarMap>,
}

#[derive(Debug, Clone)]
struct SonarMap {
    grid: Grid,
    /// When its changes were taken last.
    taken: Mark,
}

/// What is saved of a sonar besides the tiles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SonarState {
    sonar: u16,
    tiles: u64,
    changed: Vec<TileIndex>,
}

fn prefix(sonar: u16) -> String {
    format!("sonar/{sonar}/")
}

impl SonarMaps {
    /// None yet; with cells of `resolution_m`. `is_limited`: without what is out of range.
    pub(crate) fn new(resolution_m: f64, is_limited: bool) -> Self {
        Self { resolution_m, is_limited, maps: BTreeMap::new() }
    }

    /// The map of a sonar that has one.
    pub(crate) fn get(&self, sonar: u16) -> Option<&Grid> {
        self.maps.get(&sonar).map(|map| &map.grid)
    }

    /// Adds what a sonar says to its own map, whatever the filters that came after the range limits thought of it.
    pub(crate) fn record(&mut self, sounding: &Sounding<'_>, fused: Result<Weighed, Verdict>, fuser: &mut Fuser) {
        let news = match fused {
            Ok(Weighed { news, .. }) => news,
            Err(Verdict::NotSelected | Verdict::Stuck | Verdict::Lone | Verdict::MultipleReflection) => 1.0,
            Err(_) => return,
        };
        let (Some(sonar), Some(range_m)) = (sounding.channel.sonar, sounding.range_m) else { return };
        if self.is_limited && sounding.channel.refusal(range_m).is_some() {
            return;
        }
        let empty = || SonarMap { grid: Grid::new(self.resolution_m), taken: Mark::default() };
        let map = self.maps.entry(sonar).or_insert_with(empty);
        // What is not trusted, or outside of what a map can hold, is so in the other too.
        let _ = fuser.fuse(&mut map.grid, sounding, news);
    }

    /// The tiles that changed since the last call, by sonar, row by row.
    pub(crate) fn take_changed(&mut self) -> Vec<(u16, TileIndex)> {
        let mut changed = Vec::new();
        for (sonar, map) in &mut self.maps {
            changed.extend(map.grid.changed_since(map.taken).into_iter().map(|tile| (*sonar, tile)));
            map.taken = map.grid.mark();
        }
        changed
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> Vec<SonarState> {
        let state = |(sonar, SonarMap { grid, taken }): (&u16, &mut SonarMap)| {
            grid.save(parts, &prefix(*sonar));
            SonarState { sonar: *sonar, tiles: grid.tile_count() as u64, changed: grid.changed_since(*taken) }
        };
        self.maps.iter_mut().map(state).collect()
    }

    /// Takes the maps that were saved; this has none yet.
    ///
    /// # Errors
    /// A tile is missing, or damaged.
    pub(crate) fn restore(&mut self, saved: &Saved, states: Vec<SonarState>) -> Result<(), SavedError> {
        for SonarState { sonar, tiles, changed } in states {
            let mut grid = Grid::restore(self.resolution_m, saved, &prefix(sonar), tiles)?;
            let taken = grid.mark_changed(&changed);
            self.maps.insert(sonar, SonarMap { grid, taken });
        }
        Ok(())
    }
}
