//! What is wrong within a log that is usable all the same.

use std::collections::BTreeMap;

use serde::Serialize;

/// Longest sample of a faulty value that is kept, characters.
const SAMPLE_CHARS: usize = 72;

/// A kind of damage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FaultKind {
    /// A word that should be a number is none; the line is refused.
    BadNumber,
    /// A pose or a velocity is NaN or infinite; the line is refused.
    NotFinite,
    /// A range is NaN or infinite; the reading is invalid.
    RangeNotFinite,
    /// A range beyond 100 km; the reading is invalid.
    AbsurdRange,
    /// A pose beyond 30 000 km or 10⁶ rad, or a sensor's angles that can't be; the line is refused.
    AbsurdPose,
    /// A velocity beyond 1000 m/s or rad/s; the line is refused.
    AbsurdVelocity,
    /// A stamp that is no number, negative, or beyond the year 2286; the line is placed after the one before it.
    BadStamp,
    /// A count of readings that can't be; the line is refused.
    BadCount,
    /// Words are missing at the end; the line is refused.
    Truncated,
    /// There are words too many; the line is refused.
    ExtraWords,
    /// More mounts of sonars than a robot can have sensors; the line is refused.
    TooManyMounts,
    /// A laser's angles are beyond a turn: they are read as degrees.
    AnglesInDegrees,
    /// A laser states neither field of view nor step: its beams are spread as those of `FLASER`.
    AnglesMissing,
    /// Step and number of beams make another field of view than the one that is stated: the step is believed.
    StepNotOfView,
    /// Step and number of beams make more than a turn: the field of view is believed.
    StepBeyondTurn,
    /// A sonar's cone is beyond half a turn: it is read as degrees.
    ConeInDegrees,
    /// A sonar's cone is 0: it is taken to be 30° wide.
    ConeMissing,
    /// A sonar's cone is negative: its size counts.
    ConeNegative,
    /// A sonar's cone is wider than 90°: it is used, but hardly any sonar's is.
    ConeWide,
    /// A sonar cone narrower than 1°; it is used as it stands.
    ConeNarrow,
    /// No message at all; the line is refused.
    NotAMessage,
    /// Bytes that are no text; the line is refused.
    NotUtf8,
    /// Longer than any message; the line is refused.
    LineTooLong,
    /// The compressed stream is cut or damaged; everything before the damage is used.
    GzipDamaged,
    /// A recording ends before its end; everything up to there is used.
    RecordingCut,
    /// A recording was never closed: nobody knows what its recorder had not written yet.
    RecordingUnclosed,
    /// What should be a record of a recording is none; everything before it is used.
    RecordingDamaged,
    /// A chunk of messages can't be unpacked, or not whole; what can is used.
    ChunkDamaged,
    /// A message is not what its type says, and not used.
    MessageDamaged,
    /// Readings of a sensor that was not there when the robot was described; they are not used.
    SensorCameLate,
    /// A line is, word for word, the one of its kind before it, stamp included: it is used once.
    Repeated,
}

/// What is counted, where something is said to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CountedBy {
    /// Lines of a text.
    #[default]
    Line,
    /// Messages of a recording.
    Message,
}

impl core::fmt::Display for CountedBy {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Line => "line",
            Self::Message => "message",
        })
    }
}

impl core::fmt::Display for FaultKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::BadNumber => "not a number",
            Self::NotFinite => "pose or velocity not finite",
            Self::RangeNotFinite => "range not finite",
            Self::AbsurdRange => "range beyond 100 km",
            Self::AbsurdPose => "absurd pose or angle",
            Self::AbsurdVelocity => "velocity beyond 1000 m/s or rad/s",
            Self::BadStamp => "stamp unusable",
            Self::BadCount => "impossible count of readings",
            Self::Truncated => "truncated line",
            Self::ExtraWords => "words too many",
            Self::TooManyMounts => "more mounts of sonars than a robot can have",
            Self::AnglesInDegrees => "laser angles beyond a turn, read as degrees",
            Self::AnglesMissing => "laser without field of view and step, beams spread over 180° as in FLASER",
            Self::StepNotOfView => "step and number of beams don't make the field of view; the step is believed",
            Self::StepBeyondTurn => "step and number of beams make more than a turn; the field of view is believed",
            Self::ConeInDegrees => "sonar cone beyond half a turn, read as degrees",
            Self::ConeMissing => "sonar cone of 0, taken for one of 30°",
            Self::ConeNegative => "negative sonar cone, its size is used",
            Self::ConeWide => "sonar cone wider than 90°, used as it stands",
            Self::ConeNarrow => "sonar cone narrower than 1°, used as it stands: is it in radians?",
            Self::NotAMessage => "not a message",
            Self::NotUtf8 => "not text",
            Self::LineTooLong => "line too long",
            Self::GzipDamaged => "compressed stream cut or damaged",
            Self::RecordingCut => "recording cut, used up to there",
            Self::RecordingUnclosed => "recording never closed, what its recorder had not written is missing",
            Self::RecordingDamaged => "no record of a recording, nothing behind it is used",
            Self::ChunkDamaged => "chunk of messages damaged",
            Self::MessageDamaged => "message that is not what its type says",
            Self::SensorCameLate => "readings of a sensor that the first lines did not show, not used",
            Self::Repeated => "line that repeats the one of its kind before it, word for word, used once",
        })
    }
}

