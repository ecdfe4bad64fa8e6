//! `[localizer]`: who knows where the robot is, and how well.

use std::path::{Path, PathBuf};

use echogrid_core::config::ConfigError;
use echogrid_core::landmarks::{SIGMA_MAX, SIGMA_MIN};
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
    /// A file of where the robot was.
    Reference,
    /// Surveyed landmarks, and what is measured of them.
    Landmarks,
    /// A map that was saved before, by what the sensors hear or see in it.
    Map,
}

/// What is measured of a landmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Range and bearing.
    Both,
    /// Range alone: that tells the position, not the heading.
    Range,
    /// Bearing alone.
    Bearing,
}

impl Measure {
    /// Whether ranges are used.
    #[must_use]
    pub fn ranges(self) -> bool {
        self != Self::Bearing
    }

    /// Whether bearings are used.
    #[must_use]
    pub fn bearings(self) -> bool {
        self != Self::Range
    }
}

/// `[localizer]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LocalizerConfig {
    /// Who knows where the robot is.
    pub source: Source,
    /// Standard deviation of the position that truth or reference tell, metres along each axis. The truth is told with an
    /// error drawn so; a reference as it stands.
    pub position_sigma_m: f64,
    /// Standard deviation of the heading that truth or reference tell, radians.
    pub heading_sigma_rad: f64,
    /// Seed of all that is drawn.
    pub seed: u64,
    /// The file of a reference path; empty: not named.
    pub reference: PathBuf,
    /// Between poses of the reference path farther apart than this nothing is known, seconds.
    pub reference_gap_s: f64,
    /// The file of the surveyed landmarks; empty: not named.
    pub landmarks: PathBuf,
    /// The file of what was measured of the landmarks; empty: that is measured from where the robot really is.
    pub sightings: PathBuf,
    /// Sightings so far from a request in time count for it, seconds.
    pub sightings_within_s: f64,
    /// Landmarks are measured from where the robot really is up to this far, metres.
    pub sight_m: f64,
    /// What is measured.
    pub measure: Measure,
    /// Standard deviation of a range to a landmark, metres.
    pub range_sigma_m: f64,
    /// Standard deviation of a bearing of a landmark, radians.
    pub bearing_sigma_rad: f64,
    /// The file of a map that was saved before; empty: not named.
    pub map: PathBuf,
    /// The way back over which what sonars heard is laid on the map as one piece, metres; by half more while nothing is known.
    pub map_window_m: f64,
    /// How much better the readings of sonars must fit the map than nothing, nat a reading.
    pub map_evidence_nat: f64,
    /// How much worse the next best place must be, nat a reading.
    pub map_margin_nat: f64,
}

impl Default for LocalizerConfig {
    fn default() -> Self {
        Self {
            source: Source::None,
            position_sigma_m: 0.0,
            heading_sigma_rad: 0.0,
            seed: 1,
            reference: PathBuf::new(),
            reference_gap_s: 5.0,
            landmarks: PathBuf::new(),
            sightings: PathBuf::new(),
            sightings_within_s: 0.5,
            sight_m: 8.0,
            measure: Measure::Both,
            range_sigma_m: 0.1,
            bearing_sigma_rad: 0.02,
            map: PathBuf::new(),
            map_window_m: 4.0,
            map_evidence_nat: 1.2,
            map_margin_nat: 0.6,
        }
    }
}

impl LocalizerConfig {
    /// The keys that name files.
    pub const FILES: [&str; 4] = ["reference", "landmarks", "sightings", "map"];

    /// The files that the source reads, each with its key.
    #[must_use]
    pub fn files(&self) -> Vec<(&'static str, &Path)> {
        let files = match self.source {
            Source::None | Source::Operator | Source::Truth => Vec::new(),
            Source::Map => vec![("map", self.map.as_path())],
            Source::Reference => vec![("reference", self.reference.as_path())],
            Source::Landmarks => vec![("landmarks", self.landmarks.as_path()), ("sightings", self.sightings.as_path())],
        };
        files.into_iter().filter(|(_, file)| !file.as_os_str().is_empty()).collect()
    }

    /// Whether the sensor has to know where the robot really is.
    #[must_use]
    pub fn needs_truth(&self) -> bool {
        match self.source {
            Source::None | Source::Operator | Source::Reference | Source::Map => false,
            Source::Truth => true,
            Source::Landmarks => self.sightings.as_os_str().is_empty(),
        }
    }

    /// Whether it looks things up by the stamps of the sensor, in files of the same clock.
    #[must_use]
    pub fn needs_time(&self) -> bool {
        match self.source {
            Source::None | Source::Operator | Source::Truth | Source::Map => false,
            Source::Reference => true,
            Source::Landmarks => !self.sightings.as_os_str().is_empty(),
        }
    }

