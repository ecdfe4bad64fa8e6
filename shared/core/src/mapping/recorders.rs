//! What is written down beside the map, each kind if it is asked for. The map does not depend on it.

use crate::config::{Filter, MapperConfig};
use crate::doubt::Doubt;
use crate::fusion::{Fuser, Sounding, Weighed};
use crate::grid::Grid;
use crate::kept::KeptReadings;
use crate::remap::Journal;
use crate::sonar_maps::SonarMaps;
use crate::verdict::Verdict;

/// All recorders; none: not asked for.
#[derive(Debug, Clone)]
pub(crate) struct Recorders {
    /// What a fix may change.
    pub(crate) journal: Option<Journal>,
    /// The readings as they were fused last.
    pub(crate) kept: Option<KeptReadings>,
    /// A map of each sonar.
    pub(crate) sonar_maps: Option<SonarMaps>,
    /// How much odometry error the evidence of each cell carried.
    pub(crate) doubt: Option<Doubt>,
}

impl Recorders {
    /// Those that a valid configuration asks for, of an empty `grid`.
    pub(super) fn new(config: &MapperConfig, grid: &mut Grid) -> Self {
        let is_limited = config.filters.contains(&Filter::Range);
        Self {
            journal: config.remap.then(|| Journal::new(config.remap_readings_max as usize, grid)),
            kept: config.keep_readings.then(|| KeptReadings::new(config.keep_readings_max as usize)),
            sonar_maps: config.sonar_maps.then(|| SonarMaps::new(config.resolution_m, is_limited)),
            doubt: config.doubt.then(|| Doubt::new(config.log_odds_prior)),
        }
    }

    /// So many readings are about to be taken in, fused or not.
    pub(super) fn begin_readings(&mut self, grid: &mut Grid, count: usize) {
        if let Some(journal) = &mut self.journal {
            journal.make_room(grid, count);
        }
    }

    /// A reading was taken in: `fused`, or refused. `cleared_at`: where the robot had cleared its footprint last before it, metres.
    pub(super) fn end_reading(
        &mut self,
        sounding: &Sounding<'_>,
        fused: Result<Weighed, Verdict>,
        cleared_at: Option<[f64; 2]>,
        fuser: &mut Fuser,
    ) {
        if let Some(journal) = &mut self.journal {
            let place = self.kept.as_ref().map_or(0, KeptReadings::next_place);
            journal.record(sounding, fused, place, cleared_at);
        }
        if let Some(kept) = &mut self.kept {
            kept.record(sounding, fused, fuser);
        }
        if let Some(sonar_maps) = &mut self.sonar_maps {
            sonar_maps.record(sounding, fused, fuser);
        }
    }

    /// The grid is about to be changed by a reading.
    pub(super) fn begin_change(&mut self, grid: &mut Grid) {
        if let Some(doubt) = &mut self.doubt {
            doubt.begin_reading(grid);
        }
    }

    /// A reading changed the grid.
    pub(super) fn end_change(&mut self, grid: &mut Grid, weighed: &Weighed) {
        if let Some(doubt) = &self.doubt {
            doubt.end_reading(grid, weighed.doubt_m);
        }
    }
}
