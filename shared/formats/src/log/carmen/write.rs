//! Any log, written as a CARMEN log.
//!
//! Every number is written so that reading it gives the same number again, stamps with nine
//! decimals. A lidar whose beams lie as in `FLASER` becomes `FLASER` (or `RLASER`), any other
//! `ROBOTLASERk`; lidars at one mount are one lidar whose beams lie otherwise from scan to scan; all sonars together become `SONAR`. No echo is written as the lidar's maximum, for
//! a sonar as 1 m more (an echo may come from its very maximum), invalid as 0. What is lost: the sensors' nearest ranges, time offsets of
//! single readings that differ from scan to scan, and scans before the first odometry, which have no pose to be written with.

use core::f64::consts::TAU;
use std::io::{self, Write};

use echogrid_core::{Echo, Pose2, Reading, Robot, Sensor, SensorKind};

use super::angles::plain_fan;
use super::{SONAR_MAX_PARAM, SONAR_OFFSETS_PARAM};
use crate::log::LogEvent;
use crate::log::stamp::format_stamp;

/// Bearings and mount poses closer than this are taken for the same.
const SAME: f64 = 1e-9;
/// The host in every line.
const HOST: &str = "echogrid";

/// How a lidar is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Message {
    Front,
    Rear,
    Robot(usize),
}

/// Writes events as lines of a CARMEN log.
pub(crate) struct CarmenWriter<W> {
    out: W,
    /// Lidars with the message each is written as.
    lidars: Vec<(Sensor, Message)>,
    sonars: Vec<Sensor>,
    odom_from_base: Option<Pose2>,
    v_mps: f64,
    w_radps: f64,
    /// Scans before the first odometry: there is no pose to write them with.
    pub(crate) scans_without_pose: u64,
}

impl<W: Write> CarmenWriter<W> {
    /// Writes the parameters.
    pub(crate) fn new(out: W, robot: &Robot) -> io::Result<Self> {
        Self::with_offsets(out, robot, &[])
    }

