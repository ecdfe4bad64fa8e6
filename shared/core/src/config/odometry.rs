//! `[odometry]`: where it begins, and its error model.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::ConfigError;
use crate::pose::Pose2;

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

/// Where in the map the odometry begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// By a word.
    Word(StartWord),
    /// The robot's first pose in the map: x and y in metres, θ in radians.
    Pose([f64; 3]),
}

/// [`Start`] as it is written: a word or a list.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum WrittenStart {
    Word(StartWord),
    Pose([f64; 3]),
}

/// [`Start`] in a saved state, whose format tells no type.
#[derive(Serialize, Deserialize)]
enum SavedStart {
    Word(StartWord),
    Pose([f64; 3]),
}

impl Serialize for Start {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (*self, serializer.is_human_readable()) {
            (Self::Word(word), true) => WrittenStart::Word(word).serialize(serializer),
            (Self::Pose(pose), true) => WrittenStart::Pose(pose).serialize(serializer),
            (Self::Word(word), false) => SavedStart::Word(word).serialize(serializer),
            (Self::Pose(pose), false) => SavedStart::Pose(pose).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Start {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            return Ok(match WrittenStart::deserialize(deserializer)? {
                WrittenStart::Word(word) => Self::Word(word),
                WrittenStart::Pose(pose) => Self::Pose(pose),
            });
        }
        Ok(match SavedStart::deserialize(deserializer)? {
            SavedStart::Word(word) => Self::Word(word),
            SavedStart::Pose(pose) => Self::Pose(pose),
        })
    }
}

impl Start {
    /// The robot's first pose in the map, where it is given.
    #[must_use]
    pub fn pose(self) -> Option<Pose2> {
        match self {
            Self::Word(_) => None,
            Self::Pose([x, y, theta]) => Some(Pose2::new(x, y, theta)),
        }
    }

    /// Whether nobody has said where in the map the odometry begins.
    #[must_use]
    pub fn is_open(self) -> bool {
        self == Self::Word(StartWord::Auto)
    }
}

/// The words of [`Start`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartWord {
    /// Where the first fix says; where nobody is asked for one, as `odometry`.
    Auto,
    /// Where the odometry says: its frame is the map's.
    Odometry,
}

/// Whose poses the odometry is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Poses {
    /// The poses are those of a drive, which drifts.
    Drive,
    /// The poses are those of SLAM or motion capture, which do not drift. They have no error; a leap of theirs is a correction.
    Exact,
}

/// `[odometry]`: where it begins, and the error model (eqs 1–4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OdometryConfig {
    /// Where in the map it begins.
    pub start: Start,
    /// Whose poses it is; exact ones have no error, whatever the keys below say.
    pub poses: Poses,
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
            start: Start::Word(StartWord::Auto),
            poses: Poses::Drive,
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

impl OdometryConfig {
    /// What it comes to: exact poses have no error.
    #[must_use]
    pub fn resolved(&self) -> Self {
        match self.poses {
            Poses::Drive => self.clone(),
            Poses::Exact => {
                Self { systematic: Systematic::Off, k_ll: 0.0, k_lt: 0.0, k_tt: 0.0, k_tl: 0.0, ..self.clone() }
            }
        }
    }

    /// Every value within its range, or the first that is not.
    ///
    /// # Errors
    /// Names the key, what it is and what it should be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if let Start::Pose(pose) = self.start {
            const POSE: &str = "[x, y, θ]: metres within ±1e6, and radians within ±1e6";
            ConfigError::unless(pose.iter().all(|value| value.abs() <= 1e6), "start", format_args!("{pose:?}"), POSE)?;
        }
        const SCALE: &str = "a number between -1 and 1";
        const FINITE: &str = "a finite number";
        const NOT_NEGATIVE: &str = "a finite number, 0 or more";
        let not_negative =
            |key, value: f64| ConfigError::unless(value.is_finite() && value >= 0.0, key, value, NOT_NEGATIVE);
        ConfigError::unless(self.lin_scale.abs() < 1.0, "lin_scale", self.lin_scale, SCALE)?;
        ConfigError::unless(self.lin_offset_m.is_finite(), "lin_offset_m", self.lin_offset_m, FINITE)?;
        not_negative("lin_offset_from_turn_rad", self.lin_offset_from_turn_rad)?;
        ConfigError::unless(self.ang_scale.abs() < 1.0, "ang_scale", self.ang_scale, SCALE)?;
        ConfigError::unless(self.ang_offset_rad.is_finite(), "ang_offset_rad", self.ang_offset_rad, FINITE)?;
        not_negative("ang_offset_from_travel_m", self.ang_offset_from_travel_m)?;
        not_negative("k_ll", self.k_ll)?;
        not_negative("k_lt", self.k_lt)?;
        not_negative("k_tt", self.k_tt)?;
        not_negative("k_tl", self.k_tl)
    }
}
