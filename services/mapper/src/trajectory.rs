//! Where the robot was when: the estimates that scans still need.

use std::collections::VecDeque;

use echogrid_core::Estimate;
use echogrid_topics::PoseEstimate;

/// Estimates in the order of their stamps.
#[derive(Debug, Default)]
pub(crate) struct Trajectory {
    estimates: VecDeque<(u64, PoseEstimate)>,
}

impl Trajectory {
    /// Adds the next estimate. One that runs backwards in time is dropped: it could change what was
    /// interpolated already.
    pub(crate) fn push(&mut self, stamp_ns: u64, estimate: PoseEstimate) {
        if self.estimates.back().is_none_or(|(last_ns, _)| stamp_ns >= *last_ns) {
            self.estimates.push_back((stamp_ns, estimate));
        }
    }

    /// Whether the pose at `stamp_ns` can be told, or never will be better.
    pub(crate) fn reaches(&self, stamp_ns: u64) -> bool {
        self.estimates.back().is_some_and(|(last_ns, _)| *last_ns >= stamp_ns)
    }

    /// The estimate at `stamp_ns`, interpolated; none before the first or after the last.
    pub(crate) fn at(&self, stamp_ns: u64) -> Option<Estimate> {
        let after = self.estimates.partition_point(|(estimate_ns, _)| *estimate_ns < stamp_ns);
        let (after_ns, later) = self.estimates.get(after)?;
        if *after_ns == stamp_ns {
            return Some(later.estimate);
        }
        let (before_ns, earlier) = self.estimates.get(after.checked_sub(1)?)?;
        let fraction = (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
        Some(earlier.estimate.interpolate(&later.estimate, fraction))
    }

    /// Lets go of what no scan from `stamp_ns` on can need.
    pub(crate) fn forget_before(&mut self, stamp_ns: u64) {
        while self.estimates.len() >= 2 && self.estimates[1].0 < stamp_ns {
            self.estimates.pop_front();
        }
    }

    /// Trust of the latest estimate; 1 before the first.
    pub(crate) fn trust(&self) -> f64 {
        self.estimates.back().map_or(1.0, |(_, estimate)| estimate.trust)
    }

    /// Distance travelled so far, metres.
    pub(crate) fn distance_m(&self) -> f64 {
        self.estimates.back().map_or(0.0, |(_, estimate)| estimate.distance_m)
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::Pose2;

    use super::*;

    fn at_x(x: f64) -> PoseEstimate {
        PoseEstimate { estimate: Estimate::certain(Pose2::new(x, 0.0, 0.0)), trust: 1.0, distance_m: x }
    }

    fn trajectory(points: &[(u64, f64)]) -> Trajectory {
        let mut trajectory = Trajectory::default();
        for (stamp_ns, x) in points {
            trajectory.push(*stamp_ns, at_x(*x));
        }
        trajectory
    }

    #[test]
    fn poses_are_interpolated_between_estimates_and_nowhere_else() {
        let trajectory = trajectory(&[(100, 0.0), (200, 1.0), (400, 2.0)]);
        let x = |stamp_ns| trajectory.at(stamp_ns).map(|estimate| estimate.pose.x);
        assert_eq!(x(100), Some(0.0));
        assert_eq!(x(150), Some(0.5));
        assert_eq!(x(350), Some(1.75));
        assert_eq!(x(400), Some(2.0));
        assert_eq!(x(99), None);
        assert_eq!(x(401), None);
        assert!(trajectory.reaches(400) && !trajectory.reaches(401));
    }

    #[test]
    fn of_equal_stamps_the_first_counts_whatever_comes_after() {
        let mut trajectory = trajectory(&[(100, 0.0), (200, 1.0)]);
        let early = trajectory.at(200);
        trajectory.push(200, at_x(5.0));
        assert_eq!(trajectory.at(200), early);
    }

    #[test]
    fn estimates_that_run_backwards_are_dropped() {
        assert_eq!(trajectory(&[(100, 0.0), (200, 1.0), (150, 9.0)]).at(150).map(|e| e.pose.x), Some(0.5));
    }

    #[test]
    fn what_later_scans_need_is_kept() {
        let mut trajectory = trajectory(&[(100, 0.0), (200, 1.0), (300, 2.0)]);
        trajectory.forget_before(250);
        assert_eq!(trajectory.at(150), None);
        assert_eq!(trajectory.at(250).map(|e| e.pose.x), Some(1.5));
    }
}
