//! Where a robot is in a map that is known: by what its sonars hear, or by what its lidar sees.
//!
//! The last metres of a drive are one rigid piece, whose shape the odometry says; it is laid on the map. That nobody can say where it
//! lies is an answer, too: each comes with its reason.

mod coarse;
mod echoes;
mod ground;
mod laid;
mod outlines;
#[cfg(test)]
mod tests;
mod trail;

use core::fmt::Display;

pub use echoes::{Echo, EchoMap};
use echogrid_core::Pose2;
pub use ground::{Ground, GroundError, MapModel};
pub use outlines::OutlineMap;
pub use trail::{Stop, Trail};

use crate::matrix::{self, Matrix};

/// What was known of a pose before: where, and the covariance of (x, y, θ) in the map's frame; m², m rad, rad².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// The robot in the map.
    pub pose: Pose2,
    /// How exactly.
    pub covariance: Matrix,
}

impl Prior {
    /// Standard deviations along the worse axis and of the heading, metres and radians.
    fn sigmas(&self) -> (f64, f64) {
        let variance = self.covariance[0][0].max(self.covariance[1][1]);
        (variance.max(0.0).sqrt(), self.covariance[2][2].max(0.0).sqrt())
    }

    /// Inverse of the covariance; what is known exactly is known to a millimetre and a thousandth of a radian.
    fn information(&self) -> Matrix {
        matrix::inverse(&matrix::sum(&self.covariance, &matrix::diagonal([1e-6; 3])))
    }
}

/// What a place must fulfil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gates {
    /// Mean over the readings of ln T(map) − ln T(nothing there), nat, at least.
    pub evidence_min: f64,
    /// By how much the next best place must be worse, nat a reading.
    pub margin_min: f64,
}

/// A place in a known map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// The robot in the map.
    pub pose: Pose2,
    /// The covariance of (x, y, θ) in the map's frame, without what was known before; m², m rad, rad².
    pub covariance: Matrix,
    /// How well it fits: of sonars nat a reading, of a lidar the share of points on walls.
    pub evidence: f64,
}

/// Why a place can't be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unlocated {
    /// Too little was heard or seen so far.
    TooFew {
        /// Readings that there are.
        readings: usize,
        /// Readings that it takes.
        needed: usize,
    },
    /// Nowhere does it fit.
    NoFit {
        /// How well the best place fits.
        evidence: f64,
        /// What it takes.
        needed: f64,
    },
    /// It fits elsewhere, too.
    Ambiguous {
        /// How far away, metres.
        apart_m: f64,
        /// By how much worse.
        margin: f64,
        /// By how much it must be.
        needed: f64,
    },
}

impl Display for Unlocated {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooFew { readings, needed } => {
                write!(f, "{readings} readings on the last metres are too few to find a place by; it takes {needed}")
            }
            Self::NoFit { evidence, needed } => {
                write!(
                    f,
                    "nowhere in the map do the readings fit: {evidence:.2} at best, where {needed:.2} is asked for"
                )
            }
            Self::Ambiguous { apart_m, margin, needed } => write!(
                f,
                "the readings fit {apart_m:.1} m away nearly as well: by {margin:.2} worse, where {needed:.2} is asked for"
            ),
        }
    }
}
