//! The odometry error model from trials (eqs 5–8, after Chenavier and Crowley).
//!
//! Two phases of trials: translation only, then rotation only. Each trial is what odometry measured and what really
//! happened; the error e of a trial is measured − true.
//!
//! | coefficient | from | how |
//! |---|---|---|
//! | a_l | translations | least-squares slope through the origin of e_lin against the measured Δl |
//! | a_θ | rotations | the same of e_ang against the measured Δθ |
//! | σ | rotations | mean of e_lin |
//! | α | translations | mean of e_ang |
//! | κ_ll | translations | Var(e_lin − a_l Δl) / mean abs Δl |
//! | κ_θl | translations | Var(e_ang) / mean abs Δl |
//! | κ_θθ | rotations | Var(e_ang − a_θ Δθ) / mean abs Δθ |
//! | κ_lθ | rotations | Var(e_lin) / mean abs Δθ |
//!
//! Variances are those of samples (n − 1); Δl and Δθ are the measured ones.
//!
//! [`Drive`] cuts trials out of a drive whose truth is known; [`Bootstrap`] tells how far a fit can be trusted. [`Profile`] tells likewise of a
//! parameter of a sensor.

mod bootstrap;
mod fit;
mod phase;
mod pieces;
mod profile;

pub use bootstrap::{Bootstrap, RESAMPLES, TRIALS_MIN};
pub use fit::{Calibration, CalibrationError};
pub use pieces::{Drive, Limits, separate};
pub use profile::{Profile, Told};

/// One trial: what the odometry measured, and what really happened.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Trial {
    /// Δl as the odometry has it, metres along the way; negative backwards.
    pub measured_m: f64,
    /// Δθ as the odometry has it, radians, not wrapped.
    pub measured_rad: f64,
    /// Δl as it was, metres.
    pub true_m: f64,
    /// Δθ as it was, radians, not wrapped.
    pub true_rad: f64,
}

impl Trial {
    /// The error of Δl, measured less true, metres.
    #[must_use]
    pub fn lin_error_m(&self) -> f64 {
        self.measured_m - self.true_m
    }

    /// The error of Δθ, measured less true, radians.
    #[must_use]
    pub fn ang_error_rad(&self) -> f64 {
        self.measured_rad - self.true_rad
    }
}
