//! A step of the drive.

use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;
use crate::pose::Pose2;

/// A step of the robot, as seen from the robot: metres along and across the heading half-way through the turn.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Increment {
    /// Along the middle heading, metres; negative when driving backwards (Δl of the paper).
    pub forward_m: f64,
    /// Across it, metres, positive to the left. About zero for a drive that cannot slide sideways; kept so that
    /// the steps of a log add up to the log's own poses.
    pub lateral_m: f64,
    /// Δθ, radians in (-π, π], counter-clockwise.
    pub turn_rad: f64,
}

impl Increment {
    /// The step that leads from one odometry pose to the next.
    #[must_use]
    pub fn between(odom_from_before: Pose2, odom_from_now: Pose2) -> Self {
        let turn_rad = wrap_angle(odom_from_now.theta - odom_from_before.theta);
        let (s, c) = libm::sincos(odom_from_before.theta + 0.5 * turn_rad);
        let (dx, dy) = (odom_from_now.x - odom_from_before.x, odom_from_now.y - odom_from_before.y);
        Self { forward_m: dx * c + dy * s, lateral_m: dy * c - dx * s, turn_rad }
    }

    /// Straight length of the step, metres, never negative (|Δl|).
    #[must_use]
    pub fn length_m(self) -> f64 {
        libm::hypot(self.forward_m, self.lateral_m)
    }

    /// The step without the systematic error: Δl (1 − a_l), Δθ (1 − a_θ) (the paper's Fig. 16).
    #[must_use]
    pub fn corrected(self, lin_scale: f64, ang_scale: f64) -> Self {
        Self {
            forward_m: self.forward_m * (1.0 - lin_scale),
            lateral_m: self.lateral_m * (1.0 - lin_scale),
            turn_rad: self.turn_rad * (1.0 - ang_scale),
        }
    }
}

/// Where a robot at `pose` is after `increment`: the mid-point rule, h = θ + Δθ/2.
#[must_use]
pub fn move_by(pose: Pose2, increment: Increment) -> Pose2 {
    let (s, c) = libm::sincos(pose.theta + 0.5 * increment.turn_rad);
    Pose2::new(
        pose.x + increment.forward_m * c - increment.lateral_m * s,
        pose.y + increment.forward_m * s + increment.lateral_m * c,
        pose.theta + increment.turn_rad,
    )
}
