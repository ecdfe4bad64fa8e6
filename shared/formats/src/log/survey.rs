//! What is in a log.

use std::collections::BTreeMap;
use std::time::Duration;

use echogrid_core::{Robot, Sideways};
use serde::Serialize;

use super::carmen::{CarmenPlan, RangeUnit};
use super::{ClockReport, Fault, LogFormat};

/// What a user says of a log where the log does not.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SurveyOptions {
    /// The unit of the ranges; none: told by the ranges themselves.
    pub range_unit: Option<RangeUnit>,
    /// Topics of a recording that are used in place of others of their type.
    pub topics: Vec<String>,
    /// Who says in a recording where the robot really was: a topic, or `tf` (`map` to `odom`); none: nobody.
    pub truth: Option<String>,
    /// Over how many degrees the beams of a laser lie whose format does not say it, 1 to 360; none: as the format has it, 180.
    pub laser_view_deg: Option<u16>,
}

impl SurveyOptions {
    pub(crate) fn laser_view_rad(&self) -> Option<f64> {
        self.laser_view_deg.map(|degrees| f64::from(degrees.clamp(1, 360)).to_radians())
    }
}

/// What is in a log, learnt by reading it once.
#[derive(Debug, Clone, Serialize)]
pub struct LogSurvey {
    /// The format of the log.
    pub format: LogFormat,
    /// The robot: every range sensor that the log uses, transducers numbered over all of them.
    pub robot: Robot,
    /// The number of odometry events.
    pub odometry_count: u64,
    /// The number of scans.
    pub scan_count: u64,
    /// The number of readings in all scans.
    pub reading_count: u64,
    /// The number of true poses.
    pub true_pose_count: u64,
    /// Readings in the largest scan.
    pub max_readings_per_scan: usize,
    /// Stamp of the first event, nanoseconds.
    pub first_stamp_ns: u64,
    /// Stamp of the last event, nanoseconds.
    pub last_stamp_ns: u64,
    /// Sum of the odometry's steps, metres.
    pub distance_m: f64,
    /// Whether its odometry slides sideways, as no drive's does.
    #[serde(skip)]
    pub sideways: Sideways,
    /// What the stamps are good for, and what was made of them.
    pub clock: ClockReport,
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
    /// The time from the first event to the last.
    #[must_use]
    pub fn duration(&self) -> Duration {
        Duration::from_nanos(self.last_stamp_ns.saturating_sub(self.first_stamp_ns))
    }
}
