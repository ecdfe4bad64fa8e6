//! The error that a fix reveals was gathered on the way to it: what the estimates since the last fix look like in hindsight.
//!
//! A fix at x₁ tells about an earlier x_t what x₁ has in common with it: K = Cov(x_t, x₁) Cov(x₁)⁻¹, x_t + K (x₁ʰ − x₁),
//! C_t − K (C₁ − C₁ʰ) Kᵀ, with x₁ʰ, C₁ʰ the pose and its covariance after the fix (Rauch, Tung, Striebel, over one stretch).
//! What x₁ has in common with x_t is Φ C_t, with Φ the product of the Jacobians of the steps between them: a rigid turn about
//! x_t, and what the scales of the odometry add on the way.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::angle::wrap_angle;
use crate::joint::{JointCovariance, jacobian, tidied};
use crate::odometry::error_model::OdometryErrors;
use crate::odometry::estimate::Estimate;
use crate::odometry::increment::Increment;
use crate::pose::Pose2;
use crate::semi_inverse::{explains, semi_inverse};

/// A fix that moves the robot by more than this share of its way tells of no error of the odometry: it was carried off, or
/// the map began elsewhere. (The worst drive here is 9 % off; a turn that went wrong early may cost half of the way.)
const HALF_OF_THE_WAY: f64 = 0.5;
/// Unless the estimate itself says so, standard deviations.
const IN_KEEPING: f64 = 5.0;

/// What `way`, the estimates since the last fix in the order of their stamps, is in hindsight, when a fix has made `after` of
/// `before`. Frames and units are those of [`Estimate`]. None where the fix tells of no error of the odometry.
///
/// The errors of eqs 1–4 become a bridge where the fix took them out: ε (1 − ε/ε₁), and E likewise; greatest in the middle.
/// Where the pose before the fix is without doubt in some direction, it has nothing to tell about the way in that direction.
#[must_use]
pub fn smooth(way: &[Estimate], before: &Estimate, after: &Estimate) -> Option<Vec<Estimate>> {
    let fix = Revealed::by(before, after)?;
    let mut sensitivity: SMatrix<f64, 3, 5> = SMatrix::identity();
    let mut next = before;
    let mut smoothed = Vec::with_capacity(way.len());
    for estimate in way.iter().rev() {
        sensitivity *= between(estimate, next);
        smoothed.push(fix.seen_from(estimate, &sensitivity));
        next = estimate;
    }
    smoothed.reverse();
    Some(smoothed)
}

/// What `way`, the estimates before anything had said where the map lies, is when the first fix has made `after` of the last of
/// them, `before`: the same way, laid so that it ends at the fix, and the doubt that grew towards its end grows towards its start.
#[must_use]
pub fn placed(way: &[Estimate], before: &Estimate, after: &Estimate) -> Vec<Estimate> {
    let map_from_odom = after.pose * before.pose.inverse();
    let turned = rotation(map_from_odom.theta);
    let told = turned.transpose() * after.covariance * turned;
    let mut lead: JointCovariance = JointCovariance::identity();
    let mut next = before;
    let mut placed = Vec::with_capacity(way.len());
    for estimate in way.iter().rev() {
        lead *= between(estimate, next);
        next = estimate;
        // What the way from here on adds, seen from its end, and then from here.
        let gathered = before.covariance - lead * estimate.covariance * lead.transpose();
        let back = lead.try_inverse().unwrap_or_else(JointCovariance::identity);
        let doubt = back * (told + gathered) * back.transpose();
        let left = |at: f64, before: f64, after: f64| (before - at).max(0.0) + after;
        let (at, end, fixed) = (&estimate.errors, &before.errors, &after.errors);
        placed.push(Estimate {
            pose: map_from_odom * estimate.pose,
            covariance: tidied(turned * doubt * turned.transpose()),
            travel_m: (before.travel_m - estimate.travel_m).max(0.0),
            turn_rad: (before.turn_rad - estimate.turn_rad).max(0.0),
            errors: OdometryErrors {
                e_lin_m: left(at.e_lin_m, end.e_lin_m, fixed.e_lin_m),
                e_ang_rad: left(at.e_ang_rad, end.e_ang_rad, fixed.e_ang_rad),
                eps_lin_m2: left(at.eps_lin_m2, end.eps_lin_m2, fixed.eps_lin_m2),
                eps_ang_rad2: left(at.eps_ang_rad2, end.eps_ang_rad2, fixed.eps_ang_rad2),
            },
            ..*estimate
        });
    }
    placed.reverse();
    placed
}

