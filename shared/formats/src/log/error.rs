//! Why no map can be made of a log.

use std::io;
use std::path::{Path, PathBuf};

use echogrid_core::robot::SENSORS_MAX;

use super::detect::{KNOWN_FORMATS, LogFormat};

/// Why a log can't be used at all. What is wrong *within* a usable log is a [`super::Fault`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// There is no such file.
    #[error("{}: no such file{}", path.display(), suggestion(near.as_deref()))]
    NotFound {
        /// What was asked for.
        path: PathBuf,
        /// A file of nearly that name in the same folder.
        near: Option<PathBuf>,
    },
    /// The file could not be opened or read.
    #[error("{}: can't be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file has no bytes, or none after decompression.
    #[error("{}: the file is empty; expected {KNOWN_FORMATS}", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A device, a pipe or the like: a log is read twice, so it must be a file.
    #[error("{}: not a regular file; a log is read twice, so store it as a file first", path.display())]
    NotAFile {
        /// What was asked for.
        path: PathBuf,
    },
    /// A folder that holds no pair of files.
    #[error(
        "{}: a folder; expected a log file, a folder of rosbag2 (metadata.yaml, .mcap or .db3 files), or one that holds measurement.txt and poses.txt",
        path.display()
    )]
    Folder {
        /// The folder.
        path: PathBuf,
    },
    /// One file of a pair is missing.
    #[error("{}: one half of a sonar pair; expected the other half at {}", path.display(), missing.display())]
    MissingPair {
        /// The file that is there.
        path: PathBuf,
        /// The file that isn't.
        missing: PathBuf,
    },
    /// Nothing known begins like this.
    #[error("{}: not a log of a known format: it begins with \"{begins}\"; expected {KNOWN_FORMATS}", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// The first bytes of the file, escaped.
        begins: String,
    },
    /// A table whose header does not say what is needed.
    #[error("{}: a table, but {why}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// What is wrong with the header.
        why: String,
    },
    /// A file of a kind that is known, and is no log.
    #[error("{}: is {}, which can't be read as a log: {}", path.display(), kind.with_article(), kind.advice)]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: crate::Foreign,
    },
    /// Topics are named, and it has none.
    #[error("{}: a {format}, which has no topics that could be named (--topic, replay.topics and topic:NAME are for recordings)", path.display())]
    NoTopics {
        /// The file.
        path: PathBuf,
        /// What it is.
        format: LogFormat,
    },
    /// What of a recording is to be used can't be told.
    #[error("{}: {why}; it holds{list}", path.display())]
    Topics {
        /// The file.
        path: PathBuf,
        /// Why not.
        why: String,
        /// The topics of the recording, a line each.
        list: String,
    },
    /// There is no odometry in the log.
    #[error("{}: no odometry in it; expected {expected}{}", path.display(), refused(first_fault.as_deref()))]
    NoOdometry {
        /// The file.
        path: PathBuf,
        /// What would have been odometry.
        expected: &'static str,
        /// The first refused line, if any was refused.
        first_fault: Option<String>,
    },
    /// There are no range readings in the log.
    #[error("{}: no range readings in it; expected {expected}{}", path.display(), refused(first_fault.as_deref()))]
    NoReadings {
        /// The file.
        path: PathBuf,
        /// What would have been readings.
        expected: &'static str,
        /// The first refused line, if any was refused.
        first_fault: Option<String>,
    },
    /// All odometry stands before, or behind, all readings, and these carry no poses.
    #[error(
        "{}: all odometry stands before, or behind, all readings, so nothing tells where these were taken; put the lines in the \
         order of their stamps first",
        path.display()
    )]
    Apart {
        /// The file.
        path: PathBuf,
    },
    /// The log has more transducers than can be numbered.
    #[error("{}: {count} transducers in all sensors together; at most 65535 can be told apart", path.display())]
    TooManyTransducers {
        /// The file.
        path: PathBuf,
        /// How many there are.
        count: u64,
    },
    /// The log has more sensors than a robot can have.
    #[error("{}: {count} range sensors in it; a robot can have at most {SENSORS_MAX}", path.display())]
    TooManySensors {
        /// The file.
        path: PathBuf,
        /// How many there are.
        count: u64,
    },
    /// A line has more sonars than a robot can have.
    #[error("{}:{line}: SONAR of {count} sonars; a robot can have at most {SENSORS_MAX} range sensors", path.display())]
    TooManySonars {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// How many there are.
        count: usize,
    },
    /// The ranges are in no unit that can be told.
    #[error(
        "{}:{line}: ranges of {message} are hardly metres: {found}; say what they are by \
         --set replay.range_unit=mm (of convert: --range-unit mm), or cm, or m if they are metres",
        path.display()
    )]
    UnknownUnit {
        /// The file.
        path: PathBuf,
        /// The first line of them.
        line: u64,
        /// The message that they are in.
        message: String,
        /// What was found.
        found: String,
    },
    /// Lines that come as they are measured do not say how far a sensor can see, and nobody waits for all of them to tell.
    #[error(
        "{}: nothing says how far the sensor of {message} can see; print \"PARAM {param} METRES\" first, or name a robot (--robot)",
        path.display()
    )]
    NoMaximum {
        /// Who prints.
        path: PathBuf,
        /// The message of the sensor.
        message: String,
        /// The parameter that says it.
        param: &'static str,
    },
    /// The file has lost its end since it was surveyed.
    #[error("{}: has {left} bytes and had {surveyed} when it was surveyed: what was behind them never came", path.display())]
    Shrunk {
        /// The file.
        path: PathBuf,
        /// Bytes then.
        surveyed: u64,
        /// Bytes now.
        left: u64,
    },
    /// The file is not the one that was surveyed.
    #[error("{}: was a {surveyed} when it was surveyed and is none any more", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// What the survey found.
        surveyed: LogFormat,
    },
}

impl LogError {
    /// An error of opening or reading `path`; a missing file gets a suggestion.
    pub(crate) fn open(path: &Path, source: io::Error) -> Self {
        if source.kind() == io::ErrorKind::NotFound {
            Self::NotFound { path: path.to_path_buf(), near: crate::near::near_file(path) }
        } else {
            Self::Io { path: path.to_path_buf(), source }
        }
    }
}

fn suggestion(near: Option<&Path>) -> String {
    near.map(|path| format!("; did you mean {}?", path.display())).unwrap_or_default()
}

fn refused(first_fault: Option<&str>) -> String {
    first_fault.map(|fault| format!("; refused lines: {fault}")).unwrap_or_default()
}
