//! Poses in the plane.

use core::ops::Mul;

use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;

/// The farthest that a position can be from the origin, metres: that of UTM and web Mercator coordinates, and more.
pub const POSITION_MAX_M: f64 = 3e7;

/// A pose in the plane, or the transform between two frames: `map_from_base` takes what is
/// seen from the base into the map. Names make frames cancel: `map_from_odom * odom_from_base`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose2 {
    /// The position along x, metres.
    pub x: f64,
    /// The position along y, metres.
    pub y: f64,
    /// The heading, radians, counter-clockwise, in (-π, π].
    pub theta: f64,
}

impl Pose2 {
    /// The pose that changes nothing.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, theta: 0.0 };

    /// A pose; `theta` is wrapped.
    #[must_use]
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta: wrap_angle(theta) }
    }

    /// The transform the other way: `a_from_b.inverse()` is `b_from_a`.
    #[must_use]
    pub fn inverse(self) -> Self {
        let (s, c) = libm::sincos(self.theta);
        Self::new(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)
    }

    /// A point `(x, y)` of the inner frame, in the outer one.
    #[must_use]
    pub fn transform(self, point: [f64; 2]) -> [f64; 2] {
        let (s, c) = libm::sincos(self.theta);
        [self.x + c * point[0] - s * point[1], self.y + s * point[0] + c * point[1]]
    }

    /// Between `self` (`fraction` 0) and `other` (`fraction` 1): position on the straight line,
    /// heading along the shorter way.
    #[must_use]
    pub fn interpolate(self, other: Self, fraction: f64) -> Self {
        Self::new(
            self.x + fraction * (other.x - self.x),
            self.y + fraction * (other.y - self.y),
            self.theta + fraction * wrap_angle(other.theta - self.theta),
        )
    }

    /// Whether all three numbers are finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }

    /// Straight distance between two positions, metres.
    #[must_use]
    pub fn distance_m(self, other: Self) -> f64 {
        libm::hypot(other.x - self.x, other.y - self.y)
    }
}

impl Mul for Pose2 {
    type Output = Self;

    #[expect(clippy::suspicious_arithmetic_impl, reason = "turns one after the other add up")]
    fn mul(self, inner: Self) -> Self {
        let [x, y] = self.transform([inner.x, inner.y]);
        Self::new(x, y, self.theta + inner.theta)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_pose() -> impl Strategy<Value = Pose2> {
        (-1e3..1e3f64, -1e3..1e3f64, -7.0..7.0f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
    }

    fn close(a: Pose2, b: Pose2) -> bool {
        a.distance_m(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-12
    }

    #[test]
    fn a_quarter_turn() {
        let pose = Pose2::new(1.0, 2.0, core::f64::consts::FRAC_PI_2);
        let [x, y] = pose.transform([3.0, 0.0]);
        assert!((x - 1.0).abs() < 1e-15 && (y - 5.0).abs() < 1e-15);
    }

    #[test]
    fn the_shorter_way_round() {
        let middle = Pose2::new(0.0, 0.0, 3.0).interpolate(Pose2::new(2.0, 0.0, -3.0), 0.5);
        assert!((middle.theta.abs() - core::f64::consts::PI).abs() < 1e-12);
        assert!((middle.x - 1.0).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn inverse_cancels(pose in any_pose()) {
            prop_assert!(close(pose * pose.inverse(), Pose2::IDENTITY));
            prop_assert!(close(pose.inverse() * pose, Pose2::IDENTITY));
        }

        #[test]
        fn frames_cancel(a in any_pose(), b in any_pose(), x in -10.0..10.0f64, y in -10.0..10.0f64) {
            let [ox, oy] = (a * b).transform([x, y]);
            let [ex, ey] = a.transform(b.transform([x, y]));
            prop_assert!((ox - ex).abs() < 1e-9 && (oy - ey).abs() < 1e-9);
        }

        #[test]
        fn interpolation_ends(a in any_pose(), b in any_pose()) {
            prop_assert_eq!(a.interpolate(b, 0.0), a);
            prop_assert!(close(a.interpolate(b, 1.0), b));
        }
    }
}