/// Of the state, by `theta_rad` about the origin.
fn rotation(theta_rad: f64) -> JointCovariance {
    let (s, c) = libm::sincos(theta_rad);
    let mut turned = JointCovariance::identity();
    (turned[(0, 0)], turned[(0, 1)], turned[(1, 0)], turned[(1, 1)]) = (c, -s, s, c);
    turned
}

/// How the later of two estimates depends on the earlier.
fn between(earlier: &Estimate, later: &Estimate) -> JointCovariance {
    let made = Increment::between(earlier.pose, later.pose);
    jacobian(earlier.pose, later.scales, later.scales.measured(made))
}

/// What a fix has shown.
struct Revealed<'a> {
    before: &'a Estimate,
    after: &'a Estimate,
    off: Vector3<f64>,
    inverse: Matrix3<f64>,
    /// C₁ − C₁ʰ.
    settled: Matrix3<f64>,
}

impl<'a> Revealed<'a> {
    fn by(before: &'a Estimate, after: &'a Estimate) -> Option<Self> {
        let (b, a) = (before.pose, after.pose);
        let off = Vector3::new(a.x - b.x, a.y - b.y, wrap_angle(a.theta - b.theta));
        let covariance = before.pose_covariance();
        let inverse = semi_inverse(&covariance);
        let sigmas = (off.transpose() * inverse * off)[0].max(0.0).sqrt();
        let explained = explains(&covariance, &inverse, &off);
        let plausible = b.distance_m(a) <= HALF_OF_THE_WAY * before.travel_m;
        let known = off.iter().all(|value| value.is_finite());
        let settled = covariance - after.pose_covariance();
        (known && (plausible || explained && sigmas <= IN_KEEPING)).then_some(Self {
            before,
            after,
            off,
            inverse,
            settled,
        })
    }

    /// `estimate` in hindsight; `sensitivity` is how the pose at the fix depends on it.
    fn seen_from(&self, estimate: &Estimate, sensitivity: &SMatrix<f64, 3, 5>) -> Estimate {
        let gain: SMatrix<f64, 5, 3> = estimate.covariance * sensitivity.transpose() * self.inverse;
        let gained = gain * self.off;
        let Pose2 { x, y, theta } = estimate.pose;
        let (at, before, after) = (&estimate.errors, &self.before.errors, &self.after.errors);
        Estimate {
            pose: Pose2::new(x + gained[0], y + gained[1], theta + gained[2]),
            covariance: tidied(estimate.covariance - gain * self.settled * gain.transpose()),
            scales: estimate.scales.taught(gained[3], gained[4]),
            errors: OdometryErrors {
                e_lin_m: bridge(at.e_lin_m, before.e_lin_m, after.e_lin_m),
                e_ang_rad: bridge(at.e_ang_rad, before.e_ang_rad, after.e_ang_rad),
                eps_lin_m2: bridge(at.eps_lin_m2, before.eps_lin_m2, after.eps_lin_m2),
                eps_ang_rad2: bridge(at.eps_ang_rad2, before.eps_ang_rad2, after.eps_ang_rad2),
            },
            ..*estimate
        }
    }
}

