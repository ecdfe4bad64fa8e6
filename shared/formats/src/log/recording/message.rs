//! The messages that are read: their fields, judged no further than that they can be numbers.

use super::container::Channel;
use super::frames::{Transform, plain_frame};
use super::wire::Fields;

/// The types that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Type {
    LaserScan,
    Range,
    Odometry,
    Transforms,
    Pose,
    PoseWithCovariance,
    Transform,
}

impl Type {
    pub(crate) fn of(channel: &Channel) -> Option<Self> {
        Some(match channel.datatype.as_str() {
            "sensor_msgs/LaserScan" => Self::LaserScan,
            "sensor_msgs/Range" => Self::Range,
            "nav_msgs/Odometry" => Self::Odometry,
            "tf2_msgs/TFMessage" | "tf/tfMessage" => Self::Transforms,
            "geometry_msgs/PoseStamped" => Self::Pose,
            "geometry_msgs/PoseWithCovarianceStamped" => Self::PoseWithCovariance,
            "geometry_msgs/TransformStamped" => Self::Transform,
            _ => return None,
        })
    }

    /// Whether it may say where the robot really was.
    pub(crate) fn tells_a_pose(self) -> bool {
        matches!(self, Self::Odometry | Self::Pose | Self::PoseWithCovariance | Self::Transform)
    }
}

/// When, and in which frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Head {
    /// None: it does not say.
    pub(crate) stamp_ns: Option<u64>,
    pub(crate) frame: String,
}

impl Head {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        if fields.is_ros1() {
            fields.u32()?;
        }
        Some(Self { stamp_ns: fields.time()?, frame: plain_frame(fields.text()?) })
    }
}

/// `sensor_msgs/LaserScan`; the intensities are left.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LaserScan {
    pub(crate) head: Head,
    pub(crate) first_bearing_rad: f64,
    pub(crate) bearing_step_rad: f64,
    /// From beam to beam, seconds.
    pub(crate) beam_step_s: f64,
    /// From scan to scan, seconds.
    pub(crate) period_s: f64,
    pub(crate) range_min_m: f64,
    pub(crate) range_max_m: f64,
    pub(crate) ranges: Vec<f64>,
}

impl LaserScan {
    /// The head alone; the ranges are there.
    pub(crate) fn read_head(mut fields: Fields<'_>) -> Option<Head> {
        let head = Head::read(&mut fields)?;
        for _ in 0..7 {
            fields.f32()?;
        }
        fields.count(4).map(|_| head)
    }

    pub(crate) fn read(mut fields: Fields<'_>) -> Option<Self> {
        let head = Head::read(&mut fields)?;
        let (first_bearing_rad, _last) = (fields.f32()?, fields.f32()?);
        let (bearing_step_rad, beam_step_s) = (fields.f32()?, fields.f32()?);
        let period_s = fields.f32()?;
        let (range_min_m, range_max_m) = (fields.f32()?, fields.f32()?);
        let ranges = fields.f32s()?;
        Some(Self {
            head,
            first_bearing_rad,
            bearing_step_rad,
            beam_step_s,
            period_s,
            range_min_m,
            range_max_m,
            ranges,
        })
    }
}

/// `sensor_msgs/Range`: one sonar, or one infrared sensor.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Range {
    pub(crate) head: Head,
    pub(crate) aperture_rad: f64,
    pub(crate) range_min_m: f64,
    pub(crate) range_max_m: f64,
    pub(crate) range_m: f64,
}

impl Range {
    pub(crate) fn read(mut fields: Fields<'_>) -> Option<Self> {
        let head = Head::read(&mut fields)?;
        let _kind = fields.u8()?;
        let aperture_rad = fields.f32()?;
        let (range_min_m, range_max_m) = (fields.f32()?, fields.f32()?);
        Some(Self { head, aperture_rad, range_min_m, range_max_m, range_m: fields.f32()? })
    }
}

/// Where something is: a pose, a transform, an odometry.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Placed {
    pub(crate) head: Head,
    /// The frame that is placed, where it is said.
    pub(crate) child: String,
    /// None: its numbers place nothing.
    pub(crate) transform: Option<Transform>,
    pub(crate) v_mps: f64,
    pub(crate) w_radps: f64,
}

impl Placed {
    /// `nav_msgs/Odometry`
    pub(crate) fn odometry(mut fields: Fields<'_>) -> Option<Self> {
        let head = Head::read(&mut fields)?;
        let child = plain_frame(fields.text()?);
        let transform = pose(&mut fields)?;
        fields.f64s::<36>()?;
        let [vx, vy, _, _, _, w] = fields.f64s::<6>()?;
        // Ahead or back; sideways it has no sign.
        let v_mps = if vy == 0.0 { vx } else { libm::hypot(vx, vy).copysign(vx) };
        let speed = |value: f64| if value.is_finite() { value } else { 0.0 };
        Some(Self { head, child, transform, v_mps: speed(v_mps), w_radps: speed(w) })
    }

    /// `geometry_msgs/PoseStamped` and `PoseWithCovarianceStamped`: both begin so.
    pub(crate) fn pose(mut fields: Fields<'_>) -> Option<Self> {
        let head = Head::read(&mut fields)?;
        let transform = pose(&mut fields)?;
        Some(Self { head, child: String::new(), transform, v_mps: 0.0, w_radps: 0.0 })
    }

    /// `geometry_msgs/TransformStamped`
    pub(crate) fn transform(mut fields: Fields<'_>) -> Option<Self> {
        Self::next_transform(&mut fields)
    }

    fn next_transform(fields: &mut Fields<'_>) -> Option<Self> {
        let head = Head::read(fields)?;
        let child = plain_frame(fields.text()?);
        let transform = pose(fields)?;
        Some(Self { head, child, transform, v_mps: 0.0, w_radps: 0.0 })
    }

    /// `tf2_msgs/TFMessage`
    pub(crate) fn transforms(mut fields: Fields<'_>) -> Option<Vec<Self>> {
        // Stamp, two lengths, seven numbers.
        let count = fields.count(8 + 8 + 56)?;
        (0..count).map(|_| Self::next_transform(&mut fields)).collect()
    }
}

/// A position and a quaternion.
fn pose(fields: &mut Fields<'_>) -> Option<Option<Transform>> {
    let (translation, rotation) = (fields.f64s::<3>()?, fields.f64s::<4>()?);
    Some(Transform::new(translation, rotation))
}
