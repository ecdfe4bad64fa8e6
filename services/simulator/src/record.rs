//! The drive as a log, for a replay.

use std::path::Path;

use echogrid_core::{Pose2, Reading, Robot};
use echogrid_formats::WriteError;
use echogrid_formats::log::LogEvent;
use echogrid_formats::log::carmen::LogFile;
use echogrid_topics::RawOdometry;

/// A CARMEN log in the making; it stands at its path once it is dropped.
#[derive(Debug)]
pub(crate) struct Record(LogFile);

impl Record {
    /// `path` empty: no record.
    pub(crate) fn begin(path: &Path, robot: &Robot, offsets_ns: &[i32]) -> Result<Option<Self>, WriteError> {
        if path.as_os_str().is_empty() {
            return Ok(None);
        }
        Ok(Some(Self(LogFile::create(path, robot, offsets_ns)?)))
    }

    pub(crate) fn true_pose(&mut self, stamp_ns: u64, map_from_base: Pose2) -> Result<(), WriteError> {
        self.0.event(&LogEvent::TruePose { stamp_ns, map_from_base })
    }

    pub(crate) fn odometry(&mut self, stamp_ns: u64, odometry: &RawOdometry) -> Result<(), WriteError> {
        let RawOdometry { odom_from_base, v_mps, w_radps } = *odometry;
        self.0.event(&LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps })
    }

    pub(crate) fn scan(&mut self, stamp_ns: u64, readings: &[Reading]) -> Result<(), WriteError> {
        self.0.event(&LogEvent::Scan { stamp_ns, readings: readings.to_vec() })
    }

    /// Puts it in place.
    pub(crate) fn finish(self) -> Result<(), WriteError> {
        self.0.finish()
    }
}
