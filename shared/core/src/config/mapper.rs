//! `[mapper]`: the grid, the sensor model and the rule of fusion.

use serde::{Deserialize, Serialize};

use super::ConfigError;
use crate::driven::MOST_M;
use crate::robot::SensorKind;

/// How readings are fused into the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fusion {
    /// [`Fusion::Oriented`] for sonars; [`Fusion::Paper`] for lidars, whose beams leave nothing open that a cone does.
    Auto,
    /// The paper's model: eqs 21–23, log-odds added.
    Paper,
    /// The paper's model with deviations by direction, from the covariance of the pose: who lost the way along a corridor still
    /// knows the corridor's walls.
    Covariance,
    /// The exact Bayes update of a cone given the map so far ([`crate::first_echo`]), with deviations by direction.
    FirstEcho,
    /// The update of [`Fusion::FirstEcho`] where smooth walls mirror: each cell may be free, diffuse, or a wall that faces one of
    /// eight directions ([`crate::oriented`]).
    Oriented,
}

impl Fusion {
    /// The rule for a sensor of this kind.
    #[must_use]
    pub fn of(self, kind: SensorKind) -> Self {
        match (self, kind) {
            (Self::Auto, SensorKind::Sonar) => Self::Oriented,
            (Self::Auto, SensorKind::Lidar) => Self::Paper,
            (rule, _) => rule,
        }
    }
}

/// What a reading without an echo says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoEcho {
    /// That the cone is rather empty, where walls that mirror are part of the rule ([`Fusion::Oriented`]); else nothing.
    Auto,
    /// Nothing: a wall that mirrors returns no echo either.
    Ignore,
    /// That the cone is rather empty, as far as an echo is not lost (`echo_lost`).
    Clear,
}

impl NoEcho {
    /// Whether it says something to this rule.
    #[must_use]
    pub fn clears(self, rule: Fusion) -> bool {
        match self {
            Self::Ignore => false,
            Self::Clear => true,
            Self::Auto => rule == Fusion::Oriented,
        }
    }
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
    /// Those at right angles to a corridor's walls, and those with the smallest angle to the robot's axis (section 4.2).
    Corridor,
}

/// A filter of readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// Range limits.
    Range,
    /// The sonars that are used.
    Selection,
    /// Sonars that repeat a value, or see obstacles where there are none, and are contradicted.
    Stuck,
    /// What one sonar hears and no other supports.
    Lone,
    /// The bubble circle threshold (Lee & Chung 2006).
    Bubble,
}

