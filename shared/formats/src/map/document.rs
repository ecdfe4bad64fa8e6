//! A map with the way it was made.

use echogrid_core::{Grid, Pose2};
use serde::{Deserialize, Serialize};

/// A map, the path on which it was made, and where it comes from.
#[derive(Debug, Clone)]
pub struct MapDocument {
    /// The cells of the map, as log-odds.
    pub grid: Grid,
    /// How much odometry error the evidence of each cell carried, metres in the cells; none: nobody kept it.
    pub doubt: Option<Grid>,
    /// Which way each wall faces: its normal, radians in [0, π), in the cells; none: nobody told it.
    pub facing: Option<Grid>,
    /// Where the robot was, in order of time.
    pub path: Vec<PathPoint>,
    /// What it was made of, and by what.
    pub provenance: Provenance,
}

impl MapDocument {
    /// The path of each drive, the first first: one begins where the clock goes back. Drives of one clock count as one.
    pub fn drives(&self) -> impl DoubleEndedIterator<Item = &[PathPoint]> {
        self.path.chunk_by(|a, b| a.stamp_ns <= b.stamp_ns)
    }

    /// The path of the last drive: one that goes on with the map of another may have a clock of its own.
    #[must_use]
    pub fn last_drive(&self) -> &[PathPoint] {
        self.drives().next_back().unwrap_or_default()
    }
}

/// A point of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Nanoseconds, on the clock of the log.
    pub stamp_ns: u64,
    /// The robot in the map frame.
    pub pose: Pose2,
    /// How far the pose could be trusted then, 0 to 1.
    pub trust: f64,
}

/// Where a map comes from. There is no date and no file name in it: the same
/// log gives the same bytes.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The software and its version.
    pub software: String,
    /// SHA-256 of the log, hexadecimal; none for a map made of live readings.
    pub log_sha256: Option<String>,
    /// The drives that it goes on with, the first first: of each the SHA-256 of its log, or `live`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub earlier: Vec<String>,
    /// The configuration in effect, as TOML.
    pub config_toml: String,
}
