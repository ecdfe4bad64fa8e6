//! Dead reckoning and what it is worth: the odometry error model (eqs 1–4) and the pose covariance.
//!
//! The robot's drive reports poses in its own odometry frame. Each step between two of them is an
//! [`Increment`]; the [`Odometry`] adds the increments up into an [`Estimate`] of where the robot is
//! in the map and how much doubt has gathered since it last knew.

mod error_model;
mod estimate;
pub mod fix;
pub mod gate;
pub mod incidents;
mod increment;
pub mod joint;
pub(crate) mod kalman;
pub mod leap;
pub mod sideways;
pub mod smoothing;

pub use error_model::{ErrorModel, OdometryErrors};
pub use estimate::Estimate;
use fix::{Fix, FixError};
use gate::{Doubted, Gate, UNCALIBRATED};
pub use increment::{Increment, move_by};
use joint::Scales;
use kalman::Innovation;
use leap::Leap;
use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;
use crate::config::{OdometryConfig, Poses};
use crate::pose::Pose2;

/// Dead reckoning: the state that turns odometry poses into estimates.
///
/// ```
/// use echogrid_core::{Odometry, OdometryConfig, Pose2};
///
/// let mut odometry = Odometry::new(&OdometryConfig::default());
/// odometry.step(Pose2::IDENTITY);
/// let near = odometry.step(Pose2::new(1.0, 0.0, 0.0));
/// let far = odometry.step(Pose2::new(5.0, 0.0, 0.0));
/// assert_eq!(far.travel_m, 5.0);
/// assert!(far.errors.eps_lin_m2 > near.errors.eps_lin_m2, "the error grows with the way");
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Odometry {
    model: ErrorModel,
    last: Option<(Pose2, Estimate)>,
    /// What the last fix left open: variances that no way adds to, m² and rad².
    left_open: (f64, f64),
    /// None unless the last fix was refused.
    doubted: Option<Doubted>,
}

impl Odometry {
    /// The odometry before the first pose.
    #[must_use]
    pub fn new(config: &OdometryConfig) -> Self {
        Self { model: ErrorModel::new(&config.resolved()), last: None, left_open: (0.0, 0.0), doubted: None }
    }

    /// The estimate at the next pose that the drive reports. The first pose is taken as it stands as the map pose, unless
    /// [`OdometryConfig::start`] says where it is.
    ///
    /// A pose that is not finite changes nothing here and comes back as it is in an estimate whose pose is not finite,
    /// so that nothing is mapped from it.
    pub fn step(&mut self, odom_from_base: Pose2) -> Estimate {
        if !odom_from_base.is_finite() {
            let last = self.last.map_or_else(|| self.first(odom_from_base), |(_, estimate)| estimate);
            return Estimate { pose: odom_from_base, ..last };
        }
        let estimate = match self.last {
            None => self.first(self.model.config.start.pose().unwrap_or(odom_from_base)),
            Some((odom_from_before, before)) => {
                self.moved(&before, Increment::between(odom_from_before, odom_from_base))
            }
        };
        self.last = Some((odom_from_base, estimate));
        estimate
    }

    /// The estimate at a pose that the drive did not get to by driving: the robot went on as before, or did
    /// anything else that it may have done meanwhile. That doubt stays until the next fix. Exact poses are believed: theirs is a correction.
    pub fn leapt(&mut self, odom_from_base: Pose2, leap: &Leap) -> Estimate {
        let Some((_, before)) = self.last.filter(|_| self.model.config.poses == Poses::Drive) else {
            return self.step(odom_from_base);
        };
        self.doubted = None;
        let mut after = self.moved(&before, leap.expected);
        // Where it may be at most is two standard deviations away.
        let square = |reach: f64| 0.25 * reach * reach;
        let (lin_m2, ang_rad2) = (square(leap.reach_m), square(leap.reach_rad));
        self.left_open.0 += lin_m2;
        self.left_open.1 += ang_rad2;
        for (place, variance) in [lin_m2, lin_m2, ang_rad2].into_iter().enumerate() {
            after.covariance[(place, place)] += variance;
        }
        after.errors = self.errors(after.travel_m, after.turn_rad);
        self.last = Some((odom_from_base, after));
        after
    }

    /// How far off the fix is from where the robot is now, if no odometry is so bad: beyond the gate, and beyond what a drive
    /// that nobody calibrated is off by. None while nothing has said where the map lies. The fix, the reference that it is
    /// taken from, or the odometry is then of another drive, frame or unit; or the robot was carried off.
    #[must_use]
    pub fn contradiction(&self, fix: &Fix, gate: Gate) -> Option<Contradiction> {
        let (_, before) = self.last.filter(|_| fix.validate().is_ok())?;
        if before.fixes == 0 && self.model.config.start.is_open() {
            return None;
        }
        let innovation = Innovation::of(fix, before.pose, &before.covariance);
        let off = innovation.off;
        let found = Contradiction {
            off_m: libm::hypot(off[0], off[1]),
            off_rad: off[2].abs(),
            travel_m: before.travel_m,
            turn_rad: before.turn_rad,
        };
        let gate = Gate { sigmas: if gate.sigmas > 0.0 { gate.sigmas } else { Gate::DEFAULT_SIGMAS }, ..gate };
        (gate.is_too_far(innovation.sigmas) && found.is_no_drift()).then_some(found)
    }

