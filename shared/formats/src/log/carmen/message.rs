//! One line of a CARMEN log.
//!
//! Source of the layouts: CARMEN's `logger/writelog.c`. Metres, radians, m/s, seconds. Every
//! message but `PARAM` ends in `ipc_timestamp ipc_hostname logger_timestamp`; the first of the
//! three is the time of acquisition.

use core::str::SplitAsciiWhitespace;

use echogrid_core::{POSITION_MAX_M, Pose2};

use super::angles::{self, Beams, plain_fan};
use crate::log::fault::{FaultKind, Refusal};
use crate::log::stamp::parse_stamp_ns;
use crate::log::timeline::Source;

/// Beyond this a heading is garbage, radians (logs hold unwrapped headings).
const HEADING_MAX_RAD: f64 = 1e6;
/// Beyond this a velocity is garbage, m/s or rad/s.
const VELOCITY_MAX: f64 = 1e3;
/// Beyond this a number is no angle, in radians or degrees.
const ANGLE_MAX: f64 = 1e4;
/// Readings that one line may hold: as many as transducers can be numbered.
pub(in crate::log) const READINGS_MAX: usize = 65_535;

/// Which message a scan came in: one range sensor (or ring of sonars) of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum ScanKind {
    /// `FLASER`.
    Front,
    /// `RLASER`.
    Rear,
    /// `ROBOTLASERk`.
    Robot(u8),
    /// `RAWLASERk`.
    Raw(u8),
    /// `SONAR`.
    Sonar,
    /// A sensor of a recording, by its number there.
    Stream(u16),
}

impl ScanKind {
    /// The name of the message.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Front => "FLASER".into(),
            Self::Rear => "RLASER".into(),
            Self::Robot(number) => format!("ROBOTLASER{number}"),
            Self::Raw(number) => format!("RAWLASER{number}"),
            Self::Sonar => "SONAR".into(),
            Self::Stream(number) => format!("sensor {number}"),
        }
    }

    /// What tells its lines from those of other messages.
    pub(crate) fn source(self) -> Source {
        let number = match self {
            Self::Front => 0,
            Self::Rear => 1,
            Self::Sonar => 2,
            Self::Robot(number) => 0x100 + u16::from(number),
            Self::Raw(number) => 0x200 + u16::from(number),
            Self::Stream(number) => 0x300 + number,
        };
        Source(Source::FIRST_SCAN + number)
    }

    fn of(name: &str) -> Option<Self> {
        let numbered = |prefix: &str| -> Option<u8> {
            name.strip_prefix(prefix).filter(|digits| digits.len() <= 2)?.parse().ok().filter(|number| *number > 0)
        };
        match name {
            "FLASER" => Some(Self::Front),
            "RLASER" => Some(Self::Rear),
            "SONAR" => Some(Self::Sonar),
            _ => numbered("ROBOTLASER").map(Self::Robot).or_else(|| numbered("RAWLASER").map(Self::Raw)),
        }
    }
}

/// How the readings of a scan lie around the sensor.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Shape {
    /// A lidar's beams.
    Fan {
        first_bearing_rad: f64,
        bearing_step_rad: f64,
        /// Where the line itself says it.
        range_max_m: Option<f64>,
    },
    /// Sonars around the robot: mount poses seen from its base.
    Ring { aperture_rad: f64, base_from_sonar: Vec<Pose2> },
}

/// Poses that a scan carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Carried {
    pub(crate) odom_from_base: Pose2,
    pub(crate) odom_from_sensor: Option<Pose2>,
    pub(crate) v_mps: f64,
    pub(crate) w_radps: f64,
}

/// A sensor that a message describes: ranges are metres, infinity is no echo, and who gave none is no number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Described {
    pub(crate) base_from_sensor: Pose2,
    pub(crate) range_min_m: f64,
    pub(crate) range_max_m: f64,
    /// From reading to reading, nanoseconds.
    pub(crate) reading_step_ns: f64,
}

/// A line of readings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ScanLine {
    pub(crate) kind: ScanKind,
    pub(crate) shape: Shape,
    /// As they stand, not judged yet.
    pub(crate) ranges: Vec<f64>,
    pub(crate) carried: Option<Carried>,
    pub(crate) stamp_ns: Option<u64>,
    /// What a message says of its sensor that says all of it.
    pub(crate) described: Option<Described>,
    /// What is odd about how it describes the sensor, though it is usable.
    pub(crate) oddities: Vec<Refusal>,
}

