//! The covariance of a pose together with the two unknown scales of its odometry.
//!
//! A systematic error that is carried is one unknown constant for the whole run, not fresh noise: the scales of translation and
//! of rotation are a fourth and a fifth state, whose prior deviations are a_l and a_θ. So their effect grows linearly with the
//! way, and an error of heading grows into one of position.

use nalgebra::{Matrix3, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::config::{OdometryConfig, Systematic};
use crate::odometry::increment::Increment;
use crate::pose::Pose2;

/// Covariance of (x, y, θ, scale of translation, scale of rotation); m, rad, 1.
pub type JointCovariance = SMatrix<f64, 5, 5>;

/// No drive is farther off than this share of what it measures.
const SCALE_MAX: f64 = 0.5;

/// What the drive is believed to measure too much, as a share of what it measures: 0.03 where 1 m is 0.97 m in truth.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Scales {
    /// The scale of translation: what is measured too much, as a share of what is measured.
    pub lin: f64,
    /// The scale of rotation: what is measured too much, as a share of what is measured.
    pub ang: f64,
}

impl Scales {
    /// Before the first fix: what is to be corrected.
    pub(crate) fn of(config: &OdometryConfig) -> Self {
        match config.systematic {
            Systematic::Correct => Self { lin: config.lin_scale, ang: config.ang_scale },
            Systematic::Carry | Systematic::Off => Self::default(),
        }
    }

    /// After a fix that taught so much.
    pub(crate) fn taught(self, lin: f64, ang: f64) -> Self {
        let within = |before: f64, gained: f64| {
            let limit = SCALE_MAX.max(before.abs());
            (before + gained).clamp(-limit, limit)
        };
        Self { lin: within(self.lin, lin), ang: within(self.ang, ang) }
    }

    /// The step that the robot is believed to have made when its drive measured `measured`.
    #[must_use]
    pub fn correct(self, measured: Increment) -> Increment {
        measured.corrected(self.lin, self.ang)
    }

    /// What the drive measured when the robot is believed to have made `step`.
    pub(crate) fn measured(self, step: Increment) -> Increment {
        Increment {
            forward_m: step.forward_m / (1.0 - self.lin),
            lateral_m: step.lateral_m / (1.0 - self.lin),
            turn_rad: step.turn_rad / (1.0 - self.ang),
        }
    }
}

/// At a pose without doubt.
pub(crate) fn certain(config: &OdometryConfig) -> JointCovariance {
    let square = |scale: f64| if config.systematic == Systematic::Carry { scale * scale } else { 0.0 };
    let variances = [0.0, 0.0, 0.0, square(config.lin_scale), square(config.ang_scale)];
    JointCovariance::from_diagonal(&SVector::from(variances))
}

/// J: how the state after a step from `pose` depends on the state before it, by the mid-point rule for a step of
/// (1 − s_l) Δl and (1 − s_θ) Δθ.
pub(crate) fn jacobian(pose: Pose2, scales: Scales, measured: Increment) -> JointCovariance {
    let step = scales.correct(measured);
    let (s, c) = libm::sincos(pose.theta + 0.5 * step.turn_rad);
    let across = |of: Increment| (of.forward_m * c - of.lateral_m * s, of.forward_m * s + of.lateral_m * c);
    let (dx, dy) = across(step);
    let (measured_dx, measured_dy) = across(measured);
    let turn_rad = measured.turn_rad;
    let mut j = JointCovariance::identity();
    (j[(0, 2)], j[(1, 2)]) = (-dy, dx);
    (j[(0, 3)], j[(1, 3)]) = (-measured_dx, -measured_dy);
    (j[(0, 4)], j[(1, 4)], j[(2, 4)]) = (0.5 * turn_rad * dy, -0.5 * turn_rad * dx, -turn_rad);
    j
}

/// After a step from `pose`: C ← J C Jᵀ + B diag(ε_lin, ε_ang) Bᵀ, with J and B the Jacobians of the mid-point rule.
///
/// A sideways step, which no differential drive makes, adds κ_ll per metre across the heading.
pub(crate) fn moved(
    covariance: &JointCovariance,
    config: &OdometryConfig,
    pose: Pose2,
    scales: Scales,
    measured: Increment,
) -> JointCovariance {
    let step = scales.correct(measured);
    let Increment { forward_m: f, lateral_m: l, turn_rad } = step;
    let (s, c) = libm::sincos(pose.theta + 0.5 * turn_rad);
    let (dx, dy) = (f * c - l * s, f * s + l * c);
    let turn = turn_rad.abs();
    let noise = SVector::from([
        config.k_ll * f.abs() + config.k_lt * turn,
        config.k_ll * l.abs(),
        config.k_tt * turn + config.k_tl * step.length_m(),
    ]);
    let j = jacobian(pose, scales, measured);
    let mut b = SMatrix::<f64, 5, 3>::zeros();
    (b[(0, 0)], b[(1, 0)]) = (c, s);
    (b[(0, 1)], b[(1, 1)]) = (-s, c);
    (b[(0, 2)], b[(1, 2)], b[(2, 2)]) = (-0.5 * dy, 0.5 * dx, 1.0);
    let moved = j * covariance * j.transpose() + b * Matrix3::from_diagonal(&noise) * b.transpose();
    tidied(moved)
}

