//! A scan as points with normals, in the frame of the robot's base.

use echogrid_core::{Echo, Pose2, Reading, Robot, SensorKind};
use serde::{Deserialize, Serialize};

/// Farther than this nothing is matched: beams lie too wide apart there, metres.
const RANGE_MAX_M: f64 = 40.0;
/// Nearer than this a lidar sees the robot itself, metres.
const RANGE_MIN_M: f64 = 0.05;
/// Neighbours on each side that tell how a surface lies: as many as span these radians.
const SPAN_RAD: f64 = 0.06;
/// Two neighbours that are farther apart than this do not lie on one surface, metres; at range r, 2.5 times r Δφ.
const GAP_M: f64 = 0.10;
/// How far points of one surface lie off its line at most, metres, one standard deviation.
const FLAT_M: f64 = 0.03;
/// A surface is longer than it is thick by this ratio of variances.
const LONG: f64 = 4.0;

/// Points that a lidar saw, and how the surface lies on which each of them is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Points {
    /// In order of the beams, metres. (Single precision is exact enough, and half as large.)
    at: Vec<[f32; 2]>,
    /// Of each: the normal of its surface, of length 1, towards the sensor; zero where there is no telling.
    normals: Vec<[f32; 2]>,
}

impl Points {
    /// The points of a scan of the lidars of `robot`. `moved` says where the base was, seen from where it was at the stamp of the
    /// scan, when a reading was taken so many nanoseconds later.
    #[must_use]
    pub fn of(robot: &Robot, readings: &[Reading], moved: impl Fn(i32) -> Pose2) -> Self {
        let mut points = Self::default();
        for sensor in robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Lidar) {
            let beams: Vec<Beam> = readings
                .iter()
                .filter_map(|reading| {
                    let number = reading.transducer.checked_sub(sensor.first_transducer)?;
                    let Echo::Hit { range_m } = reading.echo else { return None };
                    let counts = number < sensor.transducers
                        && range_m >= sensor.range_min_m.max(RANGE_MIN_M)
                        && range_m < sensor.range_max_m.min(RANGE_MAX_M);
                    let base = || if reading.offset_ns == 0 { Pose2::IDENTITY } else { moved(reading.offset_ns) };
                    counts.then(|| {
                        let sensor_now = base() * sensor.base_from_sensor;
                        let bearing = sensor.first_bearing_rad + f64::from(number) * sensor.bearing_step_rad;
                        let (s, c) = libm::sincos(bearing);
                        let at = sensor_now.transform([range_m * c, range_m * s]);
                        Beam { number: i32::from(number), range_m, at, eye: [sensor_now.x, sensor_now.y] }
                    })
                })
                .collect();
            let step_rad = sensor.bearing_step_rad.abs();
            for index in 0..beams.len() {
                points.push(beams[index].at, normal(&beams, index, step_rad));
            }
        }
        points
    }

    /// Adds a point with its normal.
    pub fn push(&mut self, at: [f64; 2], normal: [f64; 2]) {
        self.at.push(at.map(|value| value as f32));
        self.normals.push(normal.map(|value| value as f32));
    }

    /// Each point with its normal.
    pub fn iter(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        self.at.iter().zip(&self.normals).map(|(at, normal)| (at.map(f64::from), normal.map(f64::from)))
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }
}

struct Beam {
    number: i32,
    range_m: f64,
    at: [f64; 2],
    eye: [f64; 2],
}

/// Of the surface on which the point of beam `index` lies, by the points of its neighbours.
fn normal(beams: &[Beam], index: usize, step_rad: f64) -> [f64; 2] {
    let beam = &beams[index];
    let gap_m = (2.5 * beam.range_m * step_rad).max(GAP_M);
    // Not fewer than four each way, for the coarsest lidars.
    let reach = ((SPAN_RAD / step_rad.max(1e-4)) as i32).clamp(4, 24);
    let (mut count, mut sums) = (1.0, [beam.at[0], beam.at[1]]);
    let mut near = vec![beam.at];
    let mut grow = |neighbours: &mut dyn Iterator<Item = &Beam>| {
        let mut last = beam.at;
        for next in neighbours {
            let apart = libm::hypot(next.at[0] - last[0], next.at[1] - last[1]);
            if (next.number - beam.number).abs() > reach || apart > gap_m {
                break;
            }
            count += 1.0;
            sums = [sums[0] + next.at[0], sums[1] + next.at[1]];
            near.push(next.at);
            last = next.at;
        }
    };
    grow(&mut beams[index + 1..].iter());
    grow(&mut beams[..index].iter().rev());
    if near.len() < 4 {
        return [0.0; 2];
    }
    let mean = [sums[0] / count, sums[1] / count];
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for at in &near {
        let (x, y) = (at[0] - mean[0], at[1] - mean[1]);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let (xx, xy, yy) = (xx / count, xy / count, yy / count);
    let root = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
    let (thick, long) = ((xx + yy - root) / 2.0, (xx + yy + root) / 2.0);
    if thick > FLAT_M * FLAT_M || long < LONG * thick {
        return [0.0; 2];
    }
    let (s, c) = libm::sincos(0.5 * libm::atan2(2.0 * xy, xx - yy));
    let towards = -s * (beam.eye[0] - beam.at[0]) + c * (beam.eye[1] - beam.at[1]);
    if towards > 0.0 { [-s, c] } else { [s, -c] }
}
