//! A robot in a world, moment by moment.

use std::collections::VecDeque;

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::{Footprint, Pose2, Robot, Vicinity, World};
use echogrid_service::{Plan, Sensor};
use echogrid_topics::{Command as Order, Message, RawOdometry, Topic, TruePose, TrueWorld};

use crate::cause::Heard;
use crate::config::{Route, SimulatorConfig};
use crate::corners::Corners;
use crate::drive::{Command, Drive, Motion, STEP_S, Script};
use crate::error::SimulatorError;
use crate::fault::Faults;
use crate::lidar::Lidar;
use crate::people::People;
use crate::record::Record;
use crate::ring::Ring;
use crate::route::Tour;
use crate::sonar::Scene;
use crate::{OUTPUTS, nanoseconds, world_of};

/// No robot is told to drive (m/s) or turn (rad/s) faster.
const FASTEST: f64 = 10.0;
/// Of a robot whose footprint is not known, metres.
const UNKNOWN_RADIUS_M: f64 = 0.25;
/// What is near the robot is looked up anew when it has gone so far, metres.
const VICINITY_M: f64 = 0.5;

/// What decides where the robot goes.
#[derive(Debug)]
enum Pilot {
    Tour(Box<Tour>),
    Script { motions: VecDeque<Motion>, now: Option<Script> },
    Commands { v_mps: f64, w_radps: f64 },
}

/// A simulated robot.
#[derive(Debug)]
pub struct Simulator {
    world: World,
    world_name: String,
    corners: Corners,
    vicinity: Vicinity,
    /// What the sonars may hear is within so far of the robot, metres.
    reach_m: f64,
    people: People,
    drive: Drive,
    pilot: Pilot,
    robot_radius_m: f64,
    ring: Option<Ring>,
    faults: Faults,
    lidar: Option<Lidar>,
    record: Option<Record>,

    /// Goes out first.
    robot: Option<Robot>,
    /// Of one moment.
    waiting: VecDeque<(u64, Message)>,
    started: bool,
    now_ns: u64,
    /// No scan begins after this.
    ends_ns: Option<u64>,
    odometry_ns: Timer,
    ring_ns: Timer,
    lidar_ns: Timer,
    last_scan_ns: u64,
    /// The pose that the odometry told last.
    odom_from_base: Pose2,
    last_heard: LastHeard,
    /// The drive is over; odometry goes on until it is past the last scan.
    ending: bool,
    ended: bool,
}

/// Which scan came last.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LastHeard {
    Nothing,
    Ring,
    Lidar,
}

/// Something that happens again and again.
#[derive(Debug, Clone, Copy)]
struct Timer {
    period_ns: u64,
    next_ns: u64,
}

impl Timer {
    fn every(period_ns: u64) -> Self {
        Self { period_ns: period_ns.max(1), next_ns: 0 }
    }

    fn never() -> Self {
        Self { period_ns: 1, next_ns: u64::MAX }
    }

    /// Whether it is time; then it is set anew.
    fn rings(&mut self, now_ns: u64) -> bool {
        let rings = now_ns >= self.next_ns;
        if rings {
            self.next_ns += self.period_ns;
        }
        rings
    }
}

impl Simulator {
    /// The robot of a configuration in its world, along its route. (`config.world` is a name only, for errors
    /// and for whoever wants to know.)
    ///
    /// # Errors
    /// A value out of its range, a route that can't be driven, a start without room, a record that can't be written.
    pub fn new(config: &SimulatorConfig, world: World, robot: Robot) -> Result<Self, SimulatorError> {
        let mut simulator = Self::standing(config, world, robot)?;
        simulator.pilot = match config.route {
            Route::Commands => Pilot::Commands { v_mps: 0.0, w_radps: 0.0 },
            Route::Tour | Route::Places(_) => Pilot::Tour(Box::new(Tour::plan(
                config,
                &simulator.world,
                simulator.drive.true_pose(),
                simulator.robot_radius_m,
            )?)),
        };
        Ok(simulator.recorded(config)?)
    }

    /// The robot of a configuration in its world, which carries out motions, one after the other, instead of its route.
    ///
    /// Where a wall is in the way it stands, and the script is over.
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn scripted(
        config: &SimulatorConfig,
        world: World,
        robot: Robot,
        motions: impl IntoIterator<Item = Motion>,
    ) -> Result<Self, SimulatorError> {
        let mut simulator = Self::standing(config, world, robot)?;
        simulator.pilot = Pilot::Script { motions: motions.into_iter().collect(), now: None };
        Ok(simulator.recorded(config)?)
    }

