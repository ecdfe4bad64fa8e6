//! Absolute localization: when to ask for it (the paper's section 4.1, Fig. 9).

pub mod placing;

use core::fmt::Display;

use serde::{Deserialize, Serialize};

use crate::config::ConfigError;
use crate::odometry::gate::Gate;

/// Yes, no, or as the graph suggests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// What the graph suggests.
    Auto,
    /// Yes.
    Always,
    /// No.
    Never,
}

impl Choice {
    /// Yes or no, where the graph suggests `suggested`.
    #[must_use]
    pub fn resolve(self, suggested: bool) -> bool {
        match self {
            Self::Auto => suggested,
            Self::Always => true,
            Self::Never => false,
        }
    }
}

impl From<bool> for Choice {
    fn from(yes: bool) -> Self {
        if yes { Self::Always } else { Self::Never }
    }
}

/// What a localization is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ask {
    /// When the state is degraded (paper).
    Degraded,
    /// Every so many metres or seconds.
    Schedule,
    /// When either is the case.
    Both,
    /// For nothing: fixes come by hand, or not at all.
    Never,
}

/// `[localization]`: when an absolute localization is asked for, and what happens until it comes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LocalizationConfig {
    /// What it is asked for.
    pub ask: Ask,
    /// The way after which a localization is asked for by schedule, metres by odometry; 0: not by way.
    pub every_m: f64,
    /// The time after which a localization is asked for by schedule, seconds by the sensor's clock; 0: not by time.
    pub every_s: f64,
    /// The least time to the next request after an answer that holds no fix, seconds.
    pub retry_s: f64,
    /// A fix is refused that is farther off than so many standard deviations; 0: none is.
    pub gate_sigmas: f64,
    /// The state is degraded while the trust of a nominal reading is below this.
    pub degraded_trust: f64,
    /// Whether mapping holds while degraded. Auto: if somebody is asked then to mend it.
    pub hold: Choice,
    /// Whether the odometry waits for the answer, so that the same log gives the same map. Auto: unless the robot is real.
    pub wait: Choice,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            ask: Ask::Degraded,
            every_m: 0.0,
            every_s: 0.0,
            retry_s: 1.0,
            gate_sigmas: Gate::DEFAULT_SIGMAS,
            // (0.65 − ½) / (0.85 − ½): below, one reading can't make an undecided cell occupied.
            degraded_trust: 0.43,
            hold: Choice::Auto,
            wait: Choice::Auto,
        }
    }
}

impl LocalizationConfig {
    /// Whether `trust` of a nominal reading, in [0, 1], is too low for a reading to decide a cell: "values of each cell do
    /// not define anymore whether a cell is occupied, empty or mapped yet" (section 4.1).
    #[must_use]
    pub fn is_degraded(&self, trust: f64) -> bool {
        trust < self.degraded_trust
    }

    /// Every value within its range, or the first that is not.
    ///
    /// # Errors
    /// Names the key, what it is and what it should be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let schedule = matches!(self.ask, Ask::Schedule | Ask::Both);
        let amount = |value: f64| value.is_finite() && value >= 0.0;
        ConfigError::unless(amount(self.every_m), "every_m", self.every_m, "metres, 0 or more")?;
        ConfigError::unless(amount(self.every_s), "every_s", self.every_s, "seconds, 0 or more")?;
        ConfigError::unless(
            !schedule || self.every_m > 0.0 || self.every_s > 0.0,
            "every_m",
            self.every_m,
            "metres above 0, or seconds above 0 in every_s, where ask is \"schedule\" or \"both\"",
        )?;
        ConfigError::unless(amount(self.retry_s), "retry_s", self.retry_s, "seconds, 0 or more")?;
        const SIGMAS: &str = "standard deviations, 0 or more";
        ConfigError::unless(amount(self.gate_sigmas), "gate_sigmas", self.gate_sigmas, SIGMAS)?;
        let share = (0.0..=1.0).contains(&self.degraded_trust);
        ConfigError::unless(share, "degraded_trust", self.degraded_trust, "a number from 0 to 1")
    }
}

/// Why a localization is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Reason {
    /// The state is degraded.
    Degraded = 1,
    /// It is time.
    Schedule = 2,
    /// Nothing has said yet where in the map the robot is.
    Start = 3,
    /// The odometry leapt.
    Leap = 4,
}

impl Display for Reason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Degraded => "degraded",
            Self::Schedule => "by schedule",
            Self::Start => "at the start",
            Self::Leap => "after a leap",
        })
    }
}

/// When to ask. Depends on stamps and distances alone, so that a replay asks where the run did.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Asking {
    config: LocalizationConfig,
    /// Stamp and odometer of the last fix, or of the start.
    since: Option<(u64, f64)>,
    not_before_ns: u64,
    /// What it is asked for whatever the schedule says.
    urgent: Option<Reason>,
}

