//! `[replay]`: which log is played, and what it does not say of itself.

use std::path::PathBuf;

use echogrid_formats::log::{RangeUnit, SurveyOptions};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// The `[replay]` section: which log is played, and what it does not say itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReplayConfig {
    /// The log; empty where none was given.
    pub log: PathBuf,
    /// The unit of its ranges.
    pub range_unit: LogUnit,
    /// Topics of a recording that are used in place of others of their type.
    pub topics: Vec<String>,
    /// Who says in a recording where the robot really was: a topic, or `tf`; empty: nobody.
    pub truth: String,
    /// Over how many degrees the beams of a laser lie whose format does not say it; 0: as the format has it, 180.
    #[serde(deserialize_with = "degrees")]
    pub laser_view_deg: u16,
    /// Whether a recording of a run is mapped with the settings of that run, where nothing else is said.
    pub use_settings: bool,
}

impl Default for ReplayConfig {
    fn default() -> Self {
        let (log, topics, truth) = (PathBuf::new(), Vec::new(), String::new());
        Self { log, range_unit: LogUnit::Auto, topics, truth, laser_view_deg: 0, use_settings: true }
    }
}

/// The unit of a log's ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LogUnit {
    /// Told by the ranges themselves.
    #[default]
    Auto,
    /// Metres.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
}

fn degrees<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u16, D::Error> {
    let degrees = u16::deserialize(deserializer)?;
    if degrees <= 360 { Ok(degrees) } else { Err(D::Error::custom("expected a whole number from 0 to 360")) }
}

impl ReplayConfig {
    /// What the user says of the log.
    #[must_use]
    pub fn survey_options(&self) -> SurveyOptions {
        let range_unit = match self.range_unit {
            LogUnit::Auto => None,
            LogUnit::M => Some(RangeUnit::Metres),
            LogUnit::Cm => Some(RangeUnit::Centimetres),
            LogUnit::Mm => Some(RangeUnit::Millimetres),
        };
        let truth = Some(self.truth.clone()).filter(|truth| !truth.is_empty());
        let laser_view_deg = Some(self.laser_view_deg).filter(|degrees| *degrees > 0);
        SurveyOptions { range_unit, topics: self.topics.clone(), truth, laser_view_deg }
    }
}
