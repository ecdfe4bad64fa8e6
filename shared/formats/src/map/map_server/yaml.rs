//! What the YAML of a map says.
//!
//! Any YAML 1.2 is understood (see [`super::entries`]); keys that a map has no use for are ignored.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::entries::{Entry, entries};
use crate::near::near_word;
use crate::text::shortened;

/// How the pixels of a map are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapMode {
    /// Occupied, free or unknown.
    #[default]
    Trinary,
    /// A probability; transparent is unknown.
    Scale,
    /// Percent; above 100 is unknown.
    Raw,
}

impl MapMode {
    /// The word for it in a YAML.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Trinary => "trinary",
            Self::Scale => "scale",
            Self::Raw => "raw",
        }
    }
}

/// What a map's YAML says.
#[derive(Debug, Clone, PartialEq)]
pub struct MapYaml {
    /// The image, relative to the YAML's folder.
    pub image: String,
    /// Side of a pixel, metres.
    pub resolution_m: f64,
    /// Pose of the lower-left corner of the lower-left pixel: x, y in metres, yaw in radians.
    pub origin: [f64; 3],
    /// White is occupied, not free.
    pub negate: bool,
    /// Darker than this is occupied.
    pub occupied_thresh: f64,
    /// Lighter than this is free.
    pub free_thresh: f64,
    /// How pixels are read.
    pub mode: MapMode,
}

/// What is wrong with a map's YAML.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum YamlError {
    /// A line that is no YAML, or not what a map's YAML is made of.
    #[error("line {line}: \"{text}\": {what}; expected `key: value`")]
    Line {
        /// CountedBy from 1.
        line: usize,
        /// The line, shortened.
        text: String,
        /// What is wrong with it.
        what: String,
    },
    /// A value that can't be.
    #[error("line {line}: {key} is \"{value}\"; expected {expected}")]
    Value {
        /// CountedBy from 1.
        line: usize,
        /// The key.
        key: &'static str,
        /// What was found, shortened.
        value: String,
        /// What would have been right.
        expected: &'static str,
    },
    /// A key stands there twice.
    #[error("line {line}: {key} stands there twice")]
    Twice {
        /// CountedBy from 1.
        line: usize,
        /// The key.
        key: String,
    },
    /// A key that must be there is not.
    #[error("there is no {key}{}", near.as_deref().map(|near| format!("; did you mean it by {near}?")).unwrap_or_default())]
    Missing {
        /// The key.
        key: &'static str,
        /// A key that is there and nearly that.
        near: Option<String>,
    },
    /// Too long for a map's YAML.
    #[error("{bytes} bytes; a map's YAML has at most 65536")]
    TooLong {
        /// The length of the text, bytes.
        bytes: usize,
    },
}

const BYTES_MAX: usize = 65_536;

impl MapYaml {
    /// Reads a YAML. Keys that a map has no use for are ignored.
    ///
    /// # Errors
    /// When a key is missing, stands there twice, or has an impossible value.
    pub fn parse(text: &str) -> Result<Self, YamlError> {
        if text.len() > BYTES_MAX {
            return Err(YamlError::TooLong { bytes: text.len() });
        }
        let entries = entries(text)?;
        let find = |key: &'static str| entries.iter().find(|entry| &*entry.key == key);
        let need = |key: &'static str| {
            find(key).ok_or_else(|| {
                let unknown = entries.iter().map(|entry| &*entry.key).filter(|key| !KEYS.contains(key));
                YamlError::Missing { key, near: near_word(key, unknown).map(ToOwned::to_owned) }
            })
        };
        let image_entry = need("image")?;
        let image = image_entry
            .text()
            .map(str::trim_end)
            .filter(|image| !image.is_empty())
            .ok_or_else(|| image_entry.wrong("image", "a file name"))?;
        let resolution = need("resolution")?;
        let resolution_m = resolution
            .text()
            .and_then(number)
            .filter(|metres| (1e-6..1e6).contains(metres))
            .ok_or_else(|| resolution.wrong("resolution", "metres per pixel, above 0"))?;
        let origin_entry = need("origin")?;
        let origin =
            origin(origin_entry).ok_or_else(|| origin_entry.wrong("origin", "[x, y, yaw] in metres and radians"))?;
        let negate = match find("negate") {
            None => false,
            Some(entry) => entry.text().and_then(truth).ok_or_else(|| entry.wrong("negate", "0 or 1"))?,
        };
        let mode = match find("mode") {
            None => MapMode::Trinary,
            Some(entry) => match entry.text() {
                Some("trinary") => MapMode::Trinary,
                Some("scale") => MapMode::Scale,
                Some("raw") => MapMode::Raw,
                _ => return Err(entry.wrong("mode", "trinary, scale or raw")),
            },
        };
        let threshold = |key: &'static str| {
            let entry = need(key)?;
            entry
                .text()
                .and_then(number)
                .filter(|threshold| (0.0..=1.0).contains(threshold))
                .ok_or_else(|| entry.wrong(key, "a number from 0 to 1"))
        };
        let (occupied_thresh, free_thresh) = (threshold("occupied_thresh")?, threshold("free_thresh")?);
        if free_thresh > occupied_thresh {
            return Err(need("free_thresh")?.wrong("free_thresh", "at most occupied_thresh"));
        }
        Ok(Self { image: image.to_owned(), resolution_m, origin, negate, occupied_thresh, free_thresh, mode })
    }
}