/// What a line says. A stamp that is unusable is none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Message<'a> {
    /// `ODOM`.
    Odometry { odom_from_base: Pose2, v_mps: f64, w_radps: f64, stamp_ns: Option<u64> },
    /// Any range sensor.
    Scan(ScanLine),
    /// `TRUEPOS`.
    TruePose { map_from_base: Pose2, stamp_ns: Option<u64> },
    /// `PARAM`.
    Param { name: &'a str, value: &'a str },
    /// A message that is known to hold nothing of use (`SYNC`, `NEFF`), or an unknown one.
    Other { name: &'a str },
    /// A comment or a blank line.
    Nothing,
}

/// Whether a log that has a line beginning with this word is a CARMEN log.
pub(crate) fn is_message_name(word: &str) -> bool {
    matches!(word, "ODOM" | "TRUEPOS" | "PARAM") || ScanKind::of(word).is_some()
}

/// Reads one line, without its end.
pub(crate) fn parse(line: &[u8]) -> Result<Message<'_>, Refusal> {
    if line.trim_ascii_start().first().is_none_or(|byte| *byte == b'#') {
        return Ok(Message::Nothing);
    }
    let text = core::str::from_utf8(line)
        .map_err(|_| Refusal::new(FaultKind::NotUtf8, String::from_utf8_lossy(line.get(..200).unwrap_or(line))))?
        .trim();
    let mut words = Words(text.split_ascii_whitespace());
    let Some(name) = words.0.next() else { return Ok(Message::Nothing) };
    match name {
        "ODOM" => odometry(words),
        "TRUEPOS" => true_pose(words),
        "PARAM" => param(text),
        _ => match ScanKind::of(name) {
            Some(kind @ (ScanKind::Front | ScanKind::Rear)) => laser(kind, words),
            Some(kind @ (ScanKind::Raw(_) | ScanKind::Robot(_))) => described_laser(kind, words),
            Some(ScanKind::Sonar) => sonar(words),
            // No word is one.
            Some(ScanKind::Stream(_)) => Err(Refusal::new(FaultKind::NotAMessage, text)),
            None if looks_like_a_name(name) => Ok(Message::Other { name }),
            None => Err(Refusal::new(FaultKind::NotAMessage, text)),
        },
    }
}

