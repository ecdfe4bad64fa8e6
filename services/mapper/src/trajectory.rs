//! Where the robot was when: the estimates that scans still need.

use std::collections::VecDeque;

use echogrid_core::{Chunks, Estimate, Parts, Saved, SavedError, placed};
use echogrid_topics::PoseEstimate;
use serde::{Deserialize, Serialize};

/// A fix, as the mapper sees it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Rectified {
    pub(crate) stamp_ns: u64,
    pub(crate) before: Estimate,
    pub(crate) after: Estimate,
}

/// Estimates in the order of their stamps.
#[derive(Debug)]
pub(crate) struct Trajectory {
    estimates: VecDeque<(u64, PoseEstimate)>,
    /// Those that no scan has come after yet.
    fixes: VecDeque<Rectified>,
    /// Estimates that were let go of.
    forgotten: u64,
    chunks: Chunks,
}

/// Under what the estimates are saved, by so many.
const PREFIX: &str = "trajectory/";
const CHUNK: u64 = 256;

/// Most estimates that are kept for scans that may yet come: twenty minutes at 100 Hz.
const WAITING_MAX: usize = 1 << 17;

/// What is saved besides the estimates.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct TrajectoryState {
    forgotten: u64,
    estimates: u64,
    fixes: VecDeque<Rectified>,
}

impl Default for Trajectory {
    fn default() -> Self {
        Self { estimates: VecDeque::new(), fixes: VecDeque::new(), forgotten: 0, chunks: Chunks::new(CHUNK) }
    }
}

impl Trajectory {
    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> TrajectoryState {
        self.chunks.save(parts, PREFIX, self.forgotten, &self.estimates);
        let end = self.forgotten + self.estimates.len() as u64;
        TrajectoryState { forgotten: self.forgotten, estimates: end, fixes: self.fixes.clone() }
    }