/// What rounding has made lopsided or, next to certain, negative is neither.
pub(crate) fn tidied(covariance: JointCovariance) -> JointCovariance {
    let mut tidy = (covariance + covariance.transpose()) * 0.5;
    for index in 0..5 {
        if tidy[(index, index)] <= 0.0 {
            tidy.fill_row(index, 0.0);
            tidy.fill_column(index, 0.0);
        }
    }
    // Two errors go together at most fully: where a variance is all but gone, rounding would have them go together more.
    for row in 0..5 {
        for column in 0..row {
            let most = (tidy[(row, row)] * tidy[(column, column)]).sqrt();
            let together = tidy[(row, column)].max(-most).min(most);
            (tidy[(row, column)], tidy[(column, row)]) = (together, together);
        }
    }
    tidy
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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

    /// An exact heading told a scale, whose variance is then rounding; what is left beside it must not outweigh it.
    #[test]
    fn a_variance_that_is_all_but_gone_goes_together_with_nothing() {
        let mut covariance = JointCovariance::from_diagonal(&SVector::from([0.1, 0.1, 1e-4, 9e-4, 1e-18]));
        (covariance[(0, 4)], covariance[(4, 0)]) = (6.8e-6, 6.8e-6);
        assert!(covariance.symmetric_eigenvalues().min() < -1e-10);
        let tidy = tidied(covariance);
        assert!(tidy.symmetric_eigenvalues().min() > -1e-15 && tidy == tidy.transpose(), "{tidy}");
        assert_eq!(tidy.diagonal(), covariance.diagonal());
    }

    /// Ten thousand drives, each with its own scales and its own noise, spread as the covariance says.
    #[test]
    fn many_drives_spread_as_it_says() {
        for systematic in [Systematic::Off, Systematic::Carry] {
            let config = OdometryConfig { systematic, lin_scale: 0.03, ang_scale: 0.03, ..OdometryConfig::default() };
            let (mut pose, mut covariance) = (Pose2::IDENTITY, certain(&config));
            for index in 0..STEPS {
                covariance = moved(&covariance, &config, pose, Scales::default(), step(index));
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
            let said = covariance;
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
        let mut covariance = certain(&config);
        for metre in 1..=10 {
            let ahead = Increment { forward_m: 1.0, ..Increment::default() };
            covariance = moved(&covariance, &config, Pose2::IDENTITY, Scales::default(), ahead);
            let expected = (0.1 * f64::from(metre)) * (0.1 * f64::from(metre));
            assert!((covariance[(0, 0)] - expected).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn the_jacobian_is_that_of_the_step(
            theta in -3.0..3.0f64, f in -0.5..0.5f64, l in -0.5..0.5f64, turn_rad in -1.0..1.0f64,
            lin in -0.3..0.3f64, ang in -0.3..0.3f64,
        ) {
            const H: f64 = 1e-6;
            let measured = Increment { forward_m: f, lateral_m: l, turn_rad };
            let end = |state: [f64; 5]| {
                let [x, y, theta, lin, ang] = state;
                let end = move_by(Pose2 { x, y, theta }, Scales { lin, ang }.correct(measured));
                [end.x, end.y, end.theta]
            };
            let j = jacobian(Pose2::new(1.0, 2.0, theta), Scales { lin, ang }, measured);
            for column in 0..5 {
                let moved = |h: f64| {
                    let mut state = [1.0, 2.0, theta, lin, ang];
                    state[column] += h;
                    end(state)
                };
                let (up, down) = (moved(H), moved(-H));
                for row in 0..3 {
                    let slope = if row == 2 { wrap_angle(up[2] - down[2]) } else { up[row] - down[row] } / (2.0 * H);
                    prop_assert!((j[(row, column)] - slope).abs() < 1e-6, "{} {}", row, column);
                }
            }
        }
    }
}
