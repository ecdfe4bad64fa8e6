//! The last metres of the drive: what was heard and seen on them, and how the odometry says that they went.

use std::collections::{BTreeMap, VecDeque};

use echogrid_core::{
    DrivePose, Echo as Answered, Increment, Leaps, Pose2, Reading, Robot, Scales, SensorKind, move_by,
};
use echogrid_slam::Points;
use echogrid_slam::known::{Echo, Stop, Trail};
use serde::{Deserialize, Serialize};

/// Odometry poses that are remembered: as many as requests can be behind what was measured.
const REMEMBERED: usize = 2048;
/// So many poses after a request without a scan, and none is waited for: fewer than the sensor may be ahead of the odometry.
const SILENT: usize = 512;
/// So many poses back a step of the way is looked for.
const LOOKED_BACK: usize = 512;
/// The most way that is looked back over, metres.
pub(crate) const WINDOW_MAX_M: f64 = 18.0;
/// A turn of a radian counts as so many metres of way.
const METRES_PER_RAD: f64 = 0.3;
/// A sonar is heard again after so much way or turn.
const HEARD_EVERY: (f64, f64) = (0.28, 0.25);
/// A scan of a lidar counts again after so much.
const SEEN_EVERY: (f64, f64) = (0.05, 0.04);
/// Beams of a scan that are kept, about.
const POINTS: usize = 120;
/// Nearer a sonar hears itself, farther what it hears has come by detours, metres.
const RANGE_M: (f64, f64) = (0.15, 5.0);

/// A pose of the odometry.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Moment {
    stamp_ns: u64,
    odom_from_base: Pose2,
    /// Until here, metres.
    way_m: f64,
    /// How often the odometry had leapt …
    piece: u32,
    /// … and how long the way was then, metres.
    leapt_m: f64,
}

impl Moment {
    fn towards(&self, later: &Self, stamp_ns: u64) -> Self {
        let fraction = (stamp_ns - self.stamp_ns) as f64 / (later.stamp_ns - self.stamp_ns).max(1) as f64;
        Self {
            stamp_ns,
            odom_from_base: self.odom_from_base.interpolate(later.odom_from_base, fraction),
            way_m: self.way_m + fraction * (later.way_m - self.way_m),
            ..*self
        }
    }
}

/// A scan whose poses are not all known yet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Scan {
    stamp_ns: u64,
    readings: Vec<Reading>,
}

impl Scan {
    fn end_ns(&self) -> u64 {
        let last = self.readings.iter().map(|reading| reading.offset_ns).max().unwrap_or(0);
        self.stamp_ns.saturating_add_signed(i64::from(last.max(0)))
    }
}

/// An echo, and where the robot was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Heard {
    at: Moment,
    transducer: u16,
    range_m: f64,
}

/// A scan of the lidars, and where the robot was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Seen {
    at: Moment,
    points: Points,
}

/// What of the drive is remembered.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Drive {
    robot: Option<Robot>,
    leaps: Leaps,
    track: VecDeque<Moment>,
    waiting: VecDeque<Scan>,
    heard: VecDeque<Heard>,
    seen: VecDeque<Seen>,
    /// Where each sonar was heard last, and the lidars were.
    kept: BTreeMap<Option<u16>, Moment>,
    /// Stamp of the last scan that came.
    scanned_ns: Option<u64>,
    /// Whether no more scans come, and no more odometry.
    ended: (bool, bool),
}

/// What was heard on a piece of way, seen from its end.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Piece {
    /// By the sonars.
    pub(crate) trail: Trail,
    /// What the lidars saw on the last part of it, and before that.
    pub(crate) points: [Points; 2],
    /// How long it is, metres.
    pub(crate) way_m: f64,
}

impl Drive {
    pub(crate) fn described(&mut self, robot: Robot) {
        self.robot.get_or_insert(robot);
    }

