//! How sure the poses of a path are: rows of stamps and covariances.
//!
//! ```text
//! # t xx xy xh yy yh hh, seconds, m², m rad, rad²: the covariance of (x, y, heading) in the frame of the map
//! 12.500000000 1.2e-3 0 1e-5 2.5e-3 0 4e-4
//! ```
//!
//! The first pose is taken for certain.

use std::fmt::Write as _;
use std::path::Path;

use super::rows::{Row, rows};
use crate::text::{TextError, TextFileError, read_text};
use crate::whole_file::{WriteError, write_whole};

/// Longest file, bytes.
const BYTES_MAX: u64 = 256 << 20;
const ROW: &str = "7 words `t xx xy xh yy yh hh`";

/// A covariance of (x, y, heading), row by row.
pub type Covariance = [[f64; 3]; 3];

/// Writes the covariances of poses by their stamps, whole or not at all.
///
/// # Errors
/// The file can't be written.
pub fn write_covariances(path: &Path, all: impl IntoIterator<Item = (u64, Covariance)>) -> Result<(), WriteError> {
    let mut text =
        "# t xx xy xh yy yh hh, seconds, m², m rad, rad²: the covariance of (x, y, heading) in the frame of the map\n"
            .to_owned();
    for (stamp_ns, [[xx, xy, xh], [_, yy, yh], [_, _, hh]]) in all {
        let (seconds, rest) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
        let _ = writeln!(text, "{seconds}.{rest:09} {xx:e} {xy:e} {xh:e} {yy:e} {yh:e} {hh:e}");
    }
    write_whole(path, text.as_bytes())
}

/// Reads what [`write_covariances`] wrote.
///
/// # Errors
/// The file can't be read, or a row is none.
pub fn read_covariances(path: &Path) -> Result<Vec<(u64, Covariance)>, TextFileError> {
    read_text(path, BYTES_MAX, parse)
}

fn parse(text: &str) -> Result<Vec<(u64, Covariance)>, TextError> {
    rows(text).map(|row| covariance(&row)).collect()
}

fn covariance(row: &Row<'_>) -> Result<(u64, Covariance), TextError> {
    let [t, numbers @ ..]: &[&str; 7] = row.words.as_slice().try_into().map_err(|_| row.wrong(ROW))?;
    let is_variance = [true, false, false, true, false, true];
    let mut values = [0.0; 6];
    for ((value, word), is_variance) in values.iter_mut().zip(numbers).zip(is_variance) {
        *value =
            row.number("covariance", word, |number| !is_variance || number >= 0.0, "a number; variances 0 or more")?;
    }
    let [xx, xy, xh, yy, yh, hh] = values;
    Ok((row.stamp_ns(t)?, [[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.covariance.txt");
        let all = [
            (5, [[0.1, 1e-3, -2.5e-7], [1e-3, 0.2, 0.0], [-2.5e-7, 0.0, 3e-9]]),
            (1_700_000_000_000_000_007, [[0.0; 3]; 3]),
        ];
        write_covariances(&file, all).unwrap();
        assert_eq!(read_covariances(&file).unwrap(), all);
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let error = |text: &str| parse(text).unwrap_err().to_string();
        assert!(error("1 2 3\n").contains("line 1: \"1 2 3\"; expected 7 words `t xx xy xh yy yh hh`"));
        assert!(error("1 0 0 0 -1 0 0\n").contains("covariance is \"-1\"; expected a number; variances 0 or more"));
        assert!(error("x 0 0 0 1 0 0\n").contains("t is \"x\""));
        assert_eq!(parse("# nothing\n").unwrap(), []);
    }
}
