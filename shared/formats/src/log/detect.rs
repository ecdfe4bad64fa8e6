//! Which format a log is of: told by its content, never by its name.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::dialect::Dialect;
use super::recording::folder::{Files, files_of};
use super::source::Source;
use super::{LogError, recording};
use crate::kind::in_place_of_a_log;
use crate::open_regular;
use crate::text::BYTE_ORDER_MARK;

/// The formats that can be read, for people.
pub const KNOWN_FORMATS: &str = "a ROS 1 bag (.bag), an MCAP recording, a folder or .db3 of rosbag2, a CARMEN log (.log, .clf), a Wean Hall log, GMapping's .gfs, a CSV \
                                 whose header names t, x, y, theta and ranges (each plain, .gz, .bz2 or .zst), a Udacity sonar pair \
                                 (measurement.txt beside poses.txt)";

/// How much of a file is looked at to tell its format, bytes after decompression: more than any comment before the data.
const HEAD_BYTES: u64 = 4 * 1024 * 1024;

/// So many bytes tell a recording.
const MAGIC_BYTES: u64 = 32;

/// The format of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogFormat {
    /// CARMEN's text log: one message per line (`ODOM`, `FLASER`, `SONAR`, …); may be gzipped.
    CarmenLog,
    /// A ROS 1 bag.
    RosBag,
    /// MCAP, as ROS 2 and others record.
    Mcap,
    /// MCAP, as echogrid's recorder writes it: a run as it was.
    EchogridRecording,
    /// A recording of ROS 2 in an SQLite file (`.db3`).
    Rosbag2,
    /// CMU's Wean Hall log: `O` and `L` lines, centimetres.
    WeanLog,
    /// What GMapping writes (`.gfs`).
    GmappingLog,
    /// A table with a header.
    CsvTable,
    /// The pair of files of Udacity's RoboND occupancy grid course: a ring of eight sonars.
    UdacitySonar,
}

impl core::fmt::Display for LogFormat {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::CarmenLog => "CARMEN log",
            Self::RosBag => "ROS bag",
            Self::Mcap => "MCAP recording",
            Self::EchogridRecording => "recording of a run",
            Self::Rosbag2 => "ROS 2 recording (.db3)",
            Self::WeanLog => "Wean Hall log",
            Self::GmappingLog => "GMapping log",
            Self::CsvTable => "CSV table",
            Self::UdacitySonar => "Udacity sonar pair",
        })
    }
}

/// The files that make up a log.
pub(crate) enum Found {
    Text { path: PathBuf, dialect: Dialect },
    Recording { files: Files, format: LogFormat },
    Udacity { measurement: PathBuf, poses: PathBuf },
}

impl Found {
    /// The format of the log.
    pub(crate) fn format(&self) -> LogFormat {
        match self {
            Self::Text { dialect, .. } => dialect.format(),
            Self::Recording { format, .. } => *format,
            Self::Udacity { .. } => LogFormat::UdacitySonar,
        }
    }
}

/// What a text looks like.
#[derive(Debug, Clone, PartialEq)]
enum Looks {
    Text(Dialect),
    Measurement,
    Poses,
    Unknown,
}

/// Opens a regular file.
pub(crate) fn open_file(path: &Path) -> Result<File, LogError> {
    match path.metadata() {
        Ok(metadata) if !metadata.is_file() => Err(LogError::NotAFile { path: path.to_path_buf() }),
        _ => open_regular(path).map_err(|source| LogError::open(path, source)),
    }
}

/// The format of the log at `path`, and the files it is made of.
pub(crate) fn detect(path: &Path) -> Result<Found, LogError> {
    let metadata = std::fs::metadata(path).map_err(|source| LogError::open(path, source))?;
    if metadata.is_dir() {
        return match files_of(path) {
            Some(files) => recording_folder(path, files),
            None => udacity_folder(path),
        };
    }
    let file = open_file(path)?;
    if metadata.len() == 0 {
        return Err(LogError::Empty { path: path.to_path_buf() });
    }
    let mut head = Vec::new();
    let mut source = Source::new(file).map_err(|source| LogError::open(path, source))?;
    // A recording is told by its first bytes; of a text it takes more.
    let _ = source.by_ref().take(MAGIC_BYTES).read_to_end(&mut head);
    if let Some(format) = recording::format_of(&head) {
        let files = Files { paths: vec![path.to_path_buf()], packs_messages: false };
        return Ok(Found::Recording { files, format });
    }
    // A damaged stream still shows what came before the damage.
    let outcome = source.take(HEAD_BYTES).read_to_end(&mut head);
    if let (Err(source), true) = (outcome, head.is_empty()) {
        return Err(LogError::open(path, source));
    }
    if head.is_empty() {
        return Err(LogError::Empty { path: path.to_path_buf() });
    }
    match looks_like(&head) {
        Looks::Text(dialect) => Ok(Found::Text { path: path.to_path_buf(), dialect }),
        Looks::Measurement => Ok(Found::Udacity { measurement: path.to_path_buf(), poses: beside(path, "poses.txt")? }),
        Looks::Poses => Ok(Found::Udacity { measurement: beside(path, "measurement.txt")?, poses: path.to_path_buf() }),
        Looks::Unknown => Err(match in_place_of_a_log(&head) {
            Some(kind) => LogError::Foreign { path: path.to_path_buf(), kind },
            None => match Dialect::wrong_with_table(head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&head)) {
                Some(why) => LogError::Table { path: path.to_path_buf(), why },
                None => LogError::UnknownFormat { path: path.to_path_buf(), begins: printable(&head) },
            },
        }),
    }
}

