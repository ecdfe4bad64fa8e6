//! What can be set: the `[odometry]` and `[mapper]` sections of a configuration.
//!
//! Units are in the key names. `validate` says which key is out of range; unknown keys are found
//! by whoever reads the file.

use serde::{Deserialize, Serialize};

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

/// What is done with the systematic error of the odometry (eqs 1, 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Systematic {
    /// Carried into the sensor model as doubt (the paper's eqs 22, 23 as printed).
    Carry,
    /// Taken out of every increment (the paper's Fig. 16).
    Correct,
    /// Not modelled.
    Off,
}

/// How the random part of the odometry error enters eqs 22, 23.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Noise {
    /// Drawn from N(0, ε) per reading (paper).
    Sampled,
    /// One standard deviation, √ε, no draw.
    OneSigma,
}

/// `[odometry]`: the error model (eqs 1–4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OdometryConfig {
    /// What is done with the systematic error.
    pub systematic: Systematic,
    /// a_l of eq 1, metres of error per metre.
    pub lin_scale: f64,
    /// σ of eq 1: mean linear error that a rotation causes, metres.
    pub lin_offset_m: f64,
    /// σ counts once the robot has turned this much, radians.
    pub lin_offset_from_turn_rad: f64,
    /// a_θ of eq 2, radians of error per radian.
    pub ang_scale: f64,
    /// α of eq 2: mean angular error that a translation causes, radians.
    pub ang_offset_rad: f64,
    /// α counts once the robot has travelled this far, metres.
    pub ang_offset_from_travel_m: f64,
    /// κ_ll of eq 3: variance of the linear error per metre travelled, m²/m.
    pub k_ll: f64,
    /// κ_lθ of eq 3: variance of the linear error per radian turned, m²/rad.
    pub k_lt: f64,
    /// κ_θθ of eq 4: variance of the angular error per radian turned, rad²/rad.
    pub k_tt: f64,
    /// κ_θl of eq 4: variance of the angular error per metre travelled, rad²/m.
    pub k_tl: f64,
    /// How the random part enters the sensor model.
    pub noise: Noise,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        Self {
            systematic: Systematic::Off,
            lin_scale: 0.09,
            lin_offset_m: 0.0,
            lin_offset_from_turn_rad: 5.0 * core::f64::consts::PI / 180.0,
            ang_scale: 0.095,
            ang_offset_rad: 0.0,
            ang_offset_from_travel_m: 0.10,
            k_ll: 4e-4,
            k_lt: 1e-4,
            k_tt: 6e-4,
            k_tl: 1.5e-4,
            noise: Noise::Sampled,
            seed: 1,
        }
    }
}

/// How readings are fused into the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fusion {
    /// The paper's model: eqs 21–23, log-odds added.
    Paper,
}

/// Which sonars are used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SonarSelection {
    /// By a word: `"all"`.
    Word(SonarWord),
    /// By number.
    Numbers(Vec<u16>),
}

/// The words of [`SonarSelection`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SonarWord {
    /// Every sonar.
    All,
}

/// A limit in metres, or `"auto"`: the sensor's own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Limit {
    /// Metres.
    Metres(f64),
    /// By a word: `"auto"`.
    Word(LimitWord),
}

/// The words of [`Limit`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitWord {
    /// For a sonar the paper's 0.15 m and 4 m, for a lidar its own range limits.
    Auto,
}

/// `[mapper]`: the grid and the sensor model (eqs 13–23).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MapperConfig {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// How readings are fused.
    pub fusion: Fusion,
    /// Log-odds are kept within ± this.
    pub log_odds_max: f64,
    /// l0: log-odds of a cell before any reading.
    pub log_odds_prior: f64,
    /// Probability at the peak of region II without odometry error.
    pub p_occupied: f64,
    /// Probability at the sensor in region I without odometry error.
    pub p_free: f64,
    /// Readings below are refused.
    pub min_range_m: Limit,
    /// Readings above are refused.
    pub max_range_m: Limit,
    /// Readings whose trust (w of eqs 22, 23) is below are refused: they could not move a cell.
    pub min_trust: f64,
    /// Sonars that are used.
    pub sonars: SonarSelection,
}

impl Default for MapperConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            fusion: Fusion::Paper,
            log_odds_max: 8.0,
            log_odds_prior: 0.0,
            p_occupied: 0.85,
            p_free: 0.30,
            min_range_m: Limit::Word(LimitWord::Auto),
            max_range_m: Limit::Word(LimitWord::Auto),
            min_trust: 0.02,
            sonars: SonarSelection::Word(SonarWord::All),
        }
    }
}
