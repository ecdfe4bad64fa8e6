//! `[pioneer]`: where the robot is, and what it may do.

use std::fmt::Display;
use std::path::PathBuf;

use echogrid_core::config::ConfigError;
use serde::{Deserialize, Serialize};

use crate::Address;

/// The `[pioneer]` section: where the robot is, and what it may do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PioneerConfig {
    /// A serial device (`/dev/ttyUSB0`), or `tcp:HOST:PORT`.
    pub port: String,
    /// Bits per second with which the serial line begins.
    pub baud: u32,
    /// Bits per second with which it goes on; 0: as the parameters say.
    pub switch_baud: u32,
    /// ARIA's parameter file of the robot (`.p`); empty: those of its model.
    pub parameters: PathBuf,
    /// Whether the motors are turned on, so that it can be driven.
    pub motors: bool,
    /// A command to drive counts for so long, seconds.
    pub dead_man_s: f64,
    /// The time from one firing of an array of sonars to the next, seconds; 0: as the robot says.
    pub sonar_cycle_s: f64,
    /// A robot that has told nothing for so long is called again, seconds.
    pub silence_s: f64,
}

impl Default for PioneerConfig {
    fn default() -> Self {
        Self {
            port: "/dev/ttyUSB0".to_owned(),
            baud: 9600,
            switch_baud: 0,
            parameters: PathBuf::new(),
            motors: false,
            dead_man_s: 1.0,
            sonar_cycle_s: 0.0,
            silence_s: 1.0,
        }
    }
}

impl PioneerConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        const BAUD: &str = "9600, 19200, 38400, 57600 or 115200";
        let is_baud = |bits_per_s| echogrid_arcos::Baud::of_bits_per_s(bits_per_s).is_some();
        unless(Address::parse(&self.port).is_some(), "port", &self.port, "a serial device, or tcp:HOST:PORT")?;
        unless(is_baud(self.baud), "baud", self.baud, BAUD)?;
        let expected = "0 (as the robot's parameters say), 9600, 19200, 38400, 57600 or 115200";
        unless(self.switch_baud == 0 || is_baud(self.switch_baud), "switch_baud", self.switch_baud, expected)?;
        let within = |key, value: f64, range: std::ops::RangeInclusive<f64>, expected| {
            unless(range.contains(&value), key, value, expected)
        };
        within("dead_man_s", self.dead_man_s, 0.1..=10.0, "a number of seconds from 0.1 to 10")?;
        within("sonar_cycle_s", self.sonar_cycle_s, 0.0..=1.0, "a number of seconds from 0 (as the robot says) to 1")?;
        within("silence_s", self.silence_s, 0.3..=60.0, "a number of seconds from 0.3 to 60")
    }
}

fn unless(holds: bool, key: &'static str, value: impl Display, expected: &'static str) -> Result<(), ConfigError> {
    if holds { Ok(()) } else { Err(ConfigError { key, value: value.to_string(), expected }) }
}
