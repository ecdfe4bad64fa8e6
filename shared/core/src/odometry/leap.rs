//! Leaps of the odometry: steps that no drive makes, told from driving by the steps and speeds of the drive itself.
//!
//! A base that is restarted counts from 0 again; a counter overflows; somebody sets another pose. Between two such poses the
//! robot did not drive what lies between them.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::odometry::increment::Increment;
use crate::pose::Pose2;

/// Steps that the drive is known by.
const STEPS: usize = 256;
/// With fewer of them only what no robot does is a leap.
const STEPS_MIN: usize = 10;
/// Shorter steps and smaller turns are none, however slow the robot was before, metres and radians.
const ALWAYS: (f64, f64) = (0.3, 1.5);
/// The same of a drive that counts from 0 again, which says enough by itself.
const ANEW: (f64, f64) = (0.1, 0.5);
/// So many times a long step is then no driving.
const FASTER_ANEW: f64 = 2.0;
/// So many times a long step of the drive is no driving: it speeds up, and messages are lost.
const FASTER: f64 = 8.0;
/// So many times what the drive's own speeds come to.
const FASTER_THAN_IT_SAYS: f64 = 3.0;
/// Whoever is known by his steps alone may go this fast all at once, m/s.
const WALK_MPS: f64 = 1.5;
/// Nobody goes faster before he is known, m/s.
const UNKNOWN_MPS: f64 = 10.0;
/// Steps shorter than this are standing, metres and radians.
const STANDING: f64 = 1e-3;
/// A base that is cut off stops by itself within this time, seconds.
const STOPS_WITHIN_S: f64 = 2.0;
/// Share of the steps that are not among the longest.
const QUANTILE: f64 = 0.95;

/// A pose of the drive, and how fast it says to be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DrivePose {
    /// The stamp of the pose, nanoseconds.
    pub stamp_ns: u64,
    /// The robot in the frame of its odometry.
    pub odom_from_base: Pose2,
    /// Speed, m/s; 0 where the drive does not say.
    pub v_mps: f64,
    /// Rate of turn, rad/s; 0 where the drive does not say.
    pub w_radps: f64,
}

/// A step that was not driven.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Leap {
    /// The length of the leap, metres.
    pub length_m: f64,
    /// The turn of the leap, radians, 0 or more.
    pub turn_rad: f64,
    /// What the robot did meanwhile if it went on as before; seen from it.
    pub expected: Increment,
    /// How far the robot may have driven meanwhile, metres.
    pub reach_m: f64,
    /// How far it may have turned meanwhile, radians.
    pub reach_rad: f64,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Step {
    seconds: f64,
    made: Increment,
    length_m: f64,
    turn_rad: f64,
    said_m: f64,
}

impl Step {
    fn between(before: DrivePose, now: DrivePose) -> Self {
        let made = Increment::between(before.odom_from_base, now.odom_from_base);
        let seconds = now.stamp_ns.saturating_sub(before.stamp_ns) as f64 * 1e-9;
        Self {
            seconds,
            made,
            length_m: made.length_m(),
            turn_rad: made.turn_rad.abs(),
            said_m: before.v_mps.abs().max(now.v_mps.abs()) * seconds,
        }
    }
}

/// Tells leaps from driving. What it says depends on the poses so far alone.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Leaps {
    last: Option<DrivePose>,
    /// The latest steps that were driven; not those of standing.
    steps: VecDeque<Step>,
    /// The latest step that was driven, or stood.
    before: Option<Step>,
}

impl Leaps {
    /// Takes the next pose: the leap that led to it, if the robot did not drive there. A pose that is not finite is none.
    pub fn next(&mut self, now: DrivePose) -> Option<Leap> {
        if !now.odom_from_base.is_finite() {
            return None;
        }
        let step = Step::between(self.last.replace(now)?, now);
        let leap = self.leap(step, now);
        if leap.is_none() {
            self.before = Some(step);
        }
        if leap.is_none() && (step.length_m > STANDING || step.turn_rad > STANDING) {
            if self.steps.len() == STEPS {
                self.steps.pop_front();
            }
            self.steps.push_back(step);
        }
        leap
    }

    fn leap(&self, step: Step, now: DrivePose) -> Option<Leap> {
        // Nearly every step ends here.
        if step.length_m <= ANEW.0 && step.turn_rad <= ANEW.1 {
            return None;
        }
        let long = |of: fn(&Step) -> f64| quantile(self.steps.iter().map(of), QUANTILE);
        let (long_m, long_rad) = (long(|step| step.length_m), long(|step| step.turn_rad));
        let usual_s = quantile(self.steps.iter().map(|step| step.seconds), 0.5);
        let gap = if usual_s > 0.0 { (step.seconds / usual_s).max(1.0) } else { 1.0 };
        let driven_m = if self.steps.len() < STEPS_MIN {
            UNKNOWN_MPS * step.seconds + 1.0
        } else if self.says_its_speed() {
            (0.5 * FASTER * long_m * gap).max(FASTER_THAN_IT_SAYS * step.said_m)
        } else {
            (FASTER * long_m * gap).max(WALK_MPS * step.seconds).max(FASTER_THAN_IT_SAYS * step.said_m)
        };
        let turned_rad = (FASTER * long_rad * gap).max(FASTER_THAN_IT_SAYS * now.w_radps.abs() * step.seconds);
        let is_known = self.steps.len() >= STEPS_MIN;
        let too_far = step.length_m > driven_m + ALWAYS.0;
        let too_round = is_known && step.turn_rad > turned_rad + ALWAYS.1;
        // A base that is restarted counts from 0, whichever way it is there.
        let Pose2 { x, y, theta } = now.odom_from_base;
        let at_zero = libm::hypot(x, y) <= long_m * gap + STANDING && theta.abs() <= long_rad * gap + STANDING;
        let beyond = |made: f64, long: f64, least: f64| made > FASTER_ANEW * long * gap + least;
        let anew =
            is_known && at_zero && (beyond(step.length_m, long_m, ANEW.0) || beyond(step.turn_rad, long_rad, ANEW.1));
        (too_far || too_round || anew).then(|| {
            let expected = self.expected(step.seconds);
            // Within a step it may have stopped, or changed its speed a little; for longer it may have done anything.
            let (reach_m, reach_rad) = match expected {
                Some(expected) => (expected.length_m() + 0.25 * long_m, expected.turn_rad.abs() + 0.25 * long_rad),
                None => {
                    let steps = if usual_s > 0.0 { (step.seconds.min(STOPS_WITHIN_S) / usual_s).max(1.0) } else { 1.0 };
                    (long_m * steps, (long_rad * steps).min(core::f64::consts::PI))
                }
            };
            let expected = expected.unwrap_or_default();
            Leap { length_m: step.length_m, turn_rad: step.turn_rad, expected, reach_m, reach_rad }
        })
    }

