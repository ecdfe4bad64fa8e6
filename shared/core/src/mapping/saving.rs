//! A mapper's state, saved so that a restarted one goes on as if nothing had happened: every bit of what comes is the same.
//!
//! | part | what |
//! |---|---|
//! | `mapper` | what is small: filters, tiles that changed, how many of each part there are |
//! | `novelty` | by transducer |
//! | `heard/x/y` | how often something was heard: a square of places |
//! | `map/x/y`, `sonar/n/x/y` | a tile with its planes |
//! | `kept/n` | kept readings, the n-th 1024 |
//! | `remap/layer/n` | what a fix may change: what came to a layer between two saves |
//!
//! What follows from the configuration and the robot is made anew. What changed is written whole, the rest is not.

use serde::{Deserialize, Serialize};

use super::GridMapper;
use super::recorders::Recorders;
use crate::config::{ConfigError, MapperConfig, Noise};
use crate::filter::Memory;
use crate::grid::{Grid, TileIndex};
use crate::heard::{Heard, HeardState};
use crate::kept::{KeptReadings, KeptState};
use crate::parts::{Parts, Saved, SavedError};
use crate::remap::{Journal, JournalState};
use crate::robot::Robot;
use crate::sonar_maps::SonarState;

/// Changes when the layout of any part does.
const LAYOUT: u32 = 4;

const STATE: &str = "mapper";
const NOVELTY: &str = "novelty";
const HEARD: &str = "heard/";
const MAP: &str = "map/";

#[derive(Debug, Serialize, Deserialize)]
struct State {
    settings: u32,
    filters: Memory,
    tiles: u64,
    /// Tiles that changed since that was asked last.
    changed: Vec<TileIndex>,
    journal: Option<JournalState>,
    sonars: Option<Vec<SonarState>>,
    kept: Option<KeptState>,
    /// Where the robot cleared its footprint last.
    cleared_at: Option<[f64; 2]>,
    heard: HeardState,
}

/// A mapper that can't be restored.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RestoreError {
    /// It can't be made at all.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// It can, but not from this.
    #[error(transparent)]
    Saved(#[from] SavedError),
}

/// A number that is another where what was saved means something else.
pub(super) fn settings(config: &MapperConfig, noise: Noise, seed: u64, robot: &Robot) -> u32 {
    crc32fast::hash(format!("{LAYOUT} {config:?} {noise:?} {seed} {robot:?}").as_bytes())
}

impl GridMapper {
    /// Puts what changed since this was called last into `parts`; at first all there is.
    pub fn save(&mut self, parts: &mut Parts) {
        self.grid.save(parts, MAP);
        let Recorders { journal, kept, sonar_maps, doubt: _ } = &mut self.recorders;
        let state = State {
            settings: self.settings,
            filters: self.chain.memory(),
            tiles: self.grid.tile_count() as u64,
            changed: self.grid.changed_since(self.taken),
            journal: journal.as_mut().map(|journal| journal.save(parts, &self.grid)),
            sonars: sonar_maps.as_mut().map(|maps| maps.save(parts)),
            kept: kept.as_mut().map(|kept| kept.save(parts)),
            cleared_at: self.driven.last,
            heard: self.fuser.heard.save(parts, HEARD),
        };
        parts.put_value(NOVELTY, &self.fuser.novelty);
        parts.put_value(STATE, &state);
    }

    /// The mapper that was saved, which goes on where it was. All but `saved` is to be what it was made of ([`GridMapper::new`]).
    ///
    /// # Errors
    /// As [`GridMapper::new`]; or a part of `saved` is missing, damaged, or of a mapper that was made of something else.
    pub fn restore(
        config: &MapperConfig,
        noise: Noise,
        seed: u64,
        robot: Robot,
        saved: &Saved,
    ) -> Result<Self, RestoreError> {
        let mut mapper = Self::new(config, noise, seed, robot)?;
        let State { settings, filters, tiles, changed, journal, sonars, kept, cleared_at, heard } =
            saved.value(STATE)?;
        let Recorders { journal: own_journal, kept: own_kept, sonar_maps, doubt: _ } = &mut mapper.recorders;
        let asked = (own_journal.is_some(), sonar_maps.is_some(), own_kept.is_some());
        if settings != mapper.settings || asked != (journal.is_some(), sonars.is_some(), kept.is_some()) {
            let problem = "saved with other settings, for another robot, or by another version";
            return Err(SavedError::new(STATE, problem).into());
        }
        mapper.chain.remember(filters);
        mapper.driven.last = cleared_at;
        mapper.fuser.novelty = saved.value(NOVELTY)?;
        mapper.fuser.heard = Heard::restore(saved, HEARD, &heard)?;
        mapper.grid = Grid::restore(config.resolution_m, saved, MAP, tiles)?;
        if let Some(journal) = journal {
            let readings_max = config.remap_readings_max as usize;
            *own_journal = Some(Journal::restore(readings_max, saved, journal, &mut mapper.grid)?);
        }
        if let Some((maps, sonars)) = sonar_maps.as_mut().zip(sonars) {
            maps.restore(saved, sonars)?;
        }
        if let Some(kept) = kept {
            *own_kept = Some(KeptReadings::restore(config.keep_readings_max as usize, saved, kept)?);
        }
        mapper.taken = mapper.grid.mark_changed(&changed);
        Ok(mapper)
    }
}