const KEYS: [&str; 7] = ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];

impl fmt::Display for MapYaml {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, yaw] = self.origin;
        let image = if is_plain(&self.image) { self.image.clone() } else { quoted(&self.image) };
        writeln!(f, "image: {image}")?;
        writeln!(f, "mode: {}", self.mode.name())?;
        writeln!(f, "resolution: {:?}", self.resolution_m)?;
        writeln!(f, "origin: [{x:?}, {y:?}, {yaw:?}]")?;
        writeln!(f, "negate: {}", u8::from(self.negate))?;
        writeln!(f, "occupied_thresh: {:?}", self.occupied_thresh)?;
        writeln!(f, "free_thresh: {:?}", self.free_thresh)
    }
}

impl Entry {
    fn wrong(&self, key: &'static str, expected: &'static str) -> YamlError {
        YamlError::Value { line: self.line, key, value: shortened(&self.value.to_string()), expected }
    }
}

/// Whether a text needs no quotes, and no reader takes it for anything but a text.
fn is_plain(text: &str) -> bool {
    let is_usual = |byte: u8| byte.is_ascii_alphanumeric() || b"._-/".contains(&byte);
    let begins = text.bytes().next().is_some_and(|byte| byte.is_ascii_alphanumeric() || b"./".contains(&byte));
    let is_word = |word: &str| truth(word).is_some() || word.eq_ignore_ascii_case("null");
    begins && text.bytes().all(is_usual) && number(text).is_none() && !is_word(text)
}

/// A text in double quotes.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            // What ends a line in some YAML, and what is not seen.
            '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}' => {
                quoted += &format!("\\u{:04x}", u32::from(c))
            }
            c if c.is_control() => quoted += &format!("\\x{:02x}", u32::from(c)),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

