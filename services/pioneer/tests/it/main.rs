//! The driver against an emulated robot: over a line that exists in this process only, over a pseudo-terminal, and over TCP.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod line;
mod live;
mod reports;

use echogrid_core::{Footprint, Pose2, Robot, Sensor, SensorKind};
use echogrid_pioneer::emulator::{Emulator, Who};
use echogrid_simulator::{Motion, Route, Simulator, SimulatorConfig};

/// Sixteen sonars, as on a Pioneer: eight to the front, eight to the rear.
pub(crate) fn robot() -> Robot {
    let sonar = |number: u16| {
        let front = number < 8;
        let heading_deg = if front { 90.0 - 25.0 * f64::from(number) } else { -90.0 - 25.0 * f64::from(number - 8) };
        Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(if front { 0.2 } else { -0.2 }, 0.0, heading_deg.to_radians()),
            first_transducer: number,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        }
    };
    let footprint = Footprint { length_m: 0.5, width_m: 0.4 };
    Robot { name: "pioneer3at".into(), footprint, sensors: (0..16).map(sonar).collect() }
}

/// A robot that drives about in a room.
pub(crate) fn simulator(motions: Vec<Motion>) -> Simulator {
    let config = SimulatorConfig {
        world: "room".into(),
        firing_order: (0..8).map(|slot| vec![slot, slot + 8]).collect(),
        firing_period_s: 0.04,
        ..SimulatorConfig::default()
    };
    let world = echogrid_formats::world::find("room".as_ref()).unwrap();
    Simulator::scripted(&config, world, robot(), motions).unwrap()
}

/// One that goes where it is told to.
pub(crate) fn driven() -> Emulator<Simulator> {
    let config = SimulatorConfig { world: "room".into(), route: Route::Commands, ..SimulatorConfig::default() };
    let world = echogrid_formats::world::find("room".as_ref()).unwrap();
    Emulator::new(Who::of("p3at-sh", 40).unwrap(), Simulator::new(&config, world, robot()).unwrap())
}

/// A robot that drives about in a room, behind the door of a Pioneer.
pub(crate) fn emulator(motions: Vec<Motion>) -> Emulator<Simulator> {
    Emulator::new(Who::of("p3at-sh", 40).unwrap(), simulator(motions))
}
