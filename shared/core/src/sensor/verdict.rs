//! What became of a reading.

use serde::{Deserialize, Serialize};

/// Every reading leaves with one of these. The codes are stable: they are sent and recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Verdict {
    /// It is in the map.
    Accepted = 0,
    /// A fault, a range that is no range, or a transducer that the robot does not have.
    Invalid = 1,
    /// Nothing answered within the sensor's range.
    NoEcho = 2,
    /// Nearer than the lower range limit.
    BelowMinimum = 3,
    /// Farther than the upper range limit.
    AboveMaximum = 4,
    /// By a sonar that is not among those selected.
    NotSelected = 5,
    /// The odometry is too uncertain for it to move a cell.
    Untrusted = 6,
    /// It is not known where the robot was.
    NoPose = 7,
    /// The reading's cone lies outside what a map can hold.
    OffMap = 8,
    /// Mapping was on hold: until the next absolute localization, or because the user paused it.
    Held = 9,
    /// The sonar is stuck or blocked: it says, time and again, what others contradict.
    Stuck = 10,
    /// No other sonar supports it: crosstalk, or a ghost.
    Lone = 11,
    /// A multiple reflection: something stands in what it claims to be empty.
    MultipleReflection = 12,
}

impl Verdict {
    /// How many verdicts there are.
    pub const COUNT: usize = 13;

    /// All of them, in the order of their codes.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Accepted,
        Self::Invalid,
        Self::NoEcho,
        Self::BelowMinimum,
        Self::AboveMaximum,
        Self::NotSelected,
        Self::Untrusted,
        Self::NoPose,
        Self::OffMap,
        Self::Held,
        Self::Stuck,
        Self::Lone,
        Self::MultipleReflection,
    ];

    /// The code of the verdict on the wire and in files.
    #[must_use]
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The verdict of a code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The name of the verdict in files and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Invalid => "invalid",
            Self::NoEcho => "no_echo",
            Self::BelowMinimum => "below_minimum",
            Self::AboveMaximum => "above_maximum",
            Self::NotSelected => "not_selected",
            Self::Untrusted => "untrusted",
            Self::NoPose => "no_pose",
            Self::OffMap => "off_map",
            Self::Held => "held",
            Self::Stuck => "stuck",
            Self::Lone => "lone",
            Self::MultipleReflection => "multiple_reflection",
        }
    }

    /// What it means, for people.
    #[must_use]
    pub fn describe(self) -> &'static str {
        match self {
            Self::Accepted => "in the map",
            Self::Invalid => "a fault, or from a transducer that the robot does not have",
            Self::NoEcho => "nothing answered within the sensor's range",
            Self::BelowMinimum => "nearer than the lower range limit",
            Self::AboveMaximum => "farther than the upper range limit",
            Self::NotSelected => "by a sonar that is not selected",
            Self::Untrusted => "the odometry is too uncertain for it to move a cell",
            Self::NoPose => "it is not known where the robot was",
            Self::OffMap => "its cone lies outside what a map can hold",
            Self::Held => "mapping was on hold, until the next absolute localization or by hand",
            Self::Stuck => "its sonar is stuck or blocked: others contradict it time and again",
            Self::Lone => "no other sonar supports it",
            Self::MultipleReflection => "a multiple reflection: something stands in what it claims to be empty",
        }
    }
}

impl core::fmt::Display for Verdict {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

/// How many readings got which verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct VerdictCounts {
    counts: [u64; Verdict::COUNT],
}

impl VerdictCounts {
    /// One more reading.
    pub fn add(&mut self, verdict: Verdict) {
        self.counts[verdict as usize] += 1;
    }

    /// `count` more readings with this verdict.
    pub fn add_many(&mut self, verdict: Verdict, count: u64) {
        let slot = &mut self.counts[verdict as usize];
        *slot = slot.saturating_add(count);
    }

    /// A reading that was counted as `before` has got another verdict.
    pub fn change(&mut self, before: Verdict, now: Verdict) {
        let slot = &mut self.counts[before as usize];
        *slot = slot.saturating_sub(1);
        self.add(now);
    }

    /// All those of `other` too.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.counts.iter_mut().zip(other.counts) {
            *mine += theirs;
        }
    }

    /// How many got this verdict.
    #[must_use]
    pub fn get(&self, verdict: Verdict) -> u64 {
        self.counts[verdict as usize]
    }

    /// How many readings in all.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.counts.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Each verdict with its count, in the order of the codes, zeros included.
    pub fn iter(&self) -> impl Iterator<Item = (Verdict, u64)> + '_ {
        Verdict::ALL.into_iter().zip(self.counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_that_were_recorded() {
        let codes: Vec<(u8, &str)> = Verdict::ALL.into_iter().map(|v| (v.code(), v.name())).collect();
        let recorded = [
            (0, "accepted"),
            (1, "invalid"),
            (2, "no_echo"),
            (3, "below_minimum"),
            (4, "above_maximum"),
            (5, "not_selected"),
            (6, "untrusted"),
            (7, "no_pose"),
            (8, "off_map"),
            (9, "held"),
            (10, "stuck"),
            (11, "lone"),
            (12, "multiple_reflection"),
        ];
        assert_eq!(codes, recorded);
        for verdict in Verdict::ALL {
            assert_eq!(Verdict::from_code(verdict.code()), Some(verdict));
        }
        assert_eq!(Verdict::from_code(13), None);
    }

    #[test]
    fn counts_add_up() {
        let mut counts = VerdictCounts::default();
        counts.add(Verdict::Accepted);
        counts.add(Verdict::Accepted);
        counts.add(Verdict::OffMap);
        let mut more = VerdictCounts::default();
        more.add(Verdict::Accepted);
        counts.merge(&more);
        assert_eq!(counts.get(Verdict::Accepted), 3);
        assert_eq!(counts.get(Verdict::OffMap), 1);
        assert_eq!(counts.get(Verdict::NoEcho), 0);
        assert_eq!(counts.total(), 4);
        counts.change(Verdict::OffMap, Verdict::Accepted);
        assert_eq!((counts.get(Verdict::Accepted), counts.get(Verdict::OffMap), counts.total()), (4, 0, 4));
        counts.change(Verdict::Accepted, Verdict::OffMap);
        assert_eq!(counts.iter().filter(|(_, n)| *n > 0).count(), 2);
    }
}
