//! `[supervision]`: what happens when a service dies or hangs.

use echogrid_core::config::ConfigError;
use serde::{Deserialize, Serialize};

/// The `[supervision]` section: what happens when a service dies or hangs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SupervisionConfig {
    /// Who is restarted with a service that died.
    pub strategy: Strategy,
    /// How often one service may be restarted within `window_s`.
    pub restarts_max: u32,
    /// Seconds after which a restart is forgotten.
    pub window_s: f64,
    /// The pause before the first restart, seconds; each further one within the window waits twice as long, up to `backoff_max_s`.
    pub backoff_s: f64,
    /// The longest pause before a restart, seconds.
    pub backoff_max_s: f64,
    /// The longest time from a service's start to its readiness, seconds; one that takes longer hangs.
    pub ready_within_s: f64,
    /// The longest time from the readiness of all to the sensor's first message, and from that to the first of those who read it, seconds.
    pub first_output_within_s: f64,
}

impl Default for SupervisionConfig {
    fn default() -> Self {
        Self {
            strategy: Strategy::OneForOne,
            restarts_max: 5,
            window_s: 60.0,
            backoff_s: 0.1,
            backoff_max_s: 5.0,
            ready_within_s: 30.0,
            first_output_within_s: 30.0,
        }
    }
}

/// Who is restarted with a service that died.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Strategy {
    /// Nobody: the others hold what it needs.
    OneForOne,
    /// Those downstream of it.
    RestForOne,
}

/// When a service that died is started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Restart {
    /// Whenever it did not end as it should.
    OnFailure,
    /// Never: the graph ends with it.
    Never,
}

impl SupervisionConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let positive = [
            ("window_s", self.window_s, 1.0, 86_400.0, "a number of seconds, 1 to 86400"),
            ("backoff_s", self.backoff_s, 0.0, 3600.0, "a number of seconds, 0 to 3600"),
            ("backoff_max_s", self.backoff_max_s, 0.0, 3600.0, "a number of seconds, 0 to 3600"),
            ("ready_within_s", self.ready_within_s, 1.0, 3600.0, "a number of seconds, 1 to 3600"),
            ("first_output_within_s", self.first_output_within_s, 1.0, 86_400.0, "a number of seconds, 1 to 86400"),
        ];
        for (key, value, least, most, expected) in positive {
            if !(least..=most).contains(&value) {
                return Err(ConfigError { key, value: value.to_string(), expected });
            }
        }
        Ok(())
    }
}
