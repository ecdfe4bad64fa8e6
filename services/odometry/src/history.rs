//! What the odometry was, a while back: a fix that comes late is applied when it was true, and the way since is gone again.

use std::collections::VecDeque;

use echogrid_core::fix::{Fix, FixError};
use echogrid_core::odometry::Contradiction;
use echogrid_core::{Estimate, Gate, Leap, Odometry, Pose2};
use serde::{Deserialize, Serialize};

/// Poses that are remembered: 20 s at 100 Hz.
const REMEMBERED: usize = 2048;

#[derive(Debug, Serialize, Deserialize)]
struct Moment {
    stamp_ns: u64,
    odom_from_base: Pose2,
    /// How it came here, if not by driving.
    leap: Option<Leap>,
    /// The odometry after this pose.
    after: Odometry,
}

impl Moment {
    /// Takes `odometry` here from the pose before.
    fn reach(&self, odometry: &mut Odometry) -> Estimate {
        match &self.leap {
            Some(leap) => odometry.leapt(self.odom_from_base, leap),
            None => odometry.step(self.odom_from_base),
        }
    }
}

/// What a fix has made of the odometry.
#[derive(Debug)]
pub(crate) struct Applied {
    pub(crate) odometry: Odometry,
    /// At the latest pose.
    pub(crate) estimate: Estimate,
    pub(crate) refused: Option<FixError>,
    /// How far the fix is off beyond what the odometry can be.
    pub(crate) contradiction: Option<Contradiction>,
}

/// The latest poses, and the odometry after each.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct History {
    moments: VecDeque<Moment>,
}

impl History {
    pub(crate) fn push(&mut self, stamp_ns: u64, odom_from_base: Pose2, leap: Option<Leap>, after: &Odometry) {
        if self.moments.len() == REMEMBERED {
            self.moments.pop_front();
        }
        self.moments.push_back(Moment { stamp_ns, odom_from_base, leap, after: after.clone() });
    }

    /// Stamp of the latest pose, nanoseconds.
    pub(crate) fn latest_ns(&self) -> Option<u64> {
        self.moments.back().map(|moment| moment.stamp_ns)
    }

    /// Applies a fix that was true at `fix_ns`, not after the latest pose, and goes the way since once more. The odometry
    /// as it is then, its estimate at the latest pose, and why the fix was refused if `gate` did so.
    ///
    /// # Errors
    /// The fix can't be one, or what it corrects is forgotten: nothing has changed.
    pub(crate) fn apply(&mut self, fix_ns: u64, fix: &Fix, gate: Gate) -> Result<Applied, FixError> {
        fix.validate()?;
        let later = self.moments.partition_point(|moment| moment.stamp_ns <= fix_ns);
        let too_old = || FixError {
            field: "stamp_ns",
            value: fix_ns.to_string(),
            expected: "a time within the last 2048 odometry poses",
        };
        let at = later.checked_sub(1).and_then(|index| self.moments.get(index)).ok_or_else(too_old)?;
        let mut odometry = at.after.clone();
        let next = self.moments.get(later).filter(|next| at.stamp_ns < fix_ns && next.leap.is_none());
        if let Some(next) = next {
            odometry.step(between(at, next, fix_ns));
        }
        let contradiction = odometry.contradiction(fix, gate);
        let (mut estimate, refused) = match odometry.apply(fix, gate) {
            Ok(estimate) => (estimate, None),
            // That it was refused is remembered, too.
            Err(error) => (odometry.estimate().ok_or_else(too_old)?, Some(error)),
        };
        let first = if at.stamp_ns == fix_ns { later - 1 } else { later };
        for (index, moment) in self.moments.iter_mut().enumerate().skip(first) {
            if index >= later {
                estimate = moment.reach(&mut odometry);
            }
            moment.after = odometry.clone();
        }
        Ok(Applied { odometry, estimate, refused, contradiction })
    }

    /// The robot in the frame of its odometry at `stamp_ns`; none before what is remembered, or after it.
    pub(crate) fn odom_from_base(&self, stamp_ns: u64) -> Option<Pose2> {
        let later = self.moments.partition_point(|moment| moment.stamp_ns <= stamp_ns);
        let at = self.moments.get(later.checked_sub(1)?)?;
        match self.moments.get(later) {
            _ if at.stamp_ns == stamp_ns => Some(at.odom_from_base),
            Some(next) => Some(between(at, next, stamp_ns)),
            None => None,
        }
    }
}

