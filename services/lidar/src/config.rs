//! `[lidar]`: which lidar, and where it is.

use echogrid_core::config::ConfigError;
use echogrid_line::Address;
use serde::{Deserialize, Serialize};

use crate::codec::{Decoder, ld19::Ld19, rplidar::Rplidar};

/// The lidars that are understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// LDROBOT LD19.
    #[default]
    Ld19,
    /// LDROBOT LD06: it speaks as the LD19 does.
    Ld06,
    /// Slamtec RPLIDAR A1.
    RplidarA1,
}

impl Model {
    /// Bits per second that it speaks with.
    #[must_use]
    pub fn baud(self) -> u32 {
        match self {
            Self::Ld19 | Self::Ld06 => crate::codec::ld19::BAUD,
            Self::RplidarA1 => crate::codec::rplidar::BAUD,
        }
    }

    /// The decoder of what the lidar sends.
    #[must_use]
    pub fn decoder(self) -> Box<dyn Decoder> {
        match self {
            Self::Ld19 | Self::Ld06 => Box::new(Ld19::default()),
            Self::RplidarA1 => Box::new(Rplidar::default()),
        }
    }

    /// What it has to be told before it scans, in pieces that go out one after the other.
    #[must_use]
    pub fn greeting(self) -> &'static [&'static [u8]] {
        use crate::codec::rplidar::{SCAN, STOP};
        match self {
            Self::Ld19 | Self::Ld06 => &[],
            Self::RplidarA1 => &[&STOP, &SCAN],
        }
    }

    /// What it has to be told so that it rests.
    #[must_use]
    pub fn farewell(self) -> &'static [u8] {
        match self {
            Self::Ld19 | Self::Ld06 => &[],
            Self::RplidarA1 => &crate::codec::rplidar::STOP,
        }
    }
}

/// The `[lidar]` section: which lidar, and where it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LidarConfig {
    /// The model of the lidar.
    pub model: Model,
    /// A serial device (`/dev/ttyUSB0`), or `tcp:HOST:PORT`.
    pub port: String,
    /// Bits per second of the serial line; 0: as the model has it.
    pub baud: u32,
    /// A lidar that has said nothing for so long is called again, seconds.
    pub silence_s: f64,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self { model: Model::default(), port: "/dev/ttyUSB0".to_owned(), baud: 0, silence_s: 2.0 }
    }
}

impl LidarConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let refuse = |key, value: String, expected| Err(ConfigError { key, value, expected });
        if Address::parse(&self.port).is_none() {
            return refuse("port", self.port.clone(), "a serial device, or tcp:HOST:PORT");
        }
        if self.baud > 4_000_000 {
            return refuse("baud", self.baud.to_string(), "a whole number from 0 (as the model has it) to 4000000");
        }
        if !(0.3..=60.0).contains(&self.silence_s) {
            return refuse("silence_s", self.silence_s.to_string(), "a number of seconds from 0.3 to 60");
        }
        Ok(())
    }
}
