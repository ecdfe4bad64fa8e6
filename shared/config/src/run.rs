//! `[run]`: how fast, where to, and on which robot.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The `[run]` section, resolved: how fast, where to, and on which robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RunConfig {
    /// How fast stamps go by.
    pub rate: Rate,
    /// The folder that maps are saved to; made when it is missing.
    pub out: PathBuf,
    /// What keeps two running graphs apart.
    pub domain: Domain,
    /// `auto` (what the log says), the name of a built-in robot, or a robot file.
    pub robot: String,
    /// A service of which nothing is heard for so long, and that does not work, hangs and is killed; seconds.
    pub alive_within_s: f64,
    /// The folder in which services store what a run can be resumed from when all of it died; empty: nowhere.
    pub spool: PathBuf,
    /// The map of an earlier drive, which this one is localized in and goes on with; empty: none.
    pub r#continue: PathBuf,
}

impl Default for RunConfig {
    fn default() -> Self {
        Self {
            rate: Rate::Max,
            out: PathBuf::from("maps"),
            domain: Domain::Auto,
            robot: AUTO.to_owned(),
            alive_within_s: 30.0,
            spool: PathBuf::new(),
            r#continue: PathBuf::new(),
        }
    }
}

/// The word for "find out by yourself".
pub(crate) const AUTO: &str = "auto";

/// A word or a number that is not what it should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub struct NotA(pub &'static str);

/// How fast stamps go by, against the clock on the wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawRate", into = "RawRate")]
pub enum Rate {
    /// The fastest that the slowest process can take.
    Max,
    /// So many times real time; finite and positive.
    Times(f64),
}

/// A [`Rate`] as it is written.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum RawRate {
    Times(f64),
    Word(String),
}

impl Rate {
    const EXPECTED: NotA = NotA("\"max\" or a number above 0 (times real time)");

    /// `times` real time, when that is a number above 0.
    ///
    /// # Errors
    /// What was expected instead.
    pub fn times(times: f64) -> Result<Self, NotA> {
        if times.is_finite() && times > 0.0 { Ok(Self::Times(times)) } else { Err(Self::EXPECTED) }
    }
}

impl TryFrom<RawRate> for Rate {
    type Error = NotA;

    fn try_from(raw: RawRate) -> Result<Self, NotA> {
        match raw {
            RawRate::Times(times) => Self::times(times),
            RawRate::Word(word) if word == "max" => Ok(Self::Max),
            RawRate::Word(_) => Err(Self::EXPECTED),
        }
    }
}

impl From<Rate> for RawRate {
    fn from(rate: Rate) -> Self {
        match rate {
            Rate::Max => Self::Word("max".to_owned()),
            Rate::Times(times) => Self::Times(times),
        }
    }
}

impl FromStr for Rate {
    type Err = NotA;

    fn from_str(text: &str) -> Result<Self, NotA> {
        if text == "max" { Ok(Self::Max) } else { Self::times(text.parse().map_err(|_| Self::EXPECTED)?) }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Max => f.write_str("max"),
            Self::Times(times) => times.fmt(f),
        }
    }
}

/// The name that keeps this graph's shared memory, files and ports apart from another's.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Domain {
    /// The launcher chooses one that is free.
    Auto,
    /// This one: 1 to 20 of a-z, 0-9 and `-`.
    Named(String),
}

/// Whether `name` may name a domain or a service: 1 to 20 of a-z, 0-9 and `-`.
pub(crate) fn is_short_name(name: &str) -> bool {
    (1..=20).contains(&name.len()) && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

impl TryFrom<String> for Domain {
    type Error = NotA;

    fn try_from(text: String) -> Result<Self, NotA> {
        match text.as_str() {
            AUTO => Ok(Self::Auto),
            name if is_short_name(name) => Ok(Self::Named(text)),
            _ => Err(NotA("\"auto\" or a name: 1 to 20 of a-z, 0-9 and -")),
        }
    }
}

impl From<Domain> for String {
    fn from(domain: Domain) -> Self {
        match domain {
            Domain::Auto => AUTO.to_owned(),
            Domain::Named(name) => name,
        }
    }
}

impl FromStr for Domain {
    type Err = NotA;

    fn from_str(text: &str) -> Result<Self, NotA> {
        Self::try_from(text.to_owned())
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str(AUTO),
            Self::Named(name) => f.write_str(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates() {
        let check = |text: &str, expected: Option<Rate>| assert_eq!(text.parse::<Rate>().ok(), expected, "{text}");
        check("max", Some(Rate::Max));
        check("1", Some(Rate::Times(1.0)));
        check("0.5", Some(Rate::Times(0.5)));
        for bad in ["", "0", "-1", "nan", "inf", "Max", "fast"] {
            check(bad, None);
        }
    }

    #[test]
    fn domains() {
        let check = |text: &str, expected: Option<Domain>| assert_eq!(text.parse::<Domain>().ok(), expected, "{text}");
        check("auto", Some(Domain::Auto));
        check("lab-2", Some(Domain::Named("lab-2".to_owned())));
        for bad in ["", "Lab", "a b", "a/b", "ü", "a-name-of-21-letters-"] {
            check(bad, None);
        }
    }
}
