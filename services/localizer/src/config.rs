//! `[localizer]`: who knows where the robot is, and how well.

use echogrid_core::config::ConfigError;
use serde::{Deserialize, Serialize};

/// Who knows where the robot is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// Nobody.
    None,
    /// The user, who says `echogrid fix`.
    Operator,
    /// The sensor itself: a simulator, or a log with true poses.
    Truth,
}

/// `[localizer]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LocalizerConfig {
    /// Who knows where the robot is.
    pub source: Source,
    /// Standard deviation of the position that is told, metres along each axis.
    pub position_sigma_m: f64,
    /// Standard deviation of the heading that is told, radians.
    pub heading_sigma_rad: f64,
    /// Seed of these errors.
    pub seed: u64,
}

impl Default for LocalizerConfig {
    fn default() -> Self {
        Self { source: Source::None, position_sigma_m: 0.0, heading_sigma_rad: 0.0, seed: 1 }
    }
}

impl LocalizerConfig {
    /// Whether a process answers, rather than the user or nobody.
    #[must_use]
    pub fn is_served(&self) -> bool {
        !matches!(self.source, Source::None | Source::Operator)
    }

    /// Every value within its range, or the first that is not.
    ///
    /// # Errors
    /// Names the key, what it is and what it should be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let sigma = |key, value: f64, expected| {
            let right = value.is_finite() && value >= 0.0;
            if right { Ok(()) } else { Err(ConfigError { key, value: value.to_string(), expected }) }
        };
        sigma("position_sigma_m", self.position_sigma_m, "metres, 0 or more")?;
        sigma("heading_sigma_rad", self.heading_sigma_rad, "radians, 0 or more")
    }
}
