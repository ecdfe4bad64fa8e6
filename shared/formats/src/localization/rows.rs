//! Stamped rows of words, one to a line.

use echogrid_core::landmarks::LENGTH_MAX_M;

use crate::log::parse_stamp_ns;
use crate::text::{TextError, quoted};

/// A line that is neither blank nor a comment.
pub(super) struct Row<'a> {
    /// CountedBy from 1.
    pub(super) line: usize,
    text: &'a str,
    pub(super) words: Vec<&'a str>,
}

/// The rows of a text. A `#` and what follows it in the line is a comment.
pub(super) fn rows(text: &str) -> impl Iterator<Item = Row<'_>> {
    text.trim_start_matches('\u{feff}').lines().enumerate().filter_map(|(index, line)| {
        let text = line.split('#').next().unwrap_or_default().trim();
        (!text.is_empty()).then(|| Row { line: index + 1, text, words: text.split_whitespace().collect() })
    })
}

impl Row<'_> {
    /// An error about the whole row.
    pub(super) fn wrong(&self, expected: impl Into<String>) -> TextError {
        TextError { line: self.line, found: quoted(self.text), expected: expected.into() }
    }

    /// An error about one word.
    pub(super) fn wrong_word(&self, what: &str, word: &str, expected: impl Into<String>) -> TextError {
        TextError { line: self.line, found: format!("{what} is {}", quoted(word)), expected: expected.into() }
    }

    pub(super) fn stamp_ns(&self, word: &str) -> Result<u64, TextError> {
        parse_stamp_ns(word).ok_or_else(|| self.wrong_word("t", word, "seconds, 0 or more and before the year 2286"))
    }

    /// A number that is finite and fits.
    pub(super) fn number(
        &self,
        what: &str,
        word: &str,
        fits: impl Fn(f64) -> bool,
        expected: &str,
    ) -> Result<f64, TextError> {
        let number = word.parse().ok().filter(|number: &f64| number.is_finite() && fits(*number));
        number.ok_or_else(|| self.wrong_word(what, word, expected))
    }

    /// A coordinate in the map frame.
    pub(super) fn coordinate(&self, what: &str, word: &str) -> Result<f64, TextError> {
        self.number(what, word, |value| value.abs() <= LENGTH_MAX_M, "metres, within 3e7 of the origin")
    }
}

/// How many of some stamps are earlier than one before them.
pub(super) fn count_moved(stamps: impl Iterator<Item = u64>) -> usize {
    let mut newest = 0;
    let is_moved = |stamp: &u64| {
        let before = newest;
        newest = newest.max(*stamp);
        before > *stamp
    };
    stamps.filter(is_moved).count()
}
