//! Dead reckoning and what it is worth: the odometry error model (eqs 1–4) and the pose covariance.
//!
//! The robot's drive reports poses in its own odometry frame. Each step between two of them is an
//! [`Increment`]; the [`Odometry`] adds the increments up into an [`Estimate`] of where the robot is
//! in the map and how much doubt has gathered since it last knew.

use nalgebra::Matrix3;

use crate::angle::wrap_angle;
use crate::config::{OdometryConfig, Systematic};
use crate::joint::Joint;
use crate::localization::{Fix, FixError};
use crate::pose::Pose2;

/// A step of the robot, as seen from the robot: metres along and across the heading half-way through the turn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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

/// What the odometry may be wrong by since the last absolute fix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OdometryErrors {
    /// E_lin: systematic linear error, metres (eq 1); 0 unless systematic errors are carried.
    pub e_lin_m: f64,
    /// E_ang: systematic angular error, radians (eq 2); 0 unless systematic errors are carried.
    pub e_ang_rad: f64,
    /// ε_lin: variance of the linear error, m² (eq 3).
    pub eps_lin_m2: f64,
    /// ε_ang: variance of the angular error, rad² (eq 4).
    pub eps_ang_rad2: f64,
}

/// Eqs 1–4: the errors as functions of the way travelled and turned.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorModel {
    config: OdometryConfig,
}

impl ErrorModel {
    /// The error model of a configuration.
    #[must_use]
    pub fn new(config: &OdometryConfig) -> Self {
        Self { config: config.clone() }
    }

    /// The errors after travelling Λ = `travel_m` and turning Θ = `turn_rad` (both sums of absolute values, 0 or more).
    #[must_use]
    pub fn errors(&self, travel_m: f64, turn_rad: f64) -> OdometryErrors {
        let c = &self.config;
        let (e_lin_m, e_ang_rad) = match c.systematic {
            Systematic::Carry => {
                let sigma = if turn_rad >= c.lin_offset_from_turn_rad { c.lin_offset_m } else { 0.0 };
                let alpha = if travel_m >= c.ang_offset_from_travel_m { c.ang_offset_rad } else { 0.0 };
                (c.lin_scale * travel_m + sigma, c.ang_scale * turn_rad + alpha)
            }
            Systematic::Correct | Systematic::Off => (0.0, 0.0),
        };
        OdometryErrors {
            e_lin_m,
            e_ang_rad,
            eps_lin_m2: c.k_ll * travel_m + c.k_lt * turn_rad,
            eps_ang_rad2: c.k_tt * turn_rad + c.k_tl * travel_m,
        }
    }

    /// The step that the robot is believed to have made when its drive measured `measured`.
    #[must_use]
    pub fn believed(&self, measured: Increment) -> Increment {
        match self.config.systematic {
            Systematic::Correct => measured.corrected(self.config.lin_scale, self.config.ang_scale),
            Systematic::Carry | Systematic::Off => measured,
        }
    }
}

/// Where the robot is believed to be, and how far to believe it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// `map_from_base`.
    pub pose: Pose2,
    /// Covariance of (x, y, θ) in the map frame since the last absolute fix; m², m rad, rad². A systematic error that is
    /// carried is in it, as two unknown scales that are the same all the way.
    pub covariance: Matrix3<f64>,
    /// Λ: way travelled since the last absolute fix, metres.
    pub travel_m: f64,
    /// Θ: angle turned since the last absolute fix, radians, both directions counted positive.
    pub turn_rad: f64,
    /// Eqs 1–4 at Λ and Θ.
    pub errors: OdometryErrors,
    /// How many absolute fixes there have been.
    pub fixes: u32,
}

impl Estimate {
    /// At rest at `pose`, without doubt.
    #[must_use]
    pub fn certain(pose: Pose2) -> Self {
        Self {
            pose,
            covariance: Matrix3::zeros(),
            travel_m: 0.0,
            turn_rad: 0.0,
            errors: OdometryErrors::default(),
            fixes: 0,
        }
    }

    /// Covariance of (x, y, θ) of what sits at `base_from_part` on the robot, in the map frame: where the heading is in
    /// doubt, so is the place of what is off the base.
    #[must_use]
    pub fn covariance_of(&self, base_from_part: Pose2) -> Matrix3<f64> {
        let (s, c) = libm::sincos(self.pose.theta);
        let (x, y) = (c * base_from_part.x - s * base_from_part.y, s * base_from_part.x + c * base_from_part.y);
        let moved = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, 0.0, 0.0, 1.0);
        moved * self.covariance * moved.transpose()
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
            travel_m: mix(self.travel_m, later.travel_m),
            turn_rad: mix(self.turn_rad, later.turn_rad),
            errors: OdometryErrors {
                e_lin_m: mix(self.errors.e_lin_m, later.errors.e_lin_m),
                e_ang_rad: mix(self.errors.e_ang_rad, later.errors.e_ang_rad),
                eps_lin_m2: mix(self.errors.eps_lin_m2, later.errors.eps_lin_m2),
                eps_ang_rad2: mix(self.errors.eps_ang_rad2, later.errors.eps_ang_rad2),
            },
            fixes: self.fixes,
        }
    }
}