    /// As [`Self::new`], for sonars that fire in turn: when each of them does, nanoseconds after the stamp of its scan.
    pub(crate) fn with_offsets(mut out: W, robot: &Robot, offsets_ns: &[i32]) -> io::Result<Self> {
        let mut lidars: Vec<(Sensor, Message)> = Vec::new();
        let all: Vec<&Sensor> = robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Lidar).collect();
        for sensor in &all {
            let at_one_mount = |other: &Sensor| {
                other.base_from_sensor == sensor.base_from_sensor && other.range_max_m == sensor.range_max_m
            };
            if let Some((_, message)) = lidars.iter().find(|(other, _)| at_one_mount(other)) {
                lidars.push(((*sensor).clone(), *message));
                continue;
            }
            let used = |message| lidars.iter().any(|(_, other)| *other == message);
            let plain: Option<Vec<Message>> =
                all.iter().filter(|other| at_one_mount(other)).map(|other| plain_message(other)).collect();
            let message = match plain.and_then(|messages| messages.first().copied()) {
                Some(message) if !used(message) => message,
                // Numbers from 3 on are of no front or rear laser.
                _ => Message::Robot(3 + lidars.len()),
            };
            lidars.push(((*sensor).clone(), message));
        }
        let sonars: Vec<_> = robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Sonar).cloned().collect();
        let mut param = |name: &str, value: f64| writeln!(out, "PARAM {name} {value} {HOST} 0");
        if robot.footprint.length_m > 0.0 {
            param("robot_length", robot.footprint.length_m)?;
            param("robot_width", robot.footprint.width_m)?;
        }
        let mut said: Vec<Message> = Vec::new();
        for (sensor, message) in &lidars {
            if said.contains(message) {
                continue;
            }
            said.push(*message);
            let (offset, max) = match message {
                Message::Front => ("robot_frontlaser_offset", "robot_front_laser_max"),
                Message::Rear => ("robot_rearlaser_offset", "robot_rear_laser_max"),
                Message::Robot(_) => continue,
            };
            param(offset, sensor.base_from_sensor.x)?;
            param(max, sensor.range_max_m)?;
        }
        if let Some(max) = sonars.iter().map(|sonar| sonar.range_max_m).reduce(f64::max) {
            param(SONAR_MAX_PARAM, max)?;
        }
        if !offsets_ns.is_empty() && !sonars.is_empty() {
            let offsets: Vec<String> = offsets_ns.iter().map(i32::to_string).collect();
            writeln!(out, "PARAM {SONAR_OFFSETS_PARAM} {} {HOST} 0", offsets.join(","))?;
        }
        Ok(Self { out, lidars, sonars, odom_from_base: None, v_mps: 0.0, w_radps: 0.0, scans_without_pose: 0 })
    }

    pub(crate) fn event(&mut self, event: &LogEvent) -> io::Result<()> {
        match event {
            LogEvent::Odometry { stamp_ns, odom_from_base: Pose2 { x, y, theta }, v_mps, w_radps } => {
                self.odom_from_base = Some(Pose2 { x: *x, y: *y, theta: *theta });
                (self.v_mps, self.w_radps) = (*v_mps, *w_radps);
                write!(self.out, "ODOM {x} {y} {theta} {v_mps} {w_radps} 0")?;
                self.trailer(*stamp_ns)
            }
            LogEvent::TruePose { stamp_ns, map_from_base } => {
                write!(self.out, "TRUEPOS")?;
                self.pose(*map_from_base)?;
                self.pose(self.odom_from_base.unwrap_or_default())?;
                self.trailer(*stamp_ns)
            }
            LogEvent::Scan { stamp_ns, readings } => self.scan(*stamp_ns, readings),
        }
    }

    pub(crate) fn out(&self) -> &W {
        &self.out
    }

    pub(crate) fn into_inner(self) -> W {
        self.out
    }

    fn scan(&mut self, stamp_ns: u64, readings: &[Reading]) -> io::Result<()> {
        let Some(odom_from_base) = self.odom_from_base else {
            self.scans_without_pose += 1;
            return Ok(());
        };
        for at in 0..self.lidars.len() {
            let Some((sensor, message)) = self.lidars.get(at).cloned() else { continue };
            let Some((beams, ranges)) = beams_of(&sensor, readings, message) else { continue };
            let odom_from_sensor = odom_from_base * sensor.base_from_sensor;
            match message {
                Message::Front | Message::Rear => {
                    let name = if message == Message::Front { "FLASER" } else { "RLASER" };
                    write!(self.out, "{name} {}", ranges.len())?;
                    self.numbers(&ranges)?;
                    // The heading is the robot's, also for the rear laser.
                    self.pose(Pose2 { theta: odom_from_base.theta, ..odom_from_sensor })?;
                    self.pose(odom_from_base)?;
                }
                Message::Robot(number) => {
                    let (Beams { first_bearing_rad, bearing_step_rad }, range_max_m) = (beams, sensor.range_max_m);
                    let span = bearing_step_rad * ranges.len().saturating_sub(1) as f64;
                    write!(self.out, "ROBOTLASER{number} 0 {first_bearing_rad} {span} {bearing_step_rad} ")?;
                    write!(self.out, "{range_max_m} 0 0 {}", ranges.len())?;
                    self.numbers(&ranges)?;
                    write!(self.out, " 0")?;
                    self.pose(odom_from_sensor)?;
                    self.pose(odom_from_base)?;
                    write!(self.out, " {} {} 0 0 0", self.v_mps, self.w_radps)?;
                }
            }
            self.trailer(stamp_ns)?;
        }
        self.sonar_scan(stamp_ns, readings, odom_from_base)
    }

    fn sonar_scan(&mut self, stamp_ns: u64, readings: &[Reading], odom_from_base: Pose2) -> io::Result<()> {
        let no_echo_m = self.sonars.iter().map(|sonar| sonar.range_max_m).fold(0.0, f64::max) + 1.0;
        let heard: Vec<_> = self.sonars.iter().map(|sonar| ranges_of(sonar, readings, no_echo_m)).collect();
        if heard.iter().all(Option::is_none) {
            return Ok(());
        }
        let ranges: Vec<f64> =
            heard.into_iter().map(|ranges| ranges.and_then(|r| r.first().copied()).unwrap_or(0.0)).collect();
        let aperture_rad = self.sonars.first().map_or(0.0, |sonar| sonar.aperture_rad);
        write!(self.out, "SONAR {aperture_rad} {}", ranges.len())?;
        self.numbers(&ranges)?;
        for mount in self.sonars.iter().map(|sonar| sonar.base_from_sensor).collect::<Vec<_>>() {
            self.pose(mount)?;
        }
        self.pose(odom_from_base)?;
        self.trailer(stamp_ns)
    }

    fn numbers(&mut self, numbers: &[f64]) -> io::Result<()> {
        numbers.iter().try_for_each(|number| write!(self.out, " {number}"))
    }

    fn pose(&mut self, pose: Pose2) -> io::Result<()> {
        self.numbers(&[pose.x, pose.y, pose.theta])
    }

    fn trailer(&mut self, stamp_ns: u64) -> io::Result<()> {
        let stamp = format_stamp(stamp_ns);
        writeln!(self.out, " {stamp} {HOST} {stamp}")
    }
}

