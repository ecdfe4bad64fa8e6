//! Drives to measure on, and the robots that drive: rings of 16 sonars, and where they were heard; lidars.

use std::path::PathBuf;

use echogrid_core::{Echo, Pose2, Reading, Robot, Sensor, SensorKind};

pub(crate) const SONARS: usize = 16;
const NO_ECHO_M: f64 = 5.0;

/// x, y (metres) and bearing (degrees) of the sonars of a Pioneer 3-AT.
const PIONEER: [(f64, f64, f64); SONARS] = [
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

pub(crate) fn pioneer() -> Robot {
    let sensor = |(index, (x, y, degrees)): (usize, (f64, f64, f64))| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(x, y, degrees * core::f64::consts::PI / 180.0),
        first_transducer: index as u16,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: core::f64::consts::PI / 6.0,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: PIONEER.into_iter().enumerate().map(sensor).collect(), ..Robot::default() }
}

/// A lidar of so many beams side by side, all of which see `view_rad` together, ahead in the middle.
pub(crate) fn lidar(beams: u16, view_rad: f64) -> Robot {
    let step_rad = view_rad / f64::from(beams);
    let sensor = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: beams,
        first_bearing_rad: -0.5 * view_rad,
        bearing_step_rad: step_rad,
        aperture_rad: step_rad,
        range_min_m: 0.02,
        range_max_m: 20.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: vec![sensor], ..Robot::default() }
}

pub(crate) struct Ring {
    pub(crate) pose: Pose2,
    ranges_m: [f64; SONARS],
}

impl Ring {
    pub(crate) fn readings(&self) -> [Reading; SONARS] {
        core::array::from_fn(|sonar| {
            let range_m = self.ranges_m[sonar];
            let echo = if range_m < NO_ECHO_M { Echo::Hit { range_m } } else { Echo::NoEcho };
            Reading { transducer: sonar as u16, echo, offset_ns: 0 }
        })
    }
}

/// The numbers of a file of the workload, which lies in `$ECHOGRID_WORKLOAD`, `$ECHOGRID_DATA/workload` or beside the workspace.
///
/// # Errors
/// It is not there.
pub(crate) fn records(file: &str) -> Result<Vec<f64>, String> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let in_data = || std::env::var_os("ECHOGRID_DATA").map_or_else(beside, PathBuf::from).join("workload");
    let path = std::env::var_os("ECHOGRID_WORKLOAD").map_or_else(in_data, PathBuf::from).join(file);
    let bytes = std::fs::read(&path).map_err(|error| {
        format!("{}: {error}; ECHOGRID_DATA or ECHOGRID_WORKLOAD names another folder", path.display())
    })?;
    Ok(bytes.as_chunks().0.iter().map(|four| f64::from(f32::from_le_bytes(*four))).collect())
}

/// The rings of `workload_s.bin`.
///
/// # Errors
/// As [`records`].
pub(crate) fn recorded() -> Result<Vec<Ring>, String> {
    let ring = |record: &[f64]| Ring {
        pose: Pose2::new(record[0], record[1], record[2]),
        ranges_m: core::array::from_fn(|k| record[3 + k]),
    };
    Ok(records("workload_s.bin")?.chunks_exact(3 + SONARS).map(ring).collect())
}
