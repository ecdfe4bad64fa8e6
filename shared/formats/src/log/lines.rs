//! Lines of bytes, of bounded length.

use std::io::{self, BufRead as _, Read};
use std::path::Path;

use super::LogError;
use super::source::{Source, Stamp, is_damage};
use crate::text::BYTE_ORDER_MARK;

/// Longest line that is looked at, bytes. A lidar scan takes some 10 kB.
const LINE_BYTES: usize = 4 * 1024 * 1024;

/// Reads lines; the one at hand is kept in one buffer.
pub(crate) struct Lines<R: Read> {
    source: Source<R>,
    buffer: Vec<u8>,
    number: u64,
    ended: bool,
}

/// What comes next.
pub(crate) enum Line<'a> {
    /// A line without its end (`\n` or `\r\n`).
    Bytes(u64, &'a [u8]),
    /// A line that is too long; it has been skipped.
    TooLong(u64),
    /// The compressed stream is damaged; nothing follows.
    Damaged(u64, String),
}

impl<R: Read> Lines<R> {
    pub(crate) fn new(stored: R) -> io::Result<Self> {
        Ok(Self { source: Source::new(stored)?, buffer: Vec::new(), number: 0, ended: false })
    }

    /// The next line; none at the end.
    pub(crate) fn next(&mut self) -> io::Result<Option<Line<'_>>> {
        if self.ended {
            return Ok(None);
        }
        self.buffer.clear();
        self.number += 1;
        let is_compressed = self.source.is_compressed();
        let (mut too_long, mut any) = (false, false);
        loop {
            let available = match self.source.fill_buf() {
                Ok(available) => available,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if is_compressed && is_damage(&error) => {
                    // A partial line before the damage is lost with it: its numbers may be cut.
                    self.ended = true;
                    return Ok(Some(Line::Damaged(self.number, error.to_string())));
                }
                Err(error) => return Err(error),
            };
            if available.is_empty() {
                self.ended = true;
                if !any {
                    return Ok(None);
                }
                break;
            }
            any = true;
            let end = available.iter().position(|byte| *byte == b'\n');
            let part = available.get(..end.unwrap_or(available.len())).unwrap_or_default();
            if self.buffer.len() + part.len() > LINE_BYTES {
                too_long = true;
            } else if !too_long {
                self.buffer.extend_from_slice(part);
            }
            let used = part.len() + usize::from(end.is_some());
            self.source.consume(used);
            if end.is_some() {
                break;
            }
        }
        if too_long {
            return Ok(Some(Line::TooLong(self.number)));
        }
        let bytes = self.buffer.strip_suffix(b"\r").unwrap_or(&self.buffer);
        let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).filter(|_| self.number == 1).unwrap_or(bytes);
        Ok(Some(Line::Bytes(self.number, bytes)))
    }

    /// Of lines that have come to their end: an error if the file now has fewer bytes than when it was surveyed.
    pub(crate) fn check_whole(self, path: &Path, surveyed: u64) -> Result<(), LogError> {
        let left = self.finish().map_err(|source| LogError::open(path, source))?.bytes;
        if left < surveyed { Err(LogError::Shrunk { path: path.to_path_buf(), surveyed, left }) } else { Ok(()) }
    }

    /// Hash and number of the stored bytes.
    pub(crate) fn finish(self) -> io::Result<Stamp> {
        self.source.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(content: &[u8], expected: &[&str]) {
        let mut lines = Lines::new(content).unwrap();
        let mut found = Vec::new();
        while let Some(line) = lines.next().unwrap() {
            found.push(match line {
                Line::Bytes(_, bytes) => String::from_utf8(bytes.to_vec()).unwrap(),
                Line::TooLong(_) => "(too long)".into(),
                Line::Damaged(..) => "(damaged)".into(),
            });
        }
        assert_eq!(found, expected);
    }

    #[test]
    fn ends_of_lines() {
        check(b"", &[]);
        check(b"a", &["a"]);
        check(b"a\r\nb\n\nc\r", &["a", "b", "", "c"]);
        check(b"\xef\xbb\xbfa\nb", &["a", "b"]);
    }

    #[test]
    fn long_lines_are_skipped() {
        let mut content = vec![b'x'; LINE_BYTES + 10];
        content.extend(b"\nshort\n");
        check(&content, &["(too long)", "short"]);
    }
}
