//! What can be set: the `[slam]` section of a configuration.

use echogrid_core::ConfigError;
use serde::{Deserialize, Serialize};

/// Whether the odometry is believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UseOdometry {
    /// It says where the next scan lies, as exactly as its error model says.
    Use,
    /// The lidar alone tells the way.
    Ignore,
}

/// The `[slam]` section.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SlamConfig {
    /// Whether the odometry is believed.
    pub odometry: UseOdometry,
    /// A scan is laid on those before it after so many metres of way …
    pub node_every_m: f64,
    /// … or after so many radians of turn.
    pub node_every_rad: f64,
    /// A place counts as visited again, and is looked for, after so many metres of way.
    pub closure_after_m: f64,
    /// How often it is looked for, metres of way.
    pub closure_every_m: f64,
    /// The share of points that must lie on walls where a place is recognised.
    pub closure_score_min: f64,
    /// By how much the second best place must score less, or the place is not told apart from others.
    pub closure_margin: f64,
    /// Rounds in which all scans of one place are laid on each other at the end; 0: none.
    pub refine_rounds: u32,
    /// The way after which what was driven with a lidar is settled but for its later half, metres; and four times `closure_after_m`. It is told
    /// to the mapper, and no closure changes it any more.
    pub settle_after_m: f64,
    /// How much better the readings of the last metres must fit a place than nothing, with sonars, nat a reading.
    pub sonar_evidence_nat: f64,
    /// How much worse the readings must fit elsewhere in the place, with sonars, nat a reading.
    pub sonar_margin_nat: f64,
    /// Closures that are none, each by the numbers of its two nodes, with those from next to both of them.
    pub forbid: Vec<[u32; 2]>,
    /// Closures that are right, whether others agree or not, likewise.
    pub require: Vec<[u32; 2]>,
}

impl Default for SlamConfig {
    fn default() -> Self {
        Self {
            odometry: UseOdometry::Use,
            node_every_m: 0.08,
            node_every_rad: 0.052,
            closure_after_m: 12.0,
            closure_every_m: 1.0,
            closure_score_min: 0.62,
            closure_margin: 0.05,
            refine_rounds: 3,
            settle_after_m: 5000.0,
            sonar_evidence_nat: 0.8,
            sonar_margin_nat: 0.6,
            forbid: Vec::new(),
            require: Vec::new(),
        }
    }
}

impl SlamConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let within = |key, value: f64, low: f64, high: f64, expected| {
            let fits = value >= low && value <= high;
            if fits { Ok(()) } else { Err(ConfigError { key, value: value.to_string(), expected }) }
        };
        within("node_every_m", self.node_every_m, 0.02, 2.0, "metres, 0.02 to 2")?;
        within("node_every_rad", self.node_every_rad, 0.01, 1.0, "radians, 0.01 to 1")?;
        within("closure_after_m", self.closure_after_m, 2.0, 1000.0, "metres, 2 to 1000")?;
        within("closure_every_m", self.closure_every_m, 0.1, 100.0, "metres, 0.1 to 100")?;
        within("closure_score_min", self.closure_score_min, 0.3, 1.0, "a share, 0.3 to 1")?;
        within("closure_margin", self.closure_margin, 0.0, 0.5, "a difference of shares, 0 to 0.5")?;
        within("refine_rounds", f64::from(self.refine_rounds), 0.0, 10.0, "rounds, 0 to 10")?;
        within("settle_after_m", self.settle_after_m, 40.0, 1e9, "metres, 40 to 1e9")?;
        within("sonar_evidence_nat", self.sonar_evidence_nat, 0.1, 10.0, "nat a reading, 0.1 to 10")?;
        within("sonar_margin_nat", self.sonar_margin_nat, 0.0, 10.0, "nat a reading, 0 to 10")?;
        let refused = |key, [from, to]: [u32; 2], expected| {
            Err(ConfigError { key, value: format!("[[{from}, {to}]]"), expected })
        };
        for (key, named) in [("forbid", &self.forbid), ("require", &self.require)] {
            if let Some(pair) = named.iter().find(|[from, to]| from >= to) {
                return refused(key, *pair, "the place first, as `echogrid closures` prints them");
            }
        }
        match self.require.iter().find(|pair| self.forbid.contains(pair)) {
            Some(pair) => refused("require", *pair, "what is not in forbid, too"),
            None => Ok(()),
        }
    }
}
