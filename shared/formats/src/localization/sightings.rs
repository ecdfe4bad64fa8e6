//! Sightings: ranges and bearings that a robot measured to landmarks.
//!
//! ```text
//! # t landmark range_m bearing_rad
//! 12.5 door 2.31 -0.52
//! 12.5 corner - 1.07      # no range
//! 12.7 door 2.29 -        # no bearing
//! ```
//!
//! `t` is in the log's own time (see [`super::reference`]); the landmark is a name of the landmarks file; range and bearing are seen
//! from the robot's base, the bearing counter-clockwise from straight ahead. `-` stands for what was not measured.

use core::f64::consts::TAU;
use std::path::Path;

use echogrid_core::Sighting;
use echogrid_core::landmarks::LENGTH_MAX_M;

use super::landmarks::Landmarks;
use super::rows::{Row, count_moved, rows};
use crate::text::{TextError, TextFileError, read_text};

/// Longest sightings file, bytes.
pub const SIGHTINGS_BYTES_MAX: u64 = 64 << 20;

const ROW: &str = "4 words `t landmark range_m bearing_rad`, - for what was not measured";

/// What a robot measured of one landmark, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedSighting {
    /// Nanoseconds, in the log's time.
    pub stamp_ns: u64,
    /// Index of the landmark in [`Landmarks::all`].
    pub landmark: usize,
    /// The place of the landmark: x, y in the map frame, metres.
    pub at: [f64; 2],
    /// Distance from the robot's base, metres, if it was measured. Range or bearing, or both, are there.
    pub range_m: Option<f64>,
    /// Direction in the robot's frame, radians counter-clockwise, within a turn, if it was measured.
    pub bearing_rad: Option<f64>,
}

impl TimedSighting {
    /// With the standard deviations of the sensor, metres and radians: what
    /// [`triangulate`](echogrid_core::landmarks::triangulate) takes.
    #[must_use]
    pub fn measured(&self, range_sigma_m: f64, bearing_sigma_rad: f64) -> Sighting {
        let Self { at: landmark, range_m, bearing_rad, .. } = *self;
        Sighting { landmark, range_m, bearing_rad, range_sigma_m, bearing_sigma_rad }
    }
}

/// All sightings of a drive, by stamp.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sightings {
    all: Vec<TimedSighting>,
    moved: usize,
}

impl Sightings {
    /// Reads a sightings file.
    ///
    /// # Errors
    /// When the file can't be read, is longer than [`SIGHTINGS_BYTES_MAX`], or is refused by [`Sightings::parse`].
    pub fn read(path: &Path, landmarks: &Landmarks) -> Result<Self, TextFileError> {
        read_text(path, SIGHTINGS_BYTES_MAX, |text| Self::parse(text, landmarks))
    }

    /// The sightings that a text tells. Rows that are out of order are sorted, and counted.
    ///
    /// # Errors
    /// When a row is none, its landmark is unknown, a number is not finite or absurd, a landmark is there twice at one stamp, or
    /// there is no row.
    pub fn parse(text: &str, landmarks: &Landmarks) -> Result<Self, TextError> {
        let mut found = rows(text)
            .map(|row| sighting(&row, landmarks).map(|sighting| (sighting, row.line)))
            .collect::<Result<Vec<_>, _>>()?;
        if found.is_empty() {
            return Err(TextError { line: 1, found: "no sighting".to_owned(), expected: ROW.to_owned() });
        }
        let moved = count_moved(found.iter().map(|(sighting, _)| sighting.stamp_ns));
        found.sort_unstable_by_key(|(sighting, line)| (sighting.stamp_ns, sighting.landmark, *line));
        let key = |sighting: &TimedSighting| (sighting.stamp_ns, sighting.landmark);
        let twice = found.windows(2).filter(|pair| key(&pair[0].0) == key(&pair[1].0)).min_by_key(|pair| pair[1].1);
        if let Some([(_, first), (_, line)]) = twice {
            let expected = "each landmark once at each stamp".to_owned();
            return Err(TextError {
                line: *line,
                found: format!("stamp and landmark of line {first} again"),
                expected,
            });
        }
        Ok(Self { all: found.into_iter().map(|(sighting, _)| sighting).collect(), moved })
    }

    /// The sightings whose stamps are at most `within_ns` from a stamp, by stamp and landmark. A landmark that was seen several
    /// times within it is there several times.
    #[must_use]
    pub fn near(&self, stamp_ns: u64, within_ns: u64) -> &[TimedSighting] {
        let (first, last) = (stamp_ns.saturating_sub(within_ns), stamp_ns.saturating_add(within_ns));
        let start = self.all.partition_point(|sighting| sighting.stamp_ns < first);
        let end = self.all.partition_point(|sighting| sighting.stamp_ns <= last);
        self.all.get(start..end).unwrap_or_default()
    }

