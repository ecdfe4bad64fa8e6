//! The sonar pair of Udacity's RoboND occupancy grid course.
//!
//! `measurement.txt` holds rows `t r1 … r8` (ms, mm), `poses.txt` rows `t x y theta10` (ms, mm,
//! tenths of a degree). The eight sonars look to −90, −37.5, −22.5, −7.5, 7.5, 22.5, 37.5 and 90
//! degrees and see cones of 20 degrees; where they sit on the robot is not known, so they sit on
//! its base. Ranges from 170 to 5000 mm are echoes, larger ones no echo, smaller ones invalid.

mod read;
mod rows;
mod survey;

use echogrid_core::{Pose2, Robot, Sensor, SensorKind};
pub use read::read;
pub use survey::survey;

/// Sonars in a row.
const SONARS: usize = 8;
/// Where they look, degrees counter-clockwise from straight ahead.
const BEARINGS_DEG: [f64; SONARS] = [-90.0, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 90.0];
const APERTURE_DEG: f64 = 20.0;
/// Valid ranges, millimetres.
const RANGE_MIN_MM: i64 = 170;
const RANGE_MAX_MM: i64 = 5000;

fn robot() -> Robot {
    Robot {
        name: "Udacity sonar robot".into(),
        sensors: (0..)
            .zip(BEARINGS_DEG)
            .map(|(first_transducer, bearing_deg)| Sensor {
                kind: SensorKind::Sonar,
                base_from_sensor: Pose2::new(0.0, 0.0, bearing_deg.to_radians()),
                first_transducer,
                transducers: 1,
                first_bearing_rad: 0.0,
                bearing_step_rad: 0.0,
                aperture_rad: APERTURE_DEG.to_radians(),
                range_min_m: RANGE_MIN_MM as f64 / 1000.0,
                range_max_m: RANGE_MAX_MM as f64 / 1000.0,
                range_error_ratio: 0.01,
            })
            .collect(),
        ..Robot::default()
    }
}