fn looks_like_a_name(word: &str) -> bool {
    word.len() <= 40
        && word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// `ODOM x y theta tv rv accel`
fn odometry(mut words: Words<'_>) -> Result<Message<'static>, Refusal> {
    let odom_from_base = words.pose()?;
    let (v_mps, w_radps) = (words.velocity()?, words.velocity()?);
    words.number()?;
    Ok(Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns: words.trailer()? })
}

/// `TRUEPOS true_x true_y true_theta odom_x odom_y odom_theta`
fn true_pose(mut words: Words<'_>) -> Result<Message<'static>, Refusal> {
    let map_from_base = words.pose()?;
    words.pose()?;
    Ok(Message::TruePose { map_from_base, stamp_ns: words.trailer()? })
}

/// `PARAM name value [ipc_timestamp] host logger_timestamp`; the value may hold blanks.
fn param(text: &str) -> Result<Message<'_>, Refusal> {
    let rest = text.strip_prefix("PARAM").unwrap_or(text).trim_start();
    let (name, rest) = rest.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((rest, ""));
    if name.is_empty() {
        return Err(Refusal::new(FaultKind::Truncated, text));
    }
    let rest = rest.trim();
    // From the end: logger_timestamp, host, and in newer logs ipc_timestamp.
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    let value = match cut_last(rest) {
        Some((head, last)) if is_number(last) => match cut_last(head) {
            Some((head, _host)) => match cut_last(head) {
                Some((value, stamp)) if is_number(stamp) => value,
                _ => head,
            },
            None => rest,
        },
        _ => rest,
    };
    Ok(Message::Param { name, value })
}

/// Everything but the last word, and the last word; none if there is only one.
fn cut_last(text: &str) -> Option<(&str, &str)> {
    let (head, last) = text.rsplit_once(|c: char| c.is_ascii_whitespace())?;
    Some((head.trim_end(), last))
}

/// `FLASER n r1..rn x y theta odom_x odom_y odom_theta`
fn laser(kind: ScanKind, mut words: Words<'_>) -> Result<Message<'static>, Refusal> {
    let count = words.count()?;
    let ranges = words.ranges(count)?;
    let (odom_from_sensor, odom_from_base) = (words.pose()?, words.pose()?);
    let stamp_ns = words.trailer()?;
    let (first_bearing_rad, bearing_step_rad) = plain_fan(count);
    Ok(Message::Scan(ScanLine {
        kind,
        shape: Shape::Fan { first_bearing_rad, bearing_step_rad, range_max_m: None },
        ranges,
        carried: Some(Carried { odom_from_base, odom_from_sensor: Some(odom_from_sensor), v_mps: 0.0, w_radps: 0.0 }),
        stamp_ns,
        described: None,
        oddities: Vec::new(),
    }))
}

/// `RAWLASERk laser_type start_angle fov resolution max_range accuracy remission_mode n r1..rn m
/// remission1..m`, and for `ROBOTLASERk` after that `laser_pose robot_pose laser_tv laser_rv
/// forward_safety_dist side_safety_dist turn_axis`.
fn described_laser(kind: ScanKind, mut words: Words<'_>) -> Result<Message<'static>, Refusal> {
    words.number()?;
    let (start, view, step) = (words.angle()?, words.angle()?, words.angle()?);
    let range_max_m = words.number()?;
    words.number()?;
    words.number()?;
    let count = words.count()?;
    let ranges = words.ranges(count)?;
    let remissions = words.count_from(0)?;
    for _ in 0..remissions {
        words.word()?;
    }
    let carried = if matches!(kind, ScanKind::Robot(_)) {
        let (odom_from_sensor, odom_from_base) = (words.pose()?, words.pose()?);
        let (v_mps, w_radps) = (words.velocity()?, words.velocity()?);
        for _ in 0..3 {
            words.number()?;
        }
        Some(Carried { odom_from_base, odom_from_sensor: Some(odom_from_sensor), v_mps, w_radps })
    } else {
        None
    };
    let stamp_ns = words.trailer()?;
    let Beams { first_bearing_rad, bearing_step_rad, oddities } = Beams::stated(start, view, step, count)?;
    Ok(Message::Scan(ScanLine {
        kind,
        shape: Shape::Fan {
            first_bearing_rad,
            bearing_step_rad,
            range_max_m: Some(range_max_m).filter(|max| max.is_finite() && *max > 0.0),
        },
        ranges,
        carried,
        stamp_ns,
        described: None,
        oddities,
    }))
}

/// `SONAR cone_angle n r1..rn x1 y1 theta1 .. xn yn thetan [robot_x robot_y robot_theta]`
fn sonar(mut words: Words<'_>) -> Result<Message<'static>, Refusal> {
    let (aperture_rad, oddities) = angles::cone(words.angle()?)?;
    let count = words.count()?;
    let ranges = words.ranges(count)?;
    let base_from_sonar = (0..count).map(|_| words.pose()).collect::<Result<Vec<_>, _>>()?;
    // The robot's pose is there if more than the three words of the trailer are left.
    let carried = if words.left() > 3 {
        let odom_from_base = words.pose()?;
        Some(Carried { odom_from_base, odom_from_sensor: None, v_mps: 0.0, w_radps: 0.0 })
    } else {
        None
    };
    let stamp_ns = words.trailer()?;
    Ok(Message::Scan(ScanLine {
        kind: ScanKind::Sonar,
        shape: Shape::Ring { aperture_rad, base_from_sonar },
        ranges,
        carried,
        stamp_ns,
        described: None,
        oddities,
    }))
}

/// The words of a line, taken one by one.
pub(in crate::log) struct Words<'a>(SplitAsciiWhitespace<'a>);

impl<'a> Words<'a> {
    pub(in crate::log) fn new(line: &'a [u8]) -> Result<Self, Refusal> {
        let text = core::str::from_utf8(line)
            .map_err(|_| Refusal::new(FaultKind::NotUtf8, String::from_utf8_lossy(line.get(..200).unwrap_or(line))))?;
        Ok(Self(text.split_ascii_whitespace()))
    }

    pub(in crate::log) fn next_word(&mut self) -> Option<&'a str> {
        self.0.next()
    }

    /// A stamp as the last word. The outer result is about the words, the inner option about the stamp.
    pub(in crate::log) fn last_stamp(mut self) -> Result<Option<u64>, Refusal> {
        let stamp = self.word()?;
        match self.0.next() {
            Some(extra) => Err(Refusal::new(FaultKind::ExtraWords, extra)),
            None => Ok(parse_stamp_ns(stamp)),
        }
    }

    pub(in crate::log) fn word(&mut self) -> Result<&'a str, Refusal> {
        self.0.next().ok_or_else(|| Refusal::new(FaultKind::Truncated, "end of line"))
    }

    pub(in crate::log) fn number(&mut self) -> Result<f64, Refusal> {
        let word = self.word()?;
        word.parse().map_err(|_| Refusal::new(FaultKind::BadNumber, word))
    }

    pub(in crate::log) fn bounded(&mut self, limit: f64, beyond: FaultKind) -> Result<f64, Refusal> {
        let word = self.word()?;
        let value: f64 = word.parse().map_err(|_| Refusal::new(FaultKind::BadNumber, word))?;
        if !value.is_finite() {
            Err(Refusal::new(FaultKind::NotFinite, word))
        } else if value.abs() > limit {
            Err(Refusal::new(beyond, word))
        } else {
            Ok(value)
        }
    }

    pub(in crate::log) fn pose(&mut self) -> Result<Pose2, Refusal> {
        let x = self.bounded(POSITION_MAX_M, FaultKind::AbsurdPose)?;
        let y = self.bounded(POSITION_MAX_M, FaultKind::AbsurdPose)?;
        Ok(Pose2::new(x, y, self.bounded(HEADING_MAX_RAD, FaultKind::AbsurdPose)?))
    }

    fn velocity(&mut self) -> Result<f64, Refusal> {
        self.bounded(VELOCITY_MAX, FaultKind::AbsurdVelocity)
    }

    /// An angle of a sensor's geometry; what it means is told by [`angles`].
    fn angle(&mut self) -> Result<f64, Refusal> {
        self.bounded(ANGLE_MAX, FaultKind::AbsurdPose)
    }

    pub(in crate::log) fn count(&mut self) -> Result<usize, Refusal> {
        self.count_from(1)
    }

    fn count_from(&mut self, least: usize) -> Result<usize, Refusal> {
        let word = self.word()?;
        word.parse()
            .ok()
            .filter(|count| (least..=READINGS_MAX).contains(count))
            .ok_or_else(|| Refusal::new(FaultKind::BadCount, word))
    }

    pub(in crate::log) fn ranges(&mut self, count: usize) -> Result<Vec<f64>, Refusal> {
        let mut ranges = Vec::with_capacity(count.min(2048));
        for _ in 0..count {
            ranges.push(self.number()?);
        }
        Ok(ranges)
    }

    pub(in crate::log) fn left(&self) -> usize {
        self.0.clone().count()
    }

    /// `ipc_timestamp ipc_hostname logger_timestamp`, and nothing after it. The outer result is
    /// about the words, the inner option about the stamp.
    fn trailer(mut self) -> Result<Option<u64>, Refusal> {
        let stamp = self.word()?;
        self.word()?;
        self.word()?;
        match self.0.next() {
            Some(extra) => Err(Refusal::new(FaultKind::ExtraWords, extra)),
            None => Ok(parse_stamp_ns(stamp)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(line: &str) -> FaultKind {
        parse(line.as_bytes()).unwrap_err().kind
    }

    #[test]
    fn odometry_line() {
        let message = parse(b"ODOM 1 -2 7.0 0.5 -0.1 0 21.5 host 0.1").unwrap();
        assert_eq!(
            message,
            Message::Odometry {
                odom_from_base: Pose2::new(1.0, -2.0, 7.0),
                v_mps: 0.5,
                w_radps: -0.1,
                stamp_ns: Some(21_500_000_000)
            }
        );
    }

    #[test]
    fn faults_are_told_apart() {
        assert_eq!(fault("ODOM 1 2 x 0 0 0 1 h 1"), FaultKind::BadNumber);
        assert_eq!(fault("ODOM 1 nan 0 0 0 0 1 h 1"), FaultKind::NotFinite);
        assert_eq!(fault("ODOM 1e8 0 0 0 0 0 1 h 1"), FaultKind::AbsurdPose);
        assert_eq!(fault("ODOM 1 0 0 1e9 0 0 1 h 1"), FaultKind::AbsurdVelocity);
        assert_eq!(fault("ODOM 1 2 3 0 0 0 1 h"), FaultKind::Truncated);
        assert_eq!(fault("ODOM 1 2 3 0 0 0 1 h 1 1"), FaultKind::ExtraWords);
        assert_eq!(fault("FLASER 0 0 0 0 0 0 0 1 h 1"), FaultKind::BadCount);
        assert_eq!(fault("FLASER 99999999 1 1"), FaultKind::BadCount);
        assert_eq!(fault("FLASER 3 1 1"), FaultKind::Truncated);
        assert_eq!(fault("12 monkeys"), FaultKind::NotAMessage);
        assert_eq!(parse(b"ODOM \xff\xfe").unwrap_err().kind, FaultKind::NotUtf8);
        assert_eq!(fault("PARAM"), FaultKind::Truncated);
    }

    #[test]
    fn comments_may_be_of_any_bytes() {
        assert_eq!(parse(b"# \xff").unwrap(), Message::Nothing);
        assert_eq!(parse(b"  ").unwrap(), Message::Nothing);
        assert_eq!(parse(b"SYNC tag").unwrap(), Message::Other { name: "SYNC" });
    }

    #[test]
    fn parameters() {
        let value = |line: &'static str| match parse(line.as_bytes()).unwrap() {
            Message::Param { value, .. } => value,
            other => panic!("{other:?}"),
        };
        assert_eq!(value("PARAM robot_frontlaser_offset -0.04 nohost 0"), "-0.04");
        assert_eq!(value("PARAM robot_frontlaser_offset 0.3 12.5 host 0.1"), "0.3");
        assert_eq!(value("PARAM robot_use_laser on nohost 0"), "on");
        assert_eq!(value("PARAM a two words nohost 0"), "two words");
        assert_eq!(value("PARAM a lone"), "lone");
        assert_eq!(value("PARAM a"), "");
    }

    #[test]
    fn laser_and_sonar_lines() {
        let Message::Scan(scan) = parse(b"FLASER 3 1 2 nan 0.1 0 0 0 0 0 5 h 5").unwrap() else { panic!() };
        assert_eq!(
            scan.shape,
            Shape::Fan {
                first_bearing_rad: -core::f64::consts::FRAC_PI_2,
                bearing_step_rad: core::f64::consts::FRAC_PI_2,
                range_max_m: None
            }
        );
        assert!(scan.ranges[2].is_nan());
        let Message::Scan(scan) = parse(b"SONAR 0.5 1 2.5 0.1 0 1.57 5 h 5").unwrap() else { panic!() };
        assert_eq!(scan.carried, None);
        let Message::Scan(scan) = parse(b"SONAR 0.5 1 2.5 0.1 0 1.57 7 8 0 5 h 5").unwrap() else { panic!() };
        assert_eq!(scan.carried.unwrap().odom_from_base, Pose2::new(7.0, 8.0, 0.0));
        let line = b"ROBOTLASER1 0 -1.570796 3.141593 0.017453 50 0.01 0 2 1 60 0 1 0 0 0.8 0 0 0.1 0.2 0 0 0 5 h 5";
        let Message::Scan(scan) = parse(line).unwrap() else { panic!() };
        assert_eq!(scan.kind, ScanKind::Robot(1));
        assert_eq!(scan.carried.unwrap().v_mps, 0.1);
        let line = b"RAWLASER2 0 -1.57 3.14 0 50 0.01 0 3 1 60 2 1 7 5 h 5";
        let Message::Scan(scan) = parse(line).unwrap() else { panic!() };
        assert!(matches!(scan.shape, Shape::Fan { bearing_step_rad, .. } if bearing_step_rad == 1.57));
    }
}
