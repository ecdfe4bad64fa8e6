//! Text files that people write: read whole, and what is wrong with them said with file, line and value.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::read_at_most;

/// U+FEFF in UTF-8: what a text may begin with, and no part of it.
pub(crate) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// What is wrong with a text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {found}; expected {expected}")]
pub struct TextError {
    /// The number of the line, counted from 1.
    pub line: usize,
    /// What stands there, shortened.
    pub found: String,
    /// What would have been right.
    pub expected: String,
}

/// Why a text file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextFileError {
    /// There is no such file.
    #[error("{}: no such file{}", path.display(), near.as_deref().map(|near| format!("; did you mean {}?", near.display())).unwrap_or_default())]
    NotFound {
        /// What was asked for.
        path: PathBuf,
        /// A file of nearly that name in the same folder.
        near: Option<PathBuf>,
    },
    /// The file could not be opened or read, or is too long.
    #[error("{}: can't be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The text is wrong.
    #[error("{}: {source}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: TextError,
    },
}

/// Reads a text file of at most `bytes_max` bytes whole. Bytes that are no text become marks that no parser takes.
pub(crate) fn read_text<T>(
    path: &Path,
    bytes_max: u64,
    parse: impl FnOnce(&str) -> Result<T, TextError>,
) -> Result<T, TextFileError> {
    let bytes = read_at_most(path, bytes_max).map_err(|source| {
        if source.kind() == io::ErrorKind::NotFound {
            TextFileError::NotFound { path: path.to_path_buf(), near: crate::near::near_file(path) }
        } else {
            TextFileError::Read { path: path.to_path_buf(), source }
        }
    })?;
    // Editors of some systems begin a text with a mark of its encoding.
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes);
    parse(&String::from_utf8_lossy(bytes)).map_err(|source| TextFileError::Text { path: path.to_path_buf(), source })
}

/// The line that a stretch of bytes begins in, counted from 1.
pub(crate) fn line_of(text: &str, span: Option<Range<usize>>) -> usize {
    let before = text.as_bytes().get(..span.map_or(0, |span| span.start)).unwrap_or_default();
    before.iter().filter(|byte| **byte == b'\n').count() + 1
}

/// What stands in a file, fit to be shown: short, in one line.
pub(crate) fn shortened(text: &str) -> String {
    text.chars().take(60).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// The same in quotes.
pub(crate) fn quoted(text: &str) -> String {
    format!("\"{}\"", shortened(text))
}
