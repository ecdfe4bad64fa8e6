//! A simulated robot as a sensor of the graph.
//!
//! A robot drives through a known world. Its wheels slip and its encoders count whole ticks, so its odometry drifts for the
//! reasons that real odometry does ([`SimulatorConfig::expected_error_model`]); its sonars hear mirrors, corners and each
//! other; people walk about. The same configuration gives the same bytes on every machine.
//!
//! As a process it is what `--sensor simulator` starts. As a library it tells the truth besides:
//!
//! ```
//! use echogrid_core::Robot;
//! use echogrid_service::Sensor as _;
//! use echogrid_simulator::{Motion, Simulator, SimulatorConfig};
//! # use echogrid_core::{Pose2, Sensor, SensorKind};
//! # let robot = Robot { name: "one".into(), sensors: vec![Sensor {
//! #     kind: SensorKind::Sonar, base_from_sensor: Pose2::IDENTITY, first_transducer: 0, transducers: 1,
//! #     first_bearing_rad: 0.0, bearing_step_rad: 0.0, aperture_rad: 0.5, range_min_m: 0.1, range_max_m: 5.0,
//! #     range_error_ratio: 0.01 }], ..Robot::default() };
//! let world = echogrid_formats::world::find("room".as_ref())?;
//! let script = [Motion::Straight { metres: 1.0 }, Motion::Turn { radians: 1.5 }];
//! let mut simulator = Simulator::scripted(&SimulatorConfig::default(), world, robot, script)?;
//! while let Some((stamp_ns, message)) = simulator.next()? {
//!     let truth = simulator.true_pose();
//! #     let _ = (stamp_ns, message, truth);
//! }
//! # Ok::<(), anyhow::Error>(())
//! ```

mod cause;
pub mod config;
mod corners;
mod drive;
mod encoders;
mod error;
pub mod fault;
mod lidar;
mod people;
mod planner;
mod record;
mod ring;
mod route;
mod simulator;
mod slip;
mod sonar;

use std::path::Path;
use std::process::ExitCode;

use echogrid_core::World;
use echogrid_formats::world;
use echogrid_service::{Declaration, process};
use echogrid_topics::Topic;

pub use cause::{Cause, Heard, IncidenceTable};
pub use config::{Route, SimulatorConfig, Waypoint};
pub use drive::{Drive, Motion, STEP_S};
pub use error::SimulatorError;
pub use fault::{Fault, FaultKind};
pub use simulator::Simulator;
pub use slip::ExpectedErrors;

/// The topics that the simulator writes.
pub const OUTPUTS: &[Topic] =
    &[Topic::RobotDescription, Topic::TrueWorld, Topic::TruePose, Topic::OdometryRaw, Topic::RangeScan];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &[], writes: OUTPUTS, orders: &["drive"] };

/// The world that a configuration names, as the simulator takes it: walls only, where a file has walls and the points that
/// a laser once measured of them.
///
/// # Errors
/// It can't be read, or makes no world.
pub fn world_of(config: &SimulatorConfig) -> Result<World, SimulatorError> {
    let world = world::find(Path::new(&config.world))?;
    let (world, _) =
        world.walls_only().map_err(|source| SimulatorError::World { world: config.world.clone(), source })?;
    Ok(world)
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run_sensor("simulator", OUTPUTS, Simulator::from_plan)
}

/// A time in whole nanoseconds.
pub(crate) fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