/// All damage of one kind.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// What is wrong.
    pub kind: FaultKind,
    /// How often: refused lines, or for ranges the readings.
    pub count: u64,
    /// The first line that has it, or of a recording the message, counted from 1.
    pub first_line: u64,
    /// Which of the two.
    pub place: CountedBy,
    /// The value found there, shortened.
    pub sample: String,
}

impl core::fmt::Display for Fault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { kind, count, first_line, place, sample } = self;
        match (place, first_line) {
            (CountedBy::Message, 0) => write!(f, "{kind} ({count} times: \"{sample}\")"),
            _ => write!(f, "{kind} ({count} times, first in {place} {first_line}: \"{sample}\")"),
        }
    }
}

/// Why a line, or a reading in it, is refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub(crate) kind: FaultKind,
    pub(crate) sample: String,
}

impl Refusal {
    pub(crate) fn new(kind: FaultKind, sample: impl AsRef<str>) -> Self {
        Self { kind, sample: shorten(sample.as_ref()) }
    }
}

/// Counts damage by kind.
#[derive(Debug, Default)]
pub(crate) struct FaultCounter {
    faults: BTreeMap<FaultKind, Fault>,
    place: CountedBy,
}

impl FaultCounter {
    pub(crate) fn new(place: CountedBy) -> Self {
        Self { faults: BTreeMap::new(), place }
    }

    pub(crate) fn count(&mut self, line: u64, refusal: Refusal) {
        self.count_many(line, refusal, 1);
    }

    pub(crate) fn count_many(&mut self, line: u64, refusal: Refusal, times: u64) {
        let Refusal { kind, sample } = refusal;
        let place = self.place;
        self.faults.entry(kind).or_insert(Fault { kind, count: 0, first_line: line, place, sample }).count += times;
    }

    /// What was counted so far, by kind.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Fault> {
        self.faults.values()
    }

    /// All of it, by kind.
    pub(crate) fn into_faults(self) -> Vec<Fault> {
        self.faults.into_values().collect()
    }
}

/// The fault that comes first in the file, for error messages.
pub(crate) fn first_fault(faults: &[Fault]) -> Option<String> {
    faults.iter().min_by_key(|fault| fault.first_line).map(ToString::to_string)
}

fn shorten(text: &str) -> String {
    let mut sample: String = text.chars().take(SAMPLE_CHARS).flat_map(char::escape_debug).collect();
    if text.chars().nth(SAMPLE_CHARS).is_some() {
        sample.push('…');
    }
    sample
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_by_kind_and_keeps_the_first() {
        let mut counter = FaultCounter::default();
        counter.count(3, Refusal::new(FaultKind::BadNumber, "a"));
        counter.count(2, Refusal::new(FaultKind::Truncated, "b"));
        counter.count(9, Refusal::new(FaultKind::BadNumber, "c"));
        let faults = counter.into_faults();
        assert_eq!(faults.len(), 2);
        assert_eq!((faults[0].count, faults[0].first_line, faults[0].sample.as_str()), (2, 3, "a"));
        assert!(first_fault(&faults).unwrap().contains("line 2"));
    }

    #[test]
    fn samples_are_short_and_printable() {
        let refusal = Refusal::new(FaultKind::NotAMessage, "\u{1b}".repeat(1000));
        assert!(refusal.sample.len() < 500);
        assert!(!refusal.sample.contains('\u{1b}'));
    }
}