/// `FLASER` or `RLASER`, if the sensor's beams and mount are theirs.
fn plain_message(sensor: &Sensor) -> Option<Message> {
    let (first, step) = plain_fan(usize::from(sensor.transducers));
    let mount = sensor.base_from_sensor;
    let is_plain = (sensor.first_bearing_rad - first).abs() < SAME
        && (sensor.bearing_step_rad - step).abs() < SAME
        && mount.y.abs() < SAME;
    if !is_plain {
        None
    } else if mount.theta.abs() < SAME {
        Some(Message::Front)
    } else if (mount.theta.abs() - core::f64::consts::PI).abs() < SAME {
        Some(Message::Rear)
    } else {
        None
    }
}

/// Where the beams of a line lie.
#[derive(Debug, Clone, Copy)]
struct Beams {
    first_bearing_rad: f64,
    bearing_step_rad: f64,
}

/// The beams of one lidar and their ranges; none if it says nothing in this scan. A scan of some beams of a described lidar is
/// written with these alone, if they are evenly spread but for rounding.
fn beams_of(sensor: &Sensor, readings: &[Reading], message: Message) -> Option<(Beams, Vec<f64>)> {
    let Sensor { first_transducer, transducers, first_bearing_rad, bearing_step_rad, range_max_m, .. } = *sensor;
    let whole = Beams { first_bearing_rad, bearing_step_rad };
    if matches!(message, Message::Robot(_)) {
        let beam_of = |reading: &Reading| reading.transducer.checked_sub(first_transducer).filter(|b| *b < transducers);
        let (beams, ranges): (Vec<u16>, Vec<f64>) =
            readings.iter().filter_map(|r| Some((beam_of(r)?, written(r.echo, range_max_m)))).unzip();
        let is_circle = (bearing_step_rad.abs() * f64::from(transducers) - TAU).abs() < SAME;
        let spread = even_spread(&beams, is_circle.then_some(transducers));
        if let Some((first, step)) = spread.filter(|_| beams.len() < usize::from(transducers)) {
            let first_rad = first_bearing_rad + first * bearing_step_rad;
            let first_bearing_rad = if is_circle { echogrid_core::wrap_angle(first_rad) } else { first_rad };
            return Some((Beams { first_bearing_rad, bearing_step_rad: step * bearing_step_rad }, ranges));
        }
    }
    ranges_of(sensor, readings, range_max_m).map(|ranges| (whole, ranges))
}

/// First beam and step, in beams of the sensor, if all lie within one of an even spread. `circle`: so many beams are a turn.
fn even_spread(beams: &[u16], circle: Option<u16>) -> Option<(f64, f64)> {
    let first = f64::from(*beams.first()?);
    let mut unwrapped = vec![first];
    for (before, beam) in beams.iter().zip(beams.iter().skip(1)) {
        let mut way = f64::from(*beam) - f64::from(*before);
        if let Some(turn) = circle.map(f64::from) {
            way -= turn * (way / turn).round();
        }
        unwrapped.push(unwrapped.last()? + way);
    }
    let gaps = (unwrapped.len() - 1) as f64;
    let step = if gaps == 0.0 { 1.0 } else { (unwrapped.last()? - first) / gaps };
    let is_even = unwrapped.iter().enumerate().all(|(n, beam)| (first + n as f64 * step - beam).abs() <= 1.0);
    (step != 0.0 && is_even).then_some((first, step))
}

/// A range as CARMEN writes it.
fn written(echo: Echo, no_echo_m: f64) -> f64 {
    match echo {
        Echo::Hit { range_m } => range_m,
        Echo::NoEcho => no_echo_m,
        Echo::Invalid => 0.0,
    }
}

/// The ranges of one sensor, as CARMEN writes them; none if it says nothing in this scan.
fn ranges_of(sensor: &Sensor, readings: &[Reading], no_echo_m: f64) -> Option<Vec<f64>> {
    let mut ranges = vec![0.0; usize::from(sensor.transducers)];
    let mut any = false;
    for reading in readings {
        let beam = reading.transducer.checked_sub(sensor.first_transducer).map(usize::from);
        if let Some(range) = beam.and_then(|beam| ranges.get_mut(beam)) {
            any = true;
            *range = written(reading.echo, no_echo_m);
        }
    }
    any.then_some(ranges)
}