/// A folder of rosbag2; the first of its files that is there tells the format of all.
fn recording_folder(folder: &Path, files: Files) -> Result<Found, LogError> {
    let first = files.paths.iter().find(|path| path.exists()).or(files.paths.first());
    let Some(first) = first else { return Err(LogError::Folder { path: folder.to_path_buf() }) };
    match detect(first)? {
        Found::Recording { format, .. } => Ok(Found::Recording { files, format }),
        _ => Err(LogError::Folder { path: folder.to_path_buf() }),
    }
}

fn udacity_folder(folder: &Path) -> Result<Found, LogError> {
    let (measurement, poses) = (folder.join("measurement.txt"), folder.join("poses.txt"));
    match (measurement.is_file(), poses.is_file()) {
        (true, true) => Ok(Found::Udacity { measurement, poses }),
        (false, false) => Err(LogError::Folder { path: folder.to_path_buf() }),
        (true, false) => Err(LogError::MissingPair { path: measurement, missing: poses }),
        (false, true) => Err(LogError::MissingPair { path: poses, missing: measurement }),
    }
}

fn beside(path: &Path, name: &str) -> Result<PathBuf, LogError> {
    let other = path.with_file_name(name);
    if other.is_file() && other != path {
        Ok(other)
    } else {
        Err(LogError::MissingPair { path: path.to_path_buf(), missing: other })
    }
}

fn looks_like(head: &[u8]) -> Looks {
    let head = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
    let lines = || head.split(|byte| *byte == b'\n').filter_map(|line| core::str::from_utf8(line).ok());
    if let Some(dialect) = Dialect::of(head) {
        return Looks::Text(dialect);
    }
    // The last line may be cut by the end of the head, so the first one that is not blank decides.
    let Some(row) = lines().find(|line| !line.trim().is_empty()) else { return Looks::Unknown };
    let (mut words, mut whole) = (0, true);
    for word in row.split_ascii_whitespace() {
        words += 1;
        whole &= word.parse::<i64>().is_ok();
    }
    match (words, whole) {
        (9, true) => Looks::Measurement,
        (4, true) => Looks::Poses,
        _ => Looks::Unknown,
    }
}

/// The first bytes of a file as people can read them.
fn printable(head: &[u8]) -> String {
    head.iter().take(24).flat_map(|byte| core::ascii::escape_default(*byte)).map(char::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_decides() {
        assert_eq!(looks_like(b"# a comment\nPARAM a b nohost 0\n"), Looks::Text(Dialect::Carmen));
        assert_eq!(looks_like(b"\xff\xfe junk\r\nODOM 0 0 0 0 0 0 1 h 1\r\n"), Looks::Text(Dialect::Carmen));
        assert_eq!(looks_like(b"1686487 5110 5110 2320 2360 5110 5110 2160 1190\n"), Looks::Measurement);
        assert_eq!(looks_like(b"\xef\xbb\xbfODOM 0 0 0 0 0 0 1 h 1\n"), Looks::Text(Dialect::Carmen));
        let comments = b"# a line of a long licence, or of the notes of whoever drove\n".repeat(10_000);
        assert_eq!(
            looks_like(&[comments.as_slice(), b"ODOM 0 0 0 0 0 0 1 h 1\n"].concat()),
            Looks::Text(Dialect::Carmen)
        );
        assert_eq!(looks_like(b"\n1686487 0 0 0\n"), Looks::Poses);
        assert_eq!(looks_like(b"1 2 3\n"), Looks::Unknown);
        assert_eq!(looks_like(b"%PDF-1.7\n"), Looks::Unknown);
        assert_eq!(looks_like(b""), Looks::Unknown);
    }
}
