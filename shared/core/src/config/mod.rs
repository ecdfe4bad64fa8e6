//! What can be set: the `[odometry]` and `[mapper]` sections of a configuration.
//!
//! Units are in the key names. `validate` says which key is out of range; unknown keys are found
//! by whoever reads the file.

mod mapper;
mod odometry;
#[cfg(test)]
mod tests;

use core::fmt::Display;

pub use mapper::{Filter, Fusion, Limit, LimitWord, MapperConfig, NoEcho, SonarSelection, SonarWord};
pub use odometry::{Noise, OdometryConfig, Poses, Start, StartWord, Systematic};

/// A value out of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key} = {value}: expected {expected}")]
pub struct ConfigError {
    /// The key within its section.
    pub key: &'static str,
    /// What was given.
    pub value: String,
    /// What would have been right.
    pub expected: &'static str,
}

impl ConfigError {
    /// Ok if `holds`, else the error that says what `key` should have been.
    pub(crate) fn unless(
        holds: bool,
        key: &'static str,
        value: impl Display,
        expected: &'static str,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self { key, value: value.to_string(), expected }) }
    }
}
