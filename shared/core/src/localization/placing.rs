//! Where the map lies, seen from the odometry: said by the first fix that tells all of it, or by two that tell positions.

use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;
use crate::odometry::fix::Fix;
use crate::pose::Pose2;

/// Two positions tell a heading when they are this far apart, metres …
const APART_M: f64 = 0.5;
/// … and so many times as far as they are uncertain.
const APART_SIGMAS: f64 = 10.0;

/// A position that a fix told, without a heading.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct PositionFix {
    odom_from_base: Pose2,
    fix: Fix,
}

/// What has been told so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Placing {
    first: Option<PositionFix>,
}

impl Placing {
    /// Where the robot is, when a fix came at `odom_from_base`: none until that is settled.
    pub fn place(&mut self, odom_from_base: Pose2, fix: &Fix) -> Option<Fix> {
        if fix.heading_known || fix.validate().is_err() {
            return Some(*fix);
        }
        let Some(first) = self.first else {
            self.first = Some(PositionFix { odom_from_base, fix: *fix });
            return None;
        };
        let apart_m = first.odom_from_base.distance_m(odom_from_base);
        let variance = |fix: &Fix| fix.covariance[(0, 0)].max(fix.covariance[(1, 1)]);
        let sigma_m = (variance(&first.fix) + variance(fix)).sqrt();
        if apart_m < APART_M || apart_m < APART_SIGMAS * sigma_m {
            return None;
        }
        let bearing = |from: Pose2, to: Pose2| libm::atan2(to.y - from.y, to.x - from.x);
        let turned = bearing(first.fix.pose, fix.pose) - bearing(first.odom_from_base, odom_from_base);
        let mut whole = Fix { heading_known: true, ..*fix };
        whole.pose.theta = wrap_angle(odom_from_base.theta + turned);
        let heading = sigma_m / apart_m;
        for other in 0..2 {
            (whole.covariance[(2, other)], whole.covariance[(other, 2)]) = (0.0, 0.0);
        }
        whole.covariance[(2, 2)] = heading * heading;
        Some(whole)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn position(x: f64, y: f64, sigma_m: f64) -> Fix {
        Fix { heading_known: false, ..Fix::about(Pose2::new(x, y, 0.0), sigma_m, 1.0) }
    }

    #[test]
    fn a_whole_fix_says_it_at_once() {
        let fix = Fix::certain(Pose2::new(3.0, 4.0, 1.0));
        assert_eq!(Placing::default().place(Pose2::IDENTITY, &fix), Some(fix));
    }

    #[test]
    fn two_positions_far_enough_apart_tell_the_heading() {
        let mut placing = Placing::default();
        assert_eq!(placing.place(Pose2::IDENTITY, &position(10.0, 20.0, 0.05)), None);
        assert_eq!(placing.place(Pose2::new(0.6, 0.0, 0.0), &position(10.0, 20.6, 0.05)), None, "too near");
        let placed = placing.place(Pose2::new(2.0, 0.0, 0.3), &position(10.0, 22.0, 0.05)).unwrap();
        assert!((placed.pose.theta - (0.3 + core::f64::consts::FRAC_PI_2)).abs() < 1e-12, "{placed:?}");
        assert!(placed.heading_known && placed.validate().is_ok());
        assert!((placed.covariance[(2, 2)].sqrt() - 0.05 * 2.0_f64.sqrt() / 2.0).abs() < 1e-12);
    }
}