    /// What the robot does in so many seconds if it goes on as before; none where that is much longer than a step: a base that
    /// is cut off stops.
    fn expected(&self, seconds: f64) -> Option<Increment> {
        self.before.filter(|before| seconds <= 2.0 * before.seconds).map(|before| before.made)
    }

    /// Whether the speeds that the drive says are those that it drives.
    fn says_its_speed(&self) -> bool {
        let sum = |of: fn(&Step) -> f64| self.steps.iter().map(of).sum::<f64>();
        let (said_m, driven_m) = (sum(|step| step.said_m), sum(|step| step.length_m));
        driven_m > 0.1 && (0.5..=2.0).contains(&(said_m / driven_m))
    }
}

/// 0 of nothing.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    const TENTH: u64 = 100_000_000;

    fn pose(index: u64, x: f64, v_mps: f64) -> DrivePose {
        DrivePose { stamp_ns: index * TENTH, odom_from_base: Pose2::new(x, 0.0, 0.0), v_mps, w_radps: 0.0 }
    }

    /// A drive at 0.3 m/s.
    fn driven(says: bool, poses: u64) -> Leaps {
        let mut leaps = Leaps::default();
        for index in 0..poses {
            assert_eq!(leaps.next(pose(index, 0.03 * index as f64, if says { 0.3 } else { 0.0 })), None);
        }
        leaps
    }

    #[test]
    fn a_base_that_counts_anew_and_a_pose_far_away() {
        for says in [true, false] {
            let at = |x| driven(says, 50).next(pose(50, x, 0.0)).map(|leap| leap.length_m);
            assert_eq!(at(1.5), None, "on its way");
            assert_eq!(at(1.6), None, "less than a step of a walk");
            assert!((at(0.0).unwrap() - 1.47).abs() < 1e-9, "anew");
            assert!(at(5e5).unwrap() > 4.9e5);
        }
        // As far as the drive goes in the time that the leap took; not for ever.
        let reach = |tenths: u64| driven(true, 50).next(pose(49 + tenths, 500.0, 0.0)).unwrap().reach_m;
        assert!((reach(1) - 0.0375).abs() < 1e-9 && (reach(600) - 0.6).abs() < 1e-9);
    }

    #[test]
    fn a_base_that_counts_anew_near_its_origin() {
        let mut leaps = driven(false, 11);
        // 0.3 m from it: less than a leap anywhere else.
        let leap = leaps.next(pose(11, 0.0, 0.0)).unwrap();
        assert!((leap.length_m - 0.3).abs() < 1e-9 && (leap.expected.forward_m - 0.03).abs() < 1e-9, "{leap:?}");
        assert_eq!(driven(false, 11).next(pose(11, 0.05, 0.0)), None, "not quite there");
        // Home again by driving.
        let mut leaps = driven(true, 50);
        (0..50).for_each(|index| assert_eq!(leaps.next(pose(50 + index, 1.47 - 0.03 * index as f64, -0.3)), None));
    }

    #[test]
    fn driving_on_after_a_gap_is_no_leap() {
        for says in [true, false] {
            let mut leaps = driven(says, 50);
            assert_eq!(leaps.next(pose(50 + 100, 1.5 + 3.0, 0.3)), None, "10 s at the same speed");
        }
        // From slow to fast, a pose a second.
        let mut leaps = Leaps::default();
        for index in 0..50_u64 {
            leaps.next(pose(10 * index, 0.02 * index as f64, 0.0));
        }
        assert_eq!(leaps.next(pose(500, 1.0 + 1.4, 0.0)), None);
    }

    #[test]
    fn a_heading_that_starts_anew() {
        let mut leaps = driven(true, 50);
        let turned = DrivePose { odom_from_base: Pose2::new(1.5, 0.0, 2.6), ..pose(50, 1.5, 0.3) };
        assert!(leaps.next(turned).is_some_and(|leap| leap.length_m < 0.1 && leap.turn_rad > 2.5));
    }

    #[test]
    fn before_it_is_known_only_what_no_robot_does() {
        let mut leaps = Leaps::default();
        assert_eq!(leaps.next(pose(0, 0.0, 0.0)), None);
        assert_eq!(leaps.next(pose(1, 1.5, 0.0)), None);
        assert!(leaps.next(pose(2, 40.0, 0.0)).is_some());
        let nowhere = DrivePose { odom_from_base: Pose2 { x: f64::NAN, ..Pose2::IDENTITY }, ..pose(3, 0.0, 0.0) };
        assert_eq!(leaps.next(nowhere), None);
        assert_eq!(leaps.next(pose(4, 40.1, 0.0)), None);
    }
}
