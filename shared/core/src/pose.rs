//! Poses in the plane.

use core::ops::Mul;

use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;

/// A pose in the plane, or the transform between two frames: `map_from_base` takes what is
/// seen from the base into the map. Names make frames cancel: `map_from_odom * odom_from_base`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose2 {
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Radians, counter-clockwise, in (-π, π].
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

    fn mul(self, inner: Self) -> Self {
        let [x, y] = self.transform([inner.x, inner.y]);
        Self::new(x, y, self.theta + inner.theta)
    }
}
