//! The second pass over a CARMEN log: its events.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use echogrid_core::{Echo, Reading};

use super::kinds::{CarmenPlan, UsedKind};
use super::message::{Message, ScanLine};
use super::origin::Origin;
use super::repeats::Repeats;
use crate::log::dialect::Dialect;
use crate::log::lines::{Line, Lines};
use crate::log::recording::{Container, Messages};
use crate::log::timeline::{EventLine, Rank, Source, TimedLine};
use crate::log::{LogError, LogEvent, LogReader, LogSurvey};

/// Reads the events of a CARMEN log that has been surveyed. `path` is for errors only.
///
/// # Errors
/// When reading fails.
pub fn read(stored: impl Read + Send + 'static, path: &Path, survey: &LogSurvey) -> Result<LogReader, LogError> {
    let surveyed = survey.byte_counts.first().copied().unwrap_or(0);
    let stored = stored.take(surveyed);
    let lines = Lines::new(stored).map_err(|source| LogError::open(path, source))?;
    let dialect = match &survey.plan.origin {
        Origin::Text(dialect) => dialect.clone(),
        Origin::Recording(format, _) => {
            return Err(LogError::Changed { path: path.to_path_buf(), surveyed: *format });
        }
    };
    Ok(LogReader(Box::new(CarmenReader {
        lines: Some(lines),
        shrunk: None,
        surveyed,
        dialect,
        repeats: Repeats::default(),
        path: path.to_path_buf(),
        plan: survey.plan.clone(),
        timeline: EventLine::new(&survey.clock),
    })))
}

struct CarmenReader<R: Read> {
    /// What is said after the last event.
    shrunk: Option<LogError>,
    /// None after their end.
    lines: Option<Lines<R>>,
    /// Bytes of the file when it was surveyed.
    surveyed: u64,
    dialect: Dialect,
    repeats: Repeats,
    path: PathBuf,
    plan: CarmenPlan,
    timeline: EventLine,
}

impl<R: Read> Iterator for CarmenReader<R> {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(event) = self.timeline.pop() {
                return Some(Ok(event));
            }
            let Some(lines) = &mut self.lines else { return self.shrunk.take().map(Err) };
            match lines.next() {
                // What is refused has been counted by the survey.
                Ok(Some(Line::Bytes(number, bytes))) => {
                    let (plan, timeline) = (&self.plan, &mut self.timeline);
                    let repeats = &mut self.repeats;
                    let stands_twice = repeats.stands_twice(bytes);
                    let _ = self.dialect.parse(bytes, &mut |message| {
                        if repeats.is_copy(stands_twice, &message) {
                            return;
                        }
                        if let Some(line) = timed_line(number, message, plan) {
                            timeline.push(line);
                        }
                    });
                }
                Ok(Some(Line::TooLong(_) | Line::Damaged(..))) => {}
                Ok(None) => {
                    self.timeline.finish();
                    self.shrunk = self.lines.take()?.check_whole(&self.path, self.surveyed).err();
                }
                Err(source) => {
                    self.lines = None;
                    return Some(Err(LogError::open(&self.path, source)));
                }
            }
        }
    }
}

/// Reads the events of a recording that has been surveyed.
pub(in crate::log) fn read_recording(
    container: Box<dyn Container>,
    path: &Path,
    survey: &LogSurvey,
) -> Result<LogReader, LogError> {
    let Origin::Recording(_, plan) = &survey.plan.origin else {
        return Err(LogError::Changed { path: path.to_path_buf(), surveyed: survey.format });
    };
    Ok(LogReader(Box::new(RecordingReader {
        messages: Some(Messages::new(container, Arc::clone(plan))),
        surveyed: survey.byte_counts.first().copied().unwrap_or(0),
        shrunk: None,
        path: path.to_path_buf(),
        plan: survey.plan.clone(),
        timeline: EventLine::new(&survey.clock),
    })))
}

struct RecordingReader {
    /// None after their end.
    messages: Option<Messages>,
    /// Bytes of the file when it was surveyed.
    surveyed: u64,
    /// What is said after the last event.
    shrunk: Option<LogError>,
    path: PathBuf,
    plan: CarmenPlan,
    timeline: EventLine,
}