    /// Whether a simulation could be started: reads the world, plans the route, and writes nothing.
    ///
    /// # Errors
    /// As [`world_of`] and [`Simulator::new`].
    pub fn check(config: &SimulatorConfig, robot: Robot) -> Result<(), SimulatorError> {
        let unrecorded = SimulatorConfig { record: std::path::PathBuf::new(), ..config.clone() };
        Self::new(&unrecorded, world_of(config)?, robot).map(drop)
    }

    /// Makes the simulator from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong, or the world or the route is.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let config: SimulatorConfig = plan.section("simulator")?;
        let world = world_of(&config)?;
        Ok(Self::new(&config, world, plan.section("robot")?)?)
    }

    /// At its start, without a plan.
    fn standing(config: &SimulatorConfig, world: World, robot: Robot) -> Result<Self, SimulatorError> {
        config.validate()?;
        if robot.transducer_count() == 0 {
            return Err(SimulatorError::NoSensor { robot: robot.name });
        }
        let robot_radius_m = radius_m(robot.footprint);
        let start = start(config, &world, robot_radius_m)?;
        let ring = Ring::new(config, &robot)?;
        let lidar = Lidar::new(config, &robot);
        let faults = Faults::new(&config.faults, &robot, config.seed)?;
        if ring.is_none() && lidar.is_none() {
            return Err(SimulatorError::NoSensor { robot: robot.name });
        }
        let reach_m = ring.as_ref().map_or(0.0, Ring::reach_m);
        Ok(Self {
            vicinity: Vicinity::of(&world, [start.x, start.y], reach_m + VICINITY_M),
            reach_m,
            corners: Corners::of(&world, ring.as_ref().map_or(1.0, |ring| ring.range_max_m() + robot_radius_m)),
            people: People::new(&world.parts().people, config.seed),
            drive: Drive::new(config, start),
            pilot: Pilot::Commands { v_mps: 0.0, w_radps: 0.0 },
            robot_radius_m,
            record: None,
            robot: Some(robot),
            waiting: VecDeque::new(),
            started: false,
            now_ns: 0,
            ends_ns: (config.duration_s > 0.0).then(|| nanoseconds(config.duration_s)),
            odometry_ns: Timer::every(nanoseconds(config.odometry_period_s)),
            ring_ns: ring.as_ref().map_or(Timer::never(), |ring| Timer::every(ring.period_ns())),
            lidar_ns: lidar.as_ref().map_or(Timer::never(), |lidar| Timer::every(lidar.period_ns())),
            last_scan_ns: 0,
            odom_from_base: start,
            last_heard: LastHeard::Nothing,
            ending: false,
            ended: false,
            world_name: config.world.clone(),
            world,
            ring,
            faults,
            lidar,
        })
    }

    fn recorded(mut self, config: &SimulatorConfig) -> Result<Self, echogrid_formats::WriteError> {
        let offsets_ns = match (&self.ring, &self.robot) {
            (Some(ring), Some(robot)) => ring.offsets_ns(robot),
            _ => Vec::new(),
        };
        if let Some(robot) = &self.robot {
            self.record = Record::begin(&config.record, robot, &offsets_ns)?;
        }
        Ok(self)
    }

    /// Where the robot really is, map frame, at the stamp of the last message.
    #[must_use]
    pub fn true_pose(&self) -> Pose2 {
        self.drive.true_pose()
    }

    /// Where its odometry believed that it is, when it last told.
    #[must_use]
    pub fn odometry_pose(&self) -> Pose2 {
        self.odom_from_base
    }

    /// The simulated time, nanoseconds since the start.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The truth about each reading of the last scan, in its order.
    #[must_use]
    pub fn last_causes(&self) -> &[Heard] {
        match (self.last_heard, &self.ring, &self.lidar) {
            (LastHeard::Ring, Some(ring), _) => &ring.heard,
            (LastHeard::Lidar, _, Some(lidar)) => &lidar.heard,
            _ => &[],
        }
    }

    /// The places of the route that were given up because something was in the way.
    #[must_use]
    pub fn given_up(&self) -> &[String] {
        match &self.pilot {
            Pilot::Tour(tour) => &tour.given_up,
            Pilot::Script { .. } | Pilot::Commands { .. } => &[],
        }
    }

    /// Where everybody is who walks about: centre and radius, metres, map frame.
    pub fn people(&self) -> impl Iterator<Item = ([f64; 2], f64)> {
        self.people.discs().iter().map(|disc| (disc.centre, disc.radius_m))
    }

    /// From now on the robot drives at this speed, as far as its acceleration lets it and no wall is in the way: m/s and
    /// rad/s. What it was about before is forgotten.
    pub fn set_velocity(&mut self, v_mps: f64, w_radps: f64) {
        let sound = |value: f64| if value.is_finite() { value } else { 0.0 };
        self.pilot = Pilot::Commands { v_mps: sound(v_mps), w_radps: sound(w_radps) };
    }

    /// Goes on to the next moment at which something happens, and lets it happen.
    fn advance(&mut self) -> Result<()> {
        if self.started {
            let next_ns = self.odometry_ns.next_ns.min(self.ring_ns.next_ns).min(self.lidar_ns.next_ns);
            let next_ns = next_ns.min(self.now_ns + nanoseconds(STEP_S));
            let dt_s = (next_ns - self.now_ns) as f64 * 1e-9;
            self.now_ns = next_ns;
            self.people.step(dt_s, position(self.drive.true_pose()), self.robot_radius_m);
            self.drive_on(dt_s);
        }
        self.started = true;
        self.happen()
    }

    /// All that falls on this moment.
    fn happen(&mut self) -> Result<()> {
        let now_ns = self.now_ns;
        if self.odometry_ns.rings(now_ns) {
            self.tell_odometry().context("recording the drive")?;
        }
        if self.ending || self.ends_ns.is_some_and(|ends_ns| now_ns > ends_ns) {
            self.ending = true;
            (self.ring_ns, self.lidar_ns) = (Timer::never(), Timer::never());
            return Ok(());
        }
        let fires = self.ring_ns.rings(now_ns);
        let scans = self.lidar_ns.rings(now_ns);
        if !fires && !scans {
            return Ok(());
        }
        let map_from_base = self.drive.true_pose();
        let corners = if fires { self.corners.near(position(map_from_base)) } else { &[] };
        if fires && !self.vicinity.covers(position(map_from_base), self.reach_m) {
            self.vicinity = Vicinity::of(&self.world, position(map_from_base), self.reach_m + VICINITY_M);
        }
        let scene = Scene { world: &self.world, vicinity: &self.vicinity, corners, people: self.people.discs() };
        let ring = self.ring.as_mut().filter(|_| fires).and_then(|ring| {
            let mut readings = ring.fire(&scene, map_from_base)?;
            self.faults.spoil(now_ns, &mut readings, &mut ring.heard);
            Some(readings)
        });
        let lidar = self.lidar.as_mut().filter(|_| scans).map(|lidar| lidar.scan(&scene, map_from_base));
        for (readings, heard) in [(ring, LastHeard::Ring), (lidar, LastHeard::Lidar)] {
            let Some(readings) = readings else { continue };
            if let Some(record) = &mut self.record {
                record.scan(now_ns, &readings).context("recording the drive")?;
            }
            self.last_heard = heard;
            self.last_scan_ns = now_ns;
            self.waiting.push_back((now_ns, Message::Scan(readings)));
        }
        Ok(())
    }

    fn tell_odometry(&mut self) -> Result<(), echogrid_formats::WriteError> {
        let map_from_base = self.drive.true_pose();
        let odom_from_base = self.drive.odometry_pose();
        self.odom_from_base = odom_from_base;
        let (v_mps, w_radps) = (self.drive.v_mps(), self.drive.w_radps());
        let odometry = RawOdometry { odom_from_base, v_mps, w_radps };
        if let Some(record) = &mut self.record {
            record.odometry(self.now_ns, &odometry)?;
            record.true_pose(self.now_ns, map_from_base)?;
        }
        let truth = TruePose { map_from_base: Some(map_from_base) };
        self.waiting.push_back((self.now_ns, Message::TruePose(truth)));
        self.waiting.push_back((self.now_ns, Message::Odometry(odometry)));
        // Past the last scan, so that each of its readings lies between two poses.
        self.ended = self.ending && self.now_ns > self.last_scan_ns;
        Ok(())
    }

    fn drive_on(&mut self, dt_s: f64) {
        let command = match self.next_command(dt_s) {
            Some(command) => command,
            None => {
                self.ending = true;
                self.drive.halt();
                Command::default()
            }
        };
        // Nothing drives into a wall: the robot stands before it. Turning on the spot takes no more room.
        let (ahead_m, _) = self.drive.next_step(command, dt_s);
        if ahead_m != 0.0 && self.would_touch(ahead_m) {
            self.drive.halt();
            match &mut self.pilot {
                Pilot::Tour(tour) => tour.stalled(&self.drive, dt_s),
                Pilot::Script { motions, now } => {
                    motions.clear();
                    *now = None;
                }
                Pilot::Commands { w_radps, .. } => {
                    let w_radps = *w_radps;
                    self.drive.step(Command { w_radps, ..Command::default() }, dt_s);
                }
            }
            return;
        }
        self.drive.step(command, dt_s);
    }

    /// Whether a step would bring the robot nearer to a wall than its radius allows.
    fn would_touch(&self, ahead_m: f64) -> bool {
        let here = self.drive.true_pose();
        let there = here * Pose2::new(ahead_m, 0.0, 0.0);
        let clearance_m = |pose: Pose2| self.world.clearance_m(position(pose), self.robot_radius_m);
        let next_m = clearance_m(there);
        next_m < self.robot_radius_m && next_m <= clearance_m(here)
    }

    /// What the robot is told next; none: it has done all that it was to do.
    fn next_command(&mut self, dt_s: f64) -> Option<Command> {
        if self.ending {
            return None;
        }
        match &mut self.pilot {
            Pilot::Tour(tour) => tour.next(&self.drive, self.people.discs(), dt_s),
            Pilot::Commands { v_mps, w_radps } => {
                Some(Command { v_mps: *v_mps, w_radps: *w_radps, at_most_m: None, at_most_rad: None })
            }
            Pilot::Script { motions, now } => loop {
                if let Some(command) = now.as_mut().and_then(|now| now.next(&self.drive, dt_s)) {
                    return Some(command);
                }
                *now = Some(Script::new(motions.pop_front()?, &self.drive));
            },
        }
    }
}

