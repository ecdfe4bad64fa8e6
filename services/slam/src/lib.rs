//! SLAM in the place of the odometry: raw odometry and what lidars see, or sonars hear, in; corrected pose estimates out.
//!
//! Where a closure shows that the robot is where it was before, poses of the past are others than they were believed to be. So the
//! estimates go out when the drive is over, all but the first, and the mapper makes the map at once of the final poses: what it makes
//! has the bytes of mapping the log from scratch with them. (Of a drive of kilometres they go out once they are settled.) A robot with a lidar is corrected by that, one without by its sonars; where
//! sonars recognise nothing, the estimates are those of the odometry.

mod files;
mod history;
mod saving;
mod sonars;
mod telling;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{
    DrivePose, Estimate, Incidents, Leaps, MapperConfig, Odometry, OdometryConfig, Pose2, Reading, Robot, SensorKind,
};
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, process};
use echogrid_slam::report::Report;
use echogrid_slam::{Drive, Points, Slam, SlamConfig};
use echogrid_topics::{Message, PoseEstimate, RawOdometry, Topic};
use history::History;
use serde::{Deserialize, Serialize};
use sonars::Sonars;
use telling::{Telling, told};

use files::Written;
pub use files::{CLOSURES_FILE, COVARIANCE_FILE, FILES, GRAPH_FILE, PATH_FILE};

/// What it reads.
pub const INPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];
/// What it writes.
pub const OUTPUTS: &[Topic] = &[Topic::OdometryEstimate];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: INPUTS, looks_on: &[], writes: OUTPUTS, orders: &[] };

/// Of so many poses at most it is told how sure they are.
const DOUBTS: usize = 500;

/// A scan whose pose is not known yet.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Scan {
    stamp_ns: u64,
    readings: Vec<Reading>,
}

impl Scan {
    /// When its last reading was taken.
    fn end_ns(&self) -> u64 {
        let last = self.readings.iter().map(|reading| reading.offset_ns).max().unwrap_or(0);
        self.stamp_ns.saturating_add_signed(i64::from(last.max(0)))
    }
}

/// What the messages so far have come to, besides the drive.
#[derive(Debug)]
struct State {
    robot: Option<Robot>,
    odometry: Odometry,
    leaps: Leaps,
    leapt: Incidents,
    history: History,
    waiting: VecDeque<Scan>,
    telling: Telling,
}

/// The SLAM service.
#[derive(Debug)]
pub struct SlamService {
    slam: Slam,
    sonars: Sonars,
    state: State,
    /// Where the files go; none in tests.
    out: Option<PathBuf>,
}

/// The part of `[run]` that it needs.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
}

