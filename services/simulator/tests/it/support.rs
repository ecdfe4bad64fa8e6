//! Robots and worlds that the tests share.

use core::f64::consts::PI;

use echogrid_core::{Footprint, Pose2, Robot, Segment, Sensor, SensorKind, World, WorldParts};
use echogrid_service::Sensor as _;
use echogrid_simulator::{Heard, Motion, Simulator, SimulatorConfig};
use echogrid_topics::Message;

/// x, y (metres) and heading (degrees) of a Pioneer 3-AT's sonars.
const PIONEER: [(f64, f64, f64); 16] = [
    (0.147, 0.136, 90.0),
    (0.193, 0.119, 50.0),
    (0.227, 0.079, 30.0),
    (0.245, 0.027, 10.0),
    (0.245, -0.027, -10.0),
    (0.227, -0.079, -30.0),
    (0.193, -0.119, -50.0),
    (0.147, -0.136, -90.0),
    (-0.144, -0.136, -90.0),
    (-0.189, -0.119, -130.0),
    (-0.223, -0.079, -150.0),
    (-0.241, -0.027, -170.0),
    (-0.241, 0.027, 170.0),
    (-0.223, 0.079, 150.0),
    (-0.189, 0.119, 130.0),
    (-0.144, 0.136, 90.0),
];

fn sonar(number: u16, (x, y, heading_deg): (f64, f64, f64)) -> Sensor {
    Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(x, y, heading_deg * PI / 180.0),
        first_transducer: number,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: PI / 6.0,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    }
}

/// A robot of no extent with sonars at its middle, looking these ways, degrees.
pub(crate) fn sonars(headings_deg: &[f64]) -> Robot {
    let sensors = (0..).zip(headings_deg).map(|(number, heading)| sonar(number, (0.0, 0.0, *heading))).collect();
    Robot { name: "sonars".into(), footprint: Footprint { length_m: 0.02, width_m: 0.02 }, sensors }
}

pub(crate) fn pioneer() -> Robot {
    let sensors = (0..).zip(PIONEER).map(|(number, mount)| sonar(number, mount)).collect();
    Robot { name: "pioneer3at".into(), footprint: Footprint { length_m: 0.626, width_m: 0.505 }, sensors }
}

/// A laser of 181 beams that looks ahead.
pub(crate) fn laser() -> Robot {
    let lidar = Sensor {
        kind: SensorKind::Lidar,
        transducers: 181,
        first_bearing_rad: -PI / 2.0,
        bearing_step_rad: PI / 180.0,
        aperture_rad: PI / 180.0,
        range_max_m: 32.0,
        range_error_ratio: 0.005,
        ..sonar(0, (0.0, 0.0, 0.0))
    };
    Robot { name: "laser".into(), footprint: Footprint::default(), sensors: vec![lidar] }
}

/// As in the robot's own file: front and rear together, from side to side.
pub(crate) fn pioneer_config(world: &str) -> SimulatorConfig {
    SimulatorConfig {
        world: world.to_owned(),
        firing_order: (0..8).map(|number| vec![number, number + 8]).collect(),
        ..SimulatorConfig::default()
    }
}

/// A drive whose odometry is right, but for its ticks.
pub(crate) fn exact() -> SimulatorConfig {
    SimulatorConfig {
        slip_m2_per_m: 0.0,
        scrub_rad2_per_rad: 0.0,
        scrub_m2_per_rad: 0.0,
        bumps_per_m: 0.0,
        ..SimulatorConfig::default()
    }
}

pub(crate) fn named(world: &str) -> World {
    echogrid_formats::world::find(world.as_ref()).unwrap()
}

pub(crate) fn line(x1: f64, y1: f64, x2: f64, y2: f64) -> Segment {
    Segment { from: [x1, y1], to: [x2, y2] }
}

pub(crate) fn world(walls: &[Segment]) -> World {
    World::new(WorldParts { walls: walls.to_vec(), ..WorldParts::default() }).unwrap()
}

/// All scans that are heard while a robot stands for `seconds` at x, y (metres) and heading (degrees).
pub(crate) fn standing(
    config: &SimulatorConfig,
    world: World,
    robot: Robot,
    start: [f64; 3],
    seconds: f64,
) -> Vec<Vec<Heard>> {
    let config = SimulatorConfig { start: start.into(), ..config.clone() };
    let mut simulator = Simulator::scripted(&config, world, robot, [Motion::Wait { seconds }]).unwrap();
    let mut scans = Vec::new();
    while let Some((_, message)) = simulator.next().unwrap() {
        if matches!(message, Message::Scan(_)) {
            scans.push(simulator.last_causes().to_vec());
        }
    }
    assert!(!scans.is_empty());
    scans
}
