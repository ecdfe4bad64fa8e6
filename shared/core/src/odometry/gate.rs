//! Which absolute fixes are believed.

use core::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::estimate::Estimate;
use super::fix::Fix;
use super::increment::{Increment, move_by};
use super::joint::{self, JointCovariance, Scales};
use super::kalman::Innovation;
use crate::config::OdometryConfig;
use crate::pose::Pose2;

/// So many refused fixes in a row that agree with each other are believed: the robot has been carried off.
const AGREEING: u32 = 3;
/// So many refused fixes in a row are believed, whatever they say: who is sure of itself and wrong must not refuse for ever.
const IN_A_ROW: u32 = 10;
/// What the scales may be off by when fixes are compared: a robot that nobody calibrated is no better.
pub(crate) const UNCALIBRATED: f64 = 0.1;

/// What becomes of a fix that is too far off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Mahalanobis distance beyond which a fix is too far off, standard deviations; 0: none is.
    pub sigmas: f64,
    /// Whether it is refused then. If not, or if it is exact, it takes the place of what was believed.
    pub refuses: bool,
    /// Whether every fix takes the place of what was believed: nothing has said yet where the map lies.
    pub places: bool,
}

impl Gate {
    /// Standard deviations that a good fix is never off by: one in 65 000 is, of three numbers that are normally distributed.
    pub const DEFAULT_SIGMAS: f64 = 5.0;

    /// Refuses what is farther off than `sigmas`; 0: nothing.
    #[must_use]
    pub fn closed(sigmas: f64) -> Self {
        Self { sigmas, refuses: true, places: false }
    }

    /// Refuses nothing: for who knows better.
    #[must_use]
    pub fn open() -> Self {
        Self { sigmas: Self::DEFAULT_SIGMAS, refuses: false, places: false }
    }

    /// The gate for the fix that says where the map lies.
    #[must_use]
    pub fn placing() -> Self {
        Self { places: true, ..Self::open() }
    }

    pub(crate) fn is_too_far(&self, sigmas: f64) -> bool {
        self.sigmas > 0.0 && sigmas > self.sigmas
    }
}

/// Where the robot would be by the last fix that was refused.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Doubted {
    pose: Pose2,
    covariance: JointCovariance,
    agreeing: u32,
    in_a_row: u32,
}

impl Doubted {
    /// After one more fix that is too far off from `estimate`.
    pub(crate) fn after(before: Option<&Self>, fix: &Fix, estimate: &Estimate, gate: Gate) -> Self {
        let agrees = |before: &&Self| !gate.is_too_far(Innovation::of(fix, before.pose, &before.covariance).sigmas);
        let mut pose = estimate.pose;
        let mut covariance = Innovation::of(fix, pose, &estimate.covariance).replace(&estimate.covariance);
        if fix.position_known {
            (pose.x, pose.y) = (fix.pose.x, fix.pose.y);
        }
        if fix.heading_known {
            pose.theta = fix.pose.theta;
        } else {
            // Who is not where it was believed to be may look anywhere.
            covariance[(2, 2)] = PI * PI / 3.0;
        }
        for scale in [3, 4] {
            covariance.fill_row(scale, 0.0);
            covariance.fill_column(scale, 0.0);
            covariance[(scale, scale)] = UNCALIBRATED * UNCALIBRATED;
        }
        Self {
            pose,
            covariance,
            agreeing: before.filter(agrees).map_or(1, |before| before.agreeing + 1),
            in_a_row: before.map_or(1, |before| before.in_a_row.saturating_add(1)),
        }
    }

    /// Whether it is time to believe it.
    pub(crate) fn is_believed(&self) -> bool {
        self.agreeing >= AGREEING || self.in_a_row >= IN_A_ROW
    }

    pub(crate) fn moved(&mut self, config: &OdometryConfig, scales: Scales, measured: Increment) {
        self.covariance = joint::moved(&self.covariance, config, self.pose, scales, measured);
        self.pose = move_by(self.pose, scales.correct(measured));
    }
}