/// Dead reckoning: the state that turns odometry poses into estimates.
#[derive(Debug, Clone)]
pub struct Odometry {
    model: ErrorModel,
    last: Option<(Pose2, Estimate)>,
    /// The covariance of the last estimate, and of the scales.
    joint: Joint,
    /// What the last fix left open: variances that no way adds to, m² and rad².
    left_open: (f64, f64),
}

impl Odometry {
    /// Before the first pose.
    #[must_use]
    pub fn new(config: &OdometryConfig) -> Self {
        Self { model: ErrorModel::new(config), last: None, joint: Joint::certain(config), left_open: (0.0, 0.0) }
    }

    /// The estimate at the next pose that the drive reports. The first pose is taken as it stands as the map pose.
    ///
    /// A pose that is not finite changes nothing here and comes back as it is in an estimate whose pose is not finite,
    /// so that nothing is mapped from it.
    pub fn step(&mut self, odom_from_base: Pose2) -> Estimate {
        if !odom_from_base.is_finite() {
            let last = self.last.map_or_else(|| Estimate::certain(odom_from_base), |(_, estimate)| estimate);
            return Estimate { pose: odom_from_base, ..last };
        }
        let estimate = match self.last {
            None => Estimate::certain(odom_from_base),
            Some((odom_from_before, before)) => {
                self.moved(&before, Increment::between(odom_from_before, odom_from_base))
            }
        };
        self.last = Some((odom_from_base, estimate));
        estimate
    }

    /// The estimate, corrected by an absolute localization of where the robot is now: "odometry error goes to zero here"
    /// (Fig. 13). What is known replaces what was believed; the doubt that is left is that of the fix, which stays in ε_lin
    /// and ε_ang until the next one. Λ begins again with a position, Θ with a heading.
    ///
    /// # Errors
    /// The fix can't be one, or no pose has come yet that it could correct.
    pub fn apply(&mut self, fix: &Fix) -> Result<Estimate, FixError> {
        fix.validate()?;
        let Some((odom_from_base, before)) = self.last else {
            return Err(FixError {
                field: "fix",
                value: "too early".to_owned(),
                expected: "an odometry pose before it",
            });
        };
        let mut after = Estimate { fixes: before.fixes.saturating_add(1), ..before };
        self.joint = self.joint.fixed(fix);
        after.covariance = self.joint.pose();
        if fix.position_known {
            (after.pose.x, after.pose.y, after.travel_m) = (fix.pose.x, fix.pose.y, 0.0);
            self.left_open.0 = 0.5 * (fix.covariance[(0, 0)] + fix.covariance[(1, 1)]);
        }
        if fix.heading_known {
            (after.pose.theta, after.turn_rad) = (wrap_angle(fix.pose.theta), 0.0);
            self.left_open.1 = fix.covariance[(2, 2)];
        }
        after.errors = self.errors(after.travel_m, after.turn_rad);
        self.last = Some((odom_from_base, after));
        Ok(after)
    }

    /// Eqs 1–4 since the last fix, and what that left open.
    fn errors(&self, travel_m: f64, turn_rad: f64) -> OdometryErrors {
        let errors = self.model.errors(travel_m, turn_rad);
        let (lin_m2, ang_rad2) = self.left_open;
        OdometryErrors {
            eps_lin_m2: errors.eps_lin_m2 + lin_m2,
            eps_ang_rad2: errors.eps_ang_rad2 + ang_rad2,
            ..errors
        }
    }

