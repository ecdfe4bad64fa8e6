//! What the sensor says of where the robot really is.

use std::collections::VecDeque;

use echogrid_core::Pose2;
use serde::{Deserialize, Serialize};

/// True poses that are remembered: more than odometry can be behind.
const REMEMBERED: usize = 8192;

/// What is known of a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Known {
    /// Where the robot was.
    Pose(Pose2),
    /// That will never be known.
    Never,
    /// The truth has not come that far.
    NotYet,
}

/// True poses in the order of their stamps.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Truth {
    poses: VecDeque<(u64, Option<Pose2>)>,
}

impl Truth {
    /// Adds the next one; one that runs backwards in time is dropped.
    pub(crate) fn push(&mut self, stamp_ns: u64, map_from_base: Option<Pose2>) {
        if self.poses.back().is_none_or(|(last_ns, _)| stamp_ns > *last_ns) {
            if self.poses.len() == REMEMBERED {
                self.poses.pop_front();
            }
            self.poses.push_back((stamp_ns, map_from_base));
        }
    }

    /// Where the robot was at `stamp_ns`, between two true poses interpolated.
    pub(crate) fn at(&self, stamp_ns: u64) -> Known {
        let after = self.poses.partition_point(|(pose_ns, _)| *pose_ns < stamp_ns);
        let Some((after_ns, later)) = self.poses.get(after) else { return Known::NotYet };
        if *after_ns == stamp_ns {
            return later.map_or(Known::Never, Known::Pose);
        }
        let before = after.checked_sub(1).and_then(|before| self.poses.get(before));
        match (before, later) {
            (Some((before_ns, Some(earlier))), Some(later)) => {
                let fraction = (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
                Known::Pose(earlier.interpolate(*later, fraction))
            }
            _ => Known::Never,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_between_before_and_after() {
        let mut truth = Truth::default();
        assert_eq!(truth.at(100), Known::NotYet);
        for (stamp_ns, x) in [(100, Some(0.0)), (200, Some(1.0)), (150, Some(9.0)), (300, None), (400, Some(3.0))] {
            truth.push(stamp_ns, x.map(|x| Pose2::new(x, 0.0, 0.0)));
        }
        let pose = |x| Known::Pose(Pose2::new(x, 0.0, 0.0));
        assert_eq!([50, 100, 150, 200].map(|at| truth.at(at)), [Known::Never, pose(0.0), pose(0.5), pose(1.0)]);
        assert_eq!([250, 300, 350, 400].map(|at| truth.at(at)), [Known::Never, Known::Never, Known::Never, pose(3.0)]);
        assert_eq!(truth.at(401), Known::NotYet);
    }
}
