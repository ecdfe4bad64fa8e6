//! Tables of trials, of which an odometry error model is made.
//!
//! ```text
//! phase,measured_dl_m,measured_dtheta_rad,true_dl_m,true_dtheta_rad
//! translation,3.297,0.012,3.000,0.004
//! rotation,0.002,3.471,0.000,3.142     # counter-clockwise
//! ```
//!
//! Words are separated by commas, columns may stand in any order, and the first row names them. A trial is a translation or a
//! rotation; what was measured of it is what the odometry says, what is true was taken with a tape measure or the like: ways
//! along the path, negative backwards; turns counter-clockwise, not wrapped. A column `series` may tell several calibrations
//! apart. A `#` and what follows it in the line is a comment. These tables are small and made with care, so nothing in them
//! is passed over: whatever is wrong is an error with its line.

use std::path::Path;

use echogrid_core::Trial;

use crate::near::near_word;
use crate::text::{TextError, TextFileError, quoted, read_text};

/// Longest table, bytes.
pub const TRIALS_BYTES_MAX: u64 = 16 << 20;

const COLUMNS: [&str; 5] = ["phase", "measured_dl_m", "measured_dtheta_rad", "true_dl_m", "true_dtheta_rad"];
const SERIES: &str = "series";
/// A way beyond this is none, metres; nor is an angle, radians.
const MOST: f64 = 1e6;

/// One of the two kinds of trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Straight ahead, or back.
    Translation,
    /// On the spot.
    Rotation,
}

/// A table of trials.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trials {
    rows: Vec<Row>,
}

#[derive(Debug, Clone, PartialEq)]
struct Row {
    series: Option<String>,
    phase: Phase,
    trial: Trial,
}

impl Trials {
    /// Reads a table of trials.
    ///
    /// # Errors
    /// When the file can't be read, is longer than [`TRIALS_BYTES_MAX`], or is refused by [`Trials::parse`].
    pub fn read(path: &Path) -> Result<Self, TextFileError> {
        read_text(path, TRIALS_BYTES_MAX, Self::parse)
    }

    /// The trials that a text tells.
    ///
    /// # Errors
    /// When a column is missing, unknown or there twice, a row has more or fewer words than the first, a word is not what its
    /// column says, or there is no trial.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().filter_map(|(index, line)| {
            let text = line.split('#').next().unwrap_or_default().trim();
            (!text.is_empty()).then(|| Line {
                number: index + 1,
                text,
                words: text.split(',').map(str::trim).collect(),
            })
        });
        let header = lines.next().ok_or_else(|| TextError {
            line: 1,
            found: "an empty table".to_owned(),
            expected: format!("a first row {}", COLUMNS.join(",")),
        })?;
        let columns = header.columns()?;
        let rows = lines.map(|line| line.row(&header, &columns)).collect::<Result<Vec<_>, _>>()?;
        if rows.is_empty() {
            let expected = "a row for each trial".to_owned();
            return Err(TextError {
                line: header.number,
                found: "no trial after the names of the columns".to_owned(),
                expected,
            });
        }
        Ok(Self { rows })
    }

    /// The trials of a phase; of one series, or of all.
    #[must_use]
    pub fn of(&self, phase: Phase, series: Option<&str>) -> Vec<Trial> {
        let of_series = |row: &&Row| series.is_none() || row.series.as_deref() == series;
        self.rows.iter().filter(of_series).filter(|row| row.phase == phase).map(|row| row.trial).collect()
    }

    /// The names of the series, each once, in the order of the table; none where there is no such column.
    #[must_use]
    pub fn series(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        let mut seen = std::collections::BTreeSet::new();
        names.extend(self.rows.iter().filter_map(|row| row.series.as_deref()).filter(|name| seen.insert(*name)));
        names
    }
}

/// A line that is neither blank nor a comment.
struct Line<'a> {
    /// CountedBy from 1.
    number: usize,
    text: &'a str,
    words: Vec<&'a str>,
}

/// Where the columns stand.
struct Columns {
    known: [usize; 5],
    series: Option<usize>,
}

