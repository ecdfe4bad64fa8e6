//! Logs of robots: odometry, range readings, true poses.
//!
//! A log is read in two passes, so that memory stays bounded whatever its size. [`survey`] reads
//! it once and says what is in it: the robot's sensors, counts, how good the stamps are, what was
//! refused and why. [`open`] reads it again and gives its events in stamp order, each reading
//! already told apart (echo, no echo, invalid). The same file gives the same events, always.
//!
//! | format | recognised by | module |
//! |---|---|---|
//! | ROS 1 bag, MCAP, rosbag2 (folder or `.db3`) | their first bytes | `recording` |
//! | CARMEN log | a message line such as `ODOM …` or `FLASER …` | [`carmen`] |
//! | Wean Hall log | lines `O …` and `L …` of numbers | `dialect/wean.rs` |
//! | GMapping's `.gfs` | `LASER_READING …` | `dialect/gfs.rs` |
//! | CSV with a header | the names of its columns | `dialect/csv.rs` |
//! | Udacity sonar pair `measurement.txt` + `poses.txt` | rows of 9 or 4 whole numbers, or the folder | [`udacity`] |
//!
//! Text logs may be plain, or packed by gzip, bzip2 or Zstandard, told by their content.
//!
//! Damage is counted, not fatal: a refused line is a [`Fault`], and everything else is kept.
//! Only a log that can make no map is an error ([`LogError`]).

pub mod carmen;
mod carried;
mod clock;
mod clock_report;
mod detect;
mod dialect;
mod error;
mod event;
mod fault;
mod lines;
mod order;
mod recording;
mod source;
mod spread;
mod stamp;
mod survey;
mod tally;
mod timeline;
mod track;
pub mod udacity;
mod zstandard;

use std::path::Path;
use std::sync::Arc;

pub use carmen::RangeUnit;
pub use clock_report::{ClockReport, ClockStep, StepKind};
pub(crate) use detect::open_file;
use detect::{Found, detect};
pub use detect::{KNOWN_FORMATS, LogFormat};
pub use error::LogError;
pub use event::{LogEvent, LogReader};
pub use fault::{CountedBy, Fault, FaultKind};
pub use recording::{McapChannel, McapWriter, RUN_SETTINGS, RecordingContents, RunWords, TopicContents, words_of_run};
pub(crate) use stamp::parse_stamp_ns;
pub use survey::{LogSurvey, SurveyOptions};

/// Reads the log at `path` once and says what is in it.
///
/// # Errors
/// When the file can't be read, is of no known format, or no map can be made of it (no odometry,
/// no readings). Damage within an otherwise usable log is no error; see [`LogSurvey::faults`].
pub fn survey(path: &Path) -> Result<LogSurvey, LogError> {
    survey_with(path, SurveyOptions::default())
}

/// Surveys a log as [`survey`] does, where the user says what the log does not.
///
/// # Errors
/// As [`survey`].
pub fn survey_with(path: &Path, options: SurveyOptions) -> Result<LogSurvey, LogError> {
    let found = detect(path)?;
    let names_topics = !options.topics.is_empty() || options.truth.is_some();
    if names_topics && !matches!(found, Found::Recording { .. }) {
        return Err(LogError::NoTopics { path: path.to_path_buf(), format: found.format() });
    }
    match found {
        Found::Text { path, dialect } => carmen::survey_of(detect::open_file(&path)?, &path, dialect, options),
        Found::Recording { files, format } => {
            let container = || recording::open(&files, format, u64::MAX);
            let inventory = recording::inventory(path, container()?)?;
            // Who names topics wants those.
            if !names_topics && recording::is_native(path, &inventory)? {
                return recording::survey_native(container()?, path);
            }
            let plan = Arc::new(recording::choose(path, &inventory, &options)?);
            carmen::survey_recording(container()?, path, format, plan, options)
        }
        Found::Udacity { measurement, poses } => {
            udacity::survey(detect::open_file(&measurement)?, &measurement, detect::open_file(&poses)?, &poses)
        }
    }
}

/// The format of the log at `path`, told by its content.
///
/// # Errors
/// When the file can't be read or is of no known format.
pub fn detect_format(path: &Path) -> Result<LogFormat, LogError> {
    Ok(detect(path)?.format())
}

/// Reads the log at `path` a second time: its events, in stamp order.
///
/// At most the bytes that the survey saw are read, so a log that is still growing gives what was
/// there when it was surveyed.
///
/// # Errors
/// When the file can't be read any more or is no longer of the format that the survey found.
pub fn open(path: &Path, survey: &LogSurvey) -> Result<LogReader, LogError> {
    match (detect(path)?, survey.format) {
        (Found::Text { path, dialect }, _) if survey.plan.is_text_of(&dialect) && dialect.format() == survey.format => {
            carmen::read(detect::open_file(&path)?, &path, survey)
        }
        (Found::Recording { files, .. }, LogFormat::EchogridRecording) => {
            let bytes = survey.byte_counts.first().copied().unwrap_or(0);
            Ok(recording::read_native(recording::open(&files, LogFormat::Mcap, bytes)?, path, survey))
        }
        (Found::Recording { files, format }, surveyed) if format == surveyed => {
            let bytes = survey.byte_counts.first().copied().unwrap_or(0);
            carmen::read_recording(recording::open(&files, format, bytes)?, path, survey)
        }
        (Found::Udacity { measurement, poses }, LogFormat::UdacitySonar) => {
            udacity::read(detect::open_file(&measurement)?, &measurement, detect::open_file(&poses)?, &poses, survey)
        }
        _ => Err(LogError::Changed { path: path.to_path_buf(), surveyed: survey.format }),
    }
}

/// What is in the recording at `path`; none if it is no recording.
///
/// # Errors
/// When the file can't be read or is of no known format.
pub fn contents(path: &Path) -> Result<Option<RecordingContents>, LogError> {
    let Found::Recording { files, format } = detect(path)? else { return Ok(None) };
    let inventory = recording::inventory(path, recording::open(&files, format, u64::MAX)?)?;
    Ok(Some(RecordingContents::of(&inventory)))
}