impl Filter {
    /// Whether it looks at each reading alone.
    #[must_use]
    pub fn is_alone(self) -> bool {
        matches!(self, Self::Range | Self::Selection)
    }
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
    /// For a sonar the paper's 0.15 m and 4 m (its own range, up to 6 m, where walls that mirror are part of the rule), for a lidar its own range limits, up to 100 m; of a footprint what the robot's says.
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
    /// The way after which what a transducer says is all new, metres; 0: everything always is ([`crate::novelty`]).
    pub novelty_m: f64,
    /// What a reading without an echo says.
    pub no_echo: NoEcho,
    /// p0 of first_echo: how probably a cell is occupied before any reading.
    pub echo_prior: f64,
    /// r0 of first_echo: how probably an occupied cell on the axis answers.
    pub echo_detection: f64,
    /// How probably an echo is nobody's (multipath, crosstalk), by the rule first_echo.
    pub echo_clutter: f64,
    /// m: how probably an echo is lost.
    pub echo_lost: f64,
    /// p0 of oriented: how probably a cell is occupied before any reading.
    pub oriented_prior: f64,
    /// r0 of oriented: how probably a cell answers that is occupied and mirrors nothing.
    pub oriented_detection: f64,
    /// q of oriented: of what is occupied, the share that is no smooth wall.
    pub oriented_diffuse: f64,
    /// α_c of oriented: up to so far from its normal a smooth wall answers, degrees.
    pub oriented_incidence_deg: f64,
    /// How probably an echo is nobody's (multipath, crosstalk), by the rule oriented.
    pub oriented_clutter: f64,
    /// How probably an echo is lost, by the rule oriented.
    pub oriented_lost: f64,
    /// The range up to which no echo clears by the rule oriented, metres.
    pub oriented_clear_m: f64,
    /// τ of oriented: gains are multiplied by (σ_z0/σ_z)^τ, as successive readings share the error of the pose.
    pub oriented_tempering: f64,
    /// n of oriented: looks along which a wall answers with probability r leave 1 − (n r)² of its weight, however many they are; 0: they
    /// may take all of it.
    pub oriented_looks: f64,
    /// The side of a place, metres (rule oriented): from the third visit on, what is heard there in the same direction says little
    /// that is new; 0: off ([`crate::novelty`] holds for every rule).
    pub oriented_place_m: f64,
    /// How far walls go on in the mean, metres (rule oriented), by which the map shows what is known along them; 0: cells are shown
    /// as they are.
    pub oriented_wall_m: f64,
    /// τ of first_echo, as that of oriented.
    pub tempering: f64,
    /// Radius around the robot within which nothing is, as it stands there, metres; 0: it clears nothing.
    pub footprint_m: Limit,
    /// Whether a fix has the readings since the last one fused again, where the robot was in hindsight.
    pub remap: bool,
    /// The most readings that are kept for that.
    pub remap_readings_max: u32,
    /// What readings pass before they are fused, in this order.
    pub filters: Vec<Filter>,
    /// Rings before the present one that `stuck` and `lone` look back on.
    pub filter_rings: u16,
    /// Rings before the present one that `bubble` looks back on.
    pub bubble_rings: u16,
    /// A sonar that repeats a value over so much way, and is contradicted, is stuck, metres.
    pub stuck_after_m: f64,
    /// Echoes that may come from within this of each other support each other, metres.
    pub lone_tolerance_m: f64,
    /// A point that is this little inside of a bubble does not invade it, metres.
    pub bubble_tolerance_m: f64,
    /// How often tiles that changed are told while the map grows, seconds of real time; 0: after each scan.
    pub tiles_every_s: f64,
    /// Whether a map of each sonar is kept besides.
    pub sonar_maps: bool,
    /// Whether it is kept how much odometry error the evidence of each cell carried.
    pub doubt: bool,
    /// Whether it is told which way each wall faces, where the rule of fusion knows it.
    pub facing: bool,
    /// Whether readings are kept as they were fused, so that it can be told why a cell is what it is ([`crate::why`]).
    pub keep_readings: bool,
    /// The most readings that are kept for that, of 80 bytes each.
    pub keep_readings_max: u32,
}

impl Default for MapperConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            fusion: Fusion::Auto,
            log_odds_max: 8.0,
            log_odds_prior: 0.0,
            p_occupied: 0.85,
            p_free: 0.30,
            min_range_m: Limit::Word(LimitWord::Auto),
            max_range_m: Limit::Word(LimitWord::Auto),
            min_trust: 0.02,
            sonars: SonarSelection::Word(SonarWord::All),
            novelty_m: 0.05,
            no_echo: NoEcho::Auto,
            echo_prior: 0.01,
            echo_detection: 0.2,
            echo_clutter: 0.4,
            echo_lost: 0.9,
            oriented_prior: 0.0165,
            oriented_detection: 0.95,
            oriented_diffuse: 0.15,
            oriented_incidence_deg: 20.0,
            oriented_clutter: 0.3,
            oriented_lost: 0.8,
            oriented_clear_m: 3.5,
            oriented_tempering: 0.9,
            oriented_looks: 2.5,
            oriented_place_m: 0.2,
            oriented_wall_m: 2.5,
            tempering: 0.5,
            footprint_m: Limit::Word(LimitWord::Auto),
            remap: true,
            remap_readings_max: 50_000,
            filters: vec![Filter::Range, Filter::Selection, Filter::Stuck],
            filter_rings: 10,
            bubble_rings: 30,
            stuck_after_m: 0.5,
            lone_tolerance_m: 0.15,
            bubble_tolerance_m: 0.05,
            tiles_every_s: 0.02,
            sonar_maps: false,
            doubt: false,
            facing: false,
            keep_readings: false,
            keep_readings_max: 1_000_000,
        }
    }
}

