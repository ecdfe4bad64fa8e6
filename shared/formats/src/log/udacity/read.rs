//! The second pass over a sonar pair: its events.

use std::io::Read;
use std::path::{Path, PathBuf};

use echogrid_core::{Echo, Reading};

use super::rows::{Half, Next, Row, Rows};
use super::{RANGE_MAX_MM, RANGE_MIN_MM, SONARS};
use crate::log::timeline::{EventLine, Rank, Source, TimedLine};
use crate::log::{LogError, LogEvent, LogReader, LogSurvey};

/// Reads the events of a sonar pair that has been surveyed. The paths are for errors only.
///
/// # Errors
/// When reading fails.
pub fn read(
    measurement: impl Read + Send + 'static,
    measurement_path: &Path,
    poses: impl Read + Send + 'static,
    poses_path: &Path,
    survey: &LogSurvey,
) -> Result<LogReader, LogError> {
    let bytes = |file: usize| survey.byte_counts.get(file).copied().unwrap_or(0);
    let surveyed = [bytes(0), bytes(1)];
    let paths = [measurement_path.to_path_buf(), poses_path.to_path_buf()];
    let rows = Rows::new(measurement.take(bytes(0)), poses.take(bytes(1))).map_err(|error| failed(&paths, error))?;
    Ok(LogReader(Box::new(UdacityReader {
        rows: Some(rows),
        shrunk: None,
        surveyed,
        paths,
        timeline: EventLine::new(&survey.clock),
        places: 0,
    })))
}

struct UdacityReader<M: Read, P: Read> {
    /// What is said after the last event.
    shrunk: Option<LogError>,
    /// None after their end.
    rows: Option<Rows<M, P>>,
    /// Bytes of both files when they were surveyed.
    surveyed: [u64; 2],
    paths: [PathBuf; 2],
    timeline: EventLine,
    /// Rows so far.
    places: u64,
}

impl<M: Read, P: Read> Iterator for UdacityReader<M, P> {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(event) = self.timeline.pop() {
                return Some(Ok(event));
            }
            let Some(rows) = &mut self.rows else { return self.shrunk.take().map(Err) };
            match rows.next() {
                Ok(Some(Next::Row(row))) => {
                    self.places += 1;
                    self.timeline.push(timed_line(self.places, &row));
                }
                // CountedBy by the survey.
                Ok(Some(Next::Refused(..))) => {}
                Ok(None) => {
                    self.timeline.finish();
                    self.shrunk = self.rows.take()?.check_whole(&self.paths, self.surveyed).err();
                }
                Err(error) => {
                    self.rows = None;
                    return Some(Err(failed(&self.paths, error)));
                }
            }
        }
    }
}

fn failed([measurement, poses]: &[PathBuf; 2], (half, source): (Half, std::io::Error)) -> LogError {
    LogError::open(if half == Half::Measurement { measurement } else { poses }, source)
}

/// The event of a row, the `number`th of both files in the order of stamps.
pub(super) fn timed_line(number: u64, row: &Row) -> TimedLine<Vec<LogEvent>> {
    let (source, rank, stamp_ns, pose, weight, event) = match *row {
        Row::Pose { stamp_ns, odom_from_base } => {
            let event = LogEvent::Odometry { stamp_ns, odom_from_base, v_mps: 0.0, w_radps: 0.0 };
            (Source::ODOMETRY, Rank::Odometry, stamp_ns, Some(odom_from_base), 0, event)
        }
        Row::Ranges { stamp_ns, ranges_mm } => {
            let event = LogEvent::Scan { stamp_ns, readings: readings(ranges_mm) };
            (Source(Source::FIRST_SCAN), Rank::Scan, stamp_ns, None, SONARS, event)
        }
    };
    TimedLine { number, source, rank, stamp_ns: Some(stamp_ns), pose, weight, restates: false, payload: vec![event] }
}

fn readings(ranges_mm: [i64; SONARS]) -> Vec<Reading> {
    let echo = |range_mm: i64| match range_mm {
        ..RANGE_MIN_MM => Echo::Invalid,
        RANGE_MIN_MM..=RANGE_MAX_MM => Echo::Hit { range_m: range_mm as f64 / 1000.0 },
        _ => Echo::NoEcho,
    };
    (0..)
        .zip(ranges_mm)
        .map(|(transducer, range_mm)| Reading { transducer, echo: echo(range_mm), offset_ns: 0 })
        .collect()
}