/// The robot in the frame of its odometry at `stamp_ns`, which is from `at` on and before `next`.
fn between(at: &Moment, next: &Moment, stamp_ns: u64) -> Pose2 {
    let fraction = (stamp_ns - at.stamp_ns) as f64 / (next.stamp_ns - at.stamp_ns) as f64;
    at.odom_from_base.interpolate(next.odom_from_base, fraction)
}

#[cfg(test)]
mod tests {
    use echogrid_core::OdometryConfig;

    use super::*;

    const OPEN: Gate = Gate { sigmas: 5.0, refuses: false, places: false };

    /// 1 m every 100 ns along x, believed to be at y = 0.
    fn history(poses: u64) -> (History, Odometry) {
        let mut odometry = Odometry::new(&OdometryConfig::default());
        let mut history = History::default();
        for index in 0..poses {
            let pose = Pose2::new(index as f64, 0.0, 0.0);
            odometry.step(pose);
            history.push(100 * index, pose, None, &odometry);
        }
        (history, odometry)
    }

    #[test]
    fn a_fix_at_the_latest_pose_is_the_estimate() {
        let (mut history, _) = history(4);
        let fix = Fix::certain(Pose2::new(3.0, 1.0, 0.0));
        let Applied { mut odometry, estimate, .. } = history.apply(300, &fix, OPEN).unwrap();
        assert_eq!(estimate, Estimate { fixes: 1, ..Estimate::certain(fix.pose) });
        assert_eq!(odometry.step(Pose2::new(4.0, 0.0, 0.0)).pose, Pose2::new(4.0, 1.0, 0.0));
    }

    #[test]
    fn a_late_fix_is_as_good_as_one_in_time() {
        let (mut late, _) = history(10);
        let Applied { estimate, .. } = late.apply(300, &Fix::certain(Pose2::new(3.0, 1.0, 0.0)), OPEN).unwrap();
        assert_eq!((estimate.pose, estimate.travel_m), (Pose2::new(9.0, 1.0, 0.0), 6.0));
        // Between two poses: the rest of the step counts.
        let (mut between, _) = history(10);
        let Applied { estimate, .. } = between.apply(350, &Fix::certain(Pose2::new(3.5, 1.0, 0.0)), OPEN).unwrap();
        assert_eq!((estimate.pose, estimate.travel_m), (Pose2::new(9.0, 1.0, 0.0), 5.5));
        // A second one, before the first: what was remembered is as if both had come in order.
        let Applied { estimate, .. } = between.apply(600, &Fix::certain(Pose2::new(6.0, 2.0, 0.0)), OPEN).unwrap();
        assert_eq!((estimate.pose, estimate.fixes), (Pose2::new(9.0, 2.0, 0.0), 2));
    }

    #[test]
    fn what_was_refused_is_remembered() {
        let (mut history, _) = history(10);
        history.apply(100, &Fix::certain(Pose2::new(1.0, 0.0, 0.0)), OPEN).unwrap();
        for stamp_ns in [300, 450] {
            let far = Fix::about(Pose2::new(stamp_ns as f64 / 100.0, 9.0, 0.0), 0.01, 0.01);
            let Applied { estimate, refused, .. } = history.apply(stamp_ns, &far, Gate::closed(5.0)).unwrap();
            assert!(refused.is_some() && estimate.pose.distance_m(Pose2::new(9.0, 0.0, 0.0)) < 1e-9);
        }
        let third = Fix::about(Pose2::new(6.0, 9.0, 0.0), 0.01, 0.01);
        let Applied { estimate, refused, .. } = history.apply(600, &third, Gate::closed(5.0)).unwrap();
        assert!(refused.is_none() && estimate.pose.distance_m(Pose2::new(9.0, 9.0, 0.0)) < 1e-9);
        assert_eq!((estimate.fixes, estimate.refused), (2, 2));
    }

    #[test]
    fn what_is_forgotten_can_not_be_corrected() {
        let (mut history, _) = history(REMEMBERED as u64 + 10);
        assert_eq!(history.apply(900, &Fix::certain(Pose2::IDENTITY), OPEN).unwrap_err().field, "stamp_ns");
        assert!(history.apply(1000, &Fix::certain(Pose2::IDENTITY), OPEN).is_ok());
        assert!(History::default().apply(0, &Fix::certain(Pose2::IDENTITY), OPEN).is_err());
    }
}
