//! Which of a log's scan messages are used, and the sensors they stand for.

use std::collections::BTreeMap;

use echogrid_core::{Footprint, Pose2, Robot, Sensor, SensorKind};

use super::ceiling::RangeTally;
use super::message::{Carried, ScanKind, ScanLine, Shape};

/// Readings nearer than this are the robot itself or a fault, metres.
const LIDAR_MIN_M: f64 = 0.02;
/// Nearest range of an ultrasonic ranger, metres.
const SONAR_MIN_M: f64 = 0.1;
const LIDAR_ERROR_RATIO: f64 = 0.002;
const SONAR_ERROR_RATIO: f64 = 0.01;
/// Aperture of a lidar of one beam, whose step says nothing: 1°.
const LONE_BEAM_RAD: f64 = core::f64::consts::PI / 180.0;
/// Mount poses and bearings further apart than this are not the same sensor's.
const SAME_GEOMETRY: f64 = 2e-3;
/// A mount pose is taken from the poses in the messages if they agree to this, metres and radians.
const SAME_MOUNT: f64 = 0.01;
/// A sensor sits no farther than this from the robot's base, metres.
const MOUNT_MAX_M: f64 = 3.0;

/// The geometry of a sensor: what every line of its kind must have.
#[derive(Debug, Clone)]
pub(crate) struct Geometry {
    shape: Shape,
    /// Readings in a line.
    pub(crate) readings: usize,
}

impl Geometry {
    /// Whether a line has this geometry.
    pub(crate) fn fits(&self, scan: &ScanLine) -> bool {
        if self.readings != scan.ranges.len() {
            return false;
        }
        match (&self.shape, &scan.shape) {
            (
                Shape::Fan { first_bearing_rad: a, bearing_step_rad: step_a, .. },
                Shape::Fan { first_bearing_rad: b, bearing_step_rad: step_b, .. },
            ) => (a - b).abs() < SAME_GEOMETRY && ((step_a - step_b) * self.readings as f64).abs() < SAME_GEOMETRY,
            (
                Shape::Ring { aperture_rad: a, base_from_sonar: mounts_a },
                Shape::Ring { aperture_rad: b, base_from_sonar: mounts_b },
            ) => {
                (a - b).abs() < SAME_GEOMETRY && mounts_a.iter().zip(mounts_b).all(|(a, b)| near(*a, *b, SAME_GEOMETRY))
            }
            _ => false,
        }
    }
}

/// One kind of scan message, as the survey comes to know it.
#[derive(Debug)]
pub(crate) struct KindRecord {
    pub(crate) geometry: Geometry,
    pub(crate) lines: u64,
    /// Place among the lines of the file.
    first_line: u64,
    tally: RangeTally,
    mount: Mount,
}

/// Where the messages' poses say the sensor sits.
#[derive(Debug, Clone, Copy)]
enum Mount {
    Unsaid,
    Agreed(Pose2),
    Contradictory,
}

impl KindRecord {
    pub(crate) fn new(scan: &ScanLine, line: u64) -> Self {
        Self {
            geometry: Geometry { shape: scan.shape.clone(), readings: scan.ranges.len() },
            lines: 0,
            first_line: line,
            tally: RangeTally::default(),
            mount: Mount::Unsaid,
        }
    }

    /// Takes note of a line of this kind. Its geometry has been checked.
    pub(crate) fn add(&mut self, scan: &ScanLine) {
        self.lines += 1;
        for range in scan.ranges.iter().filter(|range| super::is_sane(**range) && **range > 0.0) {
            self.tally.add(*range);
        }
        if let Some(Carried { odom_from_base, odom_from_sensor: Some(odom_from_sensor), .. }) = scan.carried {
            let base_from_sensor = odom_from_base.inverse() * odom_from_sensor;
            self.mount = match self.mount {
                Mount::Unsaid => Mount::Agreed(base_from_sensor),
                Mount::Agreed(first) if near(first, base_from_sensor, SAME_MOUNT) => Mount::Agreed(first),
                Mount::Agreed(_) | Mount::Contradictory => Mount::Contradictory,
            };
        }
    }
}

