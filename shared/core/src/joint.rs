//! The covariance of a pose together with the two unknown scales of its odometry.
//!
//! A systematic error that is carried is one unknown constant for the whole run, not fresh noise: the scales of translation and
//! of rotation are a fourth and a fifth state, whose prior deviations are a_l and a_θ. So their effect grows linearly with the
//! way, and an error of heading grows into one of position.

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::config::{OdometryConfig, Systematic};
use crate::localization::Fix;
use crate::odometry::Increment;
use crate::pose::Pose2;

type Matrix5 = SMatrix<f64, 5, 5>;

/// Covariance of (x, y, θ, scale of translation, scale of rotation); m, rad, 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Joint(Matrix5);

impl Joint {
    /// At a pose without doubt.
    pub(crate) fn certain(config: &OdometryConfig) -> Self {
        let square = |scale: f64| if config.systematic == Systematic::Carry { scale * scale } else { 0.0 };
        let variances = [0.0, 0.0, 0.0, square(config.lin_scale), square(config.ang_scale)];
        Self(Matrix5::from_diagonal(&SVector::from(variances)))
    }

    /// Of (x, y, θ) alone.
    pub(crate) fn pose(&self) -> Matrix3<f64> {
        self.0.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// After a step from `pose`: C ← J C Jᵀ + B diag(ε_lin, ε_ang) Bᵀ, with J and B the Jacobians of the mid-point rule for a
    /// step of (1 − s_l) Δl and (1 − s_θ) Δθ.
    ///
    /// A sideways step, which no differential drive makes, adds κ_ll per metre across the heading.
    pub(crate) fn moved(&self, config: &OdometryConfig, pose: Pose2, increment: Increment) -> Self {
        let Increment { forward_m: f, lateral_m: l, turn_rad } = increment;
        let (s, c) = libm::sincos(pose.theta + 0.5 * turn_rad);
        let (dx, dy) = (f * c - l * s, f * s + l * c);
        let turn = turn_rad.abs();
        let noise = SVector::from([
            config.k_ll * f.abs() + config.k_lt * turn,
            config.k_ll * l.abs(),
            config.k_tt * turn + config.k_tl * increment.length_m(),
        ]);
        let mut j = Matrix5::identity();
        (j[(0, 2)], j[(1, 2)]) = (-dy, dx);
        (j[(0, 3)], j[(1, 3)]) = (-dx, -dy);
        (j[(0, 4)], j[(1, 4)], j[(2, 4)]) = (0.5 * turn_rad * dy, -0.5 * turn_rad * dx, -turn_rad);
        let mut b = SMatrix::<f64, 5, 3>::zeros();
        (b[(0, 0)], b[(1, 0)]) = (c, s);
        (b[(0, 1)], b[(1, 1)]) = (-s, c);
        (b[(0, 2)], b[(1, 2)], b[(2, 2)]) = (-0.5 * dy, 0.5 * dx, 1.0);
        let moved = j * self.0 * j.transpose() + b * Matrix3::from_diagonal(&noise) * b.transpose();
        // Rounding must not make it lopsided over a long run.
        Self((moved + moved.transpose()) * 0.5)
    }

    /// After a fix: what it knows is as well known as it says, and has nothing to do any more with how the rest was off.
    pub(crate) fn fixed(&self, fix: &Fix) -> Self {
        let known = [fix.position_known, fix.position_known, fix.heading_known, false, false];
        let mut fixed = self.0;
        for row in 0..5 {
            for column in 0..5 {
                match (known[row], known[column]) {
                    (true, true) => fixed[(row, column)] = fix.covariance[(row, column)],
                    (false, false) => {}
                    _ => fixed[(row, column)] = 0.0,
                }
            }
        }
        Self(fixed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::wrap_angle;
    use crate::noise::standard_normal_pair;
    use crate::odometry::move_by;

    const DRIVES: u32 = 10_000;
    const STEPS: u32 = 60;

    /// Straight on, round a bend, straight on.
    fn step(index: u32) -> Increment {
        let turn_rad = if (20..40).contains(&index) { 0.06 } else { 0.0 };
        Increment { forward_m: 0.1, lateral_m: 0.0, turn_rad }
    }

    /// Ten thousand drives, each with its own scales and its own noise, spread as the covariance says.
    #[test]
    fn many_drives_spread_as_it_says() {
        for systematic in [Systematic::Off, Systematic::Carry] {
            let config = OdometryConfig { systematic, lin_scale: 0.03, ang_scale: 0.03, ..OdometryConfig::default() };
            let (mut pose, mut joint) = (Pose2::IDENTITY, Joint::certain(&config));
            for index in 0..STEPS {
                joint = joint.moved(&config, pose, step(index));
                pose = move_by(pose, step(index));
            }
            let carried = f64::from(u8::from(systematic == Systematic::Carry));
            let mut spread = Matrix3::zeros();
            for drive in 0..DRIVES {
                let (lin, ang) = standard_normal_pair(u64::from(drive), 0, 0);
                let (lin, ang) = (0.03 * carried * lin, 0.03 * carried * ang);
                let mut end = Pose2::IDENTITY;
                for index in 0..STEPS {
                    let Increment { forward_m, turn_rad, .. } = step(index);
                    let (a, b) = standard_normal_pair(u64::from(drive), u64::from(index) + 1, 1);
                    let eps_lin = config.k_ll * forward_m + config.k_lt * turn_rad;
                    let eps_ang = config.k_tt * turn_rad + config.k_tl * forward_m;
                    end = move_by(
                        end,
                        Increment {
                            forward_m: forward_m * (1.0 - lin) + eps_lin.sqrt() * a,
                            lateral_m: 0.0,
                            turn_rad: turn_rad * (1.0 - ang) + eps_ang.sqrt() * b,
                        },
                    );
                }
                let off = nalgebra::Vector3::new(end.x - pose.x, end.y - pose.y, wrap_angle(end.theta - pose.theta));
                spread += off * off.transpose() / f64::from(DRIVES);
            }
            let said = joint.pose();
            for row in 0..3 {
                for column in 0..3 {
                    // Five standard errors of a sampled covariance, and 2 % for what the Jacobians leave out.
                    let scale = (said[(row, row)] * said[(column, column)]).sqrt();
                    let off = (spread[(row, column)] - said[(row, column)]).abs() / scale;
                    assert!(
                        off < 5.0 * (2.0 / f64::from(DRIVES)).sqrt() + 0.02,
                        "{systematic:?} {row} {column}: {off}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_scale_that_is_carried_counts_with_the_square_of_the_way() {
        let config = OdometryConfig {
            systematic: Systematic::Carry,
            lin_scale: 0.1,
            k_ll: 0.0,
            k_tl: 0.0,
            ..OdometryConfig::default()
        };
        let mut joint = Joint::certain(&config);
        for metre in 1..=10 {
            joint = joint.moved(&config, Pose2::IDENTITY, Increment { forward_m: 1.0, ..Increment::default() });
            let expected = (0.1 * f64::from(metre)) * (0.1 * f64::from(metre));
            assert!((joint.pose()[(0, 0)] - expected).abs() < 1e-12);
        }
        // The scale outlives a fix; the place does not remember it.
        joint = joint.fixed(&Fix::certain(Pose2::IDENTITY));
        assert_eq!(joint.pose(), Matrix3::zeros());
        joint = joint.moved(&config, Pose2::IDENTITY, Increment { forward_m: 1.0, ..Increment::default() });
        assert!((joint.pose()[(0, 0)] - 0.01).abs() < 1e-12);
    }
}