    /// What was saved.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(saved: &Saved, state: TrajectoryState) -> Result<Self, SavedError> {
        let TrajectoryState { forgotten, estimates, fixes } = state;
        let (chunks, estimates) = Chunks::restore(CHUNK, saved, PREFIX, forgotten, estimates)?;
        Ok(Self { estimates, fixes, forgotten, chunks })
    }

    /// Adds the next estimate. One that runs backwards in time is dropped: it could change what was
    /// interpolated already.
    pub(crate) fn push(&mut self, stamp_ns: u64, estimate: PoseEstimate) {
        let last = self.estimates.back();
        if last.is_some_and(|(last_ns, _)| stamp_ns < *last_ns) {
            return;
        }
        if last.is_some_and(|(_, last)| last.unplaced && !estimate.unplaced) {
            self.place(&estimate);
        } else if let Some((_, last)) = last.filter(|(_, last)| last.estimate.fixes != estimate.estimate.fixes) {
            self.fixes.push_back(Rectified { stamp_ns, before: last.estimate, after: estimate.estimate });
        }
        self.estimates.push_back((stamp_ns, estimate));
        if self.estimates.len() > WAITING_MAX {
            self.estimates.pop_front();
            self.forgotten += 1;
        }
    }

    /// Lays the way so far where the map lies, now that `first` is the first estimate that knows it.
    fn place(&mut self, first: &PoseEstimate) {
        let Some((_, before)) = self.estimates.back() else { return };
        let before = before.estimate;
        let is_unplaced = |estimate: &PoseEstimate| estimate.unplaced;
        let way: Vec<Estimate> =
            self.estimates.iter().filter(|(_, at)| is_unplaced(at)).map(|(_, at)| at.estimate).collect();
        let placed = placed(&way, &before, &first.estimate);
        let slots = (self.forgotten..).zip(&mut self.estimates).filter(|(_, (_, at))| is_unplaced(at));
        for ((place, (_, at)), estimate) in slots.zip(placed) {
            (at.estimate, at.unplaced) = (estimate, false);
            self.chunks.replace(place);
        }
    }

    /// Whether nothing has said yet where the map lies.
    pub(crate) fn is_unplaced(&self) -> bool {
        self.latest().is_some_and(|latest| latest.unplaced)
    }

    /// The oldest fix before `stamp_ns`; it is given once.
    pub(crate) fn fix_before(&mut self, stamp_ns: u64) -> Option<Rectified> {
        self.fixes.front().is_some_and(|fix| fix.stamp_ns < stamp_ns).then(|| self.fixes.pop_front()).flatten()
    }

    /// Whether the pose at `stamp_ns` can be told, or never will be better.
    pub(crate) fn reaches(&self, stamp_ns: u64) -> bool {
        self.estimates.back().is_some_and(|(last_ns, _)| *last_ns >= stamp_ns)
    }

    /// The estimate at `stamp_ns`, interpolated, and whether mapping holds there; none before the first or after the last.
    /// Where a fix rectified the estimate there are two of one stamp: the first belongs to what was before, the second to
    /// what comes after, and nothing lies between them.
    pub(crate) fn at(&self, stamp_ns: u64) -> Option<(Estimate, bool)> {
        let after = self.estimates.partition_point(|(estimate_ns, _)| *estimate_ns < stamp_ns);
        let (after_ns, later) = self.estimates.get(after)?;
        if *after_ns == stamp_ns {
            return Some((later.estimate, later.hold || later.unplaced));
        }
        let (before_ns, earlier) = self.estimates.get(after.checked_sub(1)?)?;
        let fraction = (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
        Some((earlier.estimate.interpolate(&later.estimate, fraction), earlier.hold || earlier.unplaced))
    }

    /// Lets go of what no scan from `stamp_ns` on can need.
    pub(crate) fn forget_before(&mut self, stamp_ns: u64) {
        while self.estimates.len() >= 2 && self.estimates[1].0 < stamp_ns {
            self.estimates.pop_front();
            self.forgotten += 1;
        }
    }

    /// The stamp of the latest estimate, nanoseconds; 0: there is none.
    pub(crate) fn latest_ns(&self) -> u64 {
        self.estimates.back().map_or(0, |(stamp_ns, _)| *stamp_ns)
    }

    /// The latest estimate.
    pub(crate) fn latest(&self) -> Option<&PoseEstimate> {
        self.estimates.back().map(|(_, estimate)| estimate)
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::Pose2;

    use super::*;

    fn at_x(x: f64) -> PoseEstimate {
        let estimate = Estimate::certain(Pose2::new(x, 0.0, 0.0));
        PoseEstimate::plain(estimate, 1.0, x)
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
        let x = |stamp_ns| trajectory.at(stamp_ns).map(|(estimate, _)| estimate.pose.x);
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
    fn a_fix_is_a_step_and_no_slope() {
        let mut trajectory = trajectory(&[(100, 0.0), (200, 1.0), (200, 11.0), (300, 12.0)]);
        let x = |stamp_ns| trajectory.at(stamp_ns).map(|(estimate, _)| estimate.pose.x);
        assert_eq!([x(150), x(200), x(201), x(250)], [Some(0.5), Some(1.0), Some(11.01), Some(11.5)]);
        trajectory.forget_before(250);
        assert_eq!(trajectory.at(201).map(|(estimate, _)| estimate.pose.x), Some(11.01));
    }

    #[test]
    fn a_fix_is_given_once_to_the_first_scan_after_it() {
        let mut trajectory = trajectory(&[(100, 0.0), (200, 1.0)]);
        let fixed = Estimate { fixes: 1, ..Estimate::certain(Pose2::new(5.0, 0.0, 0.0)) };
        trajectory.push(200, PoseEstimate { estimate: fixed, ..at_x(5.0) });
        trajectory.push(300, PoseEstimate { estimate: fixed, ..at_x(6.0) });
        assert_eq!(trajectory.fix_before(200), None);
        let fix = trajectory.fix_before(201).unwrap();
        assert_eq!((fix.stamp_ns, fix.before.pose.x, fix.after.pose.x), (200, 1.0, 5.0));
        assert_eq!(trajectory.fix_before(u64::MAX), None);
    }

    #[test]
    fn the_way_before_the_first_fix_ends_at_it() {
        let mut trajectory = Trajectory::default();
        for (stamp_ns, x) in [(100, 0.0), (200, 1.0), (300, 2.0)] {
            trajectory.push(stamp_ns, PoseEstimate { unplaced: true, ..at_x(x) });
        }
        assert!(trajectory.is_unplaced() && trajectory.at(150).is_some_and(|(_, hold)| hold));
        let fixed = Estimate { fixes: 1, ..Estimate::certain(Pose2::new(5.0, 7.0, core::f64::consts::FRAC_PI_2)) };
        trajectory.push(300, PoseEstimate { estimate: fixed, ..at_x(2.0) });
        assert!(!trajectory.is_unplaced() && trajectory.fix_before(u64::MAX).is_none());
        let (at, hold) = trajectory.at(150).unwrap();
        assert!(!hold && at.pose.distance_m(Pose2::new(5.0, 5.5, 0.0)) < 1e-12, "{at:?}");
    }

    #[test]
    fn mapping_holds_until_the_fix() {
        let mut trajectory = trajectory(&[(100, 0.0)]);
        trajectory.push(200, PoseEstimate { hold: true, ..at_x(1.0) });
        trajectory.push(300, PoseEstimate { hold: true, ..at_x(2.0) });
        trajectory.push(300, at_x(5.0));
        trajectory.push(400, at_x(6.0));
        let holds = |stamp_ns| trajectory.at(stamp_ns).map(|(_, hold)| hold);
        assert_eq!(
            [150, 200, 250, 300, 301, 400].map(holds).map(Option::unwrap),
            [false, true, true, true, false, false]
        );
    }

    #[test]
    fn estimates_that_run_backwards_are_dropped() {
        assert_eq!(trajectory(&[(100, 0.0), (200, 1.0), (150, 9.0)]).at(150).map(|(e, _)| e.pose.x), Some(0.5));
    }

    #[test]
    fn what_later_scans_need_is_kept() {
        let mut trajectory = trajectory(&[(100, 0.0), (200, 1.0), (300, 2.0)]);
        trajectory.forget_before(250);
        assert_eq!(trajectory.at(150), None);
        assert_eq!(trajectory.at(250).map(|(e, _)| e.pose.x), Some(1.5));
    }
}