/// A kind of scan message that is used.
#[derive(Debug, Clone)]
pub(crate) struct UsedKind {
    /// The transducer of its first reading.
    pub(crate) first_transducer: u16,
    pub(crate) range_min_m: f64,
    /// Readings from here on are no echo.
    pub(crate) ceiling_m: f64,
    /// When each reading was taken, nanoseconds after the stamp; shorter than the readings: with it.
    pub(crate) offsets_ns: Vec<i32>,
}

/// How the lines of a log become events.
#[derive(Debug, Clone, Default)]
pub(crate) struct CarmenPlan {
    /// Of every kind, used or not.
    pub(crate) geometries: BTreeMap<ScanKind, Geometry>,
    pub(crate) used: BTreeMap<ScanKind, UsedKind>,
    /// The scan messages whose pose is the odometry; none if there are `ODOM` lines.
    pub(crate) odometry_from: Option<ScanKind>,
}

fn near(a: Pose2, b: Pose2, tolerance: f64) -> bool {
    a.distance_m(b) < tolerance && echogrid_core::wrap_angle(a.theta - b.theta).abs() < tolerance
}

/// The kinds that are used. Loggers write one scan under several names (`FLASER`, `ROBOTLASER1`
/// and `RAWLASER1` are the front laser, `RLASER`, `ROBOTLASER2` and `RAWLASER2` the rear one): of
/// each group the name with most lines is used, the others repeat it.
pub(crate) fn kinds_in_use(records: &BTreeMap<ScanKind, KindRecord>) -> Vec<ScanKind> {
    let mut best: BTreeMap<(bool, u8), (u64, ScanKind)> = BTreeMap::new();
    for (kind, record) in records {
        let group = match kind {
            ScanKind::Sonar => (true, 0),
            ScanKind::Front => (false, 1),
            ScanKind::Rear => (false, 2),
            ScanKind::Robot(number) | ScanKind::Raw(number) => (false, *number),
        };
        let entry = best.entry(group).or_insert((0, *kind));
        // At equal numbers the first in the order of `ScanKind` stays.
        if record.lines > entry.0 {
            *entry = (record.lines, *kind);
        }
    }
    let mut kinds: Vec<_> = best.into_values().map(|(_, kind)| kind).collect();
    kinds.sort_by_key(|kind| records.get(kind).map(|record| record.first_line));
    kinds
}

/// The robot, and how its readings are numbered; an error is the number of transducers that is too many.
pub(crate) fn robot_and_plan(
    records: &BTreeMap<ScanKind, KindRecord>,
    kinds: &[ScanKind],
    params: &BTreeMap<String, String>,
) -> Result<(Robot, BTreeMap<ScanKind, UsedKind>), u64> {
    let number = |name: &str| -> Option<f64> { params.get(name)?.split_ascii_whitespace().next()?.parse().ok() };
    let length = |name: &str| number(name).filter(|metres| (0.0..100.0).contains(metres)).unwrap_or(0.0);
    let mut robot = Robot {
        name: "robot of a CARMEN log".into(),
        footprint: Footprint { length_m: length("robot_length"), width_m: length("robot_width") },
        sensors: Vec::new(),
    };
    let total: u64 = kinds.iter().filter_map(|kind| records.get(kind)).map(|r| r.geometry.readings as u64).sum();
    let mut used = BTreeMap::new();
    let mut next = 0_usize;
    for kind in kinds {
        let Some(record) = records.get(kind) else { continue };
        let first_transducer = u16::try_from(next).map_err(|_| total)?;
        next += record.geometry.readings;
        u16::try_from(next).map_err(|_| total)?;
        let stated = match &record.geometry.shape {
            Shape::Fan { range_max_m: Some(max), .. } => Some(*max),
            _ => number(match kind {
                ScanKind::Front => "robot_front_laser_max",
                ScanKind::Rear => "robot_rear_laser_max",
                _ => super::SONAR_MAX_PARAM,
            }),
        };
        let (range_max_m, ceiling_m) = match (kind, stated) {
            // A log written by echogrid: its sonars hear up to the maximum, and that too.
            (ScanKind::Sonar, Some(max)) if max.is_finite() && max > 0.0 => (max, max.next_up()),
            _ => {
                let ceiling_m = record.tally.ceiling_m(stated);
                (ceiling_m, ceiling_m)
            }
        };
        let range_min_m = sensors(&mut robot.sensors, *kind, record, first_transducer, range_max_m, &number);
        let offsets = params.get(super::SONAR_OFFSETS_PARAM).filter(|_| *kind == ScanKind::Sonar);
        let offsets_ns = offsets.and_then(|all| all.split(',').map(|one| one.trim().parse().ok()).collect());
        let offsets_ns = offsets_ns.unwrap_or_default();
        used.insert(*kind, UsedKind { first_transducer, range_min_m, ceiling_m, offsets_ns });
    }
    Ok((robot, used))
}