impl SlamService {
    /// From the configuration; files are written where `out` says.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(
        config: &SlamConfig,
        odometry: &OdometryConfig,
        mapper: &MapperConfig,
        out: Option<PathBuf>,
    ) -> Result<Self> {
        config.validate().context("[slam]")?;
        odometry.validate().context("[odometry]")?;
        mapper.validate().context("[mapper]")?;
        let state = State {
            robot: None,
            odometry: Odometry::new(odometry),
            leaps: Leaps::default(),
            leapt: Incidents::default(),
            history: History::default(),
            waiting: VecDeque::new(),
            telling: Telling::default(),
        };
        let sonars = Sonars::new(config, odometry, mapper);
        Ok(Self { slam: Slam::new(config, odometry), sonars, state, out })
    }

    /// From the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let run: Run = plan.section("run")?;
        Self::new(&plan.section("slam")?, &plan.section("odometry")?, &plan.section("mapper")?, Some(run.out))
    }

    fn moved(&mut self, stamp_ns: u64, raw: &RawOdometry, out: &mut Outbox) {
        let RawOdometry { odom_from_base, v_mps, w_radps } = *raw;
        if !odom_from_base.is_finite() {
            return;
        }
        let driven = DrivePose { stamp_ns, odom_from_base, v_mps, w_radps };
        let state = &mut self.state;
        let estimate = match state.leaps.next(driven) {
            Some(leap) => {
                state.leapt.add(stamp_ns, leap.length_m, leap.turn_rad);
                self.sonars.leapt(&leap);
                state.odometry.leapt(odom_from_base, &leap)
            }
            None => state.odometry.step(odom_from_base),
        };
        self.sonars.moved(driven);
        state.history.push(stamp_ns, estimate.pose);
        self.tell_first(out);
        self.take_bracketed(out);
    }

    /// Tells the first estimate, once it is known who drives. (That something comes shows that the service works.)
    fn tell_first(&mut self, out: &mut Outbox) {
        let Some((robot, (stamp_ns, pose))) = self.state.robot.as_ref().zip(self.state.history.first()) else { return };
        if self.state.telling.begins() {
            let first = if has_lidar(robot) {
                told(pose, 0.0, self.state.leapt)
            } else {
                PoseEstimate::plain(Estimate::certain(pose), 1.0, 0.0)
            };
            out.send(stamp_ns, Message::Estimate(first));
        }
    }

    /// Takes every waiting scan whose poses are known by now.
    fn take_bracketed(&mut self, out: &mut Outbox) {
        let reached_ns = self.state.history.latest_ns();
        while self.state.waiting.front().is_some_and(|scan| Some(scan.end_ns()) <= reached_ns) {
            let Some(scan) = self.state.waiting.pop_front() else { break };
            let history = &mut self.state.history;
            let Some((robot, pose)) = self.state.robot.as_ref().zip(history.at(scan.stamp_ns)) else { continue };
            history.scanned(scan.stamp_ns);
            let at = |offset_ns: i32| history.at(scan.stamp_ns.saturating_add_signed(i64::from(offset_ns)));
            if has_sonars(robot) {
                self.sonars.heard(robot, scan.stamp_ns, pose, &scan.readings, at);
            }
            if !has_lidar(robot) || !self.slam.wants(pose) {
                continue;
            }
            // Where the robot was when a beam was measured, seen from where it was at the stamp.
            let moved = |offset_ns: i32| at(offset_ns).map_or(Pose2::IDENTITY, |at| pose.inverse() * at);
            let points = Points::of(robot, &scan.readings, moved);
            self.slam.add(scan.stamp_ns, pose, points);
            if self.slam.is_long() && !self.slam.drive.recognises_nothing() {
                self.settle(out);
            }
        }
    }

    /// Tells the poses of what was driven first, which can't change any more.
    fn settle(&mut self, out: &mut Outbox) {
        self.slam.settle();
        let settled = self.slam.drive.graph.settled as usize;
        let Some(last) = settled.checked_sub(1).and_then(|last| self.slam.drive.nodes.get(last)) else { return };
        let until_ns = last.stamp_ns;
        self.sonars.forget();
        let path = self.slam.drive.path(&self.state.history.with_scans(until_ns));
        self.state.history.forget_until(until_ns);
        self.state.telling.settled(&path, self.state.leapt, out);
    }

    /// Solves all, writes the files, and tells the poses.
    fn finish(&mut self, out: &mut Outbox) -> Result<()> {
        self.state.waiting.clear();
        if self.state.history.is_empty() {
            return Ok(());
        }
        let odom = self.state.history.with_scans(u64::MAX);
        self.slam.finish();
        if let Some(robot) = self.state.robot.as_ref().filter(|robot| self.goes_by_sonars(robot)) {
            let mut found = self.sonars.solved(robot, &odom)?;
            let Drive { nodes, lost, .. } = &self.slam.drive;
            found.report.instead_of_lidar = has_lidar(robot).then_some([*lost, nodes.len() as u64]);
            if let Some(folder) = &self.out {
                let (path, covariances) = (found.path(), found.covariances());
                files::write(
                    folder,
                    &Written { path: &path, covariances, graph: &found.graph, report: &found.report },
                )?;
            }
            let trust = |estimate: &Estimate| self.sonars.trust(robot, estimate);
            self.state.telling.tell(&found.estimates, trust, self.state.leapt, out);
            return Ok(());
        }
        if let Some(unknown) = self.slam.unknown_by_hand() {
            bail!(unknown);
        }
        let path = self.slam.drive.path(&odom);
        if let Some(folder) = &self.out {
            let (graph, report) = (&files::g2o_of(&self.slam.drive), &Report::of(&self.slam));
            let path: Vec<(u64, Pose2)> = self.state.telling.path().chain(path.iter().copied()).collect();
            files::write(folder, &Written { path: &path, covariances: self.slam.doubts(DOUBTS), graph, report })?;
        }
        self.state.telling.tell_poses(&path, self.state.leapt, out);
        Ok(())
    }
}

impl SlamService {
    /// Whether the sonars correct the drive: there is no lidar, or it recognised nothing.
    fn goes_by_sonars(&self, robot: &Robot) -> bool {
        let is_settled = self.slam.drive.graph.settled > 0;
        !has_lidar(robot) || !is_settled && has_sonars(robot) && self.slam.drive.recognises_nothing()
    }
}

/// Whether SLAM goes by a lidar of this robot, as long as that recognises anything.
fn has_lidar(robot: &Robot) -> bool {
    robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Lidar)
}

fn has_sonars(robot: &Robot) -> bool {
    robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Sonar)
}

impl Service for SlamService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { message: Message::Robot(robot), .. } => {
                ensure!(!robot.sensors.is_empty(), "robot {:?} has no sensor, and SLAM needs one", robot.name);
                if !has_sonars(&robot) {
                    self.sonars.forget();
                }
                self.state.robot.get_or_insert(robot);
                self.tell_first(out);
            }
            Input::Message { stamp_ns, message: Message::Odometry(raw), .. } => self.moved(stamp_ns, &raw, out),
            Input::Message { stamp_ns, message: Message::Scan(readings), .. } => {
                self.state.waiting.push_back(Scan { stamp_ns, readings });
                self.take_bracketed(out);
            }
            Input::Message { .. } => {}
            Input::Finish => self.finish(out)?,
        }
        Ok(())
    }

    fn save(&mut self, parts: &mut Parts) {
        // The inherent one.
        Self::save(self, parts);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        Self::restore(self, saved)
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("slam", INPUTS, OUTPUTS, SlamService::from_plan)
}

#[cfg(test)]
mod tests;
