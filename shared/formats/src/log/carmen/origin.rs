//! Where messages come from: lines of text, or a recording.

use std::sync::Arc;

use super::message::ScanKind;
use crate::log::LogFormat;
use crate::log::dialect::Dialect;
use crate::log::fault::CountedBy;
use crate::log::recording::RecordingPlan;

/// How what is stored becomes messages.
#[derive(Debug, Clone)]
pub(crate) enum Origin {
    /// Lines of text.
    Text(Dialect),
    /// A recording of that format.
    Recording(LogFormat, Arc<RecordingPlan>),
}

impl Default for Origin {
    fn default() -> Self {
        Self::Text(Dialect::default())
    }
}

impl Origin {
    pub(crate) fn format(&self) -> LogFormat {
        match self {
            Self::Text(dialect) => dialect.format(),
            Self::Recording(format, _) => *format,
        }
    }

    /// What is counted, where something is said to be.
    pub(crate) fn place(&self) -> CountedBy {
        match self {
            Self::Text(_) => CountedBy::Line,
            Self::Recording(..) => CountedBy::Message,
        }
    }

    /// What is odometry in it, for people.
    pub(crate) fn odometry_lines(&self) -> &'static str {
        match self {
            Self::Text(dialect) => dialect.odometry_lines(),
            Self::Recording(..) => "messages of nav_msgs/Odometry, or of tf from odom to the robot's base",
        }
    }

    /// What is a reading in it, for people.
    pub(crate) fn reading_lines(&self) -> &'static str {
        match self {
            Self::Text(dialect) => dialect.reading_lines(),
            Self::Recording(..) => "messages of sensor_msgs/LaserScan or sensor_msgs/Range",
        }
    }

    /// The name of a range sensor, for people.
    pub(crate) fn name_of(&self, kind: ScanKind) -> String {
        match (self, kind) {
            (Self::Recording(_, plan), ScanKind::Stream(number)) => {
                plan.names.get(usize::from(number)).cloned().unwrap_or_default()
            }
            _ => kind.name(),
        }
    }

    pub(crate) fn robot_name(&self) -> &'static str {
        match self {
            Self::Text(_) => "robot of a CARMEN log",
            Self::Recording(..) => "robot of a recording",
        }
    }
}