/// Adds the sensors of one kind of message; their nearest range.
fn sensors(
    sensors: &mut Vec<Sensor>,
    kind: ScanKind,
    record: &KindRecord,
    first_transducer: u16,
    range_max_m: f64,
    number: &dyn Fn(&str) -> Option<f64>,
) -> f64 {
    match &record.geometry.shape {
        Shape::Fan { first_bearing_rad, bearing_step_rad, .. } => {
            let aperture_rad = if *bearing_step_rad == 0.0 { LONE_BEAM_RAD } else { bearing_step_rad.abs() };
            let range_min_m = LIDAR_MIN_M.min(range_max_m / 2.0);
            sensors.push(Sensor {
                kind: SensorKind::Lidar,
                base_from_sensor: laser_mount(kind, record.mount, number),
                first_transducer,
                // Checked by the caller: all transducers together can be numbered.
                transducers: u16::try_from(record.geometry.readings).unwrap_or(u16::MAX),
                first_bearing_rad: *first_bearing_rad,
                bearing_step_rad: *bearing_step_rad,
                aperture_rad,
                range_min_m,
                range_max_m,
                range_error_ratio: LIDAR_ERROR_RATIO,
            });
            range_min_m
        }
        Shape::Ring { aperture_rad, base_from_sonar } => {
            let range_min_m = SONAR_MIN_M.min(range_max_m / 2.0);
            sensors.extend(base_from_sonar.iter().zip(first_transducer..).map(|(mount, first_transducer)| Sensor {
                kind: SensorKind::Sonar,
                base_from_sensor: *mount,
                first_transducer,
                transducers: 1,
                first_bearing_rad: 0.0,
                bearing_step_rad: 0.0,
                aperture_rad: aperture_rad.abs(),
                range_min_m,
                range_max_m,
                range_error_ratio: SONAR_ERROR_RATIO,
            }));
            range_min_m
        }
    }
}

/// Where a laser sits: the log's parameter says it, else the laser and robot poses of the
/// messages if they agree, else it sits on the base. A rear laser looks backwards.
fn laser_mount(kind: ScanKind, mount: Mount, number: &dyn Fn(&str) -> Option<f64>) -> Pose2 {
    let (param, facing) = match kind {
        ScanKind::Front | ScanKind::Robot(1) | ScanKind::Raw(1) => (Some("robot_frontlaser_offset"), 0.0),
        ScanKind::Rear | ScanKind::Robot(2) | ScanKind::Raw(2) => {
            (Some("robot_rearlaser_offset"), core::f64::consts::PI)
        }
        _ => (None, 0.0),
    };
    let stated = param.and_then(number).filter(|offset| offset.abs() < MOUNT_MAX_M);
    let seen = match mount {
        // Equal poses say nothing: corrected logs write the same pose twice.
        Mount::Agreed(pose) if pose.distance_m(Pose2::IDENTITY) < MOUNT_MAX_M && !near(pose, Pose2::IDENTITY, 1e-6) => {
            Some(pose)
        }
        _ => None,
    };
    match (kind, stated, seen) {
        (ScanKind::Robot(_), _, Some(pose)) => pose,
        (_, Some(offset), _) => Pose2::new(offset, 0.0, facing),
        // Only the position: the heading in FLASER and RLASER lines is the robot's.
        (_, None, Some(pose)) => Pose2::new(pose.x, pose.y, facing),
        (_, None, None) => Pose2::new(0.0, 0.0, facing),
    }
}
