//! The rows of both files, merged by time.

use std::io::{self, Read};
use std::path::PathBuf;

use echogrid_core::Pose2;

use super::SONARS;
use crate::log::LogError;
use crate::log::fault::{FaultKind, Refusal};
use crate::log::lines::{Line, Lines};

/// Largest magnitude of a pose: 1000 km in millimetres, and as many tenths of a degree.
const POSE_MAX: i64 = 1_000_000_000;
/// Largest range in millimetres: 100 km.
const RANGE_MAX: i64 = 100_000_000;
/// Stamps from here on are no milliseconds.
const STAMP_END_MS: i64 = 10_000_000_000_000;

/// A row of either file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Row {
    Pose { stamp_ns: u64, odom_from_base: Pose2 },
    Ranges { stamp_ns: u64, ranges_mm: [i64; SONARS] },
}

impl Row {
    fn stamp_ns(&self) -> u64 {
        match self {
            Self::Pose { stamp_ns, .. } | Self::Ranges { stamp_ns, .. } => *stamp_ns,
        }
    }
}

/// Which file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Half {
    Measurement,
    Poses,
}

/// What comes next: a row, or a line that is refused.
pub(super) enum Next {
    Row(Row),
    Refused(Half, u64, Refusal),
}

/// Rows of both files: the earlier first, at equal stamps the pose.
pub(super) struct Rows<M: Read, P: Read> {
    measurement: File<M>,
    poses: File<P>,
}

struct File<R: Read> {
    lines: Lines<R>,
    half: Half,
    waiting: Option<Row>,
    ended: bool,
}

impl<M: Read, P: Read> Rows<M, P> {
    /// Over the lines of both files; an error says which file.
    pub(super) fn new(measurement: M, poses: P) -> Result<Self, (Half, io::Error)> {
        Ok(Self { measurement: File::new(measurement, Half::Measurement)?, poses: File::new(poses, Half::Poses)? })
    }

    /// Of rows that have come to their end: an error if a file now has fewer bytes than when it was surveyed.
    pub(super) fn check_whole(self, [measurement, poses]: &[PathBuf; 2], surveyed: [u64; 2]) -> Result<(), LogError> {
        self.measurement.lines.check_whole(measurement, surveyed[0])?;
        self.poses.lines.check_whole(poses, surveyed[1])
    }

    pub(super) fn next(&mut self) -> Result<Option<Next>, (Half, io::Error)> {
        if let Some(refused) = self.measurement.fill()? {
            return Ok(Some(refused));
        }
        if let Some(refused) = self.poses.fill()? {
            return Ok(Some(refused));
        }
        let pose_first = match (&self.measurement.waiting, &self.poses.waiting) {
            (Some(ranges), Some(pose)) => pose.stamp_ns() <= ranges.stamp_ns(),
            (ranges, _) => ranges.is_none(),
        };
        let row = if pose_first { self.poses.waiting.take() } else { self.measurement.waiting.take() };
        Ok(row.map(Next::Row))
    }
}

impl<R: Read> File<R> {
    fn new(stored: R, half: Half) -> Result<Self, (Half, io::Error)> {
        let lines = Lines::new(stored).map_err(|error| (half, error))?;
        Ok(Self { lines, half, waiting: None, ended: false })
    }

    /// Reads on until a row waits; a refused line is handed back at once.
    fn fill(&mut self) -> Result<Option<Next>, (Half, io::Error)> {
        while self.waiting.is_none() && !self.ended {
            let half = self.half;
            let (number, row) = match self.lines.next().map_err(|error| (half, error))? {
                None => {
                    self.ended = true;
                    return Ok(None);
                }
                Some(Line::Bytes(number, bytes)) => (number, parse(half, bytes)),
                Some(Line::TooLong(number)) => (number, Err(Refusal::new(FaultKind::LineTooLong, ""))),
                Some(Line::Damaged(number, what)) => (number, Err(Refusal::new(FaultKind::GzipDamaged, what))),
            };
            match row {
                Ok(row) => self.waiting = row,
                Err(refusal) => return Ok(Some(Next::Refused(half, number, refusal))),
            }
        }
        Ok(None)
    }
}

/// One row; none for a blank line.
fn parse(half: Half, line: &[u8]) -> Result<Option<Row>, Refusal> {
    let text = core::str::from_utf8(line)
        .map_err(|_| Refusal::new(FaultKind::NotUtf8, String::from_utf8_lossy(line.get(..200).unwrap_or(line))))?;
    let mut words = text.split_ascii_whitespace();
    let Some(first) = words.next() else { return Ok(None) };
    let stamp_ns = number(first, 0, STAMP_END_MS, FaultKind::BadStamp)?.unsigned_abs() * 1_000_000;
    let mut next = |limit: i64, beyond: FaultKind| {
        let word = words.next().ok_or_else(|| Refusal::new(FaultKind::Truncated, "end of line"))?;
        number(word, -limit, limit, beyond)
    };
    let row = match half {
        Half::Measurement => {
            let mut ranges_mm = [0; SONARS];
            for range_mm in &mut ranges_mm {
                *range_mm = next(RANGE_MAX, FaultKind::AbsurdRange)?;
            }
            Row::Ranges { stamp_ns, ranges_mm }
        }
        Half::Poses => {
            let x = next(POSE_MAX, FaultKind::AbsurdPose)? as f64 / 1000.0;
            let y = next(POSE_MAX, FaultKind::AbsurdPose)? as f64 / 1000.0;
            let theta_deg = next(POSE_MAX, FaultKind::AbsurdPose)? as f64 / 10.0;
            Row::Pose { stamp_ns, odom_from_base: Pose2::new(x, y, theta_deg.to_radians()) }
        }
    };
    match words.next() {
        Some(extra) => Err(Refusal::new(FaultKind::ExtraWords, extra)),
        None => Ok(Some(row)),
    }
}

fn number(word: &str, least: i64, most: i64, beyond: FaultKind) -> Result<i64, Refusal> {
    let value: i64 = word.parse().map_err(|_| Refusal::new(FaultKind::BadNumber, word))?;
    if (least..=most).contains(&value) { Ok(value) } else { Err(Refusal::new(beyond, word)) }
}
