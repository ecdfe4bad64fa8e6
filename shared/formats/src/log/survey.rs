//! What is in a log.

use std::collections::BTreeMap;
use std::time::Duration;

use echogrid_core::Robot;
use serde::Serialize;

use super::carmen::{CarmenPlan, RangeUnit};
use super::{Fault, LogFormat};

/// What a log's stamps are good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StampQuality {
    /// In order as they stand.
    Usable,
    /// Usable once put in order.
    Reordered {
        /// Lines whose stamp is earlier than one before them.
        count: u64,
        /// How many of these came more than 2 s late, or after a jump that no other line
        /// confirms: their stamp is replaced by that of the event before.
        clamped: u64,
    },
    /// Useless: events keep the order of their lines, and stamps are made up: 0.1 s from one
    /// odometry line to the next, a scan at the stamp of the odometry line before it.
    OrderOnly,
}

/// What a user says of a log where the log does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SurveyOptions {
    /// In which unit its ranges are; none: told by the ranges themselves.
    pub range_unit: Option<RangeUnit>,
}

/// What is in a log, learnt by reading it once.
#[derive(Debug, Clone, Serialize)]
pub struct LogSurvey {
    /// Its format.
    pub format: LogFormat,
    /// The robot: every range sensor that the log uses, transducers numbered over all of them.
    pub robot: Robot,
    /// Odometry events.
    pub odometry_count: u64,
    /// Scan events.
    pub scan_count: u64,
    /// Readings in all scans.
    pub reading_count: u64,
    /// True-pose events.
    pub true_pose_count: u64,
    /// Readings in the largest scan.
    pub max_readings_per_scan: usize,
    /// Stamp of the first event, nanoseconds.
    pub first_stamp_ns: u64,
    /// Stamp of the last event, nanoseconds.
    pub last_stamp_ns: u64,
    /// Sum of the odometry's steps, metres.
    pub distance_m: f64,
    /// What the stamps are good for.
    pub stamps: StampQuality,
    /// Messages that are not used, by name: unknown ones, and those that repeat another sensor.
    pub skipped: BTreeMap<String, u64>,
    /// Damage, by kind.
    pub faults: Vec<Fault>,
    /// What is odd about its sensors, and what was made of it, in words.
    pub remarks: Vec<String>,
    /// SHA-256 of the bytes as they are stored (compressed, if they are), hexadecimal; of a pair of
    /// files one after the other (`measurement.txt`, then `poses.txt`).
    pub sha256: String,
    /// The log's parameters; the last value before the first scan counts.
    pub params: BTreeMap<String, String>,
    /// Bytes surveyed, per file.
    #[serde(skip)]
    pub(crate) byte_counts: Vec<u64>,
    /// How the lines of a CARMEN log become events.
    #[serde(skip)]
    pub(crate) plan: CarmenPlan,
}

impl LogSurvey {
    /// From the first event to the last.
    #[must_use]
    pub fn duration(&self) -> Duration {
        Duration::from_nanos(self.last_stamp_ns.saturating_sub(self.first_stamp_ns))
    }
}
