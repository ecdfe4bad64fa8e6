//! Why a reading is what it is: what only a simulator knows.

use core::f64::consts::PI;
use std::fmt;

use echogrid_core::Echo;

/// Where what was heard came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cause {
    /// A surface that was met steeply enough.
    Direct,
    /// Two walls that meet.
    Corner,
    /// A convex corner, or the end of a wall.
    Edge,
    /// Somebody.
    Person,
    /// Over one mirror or more: too far, and in another direction than it seems.
    Multipath,
    /// The sound of another sonar.
    Crosstalk,
    /// Nothing was heard.
    Nothing,
    /// The sonar is broken.
    Fault,
}

impl Cause {
    /// Every cause.
    pub const ALL: [Self; 8] = [
        Self::Direct,
        Self::Corner,
        Self::Edge,
        Self::Person,
        Self::Multipath,
        Self::Crosstalk,
        Self::Nothing,
        Self::Fault,
    ];

    /// The cause in a word.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Corner => "corner",
            Self::Edge => "edge",
            Self::Person => "person",
            Self::Multipath => "multipath",
            Self::Crosstalk => "crosstalk",
            Self::Nothing => "nothing",
            Self::Fault => "fault",
        }
    }
}

/// A reading, and the truth about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heard {
    /// The number of the transducer.
    pub transducer: u16,
    /// What the reading says.
    pub echo: Echo,
    /// Why the reading says so.
    pub cause: Cause,
    /// What the axis of its cone meets first, were it light: how far, metres; none: nothing within its range.
    pub ahead_m: Option<f64>,
    /// The angle from the surface's normal, radians in [0, π/2]; 0 where there is none.
    pub incidence_rad: f64,
}

/// How readings depend on the angle at which a cone's axis meets what is ahead.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct IncidenceTable {
    /// By steps of 10°.
    rows: [[u64; Cause::ALL.len()]; 9],
}

impl IncidenceTable {
    /// Counts a reading; those whose axis meets nothing within the range don't count.
    pub fn add(&mut self, heard: &Heard) {
        if heard.ahead_m.is_some() {
            let row = ((heard.incidence_rad * 18.0 / PI) as usize).min(self.rows.len() - 1);
            self.rows[row][heard.cause as usize] += 1;
        }
    }

    /// Readings between `from_deg` (a multiple of 10) and 10° more, by [`Cause::ALL`].
    #[must_use]
    pub fn counts(&self, from_deg: usize) -> [u64; Cause::ALL.len()] {
        self.rows.get(from_deg / 10).copied().unwrap_or_default()
    }

    /// Share of the readings from `from_deg` (a multiple of 10) to 10° more that have one of these causes; none without
    /// a reading.
    #[must_use]
    pub fn share(&self, from_deg: usize, causes: &[Cause]) -> Option<f64> {
        let counts = self.counts(from_deg);
        let total: u64 = counts.iter().sum();
        let sum: u64 = causes.iter().map(|cause| counts[*cause as usize]).sum();
        (total > 0).then(|| sum as f64 / total as f64)
    }
}

/// As a table of Markdown: shares of causes in percent.
impl fmt::Display for IncidenceTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heads: Vec<&str> = Cause::ALL.iter().map(|cause| cause.word()).collect();
        writeln!(f, "| incidence | readings | {} |", heads.join(" | "))?;
        writeln!(f, "|---|---|{}", "---|".repeat(heads.len()))?;
        for from_deg in (0..90).step_by(10) {
            let total: u64 = self.counts(from_deg).iter().sum();
            write!(f, "| {from_deg}–{}° | {total} |", from_deg + 10)?;
            for cause in Cause::ALL {
                match self.share(from_deg, &[cause]) {
                    Some(share) => write!(f, " {:.1} % |", 100.0 * share)?,
                    None => write!(f, " – |")?,
                }
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