/// Every word that YAML 1.1, which map_server reads, has for it.
fn truth(text: &str) -> Option<bool> {
    match text.to_ascii_lowercase().as_str() {
        "1" | "true" | "yes" | "on" | "y" => Some(true),
        "0" | "false" | "no" | "off" | "n" => Some(false),
        _ => None,
    }
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

fn origin(entry: &Entry) -> Option<[f64; 3]> {
    let numbers = entry.items()?.map(|item| item.and_then(number)).collect::<Option<Vec<_>>>()?;
    let origin: [f64; 3] = numbers.try_into().ok()?;
    origin.into_iter().all(|number| number.abs() < 1e9).then_some(origin)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NAV2: &str = "image: depot.pgm\nmode: trinary\nresolution: 0.05\norigin: [0.0, 0.0, 0]\nnegate: 0\n\
                        occupied_thresh: 0.65\nfree_thresh: 0.25\n";

    #[test]
    fn what_savers_write() {
        let map = MapYaml::parse(NAV2).unwrap();
        assert_eq!((map.image.as_str(), map.resolution_m, map.free_thresh), ("depot.pgm", 0.05, 0.25));
        let block = "---\n# a map\nimage: \"a # b.pgm\"  # the image\nresolution: 0.02\norigin:\n- -12.8\n- -4.7\n\
                     - 0.0\nnegate: 1\noccupied_thresh: 0.65\nfree_thresh: 0.196\nframe_id: map\n";
        let map = MapYaml::parse(block).unwrap();
        assert_eq!((map.image.as_str(), map.origin, map.negate), ("a # b.pgm", [-12.8, -4.7, 0.0], true));
    }

    #[test]
    fn what_other_tools_write() {
        let plain = MapYaml::parse(NAV2).unwrap();
        let json = "{\"image\": \"depot.pgm\", \"mode\": \"trinary\", \"resolution\": 0.05,\n \"origin\": [0.0, 0.0, 0],\
                    \"negate\": 0, \"occupied_thresh\": 0.65, \"free_thresh\": 0.25}";
        let check = |text: &str| assert_eq!(MapYaml::parse(text).as_ref(), Ok(&plain), "{text}");
        check(json);
        let with = |from: &str, to: &str| check(&NAV2.replace(from, to));
        with("[0.0, 0.0, 0]", "[0.0,\n         0.0,\n         0] # x, y, yaw");
        with("[0.0, 0.0, 0]", "[ 0.0, 0.0, 0,\n]");
        with("[0.0, 0.0, 0]", "\n  - 0.0\n  - 0e0\n  - .0\n");
        check(&NAV2.replace(": ", ":\t"));
        check(&NAV2.replace(": ", ": \t "));
        check(&NAV2.replace(": ", ":   "));
        with("image: depot.pgm", "image: >-\n  depot.pgm");
        with("image: depot.pgm", "image: |\n  depot.pgm");
        with("image: depot.pgm", "'image' : \"de\\x70ot.pgm\"");
        with("image: depot.pgm", "? image\n: !!str depot.pgm");
        with("resolution: 0.05", "resolution: &r 5.0e-2\ncell: *r");
        with("resolution: 0.05", "cell: &r\n  size: 1\nresolution: .05");
        with("resolution: 0.05", "cell: &r +0.05\nresolution: *r");
        with("negate: 0", "negate: False");
        with("negate: 0", "negate: off");
        with("negate: 0\n", "");
        check(&format!("%YAML 1.2\n# written by hand\n---\n{NAV2}...\n"));
        check(&format!("\u{feff}{NAV2}---\n").replace('\n', "\r\n"));
    }

    #[test]
    fn not_a_map() {
        let check = |text: &str, expected: &str| {
            let error = MapYaml::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("", "there is no image");
        check("- a\n- b\n", "line 1: \"- a\": a list");
        check("just words", "line 1: \"just words\": one value");
        check(&format!("{NAV2}---\nimage: other.pgm\n"), "line 9: \"image: other.pgm\": a second document");
        check("image: [a\nresolution: 1", "line ");
        check(&NAV2.replace("depot.pgm", "[a, b]"), "line 1: image is \"[a, b]\"; expected a file name");
        check(&NAV2.replace("depot.pgm", "{a: b}"), "line 1: image is \"{…}\"; expected a file name");
        check(&NAV2.replace("depot.pgm", ""), "line 1: image is \"\"; expected a file name");
        check(&NAV2.replace("[0.0, 0.0, 0]", "[0, [0], 0]"), "line 4: origin is \"[0, […], 0]\"");
        check(&NAV2.replace("[0.0, 0.0, 0]", "*start"), "line 4: ");
        check(&NAV2.replace("0.05", ".inf"), "line 3: resolution is \".inf\"");
        check(&NAV2.replace("\"image\"", "image").replace("image", "{\"image\""), "line ");
    }

    #[test]
    fn errors_name_line_key_and_value() {
        let check = |from: &str, to: &str, expected: &str| {
            let error = MapYaml::parse(&NAV2.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("resolution: 0.05", "resolution: -1", "line 3: resolution is \"-1\"; expected metres per pixel");
        check("resolution", "resolutoin", "there is no resolution; did you mean it by resolutoin?");
        check("[0.0, 0.0, 0]", "[0.0, 0.0]", "line 4: origin");
        check("negate: 0", "negate: maybe", "expected 0 or 1");
        check("trinary", "binary", "expected trinary, scale or raw");
        check("mode: trinary", "image: b.pgm", "image stands there twice");
        check("mode: trinary", "what is this", "line 2: \"what is this\"");
        check("0.25", "0.75", "at most occupied_thresh");
        check("0.25", "nan", "a number from 0 to 1");
    }

    proptest! {
        #[test]
        fn there_and_back(
            image in "[a-z #\"'\\\\:]{0,6}[a-z]", resolution_m in 1e-3..10.0, x in -1e6..1e6, yaw in -3.0..3.0,
            negate: bool, free_thresh in 0.0..0.5, occupied_thresh in 0.5..1.0,
        ) {
            let mode = MapMode::Scale;
            let map = MapYaml { image, resolution_m, origin: [x, -x, yaw], negate, occupied_thresh, free_thresh, mode };
            prop_assert_eq!(MapYaml::parse(&map.to_string()).unwrap(), map);
        }

        #[test]
        fn any_text_is_survived(text in "(image|origin|resolution|- |: |\\[|\\]|,|#|\"|'|\n|\\PC){0,40}") {
            let _ = MapYaml::parse(&text);
        }
    }
}