impl Asking {
    /// Makes it, before the first estimate.
    #[must_use]
    pub fn new(config: &LocalizationConfig) -> Self {
        Self { config: config.clone(), since: None, not_before_ns: 0, urgent: None }
    }

    /// Asks as soon as it may, until there is a fix.
    pub fn urge(&mut self, reason: Reason) {
        if self.config.ask != Ask::Never {
            self.urgent.get_or_insert(reason);
        }
    }

    /// Whether to ask now, and why; `distance_m` is what the robot has travelled since the start.
    pub fn reason(&mut self, stamp_ns: u64, distance_m: f64, degraded: bool) -> Option<Reason> {
        let (since_ns, since_m) = *self.since.get_or_insert((stamp_ns, distance_m));
        if stamp_ns < self.not_before_ns {
            return None;
        }
        if self.urgent.is_some() {
            return self.urgent;
        }
        let LocalizationConfig { ask, every_m, every_s, .. } = self.config;
        let due = (every_m > 0.0 && distance_m - since_m >= every_m)
            || (every_s > 0.0 && stamp_ns.saturating_sub(since_ns) >= nanoseconds(every_s));
        match ask {
            Ask::Degraded | Ask::Both if degraded => Some(Reason::Degraded),
            Ask::Schedule | Ask::Both if due => Some(Reason::Schedule),
            _ => None,
        }
    }

    /// The robot was localized.
    pub fn fixed(&mut self, stamp_ns: u64, distance_m: f64) {
        self.since = Some((stamp_ns, distance_m));
        self.not_before_ns = 0;
        self.urgent = None;
    }

    /// It could not be localized.
    pub fn failed(&mut self, stamp_ns: u64) {
        self.not_before_ns = stamp_ns.saturating_add(nanoseconds(self.config.retry_s).max(1));
    }
}

/// Of 0 seconds or more; too many are the most there are.
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn asking(ask: Ask, every_m: f64, every_s: f64) -> Asking {
        Asking::new(&LocalizationConfig { ask, every_m, every_s, ..LocalizationConfig::default() })
    }

    #[test]
    fn by_way_and_by_time() {
        let mut way = asking(Ask::Schedule, 5.0, 0.0);
        assert_eq!(way.reason(0, 0.0, true), None);
        assert_eq!(way.reason(SECOND, 4.9, true), None);
        assert_eq!(way.reason(SECOND, 5.0, false), Some(Reason::Schedule));
        way.fixed(SECOND, 5.0);
        assert_eq!(way.reason(SECOND, 9.9, false), None);
        assert_eq!(way.reason(SECOND, 10.0, false), Some(Reason::Schedule));
        let mut time = asking(Ask::Schedule, 0.0, 10.0);
        // From the first stamp on, whatever it is.
        assert_eq!(time.reason(100 * SECOND, 0.0, false), None);
        assert_eq!(time.reason(110 * SECOND, 0.0, false), Some(Reason::Schedule));
    }

    #[test]
    fn when_degraded() {
        let mut asking = asking(Ask::Degraded, 0.0, 0.0);
        let config = LocalizationConfig::default();
        assert!(config.is_degraded(0.42) && !config.is_degraded(0.43));
        assert_eq!(asking.reason(0, 0.0, false), None);
        assert_eq!(asking.reason(1, 0.0, true), Some(Reason::Degraded));
        // In vain: not again before a second has passed.
        asking.failed(1);
        assert_eq!(asking.reason(SECOND, 0.0, true), None);
        assert_eq!(asking.reason(SECOND + 1, 0.0, true), Some(Reason::Degraded));
        assert_eq!(self::asking(Ask::Never, 1.0, 1.0).reason(SECOND, 9.0, true), None);
    }

    #[test]
    fn a_schedule_needs_an_interval() {
        let config = |ask, every_m| LocalizationConfig { ask, every_m, ..LocalizationConfig::default() };
        assert!(config(Ask::Degraded, 0.0).validate().is_ok());
        assert!(config(Ask::Schedule, 5.0).validate().is_ok());
        let key = |config: LocalizationConfig| config.validate().unwrap_err().key;
        assert_eq!(key(config(Ask::Schedule, 0.0)), "every_m");
        assert_eq!(key(config(Ask::Degraded, f64::NAN)), "every_m");
        assert_eq!(key(LocalizationConfig { every_s: -1.0, ..config(Ask::Never, 0.0) }), "every_s");
        assert_eq!(key(LocalizationConfig { retry_s: f64::INFINITY, ..config(Ask::Never, 0.0) }), "retry_s");
        assert_eq!(key(LocalizationConfig { gate_sigmas: -1.0, ..config(Ask::Never, 0.0) }), "gate_sigmas");
        assert_eq!(key(LocalizationConfig { degraded_trust: 1.5, ..config(Ask::Never, 0.0) }), "degraded_trust");
    }
}