    /// The latest estimate whose pose was finite.
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        self.last.map(|(_, estimate)| estimate)
    }

    /// The estimate, corrected by an absolute localization of where the robot is now: a Kalman update, which also teaches
    /// the scales where they are in doubt. An exact fix is the pose: "odometry error goes to zero here" (Fig. 13). The doubt
    /// that is left stays in ε_lin and ε_ang until the next one. Λ begins again with a position, Θ with a heading.
    ///
    /// What is too far off for `gate` is no error of the odometry: it teaches nothing about it. It is refused, unless it is
    /// exact, the first one, or the gate is open; then it takes the place of what was believed. So does the third in a row
    /// that agree with each other: the robot has been carried off; and the tenth in a row, whatever it says.
    ///
    /// # Errors
    /// The fix can't be one, or no pose has come yet that it could correct, or it is refused, which is counted.
    pub fn apply(&mut self, fix: &Fix, gate: Gate) -> Result<Estimate, FixError> {
        fix.validate()?;
        let Some((odom_from_base, before)) = self.last else {
            return Err(FixError {
                field: "fix",
                value: "too early".to_owned(),
                expected: "an odometry pose before it",
            });
        };
        let innovation = Innovation::of(fix, before.pose, &before.covariance);
        let too_far = gate.is_too_far(innovation.sigmas);
        // Where the map lies is for the first one to say.
        if too_far && gate.refuses && before.fixes > 0 && !innovation.is_exact() {
            let doubted = Doubted::after(self.doubted.as_ref(), fix, &before, gate);
            let believed = doubted.is_believed();
            self.doubted = Some(doubted);
            if !believed {
                self.last = Some((odom_from_base, Estimate { refused: before.refused.saturating_add(1), ..before }));
                return Err(refusal(&innovation));
            }
        }
        self.doubted = None;
        let mut after = Estimate { fixes: before.fixes.saturating_add(1), ..before };
        let replaces = gate.places || too_far || innovation.sigmas.is_infinite();
        if replaces {
            after.covariance = innovation.replace(&before.covariance);
        } else {
            let (gained, covariance) = innovation.update(&before.covariance);
            let Pose2 { x, y, theta } = before.pose;
            after.pose = Pose2::new(x + gained[0], y + gained[1], theta + gained[2]);
            after.scales = before.scales.taught(gained[3], gained[4]);
            after.covariance = covariance;
        }
        let is_the_pose = replaces || innovation.is_exact();
        if fix.position_known {
            if is_the_pose {
                (after.pose.x, after.pose.y) = (fix.pose.x, fix.pose.y);
            }
            after.travel_m = 0.0;
        }
        if fix.heading_known {
            if is_the_pose {
                after.pose.theta = wrap_angle(fix.pose.theta);
            }
            after.turn_rad = 0.0;
        }
        // Of what the fix did not tell no doubt is gone with Λ or Θ.
        let model = self.model.errors(after.travel_m, after.turn_rad);
        self.left_open.0 = if fix.position_known {
            0.5 * (after.covariance[(0, 0)] + after.covariance[(1, 1)])
        } else {
            before.errors.eps_lin_m2 - model.eps_lin_m2
        };
        self.left_open.1 =
            if fix.heading_known { after.covariance[(2, 2)] } else { before.errors.eps_ang_rad2 - model.eps_ang_rad2 };
        after.errors = self.errors(after.travel_m, after.turn_rad);
        self.last = Some((odom_from_base, after));
        Ok(after)
    }

    fn first(&self, pose: Pose2) -> Estimate {
        let config = &self.model.config;
        Estimate { covariance: joint::certain(config), scales: Scales::of(config), ..Estimate::certain(pose) }
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
        let (config, scales) = (&self.model.config, before.scales);
        if let Some(doubted) = &mut self.doubted {
            doubted.moved(config, scales, measured);
        }
        let step = scales.correct(measured);
        let travel_m = before.travel_m + step.length_m();
        let turn_rad = before.turn_rad + step.turn_rad.abs();
        Estimate {
            pose: move_by(before.pose, step),
            covariance: joint::moved(&before.covariance, config, before.pose, scales, measured),
            travel_m,
            turn_rad,
            errors: self.errors(travel_m, turn_rad),
            ..*before
        }
    }
}

/// A fix and an odometry that can't both be right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contradiction {
    /// How far the fix is from where the robot was believed to be, metres; 0 if it has no position.
    pub off_m: f64,
    /// How far the fix is from the heading that was believed, radians, 0 or more; 0 if it has no heading.
    pub off_rad: f64,
    /// The way since the fix before, metres.
    pub travel_m: f64,
    /// The turn since the fix before, radians.
    pub turn_rad: f64,
}

impl Contradiction {
    /// Whether it is more than a drive drifts that nobody calibrated: wrong by a share of its way and of its turns. What the
    /// heading is off by at the end, it was by half on the way.
    fn is_no_drift(&self) -> bool {
        let turned_rad = UNCALIBRATED * self.turn_rad + 0.05 * self.travel_m.min(2.0) + 0.1;
        let moved_m = UNCALIBRATED * self.travel_m + 0.5 * turned_rad.min(1.0) * self.travel_m + 0.1;
        self.off_m > moved_m || self.off_rad > turned_rad
    }
}

fn refusal(innovation: &Innovation) -> FixError {
    let [x, y, theta] = [innovation.off[0], innovation.off[1], innovation.off[2]];
    let (off_m, off_deg) = (libm::hypot(x, y), theta.abs().to_degrees());
    FixError {
        field: "fix",
        value: format!("{off_m:.2} m and {off_deg:.1}° off, {:.1} standard deviations", innovation.sigmas),
        expected: "no more than localization.gate_sigmas, unless three in a row agree",
    }
}

#[cfg(test)]
mod tests;
