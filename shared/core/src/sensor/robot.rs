//! Where the sensors sit on the robot, and what they can see.

use serde::{Deserialize, Serialize};

use crate::kernel::FAN_STEP_RAD;
use crate::pose::Pose2;

/// The most sensors that a robot can have: each sonar is one, and so is a lidar for each way in which its beams may lie.
pub const SENSORS_MAX: usize = 256;

/// What kind of range sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    /// A wide cone of sound; the first echo counts.
    Sonar,
    /// A narrow beam of light.
    Lidar,
}

/// A sensor: one sonar, or a lidar with all its beams.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Sonar or lidar.
    pub kind: SensorKind,
    /// Mount pose: the sensor's frame seen from the robot's base (x forward, y left).
    pub base_from_sensor: Pose2,
    /// Index of its first transducer among the robot's.
    pub first_transducer: u16,
    /// How many transducers: 1 for a sonar, the beams of a lidar.
    pub transducers: u16,
    /// Bearing of the first transducer in the sensor's frame, radians.
    pub first_bearing_rad: f64,
    /// Bearing from one transducer to the next, radians, positive counter-clockwise.
    pub bearing_step_rad: f64,
    /// Full aperture β of one transducer's cone, radians.
    pub aperture_rad: f64,
    /// Nearest range that the sensor can measure, metres.
    pub range_min_m: f64,
    /// The range to which it can see at all (r_cap), metres.
    pub range_max_m: f64,
    /// Range error η as a share of the range (1 % for the paper's sonars).
    pub range_error_ratio: f64,
}

/// The rectangle that the robot covers on the floor, centred on its base.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Footprint {
    /// Along x, metres.
    pub length_m: f64,
    /// Along y, metres.
    pub width_m: f64,
}

/// What the other processes need to know of a robot.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Robot {
    /// The name of the robot, for people.
    pub name: String,
    /// Zero where unknown.
    pub footprint: Footprint,
    /// All range sensors, in the order of their transducers.
    pub sensors: Vec<Sensor>,
}

/// One transducer of a robot, resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transducer {
    /// Sonar or lidar.
    pub kind: SensorKind,
    /// The frame of the transducer (x along the beam) seen from the robot's base.
    pub base_from_transducer: Pose2,
    /// Full aperture β, radians.
    pub aperture_rad: f64,
    /// Nearest measurable range, metres.
    pub range_min_m: f64,
    /// Farthest measurable range (r_cap), metres.
    pub range_max_m: f64,
    /// η, the range error as a share of the range.
    pub range_error_ratio: f64,
    /// Whether it is a beam of a lidar that leaves gaps to its neighbours: it is narrower than the step from one to the next.
    pub leaves_gaps: bool,
    /// Where it is among beams that stand side by side, if it is such a beam: it is as wide as the step then.
    pub fan: Option<Fan>,
}

/// A beam of a lidar whose beams stand side by side: beam n looks along the first one's axis + n × `step_rad`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fan {
    /// Beam 0 seen from the robot's base.
    pub base_from_first: Pose2,
    /// The angle from one beam to the next, radians, positive counter-clockwise.
    pub step_rad: f64,
    /// The number of the beam, from 0.
    pub beam: u16,
}

impl Fan {
    /// Whether `next` is a beam of the same lidar with a higher number.
    #[must_use]
    pub fn is_before(&self, next: &Self) -> bool {
        self.beam < next.beam && self.step_rad == next.step_rad && self.base_from_first == next.base_from_first
    }
}

/// What somebody rounded is no gap, and nothing that two beams share, as a share of the step.
const SLACK: f64 = 1e-3;

impl Sensor {
    /// Whether there is something between its beams that none of them sees. (A sonar's cone is wide, and the sonars overlap.)
    fn leaves_gaps(&self) -> bool {
        let step_rad = self.bearing_step_rad.abs();
        self.kind == SensorKind::Lidar && (self.transducers < 2 || self.aperture_rad < step_rad * (1.0 - SLACK))
    }
}

impl Sensor {
    /// Of beam `beam`, if its beams stand side by side.
    fn fan(&self, beam: u16) -> Option<Fan> {
        let step_rad = self.bearing_step_rad.abs();
        let is_one = self.kind == SensorKind::Lidar
            && self.transducers > 1
            && FAN_STEP_RAD.contains(&step_rad)
            && (self.aperture_rad - step_rad).abs() <= step_rad * SLACK;
        let base_from_first = self.base_from_sensor * Pose2::new(0.0, 0.0, self.first_bearing_rad);
        is_one.then_some(Fan { base_from_first, step_rad: self.bearing_step_rad, beam })
    }
}

impl Robot {
    /// Transducer `index`, or none if the robot has no such transducer.
    #[must_use]
    pub fn transducer(&self, index: u16) -> Option<Transducer> {
        let sensor = self.sensors.iter().find(|s| {
            index >= s.first_transducer && u32::from(index) < u32::from(s.first_transducer) + u32::from(s.transducers)
        })?;
        let beam = index - sensor.first_transducer;
        let bearing = sensor.first_bearing_rad + f64::from(beam) * sensor.bearing_step_rad;
        let fan = sensor.fan(beam);
        Some(Transducer {
            kind: sensor.kind,
            base_from_transducer: sensor.base_from_sensor * Pose2::new(0.0, 0.0, bearing),
            aperture_rad: fan.map_or(sensor.aperture_rad, |fan| fan.step_rad.abs()),
            range_min_m: sensor.range_min_m,
            range_max_m: sensor.range_max_m,
            range_error_ratio: sensor.range_error_ratio,
            leaves_gaps: sensor.leaves_gaps(),
            fan,
        })
    }

    /// How many transducers it has in all.
    #[must_use]
    pub fn transducer_count(&self) -> usize {
        self.sensors.iter().map(|s| usize::from(s.transducers)).sum()
    }
}
