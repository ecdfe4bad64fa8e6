//! What a log gives.

use echogrid_core::{Pose2, Reading};

use super::LogError;

/// One event of a log.
#[derive(Debug, Clone, PartialEq)]
pub enum LogEvent {
    /// Where the odometry says the robot is.
    Odometry {
        /// Nanoseconds, never less than the stamp of the event before.
        stamp_ns: u64,
        /// The robot in the frame in which its odometry counts.
        odom_from_base: Pose2,
        /// Speed, m/s; 0 where the log does not say.
        v_mps: f64,
        /// Rate of turn, rad/s, positive counter-clockwise; 0 where the log does not say.
        w_radps: f64,
    },
    /// What the range sensors say.
    Scan {
        /// Nanoseconds, never less than the stamp of the event before.
        stamp_ns: u64,
        /// By transducer of [`super::LogSurvey::robot`]; one sensor's or several'.
        readings: Vec<Reading>,
    },
    /// Where the robot really is: only simulated or externally tracked robots know.
    TruePose {
        /// Nanoseconds, never less than the stamp of the event before.
        stamp_ns: u64,
        /// The robot in the frame of the true map.
        map_from_base: Pose2,
    },
}

impl LogEvent {
    /// The stamp of the event, nanoseconds.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        match self {
            Self::Odometry { stamp_ns, .. } | Self::Scan { stamp_ns, .. } | Self::TruePose { stamp_ns, .. } => {
                *stamp_ns
            }
        }
    }

    pub(crate) fn set_stamp_ns(&mut self, at_ns: u64) {
        match self {
            Self::Odometry { stamp_ns, .. } | Self::Scan { stamp_ns, .. } | Self::TruePose { stamp_ns, .. } => {
                *stamp_ns = at_ns;
            }
        }
    }
}

/// The events of a log in stamp order; at equal stamps odometry comes before scans.
///
/// The only errors are those of reading the file: damage is counted by the survey and skipped here.
pub struct LogReader(pub(crate) Box<dyn Iterator<Item = Result<LogEvent, LogError>> + Send>);

impl LogReader {
    /// A log that is not in a file; `events` must be in stamp order.
    #[must_use]
    pub fn from_events(events: Vec<LogEvent>) -> Self {
        Self(Box::new(events.into_iter().map(Ok)))
    }
}

impl core::fmt::Debug for LogReader {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("LogReader")
    }
}

impl Iterator for LogReader {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.next()
    }
}
