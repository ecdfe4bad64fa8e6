//! The robot: its sensors and its footprint.

use echogrid_core::{Footprint, Robot, Sensor, SensorKind};
use serde_json::{Value, json};

use super::checks::{Fault, at_least_zero, check, finite, pose};
use super::range::RANGE_LIMIT_M;
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, bytes_to_text, text_to_bytes, wire};

/// Sensors that a robot description can hold.
pub const MAX_SENSORS: usize = 256;
// A description of every robot that there can be fits.
const _: () = assert!(MAX_SENSORS == echogrid_core::robot::SENSORS_MAX);

impl Content for Robot {
    const TOPIC: Topic = Topic::RobotDescription;
    type Payload = RobotWire;

    fn qos(_: usize) -> Qos {
        Qos::LATEST
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

wire! {
    /// A range sensor of the robot.
    "echogrid/Sensor/1" SensorWire {
        /// 1 sonar, 2 lidar.
        kind: u32,
        /// Index of its first transducer.
        first_transducer: u16,
        /// How many transducers.
        transducers: u16,
        /// Mount in the robot's base frame (x forward, y left), metres.
        x_m: f64,
        /// Metres.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Bearing of the first transducer, radians.
        first_bearing_rad: f64,
        /// From one transducer to the next, radians.
        bearing_step_rad: f64,
        /// Full aperture of one transducer's cone, radians.
        aperture_rad: f64,
        /// Nearest measurable range, metres.
        range_min_m: f64,
        /// Range to which it can see at all, metres.
        range_max_m: f64,
        /// Range error as a share of the range.
        range_error_ratio: f64,
    }
}

wire! {
    /// `robot/description`: the sensors and the footprint.
    "echogrid/RobotDescription/2" RobotWire {
        /// UTF-8, padded with zeros.
        name: [u8; 64],
        /// Along x, metres; 0 unknown.
        footprint_length_m: f64,
        /// Along y, metres; 0 unknown.
        footprint_width_m: f64,
        /// How many of `sensors` are in use.
        sensor_count: u32,
        /// Zero.
        reserved: u32,
        /// The sensors in the order of their transducers.
        sensors: [SensorWire; 256],
    }
}

/// A description that has more sensors than fit is cut; see [`MAX_SENSORS`].
impl From<&Robot> for RobotWire {
    fn from(robot: &Robot) -> Self {
        let mut wire = Self {
            name: text_to_bytes(&robot.name),
            footprint_length_m: robot.footprint.length_m,
            footprint_width_m: robot.footprint.width_m,
            sensor_count: robot.sensors.len().min(MAX_SENSORS) as u32,
            ..Self::default()
        };
        for (slot, sensor) in wire.sensors.iter_mut().zip(&robot.sensors) {
            *slot = SensorWire {
                kind: match sensor.kind {
                    SensorKind::Sonar => 1,
                    SensorKind::Lidar => 2,
                },
                first_transducer: sensor.first_transducer,
                transducers: sensor.transducers,
                x_m: sensor.base_from_sensor.x,
                y_m: sensor.base_from_sensor.y,
                theta_rad: sensor.base_from_sensor.theta,
                first_bearing_rad: sensor.first_bearing_rad,
                bearing_step_rad: sensor.bearing_step_rad,
                aperture_rad: sensor.aperture_rad,
                range_min_m: sensor.range_min_m,
                range_max_m: sensor.range_max_m,
                range_error_ratio: sensor.range_error_ratio,
            };
        }
        wire
    }
}

impl TryFrom<&RobotWire> for Robot {
    type Error = Fault;

    fn try_from(wire: &RobotWire) -> Result<Self, Fault> {
        check(wire.sensor_count as usize <= MAX_SENSORS, "sensor_count", wire.sensor_count, "at most 256")?;
        let sensors = wire.sensors[..wire.sensor_count as usize]
            .iter()
            .map(|s| {
                let tau = core::f64::consts::TAU;
                check(s.aperture_rad > 0.0 && s.aperture_rad <= tau, "aperture_rad", s.aperture_rad, "in (0, 2π]")?;
                let limits = s.range_min_m >= 0.0 && s.range_max_m > s.range_min_m && s.range_max_m <= RANGE_LIMIT_M;
                check(limits, "range_max_m", s.range_max_m, "0 <= range_min_m < range_max_m <= 1e5")?;
                Ok(Sensor {
                    kind: match s.kind {
                        1 => SensorKind::Sonar,
                        2 => SensorKind::Lidar,
                        other => {
                            return Err(Fault {
                                field: "kind",
                                value: other.to_string(),
                                expected: "1 sonar or 2 lidar",
                            });
                        }
                    },
                    base_from_sensor: pose(s.x_m, s.y_m, s.theta_rad)?,
                    first_transducer: s.first_transducer,
                    transducers: s.transducers,
                    first_bearing_rad: finite("first_bearing_rad", s.first_bearing_rad)?,
                    bearing_step_rad: finite("bearing_step_rad", s.bearing_step_rad)?,
                    aperture_rad: s.aperture_rad,
                    range_min_m: s.range_min_m,
                    range_max_m: s.range_max_m,
                    range_error_ratio: at_least_zero("range_error_ratio", s.range_error_ratio)?,
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            name: bytes_to_text(&wire.name),
            footprint: Footprint {
                length_m: at_least_zero("footprint_length_m", wire.footprint_length_m)?,
                width_m: at_least_zero("footprint_width_m", wire.footprint_width_m)?,
            },
            sensors,
        })
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use echogrid_core::Pose2;
    use proptest::prelude::*;

    use super::super::testing::{amount, any_bytes, number, pose, refused, sent, survives};
    use super::*;

    fn sensor() -> impl Strategy<Value = Sensor> {
        let kind = prop_oneof![Just(SensorKind::Sonar), Just(SensorKind::Lidar)];
        let bearings = (number(), number(), 1e-6..=TAU);
        (kind, pose(), any::<(u16, u16)>(), bearings, 0.0..10.0, 10.1..=1e5, amount()).prop_map(
            |(kind, base_from_sensor, (first_transducer, transducers), bearings, range_min_m, range_max_m, ratio)| {
                let (first_bearing_rad, bearing_step_rad, aperture_rad) = bearings;
                Sensor {
                    kind,
                    base_from_sensor,
                    first_transducer,
                    transducers,
                    first_bearing_rad,
                    bearing_step_rad,
                    aperture_rad,
                    range_min_m,
                    range_max_m,
                    range_error_ratio: ratio,
                }
            },
        )
    }

    fn robot() -> impl Strategy<Value = Robot> {
        let sensors = prop::collection::vec(sensor(), 0..=MAX_SENSORS);
        ("[a-zäß ]{0,32}", amount(), amount(), sensors).prop_map(|(name, length_m, width_m, sensors)| Robot {
            name,
            footprint: Footprint { length_m, width_m },
            sensors,
        })
    }

    proptest! {
        #[test]
        fn what_is_sent_arrives(robot in robot()) {
            prop_assert_eq!(sent::<RobotWire, _>(&robot), robot);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<RobotWire, Robot>(&bytes);
        }
    }

    fn good_robot() -> RobotWire {
        let sensor = Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::IDENTITY,
            first_transducer: 0,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        (&Robot { name: "r".into(), footprint: Footprint::default(), sensors: vec![sensor] }).into()
    }

    #[test]
    fn robots_that_cannot_be() {
        let check = |field, spoil: fn(&mut RobotWire)| refused::<_, Robot>(good_robot(), field, spoil);
        assert!(Robot::try_from(&good_robot()).is_ok());
        check("sensor_count", |w| w.sensor_count = 257);
        check("sensor_count", |w| w.sensor_count = u32::MAX);
        check("kind", |w| w.sensors[0].kind = 7);
        check("kind", |w| w.sensors[0].kind = 0);
        check("x_m", |w| w.sensors[0].x_m = f64::NAN);
        check("y_m", |w| w.sensors[0].y_m = -3.1e7);
        check("theta_rad", |w| w.sensors[0].theta_rad = f64::INFINITY);
        check("first_bearing_rad", |w| w.sensors[0].first_bearing_rad = f64::NAN);
        check("bearing_step_rad", |w| w.sensors[0].bearing_step_rad = f64::NEG_INFINITY);
        check("aperture_rad", |w| w.sensors[0].aperture_rad = 0.0);
        check("aperture_rad", |w| w.sensors[0].aperture_rad = 6.3);
        check("aperture_rad", |w| w.sensors[0].aperture_rad = f64::NAN);
        check("range_max_m", |w| w.sensors[0].range_max_m = 0.1);
        check("range_max_m", |w| w.sensors[0].range_max_m = 1e6);
        check("range_max_m", |w| w.sensors[0].range_max_m = f64::NAN);
        check("range_max_m", |w| w.sensors[0].range_min_m = -0.1);
        check("range_error_ratio", |w| w.sensors[0].range_error_ratio = -0.01);
        check("footprint_length_m", |w| w.footprint_length_m = f64::NAN);
        check("footprint_width_m", |w| w.footprint_width_m = -1.0);
    }
}