/// What a reading that is kept takes at most where a mapper is saved, bytes …
const KEPT_BYTES: u64 = 96;
/// … and one that a fix may change, with the estimate that it was fused at.
const REMAP_BYTES: u64 = 256;

impl MapperConfig {
    /// The most bytes that readings which are kept, for `why` or for a fix, take in what a mapper saves.
    #[must_use]
    pub fn kept_bytes_max(&self) -> u64 {
        let of = |is_asked: bool, readings: u32, bytes: u64| if is_asked { u64::from(readings) * bytes } else { 0 };
        of(self.keep_readings, self.keep_readings_max, KEPT_BYTES)
            + of(self.remap, self.remap_readings_max, REMAP_BYTES)
    }

    /// Every value within its range, or the first that is not. (Whether the robot has the sonars that are named is
    /// checked by [`crate::GridMapper::new`], which knows the robot.)
    ///
    /// # Errors
    /// Names the key, what it is and what it should be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let within = |value: f64, low: f64, high: f64| value >= low && value <= high;
        let between = |value: f64, low: f64, high: f64| value > low && value < high;
        ConfigError::unless(
            within(self.resolution_m, 0.001, 10.0),
            "resolution_m",
            self.resolution_m,
            "metres, from 0.001 to 10",
        )?;
        ConfigError::unless(
            self.log_odds_max > 0.0 && self.log_odds_max <= 100.0,
            "log_odds_max",
            self.log_odds_max,
            "a number above 0, at most 100",
        )?;
        ConfigError::unless(
            self.log_odds_prior.abs() <= self.log_odds_max,
            "log_odds_prior",
            self.log_odds_prior,
            "a number within ± log_odds_max",
        )?;
        ConfigError::unless(
            between(self.p_occupied, 0.5, 1.0),
            "p_occupied",
            self.p_occupied,
            "a probability between 0.5 and 1, both excluded",
        )?;
        ConfigError::unless(
            between(self.p_free, 0.0, 0.5),
            "p_free",
            self.p_free,
            "a probability between 0 and 0.5, both excluded",
        )?;
        if let Limit::Metres(radius_m) = self.footprint_m {
            let metres = "metres, from 0 (off) to 2, or \"auto\"";
            ConfigError::unless(within(radius_m, 0.0, MOST_M), "footprint_m", radius_m, metres)?;
        }
        if let Limit::Metres(min) = self.min_range_m {
            ConfigError::unless(min.is_finite() && min >= 0.0, "min_range_m", min, "metres, 0 or more, or \"auto\"")?;
        }
        if let Limit::Metres(max) = self.max_range_m {
            ConfigError::unless(max.is_finite() && max > 0.0, "max_range_m", max, "metres above 0, or \"auto\"")?;
        }
        if let (Limit::Metres(min), Limit::Metres(max)) = (self.min_range_m, self.max_range_m) {
            ConfigError::unless(min < max, "min_range_m", min, "less than max_range_m")?;
        }
        ConfigError::unless(within(self.min_trust, 0.0, 1.0), "min_trust", self.min_trust, "a number from 0 to 1")?;
        let probability = |key, value: f64| {
            ConfigError::unless(within(value, 1e-6, 1.0 - 1e-6), key, value, "a probability above 0 and below 1")
        };
        ConfigError::unless(
            within(self.novelty_m, 0.0, 1000.0),
            "novelty_m",
            self.novelty_m,
            "metres, from 0 (off) to 1000",
        )?;
        let every_s = self.tiles_every_s;
        ConfigError::unless(within(every_s, 0.0, 3600.0), "tiles_every_s", every_s, "seconds, from 0 to 3600")?;
        probability("echo_prior", self.echo_prior)?;
        probability("echo_detection", self.echo_detection)?;
        probability("echo_clutter", self.echo_clutter)?;
        probability("echo_lost", self.echo_lost)?;
        probability("oriented_prior", self.oriented_prior)?;
        for (key, value) in [
            ("oriented_detection", self.oriented_detection),
            ("oriented_diffuse", self.oriented_diffuse),
            ("oriented_clutter", self.oriented_clutter),
            ("oriented_lost", self.oriented_lost),
        ] {
            ConfigError::unless(within(value, 0.001, 0.999), key, value, "a probability from 0.001 to 0.999")?;
        }
        let incidence_deg = self.oriented_incidence_deg;
        let degrees = "degrees, from 5 to 90";
        ConfigError::unless(within(incidence_deg, 5.0, 90.0), "oriented_incidence_deg", incidence_deg, degrees)?;
        let clear_m = self.oriented_clear_m;
        ConfigError::unless(within(clear_m, 0.1, 1000.0), "oriented_clear_m", clear_m, "metres, from 0.1 to 1000")?;
        let place_m = self.oriented_place_m;
        ConfigError::unless(
            place_m == 0.0 || within(place_m, 0.01, 1000.0),
            "oriented_place_m",
            place_m,
            "metres, 0 (off) or from 0.01 to 1000",
        )?;
        let wall_m = self.oriented_wall_m;
        ConfigError::unless(
            wall_m == 0.0 || within(wall_m, 0.01, 1000.0),
            "oriented_wall_m",
            wall_m,
            "metres, 0 (off) or from 0.01 to 1000",
        )?;
        let (looks, number) = (self.oriented_looks, "a number, 0 (off) or from 1 to 1000000");
        ConfigError::unless(looks == 0.0 || within(looks, 1.0, 1e6), "oriented_looks", looks, number)?;
        for (key, value) in [("tempering", self.tempering), ("oriented_tempering", self.oriented_tempering)] {
            ConfigError::unless(within(value, 0.0, 10.0), key, value, "a number from 0 to 10")?;
        }
        ConfigError::unless(
            (1..=10_000_000).contains(&self.keep_readings_max),
            "keep_readings_max",
            self.keep_readings_max,
            "a whole number from 1 to 10000000",
        )?;
        ConfigError::unless(
            (4..=10_000_000).contains(&self.remap_readings_max),
            "remap_readings_max",
            self.remap_readings_max,
            "a whole number from 4 to 10000000",
        )?;
        self.validate_filters()
    }

    fn validate_filters(&self) -> Result<(), ConfigError> {
        let has = |filter| self.filters.contains(&filter);
        let written = || format!("{:?}", self.filters).to_lowercase();
        let mut once = self.filters.clone();
        once.sort_unstable();
        once.dedup();
        ConfigError::unless(once.len() == self.filters.len(), "filters", written(), "each filter once")?;
        // A key that does nothing is a mistake.
        let limits = [self.min_range_m, self.max_range_m].iter().any(|limit| matches!(limit, Limit::Metres(_)));
        ConfigError::unless(
            has(Filter::Range) || !limits,
            "filters",
            written(),
            "\"range\" among them, where min_range_m or max_range_m is set",
        )?;
        ConfigError::unless(
            has(Filter::Selection) || self.sonars == SonarSelection::Word(SonarWord::All),
            "filters",
            written(),
            "\"selection\" among them, where sonars are selected",
        )?;
        for (key, rings) in [("filter_rings", self.filter_rings), ("bubble_rings", self.bubble_rings)] {
            ConfigError::unless(rings <= 100, key, rings, "a whole number from 0 to 100")?;
        }
        for (key, metres) in [
            ("stuck_after_m", self.stuck_after_m),
            ("lone_tolerance_m", self.lone_tolerance_m),
            ("bubble_tolerance_m", self.bubble_tolerance_m),
        ] {
            ConfigError::unless((0.0..=100.0).contains(&metres), key, metres, "metres, from 0 to 100")?;
        }
        Ok(())
    }
}