/// e − (e/e₁)² (e₁ − e₁ʰ): an error of `error` on the way to one of `before` that a fix has made `after`.
fn bridge(error: f64, before: f64, after: f64) -> f64 {
    if before == 0.0 {
        return error;
    }
    let share = (error / before).clamp(0.0, 1.0);
    let taken_out = (1.0 - after / before).clamp(0.0, 1.0);
    error * (1.0 - share * taken_out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{OdometryConfig, Systematic};
    use crate::gate::Gate;
    use crate::noise::standard_normal_pair;
    use crate::odometry::fix::Fix;
    use crate::odometry::{Odometry, move_by};

    const OPEN: Gate = Gate { sigmas: 0.0, refuses: false, places: false };

    /// The estimates of a drive by these steps, and what a fix makes of the last.
    fn driven(config: &OdometryConfig, steps: &[Increment], fix: &Fix) -> (Vec<Estimate>, Estimate) {
        let mut odometry = Odometry::new(config);
        let mut pose = Pose2::IDENTITY;
        let mut way = vec![odometry.step(pose)];
        for step in steps {
            pose = move_by(pose, *step);
            way.push(odometry.step(pose));
        }
        let after = odometry.apply(fix, OPEN).unwrap();
        (way, after)
    }

    fn ahead(count: usize) -> Vec<Increment> {
        in_steps_of(0.1, count)
    }

    fn in_steps_of(forward_m: f64, count: usize) -> Vec<Increment> {
        vec![Increment { forward_m, ..Increment::default() }; count]
    }

    /// Heading drifts as a random walk of κ per metre: y after 10 m is off by its integral, of variance κ L³/3. Given that
    /// end, the way bends as s²(3L − s)/(2L³), a beam that is clamped at the start.
    #[test]
    fn a_sideways_fix_bends_a_straight_way_as_a_beam() {
        let config = OdometryConfig { k_ll: 0.0, ..OdometryConfig::default() };
        let place = Fix { heading_known: false, ..Fix::certain(Pose2::new(10.0, 0.3, 0.0)) };
        let (way, after) = driven(&config, &in_steps_of(0.01, 1000), &place);
        let smoothed = smooth(&way, way.last().unwrap(), &after).unwrap();
        for (index, estimate) in smoothed.iter().enumerate() {
            let s = index as f64 * 0.01;
            let expected = 0.3 * s * s * (30.0 - s) / 2000.0;
            assert!((estimate.pose.y - expected).abs() < 1e-4, "{s}: {} {expected}", estimate.pose.y);
            let slope = 0.3 * (60.0 * s - 3.0 * s * s) / 2000.0;
            assert!((estimate.pose.theta - slope).abs() < 1e-4, "{s}: {} {slope}", estimate.pose.theta);
        }
    }

    /// Along the way the error is a random walk: a bridge of variance κ s (L − s)/L that takes the correction in equal shares.
    #[test]
    fn a_fix_along_the_way_makes_a_bridge() {
        let config = OdometryConfig { k_tl: 0.0, ..OdometryConfig::default() };
        let (way, after) = driven(&config, &ahead(100), &Fix::certain(Pose2::new(9.9, 0.0, 0.0)));
        let smoothed = smooth(&way, way.last().unwrap(), &after).unwrap();
        for (index, estimate) in smoothed.iter().enumerate() {
            let s = index as f64 * 0.1;
            assert!((estimate.pose.x - (s - 0.01 * s)).abs() < 1e-9);
            let variance = 4e-4 * s * (10.0 - s) / 10.0;
            assert!((estimate.covariance[(0, 0)] - variance).abs() < 1e-12);
            assert!((estimate.errors.eps_lin_m2 - variance).abs() < 1e-12, "the paper's ε is a bridge, too");
        }
    }

    #[test]
    fn both_ends_are_where_they_are_known_to_be() {
        let config = OdometryConfig { systematic: Systematic::Carry, ..OdometryConfig::default() };
        let steps = vec![Increment { forward_m: 0.1, lateral_m: 0.0, turn_rad: 0.02 }; 50];
        let end = steps.iter().fold(Pose2::IDENTITY, |pose, step| move_by(pose, *step));
        let fix = Fix::about(Pose2::new(end.x + 0.1, end.y - 0.05, end.theta + 0.03), 0.01, 0.01);
        let (way, after) = driven(&config, &steps, &fix);
        let smoothed = smooth(&way, way.last().unwrap(), &after).unwrap();
        let (first, last) = (smoothed[0], smoothed[50]);
        assert_eq!((first.pose, first.pose_covariance()), (Pose2::IDENTITY, Matrix3::zeros()));
        assert!(last.pose.distance_m(after.pose) < 1e-9 && (last.pose.theta - after.pose.theta).abs() < 1e-9);
        assert!((last.covariance - after.covariance).amax() < 1e-9);
        // A scale is the same all the way, so what the fix teaches holds from the start.
        assert!((first.scales.lin - after.scales.lin).abs() < 1e-9);
        let (start, end) = (first.errors, last.errors);
        assert!(start.e_lin_m == 0.0 && end.e_lin_m.abs() < 1e-12 && smoothed[25].errors.e_lin_m > 0.0);
        assert!((end.eps_lin_m2 - after.errors.eps_lin_m2).abs() < 1e-12);
    }

    #[test]
    fn who_was_carried_off_had_been_right_before() {
        let (way, after) = driven(&OdometryConfig::default(), &ahead(20), &Fix::certain(Pose2::new(2.0, 7.0, 1.0)));
        assert!(smooth(&way, way.last().unwrap(), &after).is_none());
        // An error that the estimate did not expect, but that a drive can make, is one.
        let (way, after) = driven(&OdometryConfig::default(), &ahead(20), &Fix::certain(Pose2::new(1.5, 0.5, 0.3)));
        let smoothed = smooth(&way, way.last().unwrap(), &after).unwrap();
        assert!(smoothed.iter().all(|e| e.pose.is_finite()) && smoothed[20].pose.distance_m(after.pose) < 1e-6);
        // Of a drive without any doubt nothing is learned.
        let sure = OdometryConfig { k_ll: 0.0, k_lt: 0.0, k_tt: 0.0, k_tl: 0.0, ..OdometryConfig::default() };
        let (way, after) = driven(&sure, &ahead(20), &Fix::certain(Pose2::new(1.9, 0.0, 0.0)));
        assert_eq!(smooth(&way, way.last().unwrap(), &after).unwrap(), way);
    }

    /// Two thousand drives, each with its own scales and noise: in hindsight they are nearer to where they were, and off by
    /// as much as the covariance says.
    #[test]
    fn many_drives_are_off_as_it_says() {
        const DRIVES: u32 = 2_000;
        let config = OdometryConfig {
            systematic: Systematic::Carry,
            lin_scale: 0.03,
            ang_scale: 0.03,
            ..OdometryConfig::default()
        };
        let step = |index: u32| {
            let turn_rad = if (20..40).contains(&index) { 0.06 } else { 0.0 };
            Increment { forward_m: 0.1, lateral_m: 0.0, turn_rad }
        };
        let steps: Vec<Increment> = (0..60).map(step).collect();
        let at = [10, 30, 45];
        let (mut raw, mut hindsight, mut squares) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for drive in 0..DRIVES {
            let draw = |stream: u64, number: u16| standard_normal_pair(u64::from(drive), stream, number);
            let (lin, ang) = draw(0, 0);
            let mut truth = vec![Pose2::IDENTITY];
            for (index, step) in (0_u64..).zip(&steps) {
                let (a, b) = draw(index + 1, 1);
                let (f, turn) = (step.forward_m, step.turn_rad);
                let made = Increment {
                    forward_m: f * (1.0 - 0.03 * lin) + (config.k_ll * f + config.k_lt * turn).sqrt() * a,
                    lateral_m: 0.0,
                    turn_rad: turn * (1.0 - 0.03 * ang) + (config.k_tt * turn + config.k_tl * f).sqrt() * b,
                };
                truth.push(move_by(truth[truth.len() - 1], made));
            }
            let ((x, y), (theta, _), end) = (draw(99, 2), draw(99, 3), truth[60]);
            let fix = Fix::about(Pose2::new(end.x + 0.02 * x, end.y + 0.02 * y, end.theta + 0.01 * theta), 0.02, 0.01);
            let (way, after) = driven(&config, &steps, &fix);
            let smoothed = smooth(&way, way.last().unwrap(), &after).unwrap();
            for (slot, index) in at.into_iter().enumerate() {
                let (was, seen) = (truth[index], smoothed[index]);
                raw[slot] += way[index].pose.distance_m(was) / f64::from(DRIVES);
                hindsight[slot] += seen.pose.distance_m(was) / f64::from(DRIVES);
                let pose = seen.pose;
                let off = Vector3::new(pose.x - was.x, pose.y - was.y, wrap_angle(pose.theta - was.theta));
                let inverse = seen.pose_covariance().try_inverse().unwrap();
                squares[slot] += (off.transpose() * inverse * off)[0] / f64::from(DRIVES);
            }
        }
        // Chi-squared of three numbers: five standard errors, and 3 % for what the Jacobians leave out.
        let five = 5.0 * (6.0 / f64::from(DRIVES)).sqrt() + 0.09;
        assert!(squares.iter().all(|mean| (mean - 3.0).abs() < five), "{squares:?}");
        assert!(hindsight.iter().zip(raw).all(|(seen, raw)| *seen < 0.8 * raw), "{hindsight:?} {raw:?}");
    }
}
