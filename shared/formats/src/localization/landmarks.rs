//! Landmarks: things whose place was surveyed. TOML, metres, map frame.
//!
//! ```toml
//! [[landmark]]
//! name = "A"              # one word; sightings call it so
//! at = [1.0, 6.0]
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use echogrid_core::Landmark;
use echogrid_core::landmarks::LENGTH_MAX_M;

use crate::near::near_word;
use crate::tables::{self, Item, PLACE, Schema};
use crate::text::{TextError, TextFileError, read_text};

/// Longest landmarks file, bytes.
pub const LANDMARKS_BYTES_MAX: u64 = 1 << 20;

const SCHEMA: Schema = Schema { tables: &[("landmark", &["name", "at"])], single: None };
const NAME: &str = "one word in quotes, without blanks and #, and not -";
const WITHIN: &str = "[x, y], metres within 3e7 of the origin";

/// Surveyed landmarks, each with a name and a place of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    all: Vec<Landmark>,
    by_name: BTreeMap<String, usize>,
}

impl Landmarks {
    /// Reads a landmarks file.
    ///
    /// # Errors
    /// When the file can't be read, is longer than [`LANDMARKS_BYTES_MAX`], or is refused by [`Landmarks::parse`].
    pub fn read(path: &Path) -> Result<Self, TextFileError> {
        read_text(path, LANDMARKS_BYTES_MAX, Self::parse)
    }

    /// The landmarks that a text tells.
    ///
    /// # Errors
    /// When the text is no TOML, a key is unknown, missing or has an impossible value, a name or a place is there twice, or there
    /// is no landmark.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let document = tables::parse(text)?;
        let items = tables::items(text, &document, &SCHEMA)?;
        let mut landmarks = Self { all: Vec::new(), by_name: BTreeMap::new() };
        let mut places: BTreeMap<[u64; 2], usize> = BTreeMap::new();
        let items = items.get("landmark").map(Vec::as_slice).unwrap_or_default();
        // The line that the landmark of an index stands in.
        let line_of = |index: usize| items.get(index).map_or(0, Item::line);
        for (index, item) in items.iter().enumerate() {
            let landmark = landmark(item)?;
            if let Some(first) = landmarks.by_name.insert(landmark.name.clone(), index) {
                return Err(item.wrong("name", &format!("a name of its own, not that of line {}", line_of(first))));
            }
            // -0 is 0.
            if let Some(first) = places.insert(landmark.at.map(|value| (value + 0.0).to_bits()), index) {
                return Err(item.wrong("at", &format!("a place of its own, not that of line {}", line_of(first))));
            }
            landmarks.all.push(landmark);
        }
        if landmarks.all.is_empty() {
            let expected = "tables [[landmark]] with name, at".to_owned();
            return Err(TextError { line: 1, found: "no landmark".to_owned(), expected });
        }
        Ok(landmarks)
    }

    /// The landmarks in the order of the file, in the map frame; never empty.
    #[must_use]
    pub fn all(&self) -> &[Landmark] {
        &self.all
    }

    /// The place of the landmark of a name in [`Landmarks::all`].
    #[must_use]
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// The name of a landmark that a name was probably meant to be.
    pub(super) fn near(&self, name: &str) -> Option<&str> {
        near_word(name, self.by_name.keys().map(String::as_str))
    }
}

fn landmark(item: &Item<'_>) -> Result<Landmark, TextError> {
    let name = item.text("name")?;
    if name == "-" || name.contains(|c: char| c.is_whitespace() || c.is_control() || c == '#') {
        return Err(item.wrong("name", NAME));
    }
    let at = item.pair("at", PLACE)?;
    if at.iter().any(|value| value.abs() > LENGTH_MAX_M) {
        return Err(item.wrong("at", WITHIN));
    }
    Ok(Landmark { name, at })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LANDMARKS: &str =
        "[[landmark]]\nname = \"door\"\nat = [1, 6.0]\n\n[[landmark]]\nname = \"ecke\"\nat = [-2.5, 0]\n";

    #[test]
    fn all_of_it() {
        let landmarks = Landmarks::parse(LANDMARKS).unwrap();
        let expected =
            [("door", [1.0, 6.0]), ("ecke", [-2.5, 0.0])].map(|(name, at)| Landmark { name: name.into(), at });
        assert_eq!(landmarks.all(), expected);
        assert_eq!((landmarks.index_of("ecke"), landmarks.index_of("x")), (Some(1), None));
        assert_eq!(landmarks.near("dor"), Some("door"));
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |from: &str, to: &str, expected: &str| {
            let error = Landmarks::parse(&LANDMARKS.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check(
            "[[landmark]]",
            "[[landmrk]]",
            "line 1: unknown table \"landmrk\"; expected landmark; did you mean landmark?",
        );
        check("[[landmark]]", "[[landmark]", "expected TOML");
        check("name =", "nam =", "line 2: unknown key \"nam\"; expected name, at; did you mean name?");
        check("at = [1, 6.0]", "", "line 1: a landmark without at; expected landmark with name, at");
        check("[1, 6.0]", "[1, nan]", "line 3: at of landmark is [1, nan]; expected [x, y], metres");
        check("[1, 6.0]", "[1, 6.0, 0]", "line 3: at of landmark is [1, 6.0, 0]; expected [x, y]");
        check("[1, 6.0]", "[1, 6e7]", "within 3e7 of the origin");
        check("\"door\"", "7", "line 2: name of landmark is 7; expected a text in quotes");
        check("\"door\"", "\"the door\"", "line 2: name of landmark is \"the door\"; expected one word in quotes");
        check("\"door\"", "\"-\"", "expected one word");
        check(
            "\"door\"",
            "\"ecke\"",
            "line 6: name of landmark is \"ecke\"; expected a name of its own, not that of line 1",
        );
        check(
            "[1, 6.0]",
            "[-2.5, 0.0]",
            "line 7: at of landmark is [-2.5, 0]; expected a place of its own, not that of line 1",
        );
        check(LANDMARKS, "", "line 1: no landmark; expected tables [[landmark]]");
    }

    #[test]
    fn errors_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("marks.toml");
        std::fs::write(&path, "[[landmark]]\nat = [0, 0]\n").unwrap();
        let error = Landmarks::read(&path).unwrap_err().to_string();
        assert!(error.contains("marks.toml: line 1: a landmark without name"), "{error}");
        std::fs::File::create(&path).unwrap().set_len(2 << 30).unwrap();
        assert!(Landmarks::read(&path).unwrap_err().to_string().contains("expected at most"));
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(\\[\\[landmark\\]\\]\n|name = \"|at = |\\[|\\]|,|\"|-?[0-9]{1,3}|\n|\\PC){0,60}") {
            let _ = Landmarks::parse(&text);
        }
    }
}