impl Sensor for Simulator {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        if let Some(robot) = self.robot.take() {
            let world = TrueWorld { name: self.world_name.clone(), bounds_m: self.world.bounds_m() };
            self.waiting.push_front((0, Message::TrueWorld(world)));
            return Ok(Some((0, Message::Robot(robot))));
        }
        loop {
            if let Some(message) = self.waiting.pop_front() {
                return Ok(Some(message));
            }
            if self.ended {
                if let Some(record) = self.record.take() {
                    record.finish().context("recording the drive")?;
                }
                return Ok(None);
            }
            self.advance()?;
        }
    }

    fn command(&mut self, command: Order) -> Result<String> {
        let Order::Drive { v_mps, w_radps } = command else { bail!("this sensor has nothing to {}", command.word()) };
        ensure!(v_mps.abs() <= FASTEST, "speed {v_mps} m/s: expected at most {FASTEST} m/s either way");
        ensure!(w_radps.abs() <= FASTEST, "turn rate {w_radps} rad/s: expected at most {FASTEST} rad/s either way");
        self.set_velocity(v_mps, w_radps);
        Ok(format!("drives at {v_mps} m/s and {w_radps} rad/s, as far as walls let it"))
    }
}

fn position(pose: Pose2) -> [f64; 2] {
    [pose.x, pose.y]
}

/// Half the diagonal: what it takes to turn on the spot.
fn radius_m(footprint: Footprint) -> f64 {
    let radius_m = 0.5 * libm::hypot(footprint.length_m, footprint.width_m);
    if radius_m > 0.0 { radius_m } else { UNKNOWN_RADIUS_M }
}

/// Where the drive starts, with room for the robot.
fn start(config: &SimulatorConfig, world: &World, radius_m: f64) -> Result<Pose2, SimulatorError> {
    let start = match config.start.as_slice() {
        [x, y, heading_deg @ ..] => {
            let heading_deg = heading_deg.first().copied().unwrap_or(0.0);
            Pose2::new(*x, *y, heading_deg * core::f64::consts::PI / 180.0)
        }
        _ => world.parts().places.home.ok_or_else(|| SimulatorError::NoStart { world: config.world.clone() })?,
    };
    let nearest_m = world.clearance_m(position(start), radius_m);
    if nearest_m < radius_m {
        let (world, Pose2 { x, y, .. }) = (config.world.clone(), start);
        return Err(SimulatorError::StartTooNear { world, x, y, nearest_m, radius_m });
    }
    Ok(start)
}
