//! How many rings of 16 sonars are mapped per second (`items` of the table), with the paper's full model, with
//! `first_echo`, and with `first_echo` behind the filters that come by default.
//!
//! `synthetic_*`: a robot with the sonars of a Pioneer 3-AT on a drive through a hall, 85 % of the readings echoes, of
//! 2.78 m in the mean. `recorded_*`: the rings of `workload_s.bin` (little-endian f32: x, y, theta, 16 ranges, 5 m = no
//! echo), if there is `$ECHOGRID_DATA/workload_s.bin`, or the file beside the workspace.

#![allow(clippy::expect_used, clippy::print_stdout, reason = "a benchmark")]

use std::path::PathBuf;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use echogrid_core::config::{Fusion, Limit, Noise};
use echogrid_core::{
    Echo, Estimate, GridMapper, MapperConfig, OdometryErrors, Pose2, Reading, Robot, Sensor, SensorKind,
};

fn main() {
    divan::main();
}

const SONARS: usize = 16;
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

fn pioneer() -> Robot {
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

struct Ring {
    pose: Pose2,
    ranges_m: [f64; SONARS],
}

fn synthetic() -> Vec<Ring> {
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

fn recorded() -> Option<Vec<Ring>> {
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

/// A robot that knows where it is.
fn certain() -> OdometryErrors {
    OdometryErrors::default()
}

/// A robot 10 m and half a turn after its last fix.
fn doubtful() -> OdometryErrors {
    OdometryErrors { eps_lin_m2: 4e-3, eps_ang_rad2: 3e-3, ..OdometryErrors::default() }
}

/// What is measured.
#[derive(Clone, Copy)]
struct Work {
    fusion: Fusion,
    errors: OdometryErrors,
    /// Whether all filters judge each ring.
    filtered: bool,
}

fn paper(errors: OdometryErrors) -> Work {
    Work { fusion: Fusion::Paper, errors, filtered: false }
}

fn first_echo(filtered: bool) -> Work {
    Work { fusion: Fusion::FirstEcho, errors: certain(), filtered }
}

fn map(bencher: Bencher<'_, '_>, rings: Option<&[Ring]>, work: Work) {
    let Some(rings) = rings else {
        println!("no workload_s.bin");
        return;
    };
    let Work { fusion, errors, filtered } = work;
    // The peers map up to the 5 m that the sonars see.
    let config = MapperConfig { fusion, max_range_m: Limit::Metres(4.999), min_trust: 0.0, ..MapperConfig::default() };
    let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, pioneer()).expect("valid");
    let mut sequence = 0;
    bencher.counter(ItemsCount::new(rings.len())).bench_local(|| {
        for ring in rings {
            let estimate = Estimate { errors, ..Estimate::certain(ring.pose) };
            sequence += 1;
            let reading = |(transducer, range_m): (usize, f64)| {
                let echo = if range_m < NO_ECHO_M { Echo::Hit { range_m } } else { Echo::NoEcho };
                (Reading { transducer: transducer as u16, echo, offset_ns: 0 }, Some(estimate))
            };
            let scan: [_; SONARS] = core::array::from_fn(|sonar| reading((sonar, ring.ranges_m[sonar])));
            if filtered {
                black_box(mapper.integrate_scan(sequence, &scan));
            } else {
                for (reading, estimate) in &scan {
                    black_box(mapper.integrate(sequence, reading, estimate.as_ref()));
                }
            }
        }
        mapper.take_dirty()
    });
}

#[divan::bench(sample_count = 20)]
fn synthetic_certain(bencher: Bencher<'_, '_>) {
    map(bencher, Some(&synthetic()), paper(certain()));
}

#[divan::bench(sample_count = 20)]
fn synthetic_doubtful(bencher: Bencher<'_, '_>) {
    map(bencher, Some(&synthetic()), paper(doubtful()));
}

#[divan::bench(sample_count = 5)]
fn recorded_certain(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), paper(certain()));
}

#[divan::bench(sample_count = 5)]
fn recorded_doubtful(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), paper(doubtful()));
}

#[divan::bench(sample_count = 5)]
fn recorded_first_echo(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), first_echo(false));
}

#[divan::bench(sample_count = 5)]
fn recorded_first_echo_filtered(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), first_echo(true));
}
