//! Where the odometry said the robot was, and when scans were taken.

use echogrid_core::Pose2;
use serde::{Deserialize, Serialize};

/// All of a drive, in order of stamps.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct History {
    poses: Vec<(u64, Pose2)>,
    scans_ns: Vec<u64>,
}

impl History {
    pub(crate) fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Where it began, and when.
    pub(crate) fn first(&self) -> Option<(u64, Pose2)> {
        self.poses.first().copied()
    }

    /// Adds the next pose; one that runs backwards in time is dropped.
    pub(crate) fn push(&mut self, stamp_ns: u64, pose: Pose2) {
        if self.poses.last().is_none_or(|(last_ns, _)| stamp_ns >= *last_ns) {
            self.poses.push((stamp_ns, pose));
        }
    }

    pub(crate) fn latest_ns(&self) -> Option<u64> {
        self.poses.last().map(|(stamp_ns, _)| *stamp_ns)
    }

    /// The pose at a stamp, interpolated: the first of that stamp, none before the first or after the last.
    pub(crate) fn at(&self, stamp_ns: u64) -> Option<Pose2> {
        let after = self.poses.partition_point(|(at_ns, _)| *at_ns < stamp_ns);
        let (after_ns, later) = self.poses.get(after)?;
        if *after_ns == stamp_ns {
            return Some(*later);
        }
        let (before_ns, earlier) = self.poses.get(after.checked_sub(1)?)?;
        Some(earlier.interpolate(*later, (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64))
    }

    /// A scan was taken at a stamp whose pose is known.
    pub(crate) fn scanned(&mut self, stamp_ns: u64) {
        if self.scans_ns.last().is_none_or(|last_ns| stamp_ns > *last_ns) {
            self.scans_ns.push(stamp_ns);
        }
    }

    /// The poses at all stamps of odometry and scans, one for each stamp, in their order.
    pub(crate) fn with_scans(&self) -> Vec<(u64, Pose2)> {
        let of_scans = self.scans_ns.iter().filter_map(|stamp_ns| Some((*stamp_ns, self.at(*stamp_ns)?)));
        let mut all: Vec<(u64, Pose2)> = self.poses.iter().copied().chain(of_scans).collect();
        // Stable: of one stamp the odometry's first counts, as for the mapper.
        all.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        all.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        all
    }
}
