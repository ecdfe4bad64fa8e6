//! A planar lidar as a sensor of the graph: its scans alone. Where the robot drives another sensor says, and where the lidar sits the
//! robot's file does.
//!
//! [`codec`] understands what lidars say, without I/O or clock; [`Turns`] makes scans of their beams, by the bearings that the robot's
//! file gives them; [`Lidar`] joins both to a line that may be cut.

pub mod codec;
mod config;
mod lidar;
mod turns;

use std::process::ExitCode;

use echogrid_service::{Declaration, process};
use echogrid_topics::Topic;

pub use config::{LidarConfig, Model};
pub use lidar::Lidar;
pub use turns::Turns;

/// The topics that the lidar writes.
pub const OUTPUTS: &[Topic] = &[Topic::RangeScan];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &[], writes: OUTPUTS, orders: &[] };

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run_sensor("lidar", OUTPUTS, Lidar::from_plan)
}