    fn moved(&mut self, before: &Estimate, measured: Increment) -> Estimate {
        let step = self.model.believed(measured);
        self.joint = self.joint.moved(&self.model.config, before.pose, step);
        let travel_m = before.travel_m + step.length_m();
        let turn_rad = before.turn_rad + step.turn_rad.abs();
        Estimate {
            pose: move_by(before.pose, step),
            covariance: self.joint.pose(),
            travel_m,
            turn_rad,
            errors: self.errors(travel_m, turn_rad),
            fixes: before.fixes,
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI};

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    fn config(systematic: Systematic) -> OdometryConfig {
        OdometryConfig { systematic, lin_offset_m: 0.01, ang_offset_rad: 0.02, ..OdometryConfig::default() }
    }

    fn close(a: Pose2, b: Pose2) -> bool {
        a.distance_m(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-9
    }

    #[test]
    fn backwards_is_negative() {
        let step = Increment::between(Pose2::new(0.0, 0.0, FRAC_PI_2), Pose2::new(0.0, -0.5, FRAC_PI_2));
        assert!((step.forward_m + 0.5).abs() < 1e-15);
        assert!(step.lateral_m.abs() < 1e-15);
        assert!((step.length_m() - 0.5).abs() < 1e-15);
    }

    #[test]
    fn a_turn_across_pi_is_small() {
        let step = Increment::between(Pose2::new(0.0, 0.0, 3.1), Pose2::new(0.0, 0.0, -3.1));
        assert!((step.turn_rad - (2.0 * PI - 6.2)).abs() < 1e-12);
    }

    #[test]
    fn first_pose_is_the_map_pose() {
        let first = Pose2::new(3.0, -2.0, 1.0);
        assert_eq!(Odometry::new(&config(Systematic::Carry)).step(first), Estimate::certain(first));
    }

    #[test]
    fn errors_grow_with_the_way_not_with_the_displacement() {
        let mut odometry = Odometry::new(&config(Systematic::Carry));
        for x in [0.0, 1.0, 0.0, 1.0, 0.0] {
            odometry.step(Pose2::new(x, 0.0, 0.0));
        }
        let estimate = odometry.step(Pose2::new(0.0, 0.0, -0.5));
        assert!((estimate.travel_m - 4.0).abs() < 1e-12);
        assert!((estimate.turn_rad - 0.5).abs() < 1e-12);
        assert!((estimate.errors.e_lin_m - (0.09 * 4.0 + 0.01)).abs() < 1e-12);
        assert!((estimate.errors.e_ang_rad - (0.095 * 0.5 + 0.02)).abs() < 1e-12);
    }

    #[test]
    fn offsets_count_from_their_thresholds() {
        let model = ErrorModel::new(&config(Systematic::Carry));
        assert_eq!(model.errors(0.0, 0.0), OdometryErrors::default());
        assert!(model.errors(0.0, 0.08).e_lin_m < 0.01);
        assert!(model.errors(0.0, 0.09).e_lin_m >= 0.01);
        assert!(model.errors(0.09, 0.0).e_ang_rad < 0.02);
        assert!(model.errors(0.10, 0.0).e_ang_rad >= 0.02);
    }

    #[test]
    fn correct_takes_the_scale_out() {
        let mut odometry = Odometry::new(&config(Systematic::Correct));
        odometry.step(Pose2::IDENTITY);
        let ahead = odometry.step(Pose2::new(10.0, 0.0, 0.0));
        assert!((ahead.pose.x - 9.1).abs() < 1e-12);
        assert!((ahead.travel_m - 9.1).abs() < 1e-12);
        assert_eq!((ahead.errors.e_lin_m, ahead.errors.e_ang_rad), (0.0, 0.0));
        let turned = odometry.step(Pose2::new(10.0, 0.0, 1.0));
        assert!((turned.pose.theta - 0.905).abs() < 1e-12);
    }

    #[test]
    fn a_pose_that_is_not_finite_changes_nothing() {
        let mut odometry = Odometry::new(&config(Systematic::Carry));
        assert!(!odometry.step(Pose2 { x: f64::NAN, ..Pose2::IDENTITY }).pose.is_finite());
        assert_eq!(odometry.step(Pose2::IDENTITY), Estimate::certain(Pose2::IDENTITY));
        assert!(!odometry.step(Pose2 { y: f64::INFINITY, ..Pose2::IDENTITY }).pose.is_finite());
        let next = odometry.step(Pose2::new(1.0, 0.0, 0.0));
        assert!(close(next.pose, Pose2::new(1.0, 0.0, 0.0)));
        assert!((next.travel_m - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_fix_sets_the_errors_back() {
        let mut odometry = Odometry::new(&config(Systematic::Carry));
        assert_eq!(odometry.apply(&Fix::certain(Pose2::IDENTITY)).unwrap_err().value, "too early");
        odometry.step(Pose2::new(5.0, 5.0, 0.0));
        odometry.step(Pose2::new(8.0, 5.0, 0.4));
        let fixed = odometry.apply(&Fix::certain(Pose2::new(7.5, 5.2, 0.5))).unwrap();
        assert_eq!(fixed, Estimate { fixes: 1, ..Estimate::certain(Pose2::new(7.5, 5.2, 0.5)) });
        // From there on by the steps of the drive, seen from the corrected heading.
        let next = odometry.step(Pose2::new(8.0 + libm::cos(0.4), 5.0 + libm::sin(0.4), 0.4));
        assert!(close(next.pose, Pose2::new(7.5 + libm::cos(0.5), 5.2 + libm::sin(0.5), 0.5)));
        assert!((next.travel_m - 1.0).abs() < 1e-12 && next.fixes == 1);
    }

    #[test]
    fn what_a_fix_leaves_open_stays() {
        let mut odometry = Odometry::new(&config(Systematic::Off));
        odometry.step(Pose2::IDENTITY);
        odometry.step(Pose2::new(10.0, 0.0, 0.0));
        let fixed = odometry.apply(&Fix::about(Pose2::new(9.0, 0.0, 0.0), 0.1, 0.02)).unwrap();
        assert!((fixed.errors.eps_lin_m2 - 0.01).abs() < 1e-15 && (fixed.errors.eps_ang_rad2 - 4e-4).abs() < 1e-15);
        let next = odometry.step(Pose2::new(11.0, 0.0, 0.0));
        assert!((next.errors.eps_lin_m2 - 0.01 - 4e-4).abs() < 1e-15);
        // Position only: heading, its doubt and Θ stay.
        odometry.step(Pose2::new(11.0, 0.0, 1.0));
        let place = Fix { heading_known: false, ..Fix::certain(Pose2::new(3.0, 4.0, f64::from(9_u8))) };
        let fixed = odometry.apply(&place).unwrap();
        assert!(close(fixed.pose, Pose2::new(3.0, 4.0, 1.0)));
        assert!((fixed.turn_rad - 1.0).abs() < 1e-12 && fixed.travel_m == 0.0);
        assert!(fixed.covariance[(2, 2)] > 0.0 && fixed.covariance[(0, 2)] == 0.0);
        let refused = Fix { covariance: -nalgebra::Matrix3::identity(), ..place };
        assert!(odometry.apply(&refused).is_err());
    }

    #[test]
    fn a_sideways_step_is_followed_and_doubted() {
        let mut odometry = Odometry::new(&config(Systematic::Off));
        odometry.step(Pose2::IDENTITY);
        let estimate = odometry.step(Pose2::new(0.0, 2.0, 0.0));
        assert!(close(estimate.pose, Pose2::new(0.0, 2.0, 0.0)));
        assert!((estimate.covariance[(1, 1)] - 2.0 * 4e-4).abs() < 1e-15);
    }

    #[test]
    fn interpolation_is_linear_and_never_extrapolates() {
        let mut odometry = Odometry::new(&config(Systematic::Carry));
        odometry.step(Pose2::IDENTITY);
        let a = odometry.step(Pose2::new(1.0, 0.0, 0.2));
        let b = odometry.step(Pose2::new(2.0, 1.0, 0.6));
        let middle = a.interpolate(&b, 0.5);
        assert!((middle.travel_m - 0.5 * (a.travel_m + b.travel_m)).abs() < 1e-12);
        assert!((middle.errors.eps_lin_m2 - 0.5 * (a.errors.eps_lin_m2 + b.errors.eps_lin_m2)).abs() < 1e-15);
        assert!((middle.covariance - (a.covariance + b.covariance) * 0.5).norm() < 1e-15);
        assert_eq!(a.interpolate(&b, 0.0), a);
        assert_eq!(a.interpolate(&b, 1.0), b);
        assert_eq!(a.interpolate(&b, 7.0), b);
        assert_eq!(a.interpolate(&b, -1.0), a);
        assert_eq!(a.interpolate(&b, f64::NAN), a);
    }

    fn any_pose() -> impl Strategy<Value = Pose2> {
        (-5.0..5.0f64, -5.0..5.0f64, -4.0..4.0f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
    }

    proptest! {
        #[test]
        fn steps_add_up_to_the_logs_own_poses(poses in prop::collection::vec(any_pose(), 2..30)) {
            let mut odometry = Odometry::new(&config(Systematic::Off));
            for pose in poses {
                prop_assert!(close(odometry.step(pose).pose, pose));
            }
        }

        #[test]
        fn covariance_stays_symmetric_and_grows(poses in prop::collection::vec(any_pose(), 2..30)) {
            let mut odometry = Odometry::new(&config(Systematic::Off));
            let mut heading = -1.0;
            for pose in poses {
                let c = odometry.step(pose).covariance;
                prop_assert_eq!(c, c.transpose());
                prop_assert!(c[(2, 2)] >= heading);
                heading = c[(2, 2)];
                // No direction has a negative variance, but for rounding.
                for direction in [Vector3::x(), Vector3::new(1.0, -1.0, 0.3), Vector3::new(-0.2, 0.9, 2.0)] {
                    prop_assert!((direction.transpose() * c * direction)[0] >= -1e-12 * (1.0 + c.norm()));
                }
            }
        }

        #[test]
        fn where_the_map_lies_does_not_matter(a in any_pose(), b in any_pose(), frame in any_pose()) {
            let step = Increment::between(a, b);
            let moved = Increment::between(frame * a, frame * b);
            prop_assert!((step.length_m() - moved.length_m()).abs() < 1e-9);
            prop_assert!(wrap_angle(step.turn_rad - moved.turn_rad).abs() < 1e-9);
        }
    }
}
