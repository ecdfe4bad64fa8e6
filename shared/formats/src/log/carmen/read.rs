//! The second pass over a CARMEN log: its events.

use std::io::Read;
use std::path::{Path, PathBuf};

use echogrid_core::{Echo, Reading};

use super::kinds::{CarmenPlan, UsedKind};
use super::message::{Message, ScanLine};
use crate::log::lines::{Line, Lines};
use crate::log::timeline::{Rank, TimedLine, Timeline};
use crate::log::{LogError, LogEvent, LogReader, LogSurvey};
use crate::text::BYTE_ORDER_MARK;

/// Reads the events of a CARMEN log that has been surveyed. `path` is for errors only.
///
/// # Errors
/// When reading fails.
pub fn read(stored: impl Read + Send + 'static, path: &Path, survey: &LogSurvey) -> Result<LogReader, LogError> {
    let stored = stored.take(survey.byte_counts.first().copied().unwrap_or(u64::MAX));
    let lines = Lines::new(stored).map_err(|source| LogError::open(path, source))?;
    Ok(LogReader(Box::new(CarmenReader {
        lines,
        path: path.to_path_buf(),
        plan: survey.plan.clone(),
        timeline: Timeline::new(survey.stamps),
        ended: false,
    })))
}

struct CarmenReader<R: Read> {
    lines: Lines<R>,
    path: PathBuf,
    plan: CarmenPlan,
    timeline: Timeline,
    ended: bool,
}

impl<R: Read> Iterator for CarmenReader<R> {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(event) = self.timeline.pop() {
                return Some(Ok(event));
            }
            if self.ended {
                return None;
            }
            match self.lines.next() {
                // What is refused has been counted by the survey.
                Ok(Some(Line::Bytes(number, bytes))) => {
                    let bytes = if number == 1 { bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes) } else { bytes };
                    let (plan, timeline) = (&self.plan, &mut self.timeline);
                    let _ = plan.dialect.parse(bytes, &mut |message| {
                        if let Some(line) = timed_line(message, plan) {
                            timeline.push(line);
                        }
                    });
                }
                Ok(Some(Line::TooLong(_) | Line::Damaged(..))) => {}
                Ok(None) => {
                    self.ended = true;
                    self.timeline.finish();
                }
                Err(source) => {
                    self.ended = true;
                    return Some(Err(LogError::open(&self.path, source)));
                }
            }
        }
    }
}

/// The events of a message. A scan that is not used keeps its place in the order, without events.
fn timed_line(message: Message<'_>, plan: &CarmenPlan) -> Option<TimedLine> {
    match message {
        Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns } => Some(TimedLine {
            stamp_ns,
            rank: Rank::Odometry,
            weight: 0,
            events: vec![LogEvent::Odometry { stamp_ns: 0, odom_from_base, v_mps, w_radps }],
        }),
        Message::TruePose { map_from_base, stamp_ns } => Some(TimedLine {
            stamp_ns,
            rank: Rank::TruePose,
            weight: 0,
            events: vec![LogEvent::TruePose { stamp_ns: 0, map_from_base }],
        }),
        Message::Scan(scan) => timed_scan(&scan, plan),
        Message::Param { .. } | Message::Other { .. } | Message::Nothing => None,
    }
}

fn timed_scan(scan: &ScanLine, plan: &CarmenPlan) -> Option<TimedLine> {
    let used = plan.used.get(&scan.kind).map(|used| Some((used, used.transducers(scan)?)));
    // Of the kinds that are used, the lines that the survey used.
    let used = match used {
        Some(used) => Some(used?),
        None => None,
    };
    let mut line =
        TimedLine { stamp_ns: scan.stamp_ns, rank: Rank::Scan, weight: scan.ranges.len(), events: Vec::new() };
    if let (Some(carried), true) = (scan.carried, plan.odometry_from == Some(scan.kind)) {
        line.rank = Rank::Odometry;
        line.events.push(LogEvent::Odometry {
            stamp_ns: 0,
            odom_from_base: carried.odom_from_base,
            v_mps: carried.v_mps,
            w_radps: carried.w_radps,
        });
    }
    if let Some((used, transducers)) = used {
        line.events.push(LogEvent::Scan { stamp_ns: 0, readings: readings(&scan.ranges, used, &transducers) });
    }
    Some(line)
}

fn readings(ranges: &[f64], used: &UsedKind, transducers: &[u16]) -> Vec<Reading> {
    ranges
        .iter()
        .zip(transducers)
        .enumerate()
        .map(|(index, (range, transducer))| Reading {
            transducer: *transducer,
            echo: echo(*range, used),
            offset_ns: used.offsets_ns.get(index).copied().unwrap_or(0),
        })
        .collect()
}

fn echo(range: f64, used: &UsedKind) -> Echo {
    let range_m = range * used.unit_m;
    if !super::is_sane(range) || range_m < used.range_min_m {
        Echo::Invalid
    } else if range_m >= used.ceiling_m {
        Echo::NoEcho
    } else {
        Echo::Hit { range_m }
    }
}
