//! A robot that walks down a corridor, and may have something wrong with it.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use echogrid_core::{Echo, Footprint, Pose2, Reading, Robot, Sensor as Sonar, SensorKind};
use echogrid_service::{Sensor, process};
use echogrid_topics::{Message, RawOdometry, Topic};

use super::halt::Ear;
use super::{GATE_VARIABLE, Mode, WORLD_VARIABLE, go_deaf, strike};

/// Steps of the walk.
pub const STEPS: u64 = 400;
/// Messages of a good walk: the robot, and a pose and a scan per step.
pub const MESSAGES: u64 = 1 + 2 * STEPS;
/// A garbled pose comes before every so many steps.
pub const GARBLED_EVERY: u64 = 20;
pub(super) const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];

/// Between two looks at a gate.
const LOOK_EVERY: Duration = Duration::from_millis(5);
const STEP_NS: u64 = 100_000_000;
const STEP_M: f64 = 0.02;
/// From the axis of the corridor to its walls.
const WALL_M: f64 = 1.0;

/// Two sonars, one to each side.
pub(super) fn robot() -> Robot {
    let sonar = |(number, bearing)| Sonar {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.0, bearing),
        first_transducer: number,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: FRAC_PI_6,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    let sensors = [(0, FRAC_PI_2), (1, -FRAC_PI_2)].map(sonar).into();
    Robot { name: "corridor walker".into(), footprint: Footprint { length_m: 0.5, width_m: 0.5 }, sensors }
}

/// A pose that many steps down the corridor.
pub(super) fn odometry(step: u64) -> (u64, Message) {
    let odom_from_base = Pose2::new(STEP_M * step as f64, 0.0, 0.0);
    (step * STEP_NS, Message::Odometry(RawOdometry { odom_from_base, v_mps: 0.2, w_radps: 0.0 }))
}

/// What is heard there.
pub(super) fn scan(step: u64) -> (u64, Message) {
    let hit = |transducer| Reading { transducer, echo: Echo::Hit { range_m: WALL_M }, offset_ns: 0 };
    (step * STEP_NS, Message::Scan([0, 1].map(hit).into()))
}

/// A pose that nobody can use, of three kinds in turn.
pub(super) fn garbled(step: u64) -> (u64, Message) {
    let x = match step / GARBLED_EVERY % 3 {
        0 => f64::NAN,
        1 => 1e9,
        _ => STEP_M,
    };
    // The third could be one, but is of the past.
    let stamp_ns = if x == STEP_M { 1 } else { step * STEP_NS };
    let odom_from_base = Pose2 { x, y: 0.0, theta: 0.0 };
    (stamp_ns, Message::Odometry(RawOdometry { odom_from_base, v_mps: 0.0, w_radps: 0.0 }))
}

#[derive(Debug)]
struct Walk {
    mode: Mode,
    after: u64,
    given: u64,
    step: u64,
    outbox: VecDeque<(u64, Message)>,
    /// Holds the number of the step, whoever lives; none: every life begins at the first.
    world: Option<PathBuf>,
    /// Tells when to halt; none: after [`STEPS`].
    ear: Option<Ear>,
    /// What it waits for after the messages before it.
    gate: Option<PathBuf>,
}

impl Sensor for Walk {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_live(&self) -> bool {
        self.mode == Mode::Live
    }

    fn is_ready(&mut self) -> Result<bool> {
        let is_shut = self.given >= self.after && self.gate.as_ref().is_some_and(|gate| !gate.exists());
        if is_shut {
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(!is_shut)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        // What a live sensor has measured is given before it dies: who measures a step and tells nobody loses it.
        if self.given >= self.after && (self.world.is_none() || self.outbox.is_empty()) {
            strike(self.mode);
        }
        let goes_on = match &mut self.ear {
            Some(ear) => !ear.was_told()?,
            None => self.step < STEPS,
        };
        if self.outbox.is_empty() && goes_on {
            self.step += 1;
            if let Some(world) = &self.world {
                fs::write(world, self.step.to_string()).with_context(|| world.display().to_string())?;
            }
            self.outbox.extend([odometry(self.step), scan(self.step)]);
            if self.mode == Mode::Garbage && self.step.is_multiple_of(GARBLED_EVERY) {
                self.outbox.push_back(garbled(self.step));
            }
        }
        self.given += 1;
        Ok(self.outbox.pop_front())
    }
}

pub(super) fn run(mode: Mode, after: u64) -> ExitCode {
    process::run_sensor("fault", OUTPUTS, |plan| {
        if mode == Mode::IgnoresSigterm {
            go_deaf();
        }
        let world = if mode == Mode::Live { Some(world()?) } else { None };
        let step = world.as_deref().map_or(Ok(0), steps_done)?;
        let ear = (mode == Mode::WalksUntilTold).then(|| Ear::open(plan)).transpose()?;
        let gate = std::env::var_os(GATE_VARIABLE).map(PathBuf::from).filter(|_| mode == Mode::Gated);
        let outbox = VecDeque::from([(0, Message::Robot(robot()))]);
        Ok(Walk { mode, after, given: 0, step, outbox, world, ear, gate })
    })
}

fn world() -> Result<PathBuf> {
    std::env::var_os(WORLD_VARIABLE).map(PathBuf::from).with_context(|| format!("{WORLD_VARIABLE} is not set"))
}

/// What this file says; no step if it is not there.
fn steps_done(world: &Path) -> Result<u64> {
    match fs::read_to_string(world) {
        Ok(step) => step.trim().parse().with_context(|| format!("{}: {step:?}", world.display())),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(0),
        Err(error) => Err(error).with_context(|| world.display().to_string()),
    }
}
