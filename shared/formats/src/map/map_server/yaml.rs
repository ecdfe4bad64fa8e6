//! The YAML of a map: a flat list of keys, read by a small strict parser.
//!
//! Understood: `key: value` lines, comments, a leading `---`, quoted strings, and the origin as
//! `[x, y, yaw]` or as three `- number` lines. That is all that map savers write.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::near::near_word;

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
    /// A line that is none of the expected.
    #[error("line {line}: \"{text}\": expected `key: value`")]
    Line {
        /// Counted from 1.
        line: usize,
        /// The line, shortened.
        text: String,
    },
    /// A value that can't be.
    #[error("line {line}: {key} is \"{value}\"; expected {expected}")]
    Value {
        /// Counted from 1.
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
        /// Counted from 1.
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
        /// Its length.
        bytes: usize,
    },
}

const BYTES_MAX: usize = 65_536;

/// A key with its value, as text.
struct Entry {
    line: usize,
    key: String,
    value: String,
    /// `- item` lines that follow.
    items: Vec<String>,
}

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
        let find = |key: &'static str| entries.iter().find(|entry| entry.key == key);
        let need = |key: &'static str| {
            find(key).ok_or_else(|| {
                let unknown = entries.iter().map(|entry| entry.key.as_str()).filter(|key| !KEYS.contains(key));
                YamlError::Missing { key, near: near_word(key, unknown).map(ToOwned::to_owned) }
            })
        };
        let image = need("image")?;
        if image.value.is_empty() {
            return Err(image.wrong("image", "a file name"));
        }
        let resolution = need("resolution")?;
        let resolution_m = number(&resolution.value)
            .filter(|metres| (1e-6..1e6).contains(metres))
            .ok_or_else(|| resolution.wrong("resolution", "metres per pixel, above 0"))?;
        let origin_entry = need("origin")?;
        let origin =
            origin(origin_entry).ok_or_else(|| origin_entry.wrong("origin", "[x, y, yaw] in metres and radians"))?;
        let negate = match find("negate") {
            None => false,
            Some(entry) => match entry.value.as_str() {
                "0" | "false" | "False" | "no" => false,
                "1" | "true" | "True" | "yes" => true,
                _ => return Err(entry.wrong("negate", "0 or 1")),
            },
        };
        let mode = match find("mode") {
            None => MapMode::Trinary,
            Some(entry) => match entry.value.as_str() {
                "trinary" => MapMode::Trinary,
                "scale" => MapMode::Scale,
                "raw" => MapMode::Raw,
                _ => return Err(entry.wrong("mode", "trinary, scale or raw")),
            },
        };
        let threshold = |key: &'static str| {
            let entry = need(key)?;
            number(&entry.value)
                .filter(|threshold| (0.0..=1.0).contains(threshold))
                .ok_or_else(|| entry.wrong(key, "a number from 0 to 1"))
        };
        let (occupied_thresh, free_thresh) = (threshold("occupied_thresh")?, threshold("free_thresh")?);
        if free_thresh > occupied_thresh {
            return Err(need("free_thresh")?.wrong("free_thresh", "at most occupied_thresh"));
        }
        Ok(Self { image: image.value.clone(), resolution_m, origin, negate, occupied_thresh, free_thresh, mode })
    }
}

const KEYS: [&str; 7] = ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];

impl fmt::Display for MapYaml {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, yaw] = self.origin;
        // JSON strings are YAML strings.
        let image = if self.image.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-/".contains(&byte)) {
            self.image.clone()
        } else {
            format!("\"{}\"", self.image.replace('\\', "\\\\").replace('"', "\\\""))
        };
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
        let value = if self.items.is_empty() { self.value.clone() } else { format!("[{}]", self.items.join(", ")) };
        YamlError::Value { line: self.line, key, value: short(&value), expected }
    }
}

fn entries(text: &str) -> Result<Vec<Entry>, YamlError> {
    let mut entries: Vec<Entry> = Vec::new();
    for (number, raw) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = number + 1;
        let content = without_comment(raw).trim_end();
        if content.trim().is_empty() || content == "---" || content == "..." || content.starts_with('%') {
            continue;
        }
        let wrong = || YamlError::Line { line, text: short(raw) };
        if let Some(item) = content.trim_start().strip_prefix("- ") {
            entries.last_mut().filter(|entry| entry.value.is_empty()).ok_or_else(wrong)?.items.push(unquote(item));
            continue;
        }
        let (key, value) = content.split_once(':').ok_or_else(wrong)?;
        if key.is_empty() || key.starts_with(char::is_whitespace) || !(value.is_empty() || value.starts_with(' ')) {
            // Indented lines belong to some nested key that a map has no use for.
            if key.starts_with(char::is_whitespace) && !entries.is_empty() {
                continue;
            }
            return Err(wrong());
        }
        let key = unquote(key);
        if entries.iter().any(|entry| entry.key == key) {
            return Err(YamlError::Twice { line, key: short(&key) });
        }
        entries.push(Entry { line, key, value: unquote(value), items: Vec::new() });
    }
    Ok(entries)
}

/// A `#` begins a comment at the beginning of a line or after a blank, outside quotes.
fn without_comment(line: &str) -> &str {
    let (mut quote, mut before) = (None, ' ');
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (None, '#') if before.is_whitespace() => return line.get(..at).unwrap_or(line),
            (None, '"' | '\'') if before.is_whitespace() => quote = Some(c),
            (Some(open), _) if open == c && before != '\\' => quote = None,
            _ => {}
        }
        before = c;
    }
    line
}

fn unquote(text: &str) -> String {
    let text = text.trim();
    if let Some(inner) = text.strip_prefix('"').and_then(|inner| inner.strip_suffix('"')) {
        return inner.replace("\\\"", "\"").replace("\\\\", "\\");
    }
    if let Some(inner) = text.strip_prefix('\'').and_then(|inner| inner.strip_suffix('\'')) {
        return inner.replace("''", "'");
    }
    text.to_owned()
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

fn origin(entry: &Entry) -> Option<[f64; 3]> {
    let parts: Vec<&str> = if entry.items.is_empty() {
        entry.value.strip_prefix('[')?.strip_suffix(']')?.split(',').collect()
    } else {
        entry.items.iter().map(String::as_str).collect()
    };
    let numbers = parts.into_iter().map(number).collect::<Option<Vec<_>>>()?;
    let origin: [f64; 3] = numbers.try_into().ok()?;
    origin.into_iter().all(|number| number.abs() < 1e9).then_some(origin)
}

fn short(text: &str) -> String {
    text.chars().take(60).collect()
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