    /// All of them, by stamp and landmark.
    #[must_use]
    pub fn all(&self) -> &[TimedSighting] {
        &self.all
    }

    /// How many rows were earlier than one before them.
    #[must_use]
    pub fn moved(&self) -> usize {
        self.moved
    }
}

fn sighting(row: &Row<'_>, landmarks: &Landmarks) -> Result<TimedSighting, TextError> {
    let &[t, name, range, bearing] = row.words.as_slice() else { return Err(row.wrong(ROW)) };
    let stamp_ns = row.stamp_ns(t)?;
    let landmark = landmarks.index_of(name).ok_or_else(|| {
        let near = landmarks.near(name).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
        row.wrong_word("landmark", name, format!("a name of the landmarks file{near}"))
    })?;
    let at = landmarks.all().get(landmark).map(|landmark| landmark.at).ok_or_else(|| row.wrong(ROW))?;
    let number = |what: &str, word: &str, fits: fn(f64) -> bool, expected: &str| match word {
        "-" => Ok(None),
        word => row.number(what, word, fits, expected).map(Some),
    };
    let range_m =
        number("range_m", range, |range| (0.0..=LENGTH_MAX_M).contains(&range), "metres, from 0 to 3e7, or -")?;
    let bearing_rad =
        number("bearing_rad", bearing, |bearing| bearing.abs() <= TAU, "radians within a turn (-2π to 2π), or -")?;
    if range_m.is_none() && bearing_rad.is_none() {
        return Err(row.wrong("a range, a bearing or both"));
    }
    Ok(TimedSighting { stamp_ns, landmark, at, range_m, bearing_rad })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn landmarks() -> Landmarks {
        let text = "[[landmark]]\nname = \"door\"\nat = [1, 6]\n[[landmark]]\nname = \"corner\"\nat = [2, 3]\n";
        Landmarks::parse(text).unwrap()
    }

    #[test]
    fn all_of_it() {
        let text = "# t landmark range bearing\n2 door 1.5 -0.5\n\n1 corner - 3.1 # late\n2 corner 2.5 -\n";
        let sightings = Sightings::parse(text, &landmarks()).unwrap();
        assert_eq!((sightings.all().len(), sightings.moved()), (3, 1));
        let first =
            TimedSighting { stamp_ns: SECOND, landmark: 1, at: [2.0, 3.0], range_m: None, bearing_rad: Some(3.1) };
        assert_eq!(sightings.all()[0], first);
        let measured = sightings.all()[1].measured(0.1, 0.02);
        assert_eq!((measured.landmark, measured.range_m, measured.bearing_rad), ([1.0, 6.0], Some(1.5), Some(-0.5)));
        assert_eq!((measured.range_sigma_m, measured.bearing_sigma_rad), (0.1, 0.02));
        assert_eq!(sightings.near(2 * SECOND, 0).len(), 2);
        assert_eq!(sightings.near(3 * SECOND / 2, SECOND / 2).len(), 3);
        assert_eq!(sightings.near(3 * SECOND / 2, SECOND / 2 - 1).len(), 0);
        assert_eq!(sightings.near(u64::MAX, u64::MAX).len(), 3);
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |text: &str, expected: &str| {
            let error = Sightings::parse(text, &landmarks()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("", "line 1: no sighting; expected 4 words `t landmark range_m bearing_rad`");
        check("1 door 2\n", "line 1: \"1 door 2\"; expected 4 words");
        check("x door 2 1\n", "line 1: t is \"x\"; expected seconds");
        check(
            "\n1 dor 2 1\n",
            "line 2: landmark is \"dor\"; expected a name of the landmarks file; did you mean door?",
        );
        check("1 zzz 2 1\n", "landmark is \"zzz\"; expected a name of the landmarks file");
        check("1 door -2 1\n", "range_m is \"-2\"; expected metres, from 0 to 3e7, or -");
        check("1 door inf 1\n", "range_m is \"inf\"");
        check("1 door 2 90\n", "bearing_rad is \"90\"; expected radians within a turn");
        check("1 door - -\n", "line 1: \"1 door - -\"; expected a range, a bearing or both");
        check(
            "1 door 2 1\n2 door 2 1\n1.0 door 3 -\n",
            "line 3: stamp and landmark of line 1 again; expected each landmark once",
        );
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(-?[0-9.]{1,4} |door |corner |- |#|\n|\\PC){0,60}", stamp_ns: u64, within_ns: u64) {
            if let Ok(sightings) = Sightings::parse(&text, &landmarks()) {
                prop_assert!(sightings.near(stamp_ns, within_ns).len() <= sightings.all().len());
            }
        }
    }
}