    /// Whether the robot has a lidar; none: nothing is known of it yet.
    pub(crate) fn has_lidar(&self) -> Option<bool> {
        let is_lidar = |robot: &Robot| robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Lidar);
        self.robot.as_ref().map(is_lidar)
    }

    pub(crate) fn moved(&mut self, pose: DrivePose) {
        let DrivePose { stamp_ns, odom_from_base, .. } = pose;
        let is_late = self.track.back().is_some_and(|last| stamp_ns <= last.stamp_ns);
        if !odom_from_base.is_finite() || is_late {
            return;
        }
        let has_leapt = self.leaps.next(pose).is_some();
        let moment = match self.track.back() {
            None => Moment { stamp_ns, odom_from_base, way_m: 0.0, piece: 0, leapt_m: 0.0 },
            Some(last) => {
                let step = Increment::between(last.odom_from_base, odom_from_base);
                let way_m = if has_leapt { 0.0 } else { step.length_m() + METRES_PER_RAD * step.turn_rad.abs() };
                let (piece, leapt_m) =
                    if has_leapt { (last.piece + 1, last.way_m) } else { (last.piece, last.leapt_m) };
                Moment { stamp_ns, odom_from_base, way_m: last.way_m + way_m, piece, leapt_m }
            }
        };
        if self.track.len() == REMEMBERED {
            self.track.pop_front();
        }
        self.track.push_back(moment);
        self.take_bracketed();
        self.forget();
    }

    pub(crate) fn scanned(&mut self, stamp_ns: u64, readings: Vec<Reading>) {
        self.scanned_ns = Some(stamp_ns.max(self.scanned_ns.unwrap_or(0)));
        self.waiting.push_back(Scan { stamp_ns, readings });
        self.take_bracketed();
    }

    pub(crate) fn scans_ended(&mut self) {
        self.ended.0 = true;
    }

    pub(crate) fn odometry_ended(&mut self) {
        self.ended.1 = true;
    }

    /// Whether all has come that was measured until a stamp.
    pub(crate) fn reaches(&self, stamp_ns: u64) -> bool {
        let Some(last) = self.track.back() else { return self.ended.1 };
        if last.stamp_ns < stamp_ns && !self.ended.1 {
            return false;
        }
        let after = self.track.len() - self.track.partition_point(|moment| moment.stamp_ns <= stamp_ns);
        let no_scan_comes = self.ended.0 || self.scanned_ns.is_some_and(|scanned_ns| scanned_ns > stamp_ns);
        let none_waits = self.ended.1 || self.waiting.front().is_none_or(|scan| scan.stamp_ns > stamp_ns);
        after >= SILENT || (no_scan_comes && none_waits)
    }

    fn at(&self, stamp_ns: u64) -> Option<Moment> {
        let after = self.track.partition_point(|moment| moment.stamp_ns < stamp_ns);
        let later = self.track.get(after)?;
        if later.stamp_ns == stamp_ns {
            return Some(*later);
        }
        let earlier = self.track.get(after.checked_sub(1)?)?;
        // Where it leapt nobody knows where it was.
        (earlier.piece == later.piece).then(|| earlier.towards(later, stamp_ns))
    }

    fn take_bracketed(&mut self) {
        let reached_ns = self.track.back().map(|moment| moment.stamp_ns);
        while self.waiting.front().is_some_and(|scan| Some(scan.end_ns()) <= reached_ns) {
            let Some((scan, robot)) = self.waiting.pop_front().zip(self.robot.take()) else { break };
            self.hear(&robot, &scan);
            self.see(&robot, &scan);
            self.robot = Some(robot);
        }
    }

    fn hear(&mut self, robot: &Robot, scan: &Scan) {
        for reading in &scan.readings {
            let Answered::Hit { range_m } = reading.echo else { continue };
            let Some(sonar) = robot.transducer(reading.transducer) else { continue };
            let at = self.at(scan.stamp_ns.saturating_add_signed(i64::from(reading.offset_ns)));
            let Some(at) = at.filter(|_| sonar.kind == SensorKind::Sonar) else { continue };
            let counts = range_m >= RANGE_M.0.max(sonar.range_min_m) && range_m < RANGE_M.1.min(sonar.range_max_m);
            if counts && self.is_new(Some(reading.transducer), at, HEARD_EVERY) {
                self.heard.push_back(Heard { at, transducer: reading.transducer, range_m });
            }
        }
    }

    fn see(&mut self, robot: &Robot, scan: &Scan) {
        if self.has_lidar_of(robot)
            && let Some(at) = self.at(scan.stamp_ns)
        {
            if !self.is_new(None, at, SEEN_EVERY) {
                return;
            }
            let moved = |offset_ns: i32| {
                let then = self.at(scan.stamp_ns.saturating_add_signed(i64::from(offset_ns)));
                then.map_or(Pose2::IDENTITY, |then| at.odom_from_base.inverse() * then.odom_from_base)
            };
            let all = Points::of(robot, &scan.readings, moved);
            let mut points = Points::default();
            let stride = all.len().div_ceil(POINTS).max(1);
            all.iter().step_by(stride).for_each(|(at, normal)| points.push(at, normal));
            self.seen.push_back(Seen { at, points });
        }
    }

    fn has_lidar_of(&self, robot: &Robot) -> bool {
        robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Lidar)
    }

    /// Whether a sensor has come so far since it counted last that it counts again.
    fn is_new(&mut self, sensor: Option<u16>, at: Moment, (metres, radians): (f64, f64)) -> bool {
        let is_new = self.kept.get(&sensor).is_none_or(|last| {
            let step = Increment::between(last.odom_from_base, at.odom_from_base);
            last.piece != at.piece || step.length_m() >= metres || step.turn_rad.abs() >= radians
        });
        if is_new {
            self.kept.insert(sensor, at);
        }
        is_new
    }

    fn forget(&mut self) {
        let Some(oldest_m) = self.track.front().map(|moment| moment.way_m - WINDOW_MAX_M) else { return };
        while self.heard.front().is_some_and(|heard| heard.at.way_m < oldest_m) {
            self.heard.pop_front();
        }
        while self.seen.front().is_some_and(|seen| seen.at.way_m < oldest_m) {
            self.seen.pop_front();
        }
    }

    /// How far the robot had come at a stamp since the odometry leapt last, in steps of `every_m`: how many, and when the last of them was
    /// done.
    pub(crate) fn step_before(&self, stamp_ns: u64, every_m: f64) -> Option<(i64, u64)> {
        let now = self.at(stamp_ns)?;
        let step = (now.way_m / every_m).floor();
        let reached = |moment: &&Moment| moment.way_m >= step * every_m && moment.piece == now.piece;
        // Not farther back than is remembered however far the sensor is ahead.
        let until = self.track.partition_point(|moment| moment.stamp_ns <= stamp_ns);
        let first = self.track.range(until.saturating_sub(LOOKED_BACK)..until).find(reached)?;
        (first.stamp_ns <= stamp_ns).then_some((step as i64, first.stamp_ns))
    }

    /// How the robot went between two stamps: it at the later, seen from it at the earlier.
    pub(crate) fn between(&self, from_ns: u64, to_ns: u64, scales: Scales) -> Option<Pose2> {
        let (first, last) = (self.at(from_ns)?, self.at(to_ns)?);
        let within = |moment: &&Moment| moment.stamp_ns > from_ns && moment.stamp_ns < to_ns;
        let steps = self.track.iter().filter(within).chain([&last]);
        let (pose, _) = steps.fold((Pose2::IDENTITY, first), |(pose, before), next| {
            let step = Increment::between(before.odom_from_base, next.odom_from_base);
            (move_by(pose, scales.correct(step)), *next)
        });
        (first.piece == last.piece).then_some(pose)
    }

    /// What was heard and seen on the last `window_m` metres before a stamp, and by how much of `scales` the odometry measures too much.
    pub(crate) fn piece(&self, stamp_ns: u64, window_m: f64, seen_m: f64, scales: Scales) -> Option<Piece> {
        let now = self.at(stamp_ns)?;
        let robot = self.robot.as_ref()?;
        let is_of = |at: &Moment, metres: f64| {
            at.stamp_ns <= stamp_ns && at.piece == now.piece && at.way_m > now.way_m - metres
        };
        let trail = Trail { scales, ..Trail::default() };
        let mut piece = Piece { trail, way_m: (now.way_m - now.leapt_m).min(window_m), ..Piece::default() };
        let half_m = now.way_m - 0.5 * piece.way_m;
        let mut later = now;
        for heard in self.heard.iter().rev().filter(|heard| is_of(&heard.at, window_m)) {
            let Some(sonar) = robot.transducer(heard.transducer) else { continue };
            piece.trail.older += usize::from(heard.at.way_m < half_m);
            if later != heard.at || piece.trail.stops.is_empty() {
                let step = Increment::between(heard.at.odom_from_base, later.odom_from_base);
                piece.trail.stops.push(Stop { step, echoes: Vec::new() });
                later = heard.at;
            }
            let echo = Echo {
                base_from_transducer: sonar.base_from_transducer,
                range_m: heard.range_m,
                range_error_ratio: sonar.range_error_ratio,
                aperture_rad: sonar.aperture_rad,
                range_cap_m: sonar.range_max_m,
            };
            piece.trail.stops.last_mut().into_iter().for_each(|stop| stop.echoes.push(echo));
        }
        let mut back = Back { at: now, now_from_base: Pose2::IDENTITY, scales };
        for seen in self.seen.iter().rev().filter(|seen| is_of(&seen.at, window_m)) {
            let Pose2 { x, y, theta } = back.to(&seen.at);
            let is_last = piece.points[0].is_empty() || is_of(&seen.at, seen_m);
            let points = &mut piece.points[usize::from(!is_last)];
            let (s, c) = libm::sincos(theta);
            for (at, normal) in seen.points.iter() {
                points.push(
                    [x + c * at[0] - s * at[1], y + s * at[0] + c * at[1]],
                    [c * normal[0] - s * normal[1], s * normal[0] + c * normal[1]],
                );
            }
        }
        Some(piece)
    }
}

/// The way back from a moment, step by step.
struct Back {
    at: Moment,
    now_from_base: Pose2,
    scales: Scales,
}

impl Back {
    /// The robot at an earlier moment, seen from the one that the way began at.
    fn to(&mut self, earlier: &Moment) -> Pose2 {
        let step = Increment::between(earlier.odom_from_base, self.at.odom_from_base);
        self.now_from_base = self.now_from_base * move_by(Pose2::IDENTITY, self.scales.correct(step)).inverse();
        self.at = *earlier;
        self.now_from_base
    }
}

#[cfg(test)]
mod tests;
