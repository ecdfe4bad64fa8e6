//! The messages of a sensor as they lie in echogrid's shared memory: packed, little-endian, as `docs/topics.md` says.

use echogrid_core::robot::SENSORS_MAX;
use echogrid_core::{Echo, Footprint, POSITION_MAX_M, Pose2, Reading, Robot, Sensor, SensorKind};

use super::super::container::{Bytes, Channel};

/// A topic, and the type of its messages.
type Known = (&'static str, &'static str);
pub(super) const ROBOT: Known = ("robot/description", "echogrid/RobotDescription/2");
pub(super) const ODOMETRY: Known = ("odometry/raw", "echogrid/OdometryRaw/1");
pub(super) const SCAN: Known = ("range/scan", "echogrid/RangeReading/1");
pub(super) const TRUTH: Known = ("truth/pose", "echogrid/TruePose/1");
/// Without these there is no map.
pub(super) const NEEDED: [Known; 3] = [ROBOT, ODOMETRY, SCAN];

/// Beyond this a range is a fault, metres.
const RANGE_MAX_M: f64 = 1e5;
/// Beyond this an angle is.
const ANGLE_MAX_RAD: f64 = 1e6;
const NAME_BYTES: usize = 64;
const SENSOR_BYTES: usize = 80;

/// What a message of a sensor says.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Native {
    Robot(Robot),
    Odometry { odom_from_base: Pose2, v_mps: f64, w_radps: f64 },
    Scan(Vec<Reading>),
    TruePose(Option<Pose2>),
}

/// What a message says, or why it can't; none: it is none of a sensor.
pub(super) fn decode(channel: &Channel, data: &[u8]) -> Option<Result<Native, &'static str>> {
    let bytes = Bytes(data);
    let known = (channel.topic.as_str(), channel.datatype.as_str());
    Some(if known == ROBOT {
        robot(bytes).map(Native::Robot)
    } else if known == ODOMETRY {
        odometry(bytes)
    } else if known == SCAN {
        scan(bytes).map(Native::Scan)
    } else if known == TRUTH {
        true_pose(bytes).map(Native::TruePose)
    } else {
        return None;
    })
}

const SHORT: &str = "too few bytes";

fn f64_of(bytes: &mut Bytes<'_>) -> Result<f64, &'static str> {
    bytes.u64().map(f64::from_bits).ok_or(SHORT)
}

fn finite(bytes: &mut Bytes<'_>) -> Result<f64, &'static str> {
    f64_of(bytes).and_then(|value| if value.is_finite() { Ok(value) } else { Err("a number that is not finite") })
}

fn pose(bytes: &mut Bytes<'_>) -> Result<Pose2, &'static str> {
    let (x, y, theta) = (finite(bytes)?, finite(bytes)?, finite(bytes)?);
    let can_be = x.abs() <= POSITION_MAX_M && y.abs() <= POSITION_MAX_M && theta.abs() <= ANGLE_MAX_RAD;
    if can_be { Ok(Pose2::new(x, y, theta)) } else { Err("a pose that can't be") }
}

fn odometry(mut bytes: Bytes<'_>) -> Result<Native, &'static str> {
    let odom_from_base = pose(&mut bytes)?;
    Ok(Native::Odometry { odom_from_base, v_mps: finite(&mut bytes)?, w_radps: finite(&mut bytes)? })
}

fn true_pose(mut bytes: Bytes<'_>) -> Result<Option<Pose2>, &'static str> {
    let mut known = Bytes(bytes.0.get(24..).ok_or(SHORT)?);
    if known.u32().ok_or(SHORT)? == 0 { Ok(None) } else { pose(&mut bytes).map(Some) }
}

fn scan(mut bytes: Bytes<'_>) -> Result<Vec<Reading>, &'static str> {
    let mut readings = Vec::with_capacity(bytes.0.len() / 16);
    while !bytes.0.is_empty() {
        let range_m = f64_of(&mut bytes)?;
        let (offset, transducer) = (bytes.u32().ok_or(SHORT)?, bytes.u16().ok_or(SHORT)?);
        let (echo, _reserved) = (bytes.u8().ok_or(SHORT)?, bytes.u8().ok_or(SHORT)?);
        let echo = match echo {
            0 if range_m > 0.0 && range_m <= RANGE_MAX_M => Echo::Hit { range_m },
            1 => Echo::NoEcho,
            _ => Echo::Invalid,
        };
        readings.push(Reading { transducer, echo, offset_ns: offset.cast_signed() });
    }
    Ok(readings)
}

fn robot(mut bytes: Bytes<'_>) -> Result<Robot, &'static str> {
    let name = bytes.take(NAME_BYTES).ok_or(SHORT)?;
    let end = name.iter().position(|byte| *byte == 0).unwrap_or(name.len());
    let name = String::from_utf8_lossy(name.get(..end).unwrap_or(name)).into_owned();
    let footprint = Footprint { length_m: finite(&mut bytes)?, width_m: finite(&mut bytes)? };
    if footprint.length_m < 0.0 || footprint.width_m < 0.0 {
        return Err("a footprint that can't be");
    }
    let (count, _reserved) = (bytes.u32().ok_or(SHORT)?, bytes.u32().ok_or(SHORT)?);
    let count = usize::try_from(count).ok().filter(|count| *count <= SENSORS_MAX).ok_or("more than 256 sensors")?;
    let one = |bytes: &mut Bytes<'_>| bytes.take(SENSOR_BYTES).ok_or(SHORT).and_then(|bytes| sensor(Bytes(bytes)));
    let sensors = (0..count).map(|_| one(&mut bytes)).collect::<Result<_, _>>()?;
    Ok(Robot { name, footprint, sensors })
}

fn sensor(mut bytes: Bytes<'_>) -> Result<Sensor, &'static str> {
    let kind = match bytes.u32().ok_or(SHORT)? {
        1 => SensorKind::Sonar,
        2 => SensorKind::Lidar,
        _ => return Err("a sensor that is neither sonar nor lidar"),
    };
    let sensor = Sensor {
        kind,
        first_transducer: bytes.u16().ok_or(SHORT)?,
        transducers: bytes.u16().ok_or(SHORT)?,
        base_from_sensor: pose(&mut bytes)?,
        first_bearing_rad: finite(&mut bytes)?,
        bearing_step_rad: finite(&mut bytes)?,
        aperture_rad: finite(&mut bytes)?,
        range_min_m: finite(&mut bytes)?,
        range_max_m: finite(&mut bytes)?,
        range_error_ratio: finite(&mut bytes)?,
    };
    let can_be = sensor.aperture_rad > 0.0
        && sensor.aperture_rad <= core::f64::consts::TAU
        && sensor.range_min_m >= 0.0
        && sensor.range_max_m > sensor.range_min_m
        && sensor.range_max_m <= RANGE_MAX_M
        && sensor.range_error_ratio >= 0.0;
    if can_be { Ok(sensor) } else { Err("a sensor that can't be") }
}
