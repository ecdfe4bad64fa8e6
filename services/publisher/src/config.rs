//! `[publisher]`: which files are written, and how they look.

use echogrid_core::config::ConfigError;
use serde::{Deserialize, Serialize};

/// A file that a map is saved to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// A picture for people.
    Png,
    /// PGM and YAML, as `map_server` writes and reads them.
    Pgm,
    /// The probabilities as a NumPy array.
    Npy,
    /// The native map: evidence, counts and where they came from.
    Echogrid,
}

/// What the grey levels of a PGM mean (`mode` of its YAML).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PgmMode {
    /// Occupied, free or unknown.
    Trinary,
    /// Shades between free and occupied, unknown apart.
    Scale,
    /// The grey level is the probability in percent, 255 is unknown.
    Raw,
}

/// `[publisher]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PublisherConfig {
    /// The files that are written.
    pub formats: Vec<Format>,
    /// What the grey levels of the PGM mean.
    pub pgm_mode: PgmMode,
    /// A cell is occupied above this probability.
    pub occupied_thresh: f64,
    /// A cell is free below this probability.
    pub free_thresh: f64,
    /// Whether the picture shows where the robot went.
    pub draw_path: bool,
}

impl Default for PublisherConfig {
    fn default() -> Self {
        Self {
            formats: vec![Format::Png, Format::Pgm, Format::Npy, Format::Echogrid],
            pgm_mode: PgmMode::Trinary,
            occupied_thresh: 0.65,
            free_thresh: 0.25,
            draw_path: true,
        }
    }
}

impl PublisherConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first key that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let mut seen = self.formats.clone();
        seen.sort_unstable();
        seen.dedup();
        let in_unit = |p: f64| p > 0.0 && p < 1.0;
        let refuse = |key, value: String, expected| Err(ConfigError { key, value, expected });
        if seen.len() != self.formats.len() {
            return refuse("formats", format!("{:?}", self.formats), "each format once");
        }
        if !in_unit(self.occupied_thresh) {
            return refuse("occupied_thresh", self.occupied_thresh.to_string(), "a probability between 0 and 1");
        }
        if !(in_unit(self.free_thresh) && self.free_thresh < self.occupied_thresh) {
            return refuse(
                "free_thresh",
                self.free_thresh.to_string(),
                "a probability above 0 and below occupied_thresh",
            );
        }
        Ok(())
    }
}
