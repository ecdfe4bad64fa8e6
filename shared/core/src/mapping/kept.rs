//! The readings that made the map what it is, as they were fused: by them it can be told why a cell is what it is ([`crate::why`]).

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::chunks::Chunks;
use crate::fusion::{Fuser, Sounding, Weighed};
use crate::parts::{Parts, Saved, SavedError};
use crate::pose::Pose2;
use crate::reading::Reading;
use crate::sensor_model::Deviations;
use crate::verdict::Verdict;

/// A reading with all that its fusion depends on, besides the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KeptReading {
    /// Number of its scan.
    pub sequence: u64,
    /// What was heard.
    pub reading: Reading,
    /// `map_from_base`: where the robot was, as it was believed when this was fused last.
    pub pose: Pose2,
    /// Eqs 22, 23.
    pub deviations: Deviations,
    /// How much of it was new, in (0, 1]; 0 where it was refused.
    pub news: f64,
    /// Whether it is in the map, or why it is not.
    pub verdict: Verdict,
    /// Around the robot, where it was then, so much was cleared after this reading, metres; 0: nothing.
    pub cleared_m: f64,
}

impl KeptReading {
    /// A reading as it was fused, or as it would have been if it was refused for what it tells.
    pub(crate) fn of(sounding: &Sounding<'_>, fused: Result<Weighed, Verdict>, fuser: &Fuser) -> Option<Self> {
        let (deviations, news, cleared_m, verdict) = match fused {
            Ok(Weighed { deviations, news, cleared_m, .. }) => (deviations, news, cleared_m, Verdict::Accepted),
            Err(Verdict::Accepted | Verdict::Invalid | Verdict::NoEcho | Verdict::NoPose | Verdict::Held) => {
                return None;
            }
            Err(verdict) => (fuser.deviations(sounding), 0.0, 0.0, verdict),
        };
        let Sounding { sequence, reading, estimate, .. } = *sounding;
        Some(Self { sequence, reading: *reading, pose: estimate.pose, deviations, news, verdict, cleared_m })
    }
}

/// The last so many readings, in the order in which they were fused.
#[derive(Debug, Clone)]
pub struct KeptReadings {
    max: usize,
    readings: VecDeque<KeptReading>,
    /// Older ones that were given up.
    given_up: u64,
    chunks: Chunks,
}

/// Under what they are saved, by so many.
const PREFIX: &str = "kept/";
const CHUNK: u64 = 1024;

/// What is saved besides the readings.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct KeptState {
    given_up: u64,
    next_place: u64,
}

impl KeptReadings {
    pub(crate) fn new(max: usize) -> Self {
        Self { max, readings: VecDeque::new(), given_up: 0, chunks: Chunks::new(CHUNK) }
    }

    /// The oldest first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &KeptReading> {
        self.readings.iter()
    }

    /// How many older ones there was no room for.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// The place of the reading that comes next; it stays the same when older ones are given up.
    pub(crate) fn next_place(&self) -> u64 {
        self.given_up + self.readings.len() as u64
    }

    /// Keeps a reading, if it says anything.
    pub(crate) fn record(&mut self, sounding: &Sounding<'_>, fused: Result<Weighed, Verdict>, fuser: &Fuser) {
        if let Some(kept) = KeptReading::of(sounding, fused, fuser) {
            self.push(kept);
        }
    }

    fn push(&mut self, reading: KeptReading) {
        if self.readings.len() >= self.max {
            self.readings.pop_front();
            self.given_up += 1;
        }
        self.readings.push_back(reading);
    }

    /// It was fused again; of one that was given up nothing is said.
    pub(crate) fn replace(&mut self, place: u64, reading: KeptReading) {
        let index = place.checked_sub(self.given_up).and_then(|index| usize::try_from(index).ok());
        if let Some(slot) = index.and_then(|index| self.readings.get_mut(index)) {
            *slot = reading;
            self.chunks.replace(place);
        }
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> KeptState {
        self.chunks.save(parts, PREFIX, self.given_up, &self.readings);
        KeptState { given_up: self.given_up, next_place: self.next_place() }
    }

    /// What was saved, of at most `max`.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(max: usize, saved: &Saved, state: KeptState) -> Result<Self, SavedError> {
        let KeptState { given_up, next_place } = state;
        let (chunks, readings) = Chunks::restore(CHUNK, saved, PREFIX, given_up, next_place)?;
        Ok(Self { max, readings, given_up, chunks })
    }
}