impl RecordingReader {
    /// Reads on, by a chunk or so.
    fn advance(&mut self) -> Result<(), LogError> {
        let Some(messages) = &mut self.messages else { return Ok(()) };
        let (plan, timeline) = (&self.plan, &mut self.timeline);
        // What is refused has been counted by the survey.
        let goes_on = messages.advance(&mut |number, message| {
            if let Some(line) = message.ok().and_then(|message| timed_line(number, message, plan)) {
                timeline.push(line);
            }
        });
        let failed = |source| LogError::open(&self.path, source);
        if goes_on.map_err(failed)? {
            return Ok(());
        }
        self.timeline.finish();
        let Some(messages) = self.messages.take() else { return Ok(()) };
        let left = messages.into_container().finish().map_err(failed)?.bytes;
        let surveyed = self.surveyed;
        self.shrunk = (left < surveyed).then(|| LogError::Shrunk { path: self.path.clone(), surveyed, left });
        Ok(())
    }
}

impl Iterator for RecordingReader {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(event) = self.timeline.pop() {
                return Some(Ok(event));
            }
            if self.messages.is_none() {
                return self.shrunk.take().map(Err);
            }
            if let Err(error) = self.advance() {
                self.messages = None;
                return Some(Err(error));
            }
        }
    }
}

/// The events of a message, with stamps still to be put in. A scan that is not used keeps its place in the order, without
/// events.
pub(super) fn timed_line(number: u64, message: Message<'_>, plan: &CarmenPlan) -> Option<TimedLine<Vec<LogEvent>>> {
    let (rank, source, stamp_ns, pose, event) = match message {
        Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns } => {
            let event = LogEvent::Odometry { stamp_ns: 0, odom_from_base, v_mps, w_radps };
            (Rank::Odometry, Source::ODOMETRY, stamp_ns, Some(odom_from_base), event)
        }
        Message::TruePose { map_from_base, stamp_ns } => {
            let event = LogEvent::TruePose { stamp_ns: 0, map_from_base };
            (Rank::TruePose, Source::TRUE_POSE, stamp_ns, None, event)
        }
        Message::Scan(scan) => return timed_scan(number, &scan, plan),
        Message::Param { .. } | Message::Other { .. } | Message::Nothing => return None,
    };
    // Odometry that stands apart from the scans keeps its place in the order, without events.
    let is_used = rank != Rank::Odometry || plan.odometry_from.is_none();
    let payload = if is_used { vec![event] } else { Vec::new() };
    Some(TimedLine { number, source, rank, stamp_ns, pose, weight: 0, restates: false, payload })
}

fn timed_scan(number: u64, scan: &ScanLine, plan: &CarmenPlan) -> Option<TimedLine<Vec<LogEvent>>> {
    let used = plan.used.get(&scan.kind).map(|used| Some((used, used.transducers(scan)?)));
    // Of the kinds that are used, the lines that the survey used.
    let used = match used {
        Some(used) => Some(used?),
        None => None,
    };
    let mut events = Vec::new();
    if let (Some(carried), true) = (scan.carried, plan.odometry_from == Some(scan.kind)) {
        events.push(LogEvent::Odometry {
            stamp_ns: 0,
            odom_from_base: carried.odom_from_base,
            v_mps: carried.v_mps,
            w_radps: carried.w_radps,
        });
    }
    let rank = if events.is_empty() { Rank::Scan } else { Rank::Odometry };
    if let Some((used, transducers)) = used {
        events.push(LogEvent::Scan { stamp_ns: 0, readings: readings(scan, used, &transducers) });
    }
    Some(TimedLine {
        number,
        source: scan.kind.source(),
        rank,
        stamp_ns: scan.stamp_ns,
        pose: scan.carried.map(|carried| carried.odom_from_base),
        weight: scan.ranges.len(),
        restates: false,
        payload: events,
    })
}

fn readings(scan: &ScanLine, used: &UsedKind, transducers: &[u16]) -> Vec<Reading> {
    let step_ns = scan.described.map_or(0.0, |sensor| sensor.reading_step_ns);
    let offset_ns = |index: usize| match used.offsets_ns.get(index) {
        Some(offset_ns) => *offset_ns,
        None => libm::round(step_ns * index as f64) as i32,
    };
    let ranges = scan.ranges.iter().zip(transducers).enumerate();
    ranges
        .map(|(index, (range, transducer))| Reading {
            transducer: *transducer,
            echo: echo(*range, used),
            offset_ns: offset_ns(index),
        })
        .collect()
}

fn echo(range: f64, used: &UsedKind) -> Echo {
    let range_m = range * used.unit_m;
    if used.is_described && range == f64::INFINITY {
        return Echo::NoEcho;
    }
    if !super::is_sane(range) || range_m < used.range_min_m {
        Echo::Invalid
    } else if range_m >= used.ceiling_m {
        Echo::NoEcho
    } else {
        Echo::Hit { range_m }
    }
}
