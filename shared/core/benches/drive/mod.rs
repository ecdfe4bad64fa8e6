//! Drives to measure on: rings of 16 sonars, and where they were heard.

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

pub(crate) fn synthetic() -> Vec<Ring> {
    // A small congruential generator: the same rings everywhere.
    let mut state = 1u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / 9_007_199_254_740_992.0
    };
    let ring = |k: u32| {
        // A loop of 16 m by 8 m, 5 cm per ring, the heading swaying.
        let way = f64::from(k) * 0.05 / 6.0;
        let (s, c) = libm::sincos(way);
        let mut range = || if uniform() < 0.85 { 0.7 + 4.16 * uniform() } else { NO_ECHO_M };
        Ring { pose: Pose2::new(8.0 * c, 4.0 * s, way + 1.5), ranges_m: core::array::from_fn(|_| range()) }
    };
    (0..2000).map(ring).collect()
}

pub(crate) fn recorded() -> Option<Vec<Ring>> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/workload");
    let folder = std::env::var_os("ECHOGRID_DATA").map_or_else(beside, PathBuf::from);
    let bytes = std::fs::read(folder.join("workload_s.bin")).ok()?;
    let numbers: Vec<f64> =
        bytes.chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().expect("four bytes")))).collect();
    let ring = |record: &[f64]| Ring {
        pose: Pose2::new(record[0], record[1], record[2]),
        ranges_m: core::array::from_fn(|k| record[3 + k]),
    };
    Some(numbers.chunks_exact(3 + SONARS).map(ring).collect())
}
