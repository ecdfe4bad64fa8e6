//! The fit itself.

use super::Trial;
use super::phase::{Phase, Shares};
use crate::config::OdometryConfig;

/// The coefficients of eqs 1–4.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Calibration {
    /// a_l, metres of error per metre measured.
    pub lin_scale: f64,
    /// σ, the systematic linear error besides (eq 1), metres.
    pub lin_offset_m: f64,
    /// a_θ, radians of error per radian measured.
    pub ang_scale: f64,
    /// α, the systematic angular error besides (eq 2), radians.
    pub ang_offset_rad: f64,
    /// κ_ll, variance of the linear error per metre measured (eq 3), m²/m.
    pub k_ll: f64,
    /// κ_lθ, variance of the linear error per radian measured (eq 3), m²/rad.
    pub k_lt: f64,
    /// κ_θθ, variance of the angular error per radian measured (eq 4), rad²/rad.
    pub k_tt: f64,
    /// κ_θl, variance of the angular error per metre measured (eq 4), rad²/m.
    pub k_tl: f64,
}

/// Why trials make no model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A variance needs two.
    #[error("{count} trials of {phase}; expected two or more")]
    TooFew {
        /// Which phase: translation or rotation.
        phase: &'static str,
        /// How many there are.
        count: usize,
    },
    /// An interval needs more.
    #[error(
        "{count} trials of {phase}; expected {} or more, of which a confidence interval can be told",
        super::TRIALS_MIN
    )]
    TooFewForIntervals {
        /// Which phase.
        phase: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A number that is none.
    #[error("trial {number} of {phase} is not finite; expected finite metres and radians")]
    NotFinite {
        /// Which phase.
        phase: &'static str,
        /// Counted from 1.
        number: usize,
    },
    /// Nothing to divide by.
    #[error("no trial of {phase} measured any {phase}")]
    NoWay {
        /// Which phase.
        phase: &'static str,
    },
}

impl Calibration {
    /// Eqs 5–8: the odometry error model of a robot that made these trials.
    ///
    /// # Errors
    /// Too few trials of a phase, numbers that are not finite, or no way in them.
    pub fn fit(translations: &[Trial], rotations: &[Trial]) -> Result<Self, CalibrationError> {
        check("translation", translations, |trial| trial.measured_m)?;
        check("rotation", rotations, |trial| trial.measured_rad)?;
        Ok(Self::of(&Phase::translation(translations), &Phase::rotation(rotations)))
    }

    /// What the two phases come to; they were checked.
    pub(super) fn of(translation: &Phase, rotation: &Phase) -> Self {
        Self::from_shares(translation.shares(), rotation.shares())
    }

    /// Each phase tells four coefficients.
    pub(super) fn from_shares(translation: Shares, rotation: Shares) -> Self {
        Self {
            lin_scale: translation.scale,
            lin_offset_m: rotation.offset,
            ang_scale: rotation.scale,
            ang_offset_rad: translation.offset,
            k_ll: translation.k_own,
            k_lt: rotation.k_other,
            k_tt: rotation.k_own,
            k_tl: translation.k_other,
        }
    }

    /// A configuration with these coefficients; what is done with them stays as in `config`.
    #[must_use]
    pub fn applied_to(&self, config: &OdometryConfig) -> OdometryConfig {
        OdometryConfig {
            lin_scale: self.lin_scale,
            lin_offset_m: self.lin_offset_m,
            ang_scale: self.ang_scale,
            ang_offset_rad: self.ang_offset_rad,
            k_ll: self.k_ll,
            k_lt: self.k_lt,
            k_tt: self.k_tt,
            k_tl: self.k_tl,
            ..config.clone()
        }
    }
}

/// Whether trials make a phase.
pub(super) fn check(
    phase: &'static str,
    trials: &[Trial],
    displacement: impl Fn(&Trial) -> f64,
) -> Result<(), CalibrationError> {
    if trials.len() < 2 {
        return Err(CalibrationError::TooFew { phase, count: trials.len() });
    }
    let finite = |t: &Trial| [t.measured_m, t.measured_rad, t.true_m, t.true_rad].into_iter().all(f64::is_finite);
    if let Some(index) = trials.iter().position(|trial| !finite(trial)) {
        return Err(CalibrationError::NotFinite { phase, number: index + 1 });
    }
    let moves = trials.iter().any(|trial| displacement(trial) != 0.0);
    if moves { Ok(()) } else { Err(CalibrationError::NoWay { phase }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(measured_m: f64, measured_rad: f64, true_m: f64, true_rad: f64) -> Trial {
        Trial { measured_m, measured_rad, true_m, true_rad }
    }

    #[test]
    fn by_hand() {
        let translations = [trial(1.0, 0.02, 0.9, 0.0), trial(2.0, 0.04, 1.8, 0.0), trial(-1.0, 0.03, -0.9, 0.0)];
        let rotations = [trial(0.01, 1.0, 0.0, 0.8), trial(0.03, -2.0, 0.0, -1.6)];
        let fit = Calibration::fit(&translations, &rotations).unwrap();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}: {fit:?}");
        close(fit.lin_scale, 0.1);
        close(fit.ang_scale, 0.2);
        close(fit.lin_offset_m, 0.02);
        close(fit.ang_offset_rad, 0.03);
        close(fit.k_ll, 0.0);
        close(fit.k_tt, 0.0);
        close(fit.k_tl, 1e-4 / (4.0 / 3.0));
        close(fit.k_lt, 2e-4 / 1.5);
        let config = fit.applied_to(&OdometryConfig::default());
        assert_eq!((config.lin_scale, config.seed), (fit.lin_scale, 1));
    }

    #[test]
    fn what_makes_no_model() {
        let good = [trial(1.0, 1.0, 1.0, 1.0); 2];
        let check = |translations: &[Trial], rotations: &[Trial], expected: &str| {
            let told = Calibration::fit(translations, rotations).unwrap_err().to_string();
            assert_eq!(told, expected);
        };
        check(&good[..1], &good, "1 trials of translation; expected two or more");
        check(&good, &[], "0 trials of rotation; expected two or more");
        check(&good, &[trial(0.0, 0.0, 0.0, 1.0); 3], "no trial of rotation measured any rotation");
        let bad = [good[0], trial(1.0, f64::NAN, 1.0, 0.0)];
        check(&bad, &good, "trial 2 of translation is not finite; expected finite metres and radians");
    }
}
