//! A Pioneer robot as a sensor of the graph.
//!
//! The robot speaks ARCOS over a serial line or TCP ([`echogrid_arcos`]). A [`Session`] opens the conversation, keeps it up and closes
//! it; it does no I/O and reads no clock, so every fault of a line can be tried in a test. [`Reports`] turns what the robot tells into
//! odometry and rings of readings, [`Pioneer`] joins both to a [`Link`] and finds the robot again when its cable was pulled.
//! [`emulator`] is the other side: any sensor of the graph behind the door of a Pioneer.
//!
//! Motors stay off unless the configuration turns them on, and a command to drive counts for a moment only
//! ([`PioneerConfig::dead_man_s`]).

mod config;
pub mod emulator;
mod models;
mod pioneer;
mod reports;
mod session;

use std::process::ExitCode;

use echogrid_service::{Declaration, process};
use echogrid_topics::Topic;

pub use config::PioneerConfig;
pub use echogrid_line::{Address, Link};
pub use models::{model_of, robot_of};
pub use pioneer::Pioneer;
pub use reports::Reports;
pub use session::{Event, Out, Session, SessionSettings};

/// The topics that the Pioneer writes.
pub const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &[], writes: OUTPUTS, orders: &["drive"] };

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run_sensor("pioneer", OUTPUTS, Pioneer::from_plan)
}

/// Time since the machine was started, nanoseconds: the same for all processes, whoever sets its clock.
pub(crate) fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}
