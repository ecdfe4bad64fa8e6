//! What an absolute localization says of where the robot was.

use core::fmt::Display;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::pose::{POSITION_MAX_M, Pose2};

/// An absolute localization: where the robot was, as seen by something that does not drift.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fix {
    /// `map_from_base`; what is not known of it says nothing.
    pub pose: Pose2,
    /// Covariance of (x, y, θ); m², m rad, rad². Zero: exact.
    pub covariance: Matrix3<f64>,
    /// Whether x and y are known.
    pub position_known: bool,
    /// Whether θ is known.
    pub heading_known: bool,
}

/// A fix that can't be one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} = {value}: expected {expected}")]
pub struct FixError {
    /// The field that is wrong.
    pub field: &'static str,
    /// The value of the field.
    pub value: String,
    /// What would have been right.
    pub expected: &'static str,
}

impl Fix {
    /// A fix at `pose`, without doubt.
    #[must_use]
    pub fn certain(pose: Pose2) -> Self {
        Self { pose, covariance: Matrix3::zeros(), position_known: true, heading_known: true }
    }

    /// A fix at `pose`, known to within these standard deviations, metres along each axis and radians.
    #[must_use]
    pub fn about(pose: Pose2, position_sigma_m: f64, heading_sigma_rad: f64) -> Self {
        let (position, heading) = (position_sigma_m * position_sigma_m, heading_sigma_rad * heading_sigma_rad);
        let covariance = Matrix3::from_diagonal(&nalgebra::Vector3::new(position, position, heading));
        Self { covariance, ..Self::certain(pose) }
    }

    /// Whether it can be one: finite, and its covariance symmetric and not negative.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn validate(&self) -> Result<(), FixError> {
        let refuse = |field, value: &dyn Display, expected| Err(FixError { field, value: value.to_string(), expected });
        if !self.pose.is_finite() {
            return refuse("pose", &format_args!("{:?}", self.pose), "finite numbers");
        }
        // Farther off no message can say where the robot is.
        if let Some(value) = [self.pose.x, self.pose.y].iter().find(|value| value.abs() > POSITION_MAX_M) {
            return refuse("position", value, "metres, within ±3e7");
        }
        if !self.position_known && !self.heading_known {
            return refuse("known", &"nothing", "a position, a heading, or both");
        }
        let c = &self.covariance;
        if let Some(value) = c.iter().find(|value| !value.is_finite()) {
            return refuse("covariance", value, "finite numbers");
        }
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let scale = c.amax().max(f64::MIN_POSITIVE);
            if (c[(a, b)] - c[(b, a)]).abs() > 1e-9 * scale {
                return refuse("covariance", &c[(a, b)], "the same on both sides of its diagonal");
            }
            // |correlation| at most 1.
            if c[(a, b)] * c[(a, b)] > c[(a, a)] * c[(b, b)] * (1.0 + 1e-9) {
                return refuse("covariance", &c[(a, b)], "no more than its variances allow");
            }
        }
        if let Some(value) = c.diagonal().iter().find(|value| **value < 0.0) {
            return refuse("covariance", value, "variances of 0 or more");
        }
        let determinant = c.determinant();
        let size = c[(0, 0)] * c[(1, 1)] * c[(2, 2)];
        if determinant < -1e-9 * size {
            return refuse("covariance", &determinant, "a determinant of 0 or more");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_fixes_are_refused() {
        let field = |change: fn(&mut Fix)| {
            let mut fix = Fix::about(Pose2::new(1.0, 2.0, 3.0), 0.1, 0.05);
            change(&mut fix);
            fix.validate().err().map(|error| error.field)
        };
        assert_eq!(field(|_| {}), None);
        assert_eq!(field(|fix| fix.covariance = Matrix3::zeros()), None);
        assert_eq!(field(|fix| fix.pose.theta = f64::NAN), Some("pose"));
        assert_eq!(field(|fix| fix.pose.y = -4e7), Some("position"));
        assert_eq!(field(|fix| (fix.position_known, fix.heading_known) = (false, false)), Some("known"));
        assert_eq!(field(|fix| fix.covariance[(0, 0)] = -1.0), Some("covariance"));
        assert_eq!(field(|fix| fix.covariance[(0, 1)] = 0.001), Some("covariance"));
        assert_eq!(field(|fix| fix.covariance[(1, 2)] = f64::INFINITY), Some("covariance"));
        let correlated = field(|fix| {
            fix.covariance[(0, 2)] = 0.1;
            fix.covariance[(2, 0)] = 0.1;
        });
        assert_eq!(correlated, Some("covariance"));
    }
}
