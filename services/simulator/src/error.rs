//! Why a simulation can't be started.

use echogrid_core::config::ConfigError;
use echogrid_core::world::WorldError;
use echogrid_formats::WriteError;
use echogrid_formats::world::WorldFileError;

/// Why a simulation can't be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulatorError {
    /// A value of `[simulator]` is out of its range.
    #[error("simulator.{0}")]
    Config(#[from] ConfigError),
    /// The world can't be read.
    #[error("simulator.world: {0}")]
    WorldFile(#[from] WorldFileError),
    /// The world can't be used.
    #[error("simulator.world: {world}: {source}")]
    World {
        /// The world.
        world: String,
        /// Why not.
        source: WorldError,
    },
    /// Nothing says where to start.
    #[error(
        "simulator.start: {world} has no home; expected simulator.start = [x, y, heading_deg], or a [home] in the world"
    )]
    NoStart {
        /// The world.
        world: String,
    },
    /// The robot does not fit where it is to start.
    #[error(
        "simulator.start: at ({x}, {y}) in {world} the nearest wall is {nearest_m:.2} m from the robot's centre, and its radius is {radius_m:.2} m; expected a place with room for it"
    )]
    StartTooNear {
        /// The world.
        world: String,
        /// Where, metres.
        x: f64,
        /// Where, metres.
        y: f64,
        /// From the robot's centre to the wall, metres; 0: within it.
        nearest_m: f64,
        /// The radius of the robot, metres.
        radius_m: f64,
    },
    /// The route names a goal that the world does not have.
    #[error("simulator.route: {world} has no goal {name:?}; expected {}{}", listed(goals), near.as_ref().map(|near| format!("; did you mean {near:?}?")).unwrap_or_default())]
    UnknownGoal {
        /// The world.
        world: String,
        /// What was asked for.
        name: String,
        /// The goals that there are.
        goals: Vec<String>,
        /// The goal that was probably meant.
        near: Option<String>,
    },
    /// A tour needs goals.
    #[error(
        "simulator.route: {world} has no goal that the robot can reach; expected a route of [x, y] places, or goals in the world"
    )]
    NoGoal {
        /// The world.
        world: String,
    },
    /// There is no way to a place of the route.
    #[error(
        "simulator.route: {goal} of {world} can't be reached from ({x:.2}, {y:.2}) by a robot that keeps {clearance_m:.2} m from walls and forbidden lines; expected a way (simulator.margin_m = {margin_m} is part of that distance)"
    )]
    Unreachable {
        /// The world.
        world: String,
        /// Where it was to go, in words.
        goal: String,
        /// From where, metres.
        x: f64,
        /// From where, metres.
        y: f64,
        /// What it keeps from walls, metres.
        clearance_m: f64,
        /// What of that is the margin, metres.
        margin_m: f64,
    },
    /// The firing order names a sonar that is not there.
    #[error("simulator.firing_order: there is no sonar {number}: robot {robot} has {has}")]
    NoSuchSonar {
        /// The sonar.
        number: u16,
        /// The robot.
        robot: String,
        /// What it has, in words.
        has: String,
    },
    /// What is to break is not there.
    #[error("simulator.faults: there is no sonar {number} on robot {robot}; expected the number of one of its sonars")]
    NoSuchFault {
        /// The sonar.
        number: u16,
        /// The robot.
        robot: String,
    },
    /// A robot that hears nothing.
    #[error(
        "robot {robot} has no sensor that the simulator could stand for; expected a [[sonar]] or a [lidar] in its file"
    )]
    NoSensor {
        /// The robot.
        robot: String,
    },
    /// The drive can't be recorded.
    #[error("simulator.record: {0}")]
    Record(#[from] WriteError),
}

fn listed(goals: &[String]) -> String {
    /// What is more is not read.
    const SHOWN: usize = 12;
    let shown: Vec<String> = goals.iter().take(SHOWN).map(|goal| format!("{goal:?}")).collect();
    match goals.len() {
        0 => "[x, y] places: it has no goals".to_owned(),
        n if n > SHOWN => format!("one of {} and {} more", shown.join(", "), n - SHOWN),
        _ => format!("one of {}", shown.join(", ")),
    }
}