impl Line<'_> {
    fn wrong(&self, found: String, expected: impl Into<String>) -> TextError {
        TextError { line: self.number, found, expected: expected.into() }
    }

    /// The names of the columns.
    fn columns(&self) -> Result<Columns, TextError> {
        for (index, word) in self.words.iter().enumerate() {
            if !COLUMNS.contains(word) && *word != SERIES {
                let names = COLUMNS.iter().copied().chain([SERIES]);
                let near = near_word(word, names).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
                let found = format!("unknown column {}", quoted(word));
                return Err(self.wrong(found, format!("{} and perhaps {SERIES}{near}", COLUMNS.join(", "))));
            }
            if self.words[..index].contains(word) {
                return Err(self.wrong(format!("column {word} twice"), "each column once"));
            }
        }
        let place = |name: &str| self.words.iter().position(|word| *word == name);
        let mut known = [0; 5];
        for (known, name) in known.iter_mut().zip(COLUMNS) {
            *known = place(name).ok_or_else(|| self.wrong(format!("no column {name}"), COLUMNS.join(", ")))?;
        }
        Ok(Columns { known, series: place(SERIES) })
    }

    fn row(&self, header: &Line<'_>, columns: &Columns) -> Result<Row, TextError> {
        if self.words.len() != header.words.len() {
            let expected = format!("{} words, as in line {}", header.words.len(), header.number);
            return Err(self.wrong(quoted(self.text), expected));
        }
        let word = |place: usize| self.words.get(place).copied().unwrap_or_default();
        let phase = match word(columns.known[0]) {
            "translation" => Phase::Translation,
            "rotation" => Phase::Rotation,
            other => return Err(self.wrong(format!("phase is {}", quoted(other)), "translation or rotation")),
        };
        let number = |index: usize, unit: &str| {
            let word = word(columns.known[index]);
            let number = word.parse().ok().filter(|number: &f64| number.abs() <= MOST);
            number.ok_or_else(|| {
                self.wrong(format!("{} is {}", COLUMNS[index], quoted(word)), format!("{unit}, within ±1e6"))
            })
        };
        let trial = Trial {
            measured_m: number(1, "metres")?,
            measured_rad: number(2, "radians")?,
            true_m: number(3, "metres")?,
            true_rad: number(4, "radians")?,
        };
        Ok(Row { series: columns.series.map(|place| word(place).to_owned()), phase, trial })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const HEAD: &str = "phase,measured_dl_m,measured_dtheta_rad,true_dl_m,true_dtheta_rad\n";

    #[test]
    fn all_of_it() {
        let text = "\u{feff}# made by hand\n\ntrue_dl_m, phase ,series,measured_dl_m,measured_dtheta_rad,true_dtheta_rad\r\n\
            3,translation,a,3.3,0.01,0\n-0.1 , rotation, b ,0,-7.1,-6.9 # clockwise\n1,translation,b,1,0,0\n";
        let trials = Trials::parse(text).unwrap();
        let first = Trial { measured_m: 3.3, measured_rad: 0.01, true_m: 3.0, true_rad: 0.0 };
        let turn = Trial { measured_m: 0.0, measured_rad: -7.1, true_m: -0.1, true_rad: -6.9 };
        assert_eq!(trials.series(), ["a", "b"]);
        assert_eq!(trials.of(Phase::Translation, Some("a")), [first]);
        assert_eq!((trials.of(Phase::Translation, None).len(), trials.of(Phase::Rotation, None)), (2, vec![turn]));
        assert!(trials.of(Phase::Rotation, Some("c")).is_empty());
        assert!(Trials::parse(&format!("{HEAD}rotation,0,1,0,1\n")).unwrap().series().is_empty());
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |text: &str, expected: &str| {
            let error = Trials::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("", "line 1: an empty table; expected a first row phase,measured_dl_m,");
        check(HEAD, "line 1: no trial after the names of the columns; expected a row for each trial");
        check(
            "phase,measured_dl_m,true_dl_m,true_dtheta_rad\n",
            "line 1: no column measured_dtheta_rad; expected phase,",
        );
        check("phase,measured_dl\n", "line 1: unknown column \"measured_dl\"; expected phase, measured_dl_m");
        check("phase,measured_dl\n", "did you mean measured_dl_m?");
        check("phase,phase\n", "line 1: column phase twice; expected each column once");
        check(&format!("{HEAD}\nrotation,1,2,3\n"), "line 3: \"rotation,1,2,3\"; expected 5 words, as in line 1");
        check(&format!("{HEAD}turn,1,2,3,4\n"), "line 2: phase is \"turn\"; expected translation or rotation");
        check(
            &format!("{HEAD}rotation,1,NaN,3,4\n"),
            "line 2: measured_dtheta_rad is \"NaN\"; expected radians, within ±1e6",
        );
        check(&format!("{HEAD}rotation,1,1,1e7,4\n"), "line 2: true_dl_m is \"1e7\"; expected metres");
        check(&format!("{HEAD}rotation,,1,1,4\n"), "line 2: measured_dl_m is \"\"; expected metres");
    }

    #[test]
    fn errors_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials.csv");
        std::fs::write(&path, "phase\n").unwrap();
        let error = Trials::read(&path).unwrap_err().to_string();
        assert!(error.contains("trials.csv: line 1: no column measured_dl_m"), "{error}");
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(translation|rotation|,|-?[0-9.e]{1,5}|nan|#|\n|\\PC){0,60}", headed: bool) {
            let text = if headed { format!("{HEAD}{text}") } else { text };
            if let Ok(trials) = Trials::parse(&text) {
                let count = [Phase::Translation, Phase::Rotation].map(|phase| trials.of(phase, None).len());
                prop_assert!(count[0] + count[1] > 0);
            }
        }
    }
}
