//! Where the odometry said the robot was, and when scans were taken.

use std::collections::VecDeque;

use echogrid_core::parts::{Parts, Saved, SavedError};
use echogrid_core::{Chunks, Pose2};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Under what they are stored, by so many.
const POSES: (&str, u64) = ("odom/", 512);
const SCANS: (&str, u64) = ("scans/", 512);

/// A drive that was not told yet, in order of stamps.
#[derive(Debug, Default)]
pub(crate) struct History {
    first: Option<(u64, Pose2)>,
    /// Until then it was told.
    told_ns: Option<u64>,
    poses: Stretch<(u64, Pose2)>,
    scans_ns: Stretch<u64>,
}

/// What is stored besides lists.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct HistoryState {
    first: Option<(u64, Pose2)>,
    told_ns: Option<u64>,
    poses: [u64; 2],
    scans: [u64; 2],
}

impl History {
    pub(crate) fn is_empty(&self) -> bool {
        self.first.is_none()
    }

    /// Where it began, and when.
    pub(crate) fn first(&self) -> Option<(u64, Pose2)> {
        self.first
    }

    /// Adds the next pose; one that runs backwards in time is dropped.
    pub(crate) fn push(&mut self, stamp_ns: u64, pose: Pose2) {
        if self.latest_ns().is_none_or(|last_ns| stamp_ns >= last_ns) {
            self.first.get_or_insert((stamp_ns, pose));
            self.poses.list.push_back((stamp_ns, pose));
        }
    }

    pub(crate) fn latest_ns(&self) -> Option<u64> {
        self.poses.list.back().map(|(stamp_ns, _)| *stamp_ns)
    }

    /// The pose at a stamp, interpolated: the first of that stamp, none before the first or after the last.
    pub(crate) fn at(&self, stamp_ns: u64) -> Option<Pose2> {
        let poses = &self.poses.list;
        let after = poses.partition_point(|(at_ns, _)| *at_ns < stamp_ns);
        let (after_ns, later) = poses.get(after)?;
        if *after_ns == stamp_ns {
            return Some(*later);
        }
        let (before_ns, earlier) = poses.get(after.checked_sub(1)?)?;
        Some(earlier.interpolate(*later, (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64))
    }

    /// A scan was taken at a stamp whose pose is known.
    pub(crate) fn scanned(&mut self, stamp_ns: u64) {
        if self.scans_ns.list.back().is_none_or(|last_ns| stamp_ns > *last_ns) {
            self.scans_ns.list.push_back(stamp_ns);
        }
    }

    /// The poses at all stamps of odometry and scans that were not told, until `until_ns`: one for each stamp, in their order.
    pub(crate) fn with_scans(&self, until_ns: u64) -> Vec<(u64, Pose2)> {
        let counts = |stamp_ns: u64| self.told_ns.is_none_or(|told_ns| stamp_ns > told_ns) && stamp_ns <= until_ns;
        let scans = self.scans_ns.list.iter().filter(|stamp_ns| counts(**stamp_ns));
        let of_scans = scans.filter_map(|stamp_ns| Some((*stamp_ns, self.at(*stamp_ns)?)));
        let poses = self.poses.list.iter().copied().filter(|(stamp_ns, _)| counts(*stamp_ns));
        let mut all: Vec<(u64, Pose2)> = poses.chain(of_scans).collect();
        // Stable: of one stamp the odometry's first counts, as for the mapper.
        all.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        all.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        all
    }

    /// Until `until_ns` it was told: what no later stamp needs is forgotten.
    pub(crate) fn forget_until(&mut self, until_ns: u64) {
        self.told_ns = Some(until_ns);
        while self.poses.list.get(1).is_some_and(|(stamp_ns, _)| *stamp_ns <= until_ns) {
            self.poses.forget();
        }
        // The last says that none of an earlier stamp is new.
        while self.scans_ns.list.get(1).is_some_and(|stamp_ns| *stamp_ns <= until_ns) {
            self.scans_ns.forget();
        }
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> HistoryState {
        let (poses, scans) = (self.poses.save(parts, POSES), self.scans_ns.save(parts, SCANS));
        HistoryState { first: self.first, told_ns: self.told_ns, poses, scans }
    }

    /// What was saved.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(saved: &Saved, state: HistoryState) -> Result<Self, SavedError> {
        let HistoryState { first, told_ns, poses, scans } = state;
        let (poses, scans_ns) = (Stretch::restore(saved, POSES, poses)?, Stretch::restore(saved, SCANS, scans)?);
        Ok(Self { first, told_ns, poses, scans_ns })
    }
}

/// A list that grows at its end and loses its oldest entries, and what of it is stored.
#[derive(Debug)]
pub(crate) struct Stretch<T> {
    pub(crate) list: VecDeque<T>,
    forgotten: u64,
    chunks: Option<Chunks>,
}

impl<T> Default for Stretch<T> {
    fn default() -> Self {
        Self { list: VecDeque::new(), forgotten: 0, chunks: None }
    }
}

impl<T: Serialize + DeserializeOwned> Stretch<T> {
    fn forget(&mut self) {
        self.forgotten += u64::from(self.list.pop_front().is_some());
    }

    /// Forgets all.
    pub(crate) fn clear(&mut self) {
        self.forgotten += self.list.len() as u64;
        self.list.clear();
    }

    /// Saves what changed since the last time: where it begins and ends.
    pub(crate) fn save(&mut self, parts: &mut Parts, (prefix, size): (&str, u64)) -> [u64; 2] {
        let chunks = self.chunks.get_or_insert_with(|| Chunks::new(size));
        chunks.save(parts, prefix, self.forgotten, &self.list);
        [self.forgotten, self.forgotten + self.list.len() as u64]
    }

    /// What was saved.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(
        saved: &Saved,
        (prefix, size): (&str, u64),
        [begin, end]: [u64; 2],
    ) -> Result<Self, SavedError> {
        let (chunks, list) = Chunks::restore(size, saved, prefix, begin, end)?;
        Ok(Self { list, forgotten: begin, chunks: Some(chunks) })
    }
}
