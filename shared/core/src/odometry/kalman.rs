//! An absolute fix as a Kalman update of the pose and the two scales of the odometry.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::fix::Fix;
use super::joint::{JointCovariance, tidied};
use crate::angle::wrap_angle;
use crate::pose::Pose2;
use crate::semi_inverse::{explains, semi_inverse};

/// What a fix says that was not known: how far off the pose was, in what is known of it, and how far that could be.
#[derive(Debug, Clone)]
pub(crate) struct Innovation {
    /// Metres, metres, radians (wrapped); 0 in what the fix does not know.
    pub(crate) off: Vector3<f64>,
    /// Mahalanobis distance: `off` in standard deviations; infinite where both sides are sure and differ.
    pub(crate) sigmas: f64,
    known: [bool; 3],
    /// Covariance of the fix, in what it knows.
    fix: Matrix3<f64>,
    /// Of the covariance of `off`.
    inverse: Matrix3<f64>,
}

impl Innovation {
    /// Of a fix against `pose` with `covariance`.
    pub(crate) fn of(fix: &Fix, pose: Pose2, covariance: &JointCovariance) -> Self {
        let known = [fix.position_known, fix.position_known, fix.heading_known];
        let masked = |of: &dyn Fn(usize, usize) -> f64| {
            Matrix3::from_fn(|i, j| if known[i] && known[j] { of(i, j) } else { 0.0 })
        };
        let fix_covariance = masked(&|i, j| 0.5 * (fix.covariance[(i, j)] + fix.covariance[(j, i)]));
        let spread = masked(&|i, j| covariance[(i, j)]) + fix_covariance;
        let off = Vector3::new(fix.pose.x - pose.x, fix.pose.y - pose.y, wrap_angle(fix.pose.theta - pose.theta));
        let off = Vector3::from_fn(|i, _| if known[i] { off[i] } else { 0.0 });
        let inverse = semi_inverse(&spread);
        let square = (off.transpose() * inverse * off)[0].max(0.0);
        let sigmas = if explains(&spread, &inverse, &off) { square.sqrt() } else { f64::INFINITY };
        Self { off, sigmas, known, fix: fix_covariance, inverse }
    }

    /// Whether the fix is exact in all that it knows.
    pub(crate) fn is_exact(&self) -> bool {
        self.fix.iter().all(|value| *value == 0.0)
    }

    /// What the fix adds to the state (x, y, θ, scale of translation, scale of rotation), and the covariance after it, in
    /// Joseph's form: (I − K H) C (I − K H)ᵀ + K R Kᵀ.
    pub(crate) fn update(&self, covariance: &JointCovariance) -> (SVector<f64, 5>, JointCovariance) {
        let gain: SMatrix<f64, 5, 3> = covariance.fixed_view::<5, 3>(0, 0) * self.inverse;
        let mut rest = JointCovariance::identity();
        for row in 0..5 {
            for column in 0..3 {
                rest[(row, column)] -= gain[(row, column)];
            }
        }
        let after = rest * covariance * rest.transpose() + gain * self.fix * gain.transpose();
        let mut after = tidied(after);
        if self.is_exact() {
            // But for rounding it is so already.
            forget(&mut after, self.known);
        }
        (gain * self.off, after)
    }

    /// The covariance after a fix that takes the place of what was believed: what it knows is as well known as it says, and
    /// has nothing to do any more with how the rest was off.
    pub(crate) fn replace(&self, covariance: &JointCovariance) -> JointCovariance {
        let mut after = *covariance;
        forget(&mut after, self.known);
        for row in 0..3 {
            for column in 0..3 {
                after[(row, column)] += self.fix[(row, column)];
            }
        }
        after
    }
}

/// What is known is so without doubt.
fn forget(covariance: &mut JointCovariance, known: [bool; 3]) {
    for index in (0..3).filter(|index| known[*index]) {
        covariance.fill_row(index, 0.0);
        covariance.fill_column(index, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(variances: [f64; 5]) -> JointCovariance {
        JointCovariance::from_diagonal(&SVector::from(variances))
    }

    #[test]
    fn equal_doubts_meet_half_way() {
        let covariance = diagonal([0.04, 0.04, 0.01, 0.0, 0.0]);
        let fix = Fix::about(Pose2::new(0.2, -0.4, 0.1), 0.2, 0.1);
        let innovation = Innovation::of(&fix, Pose2::IDENTITY, &covariance);
        let expected = (0.04 / 0.08 + 0.16 / 0.08 + 0.01 / 0.02_f64).sqrt();
        assert!((innovation.sigmas - expected).abs() < 1e-12);
        let (gained, after) = innovation.update(&covariance);
        assert!((gained - SVector::from([0.1, -0.2, 0.05, 0.0, 0.0])).amax() < 1e-15);
        assert!((after - diagonal([0.02, 0.02, 0.005, 0.0, 0.0])).amax() < 1e-15);
    }

    #[test]
    fn a_heading_is_off_by_the_shorter_way() {
        let covariance = diagonal([0.0, 0.0, 0.01, 0.0, 0.0]);
        let fix = Fix { position_known: false, ..Fix::about(Pose2::new(9.0, 9.0, -3.1), 0.0, 0.1) };
        let innovation = Innovation::of(&fix, Pose2::new(0.0, 0.0, 3.1), &covariance);
        assert!((innovation.off[2] - (core::f64::consts::TAU - 6.2)).abs() < 1e-12 && innovation.off[0] == 0.0);
    }

    #[test]
    fn who_is_sure_on_both_sides_and_differs_is_infinitely_far_off() {
        let here = Innovation::of(&Fix::certain(Pose2::IDENTITY), Pose2::IDENTITY, &JointCovariance::zeros());
        assert_eq!(here.sigmas, 0.0);
        let (gained, after) = here.update(&JointCovariance::zeros());
        assert_eq!((gained, after), (SVector::zeros(), JointCovariance::zeros()));
        let there = Fix::certain(Pose2::new(0.0, 0.1, 0.0));
        assert_eq!(Innovation::of(&there, Pose2::IDENTITY, &JointCovariance::zeros()).sigmas, f64::INFINITY);
        // Sure along x only.
        let across = diagonal([0.0, 0.01, 0.01, 0.0, 0.0]);
        assert!((Innovation::of(&there, Pose2::IDENTITY, &across).sigmas - 1.0).abs() < 1e-12);
        let along = Fix::certain(Pose2::new(0.1, 0.0, 0.0));
        assert_eq!(Innovation::of(&along, Pose2::IDENTITY, &across).sigmas, f64::INFINITY);
    }
}
