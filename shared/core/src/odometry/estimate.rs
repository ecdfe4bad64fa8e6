//! Where a robot is believed to be, and how far to believe it.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::error_model::OdometryErrors;
use super::joint::{JointCovariance, Scales};
use crate::pose::Pose2;

/// Where the robot is believed to be, and how far to believe it.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Estimate {
    /// The pose `map_from_base`.
    pub pose: Pose2,
    /// Covariance of (x, y, θ) in the map frame and of `scales`; m, rad, 1. A systematic error that is carried is in it, as
    /// two unknown scales that are the same all the way.
    pub covariance: JointCovariance,
    /// What is taken out of every increment: by configuration, or as learned from fixes.
    pub scales: Scales,
    /// Λ: way travelled since the last absolute fix, metres.
    pub travel_m: f64,
    /// Θ: angle turned since the last absolute fix, radians, both directions counted positive.
    pub turn_rad: f64,
    /// Eqs 1–4 at Λ and Θ.
    pub errors: OdometryErrors,
    /// How many absolute fixes there have been.
    pub fixes: u32,
    /// How many more were refused, for being too far off.
    pub refused: u32,
}

impl PartialEq for Estimate {
    /// Matrices are compared as slices, which takes a fraction of the time: each beam of each scan asks.
    fn eq(&self, other: &Self) -> bool {
        let Self { pose, covariance, scales, travel_m, turn_rad, errors, fixes, refused } = self;
        *pose == other.pose
            && covariance.as_slice() == other.covariance.as_slice()
            && *scales == other.scales
            && (*travel_m, *turn_rad) == (other.travel_m, other.turn_rad)
            && *errors == other.errors
            && (*fixes, *refused) == (other.fixes, other.refused)
    }
}

impl Estimate {
    /// An estimate at `pose`, without doubt.
    #[must_use]
    pub fn certain(pose: Pose2) -> Self {
        Self {
            pose,
            covariance: JointCovariance::zeros(),
            scales: Scales::default(),
            travel_m: 0.0,
            turn_rad: 0.0,
            errors: OdometryErrors::default(),
            fixes: 0,
            refused: 0,
        }
    }

    /// The estimate of whoever tells a pose with its covariance of (x, y, θ): m², m rad, rad², in the map frame. The errors of eqs 1–4
    /// are as large as it: ε_lin its greatest variance of a position, ε_ang that of the heading.
    ///
    /// ```
    /// use echogrid_core::{Estimate, Matrix3, Pose2};
    ///
    /// let covariance = Matrix3::from_diagonal(&[0.04, 0.01, 0.001].into());
    /// let estimate = Estimate::with_covariance(Pose2::new(1.0, 2.0, 0.5), &covariance);
    /// assert_eq!(estimate.pose_covariance(), covariance);
    /// assert!((estimate.errors.eps_lin_m2 - 0.04).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn with_covariance(pose: Pose2, covariance: &Matrix3<f64>) -> Self {
        let mut estimate = Self::certain(pose);
        estimate.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(covariance);
        let position = covariance.fixed_view::<2, 2>(0, 0);
        let (trace, determinant) = (position.trace(), position.determinant());
        let greatest = 0.5 * trace + (0.25 * trace * trace - determinant).max(0.0).sqrt();
        estimate.errors.eps_lin_m2 = greatest;
        estimate.errors.eps_ang_rad2 = covariance[(2, 2)];
        estimate
    }

    /// Covariance of (x, y, θ) alone, map frame; m², m rad, rad².
    #[must_use]
    pub fn pose_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Covariance of (x, y, θ) of what sits at `base_from_part` on the robot, in the map frame: where the heading is in
    /// doubt, so is the place of what is off the base.
    #[must_use]
    pub fn covariance_of(&self, base_from_part: Pose2) -> Matrix3<f64> {
        let (s, c) = libm::sincos(self.pose.theta);
        let (x, y) = (c * base_from_part.x - s * base_from_part.y, s * base_from_part.x + c * base_from_part.y);
        let moved = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, 0.0, 0.0, 1.0);
        moved * self.pose_covariance() * moved.transpose()
    }

    /// Between `self` (`fraction` 0) and `later` (`fraction` 1): the pose by [`Pose2::interpolate`], all else linear;
    /// `fixes` is that of `self` until `later` is reached. `fraction` is kept within [0, 1]: there is no extrapolation.
    #[must_use]
    pub fn interpolate(&self, later: &Self, fraction: f64) -> Self {
        let fraction = if fraction > 0.0 { fraction.min(1.0) } else { 0.0 };
        if fraction == 1.0 {
            return *later;
        }
        let mix = |a: f64, b: f64| a + fraction * (b - a);
        Self {
            pose: self.pose.interpolate(later.pose, fraction),
            covariance: self.covariance + (later.covariance - self.covariance) * fraction,
            scales: Scales { lin: mix(self.scales.lin, later.scales.lin), ang: mix(self.scales.ang, later.scales.ang) },
            travel_m: mix(self.travel_m, later.travel_m),
            turn_rad: mix(self.turn_rad, later.turn_rad),
            errors: OdometryErrors {
                e_lin_m: mix(self.errors.e_lin_m, later.errors.e_lin_m),
                e_ang_rad: mix(self.errors.e_ang_rad, later.errors.e_ang_rad),
                eps_lin_m2: mix(self.errors.eps_lin_m2, later.errors.eps_lin_m2),
                eps_ang_rad2: mix(self.errors.eps_ang_rad2, later.errors.eps_ang_rad2),
            },
            fixes: self.fixes,
            refused: self.refused,
        }
    }
}