    /// The key that makes it do so, with the file.
    #[must_use]
    pub fn asks_by_time(&self) -> String {
        match self.source {
            Source::Landmarks => format!("localizer.sightings ({})", self.sightings.display()),
            _ => format!("localizer.reference ({}, --fix FILE)", self.reference.display()),
        }
    }

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
        let check = |key, value: f64, fits: bool, expected| {
            if fits { Ok(()) } else { Err(ConfigError { key, value: value.to_string(), expected }) }
        };
        let positive = |key, value: f64, expected| check(key, value, value.is_finite() && value >= 0.0, expected);
        let deviation =
            |key, value: f64, expected| check(key, value, (SIGMA_MIN..=SIGMA_MAX).contains(&value), expected);
        positive("position_sigma_m", self.position_sigma_m, "metres, 0 or more")?;
        positive("heading_sigma_rad", self.heading_sigma_rad, "radians, 0 or more")?;
        positive("reference_gap_s", self.reference_gap_s, "seconds, 0 or more")?;
        positive("sightings_within_s", self.sightings_within_s, "seconds, 0 or more")?;
        positive("sight_m", self.sight_m, "metres, 0 or more")?;
        deviation("range_sigma_m", self.range_sigma_m, "metres, from 1e-9 to 1e6")?;
        deviation("bearing_sigma_rad", self.bearing_sigma_rad, "radians, from 1e-9 to 1e6")?;
        check("map_window_m", self.map_window_m, (1.0..=12.0).contains(&self.map_window_m), "metres, from 1 to 12")?;
        positive("map_evidence_nat", self.map_evidence_nat, "nat, 0 or more")?;
        positive("map_margin_nat", self.map_margin_nat, "nat, 0 or more")?;
        // What leaves no value that would be right comes last.
        let named = |key, file: &Path, expected| match file.as_os_str().is_empty() {
            true => Err(ConfigError { key, value: "\"\"".to_owned(), expected }),
            false => Ok(()),
        };
        match self.source {
            Source::None | Source::Operator | Source::Truth => Ok(()),
            Source::Reference => named(
                "reference",
                &self.reference,
                "a file with lines `t x y theta`, which localizer.source = \"reference\" is to read (--fix FILE names it, too)",
            ),
            Source::Landmarks => named(
                "landmarks",
                &self.landmarks,
                "a file with tables [[landmark]], which localizer.source = \"landmarks\" is to read (--fix FILE.toml names \
                 it, too)",
            ),
            Source::Map => named(
                "map",
                &self.map,
                "a map.echogrid, in which localizer.source = \"map\" is to localize (--fix FILE.echogrid names it, too)",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_goes_by_its_key() {
        let wrong = |change: fn(&mut LocalizerConfig)| {
            let mut config = LocalizerConfig::default();
            change(&mut config);
            config.validate().unwrap_err().to_string()
        };
        assert!(LocalizerConfig::default().validate().is_ok());
        for (found, expected) in [
            (wrong(|config| config.position_sigma_m = -1.0), "position_sigma_m = -1: expected metres, 0 or more"),
            (wrong(|config| config.reference_gap_s = f64::NAN), "reference_gap_s = NaN: expected seconds"),
            (wrong(|config| config.sightings_within_s = -0.1), "sightings_within_s = -0.1: expected seconds"),
            (wrong(|config| config.sight_m = f64::INFINITY), "sight_m = inf: expected metres"),
            (wrong(|config| config.range_sigma_m = 0.0), "range_sigma_m = 0: expected metres, from 1e-9"),
            (wrong(|config| config.bearing_sigma_rad = 1e9), "bearing_sigma_rad = 1000000000: expected radians"),
            (wrong(|config| config.map_window_m = 0.5), "map_window_m = 0.5: expected metres, from 1 to 12"),
            (wrong(|config| config.map_evidence_nat = -1.0), "map_evidence_nat = -1: expected nat, 0 or more"),
            (wrong(|config| config.source = Source::Map), "map = \"\": expected a map.echogrid"),
            (wrong(|config| config.source = Source::Reference), "reference = \"\": expected a file with lines"),
            (wrong(|config| config.source = Source::Landmarks), "landmarks = \"\": expected a file with tables"),
        ] {
            assert!(found.contains(expected), "{found}");
        }
    }

    #[test]
    fn what_a_source_needs() {
        let with = |source, sightings: &str| LocalizerConfig {
            source,
            reference: "path.txt".into(),
            map: "map.echogrid".into(),
            landmarks: "marks.toml".into(),
            sightings: sightings.into(),
            ..LocalizerConfig::default()
        };
        let keys = |config: &LocalizerConfig| config.files().iter().map(|(key, _)| *key).collect::<Vec<_>>();
        for (config, files, truth) in [
            (with(Source::Truth, "seen.txt"), &[][..], true),
            (with(Source::Reference, "seen.txt"), &["reference"], false),
            (with(Source::Map, "seen.txt"), &["map"], false),
            (with(Source::Landmarks, ""), &["landmarks"], true),
            (with(Source::Landmarks, "seen.txt"), &["landmarks", "sightings"], false),
        ] {
            assert_eq!((keys(&config).as_slice(), config.needs_truth()), (files, truth), "{config:?}");
        }
    }
}
