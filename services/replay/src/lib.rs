//! A recorded drive as a sensor of the graph.

pub mod config;
mod truth;

use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use config::ReplayConfig;
use echogrid_core::Robot;
use echogrid_formats::log::{self, LogEvent, LogSurvey};
use echogrid_formats::map::Provenance;
use echogrid_service::{Declaration, Plan, Sensor, process};
use echogrid_topics::{Message, RawOdometry, Topic, TruePose};
use truth::Ahead;

/// The topics that the replay writes.
pub const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::TruePose, Topic::OdometryRaw, Topic::RangeScan];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &[], writes: OUTPUTS, orders: &[] };

/// A sensor that plays a log.
#[derive(Debug)]
pub struct Replay {
    /// Goes out first.
    robot: Option<Robot>,
    survey: LogSurvey,
    events: Ahead,
    /// The odometry whose true pose went out just now.
    waiting: Option<(u64, Message)>,
}

impl Replay {
    /// Plays the log that the configuration names; `robot`, if given, is believed over what the
    /// log says of its sensors.
    ///
    /// # Errors
    /// The log can't be read, or nothing can be mapped from it.
    pub fn new(config: &ReplayConfig, robot: Option<Robot>) -> Result<Self> {
        let survey = log::survey_with(&config.log, config.survey_options())?;
        let events = Ahead::new(log::open(&config.log, &survey)?);
        let robot = Some(robot.unwrap_or_else(|| survey.robot.clone()));
        Ok(Self { robot, survey, events, waiting: None })
    }

    /// Makes the replay from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong, or the log is.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let robot = plan.config.contains_key("robot").then(|| plan.section("robot")).transpose()?;
        let config: ReplayConfig = plan.section("replay")?;
        let replay = Self::new(&config, robot)?;
        // In a later life of this process, too, it must be what was surveyed before the start.
        let surveyed: Provenance = plan.section("provenance")?;
        ensure!(
            surveyed.log_sha256.is_none_or(|sha256| sha256 == replay.survey.sha256),
            "{}: is not what it was when the run began; a log must stay as it is while it is played",
            config.log.display()
        );
        Ok(replay)
    }
}

impl Replay {
    /// Whether the log says where the robot really was.
    fn knows_truth(&self) -> bool {
        self.survey.true_pose_count > 0
    }
}

impl Sensor for Replay {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        if let Some(robot) = self.robot.take() {
            return Ok(Some((self.survey.first_stamp_ns, Message::Robot(robot))));
        }
        if let Some(odometry) = self.waiting.take() {
            return Ok(Some(odometry));
        }
        while let Some(event) = self.events.next().context("reading the log")? {
            match event {
                LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps } => {
                    let odometry = (stamp_ns, Message::Odometry(RawOdometry { odom_from_base, v_mps, w_radps }));
                    if !self.knows_truth() {
                        return Ok(Some(odometry));
                    }
                    self.waiting = Some(odometry);
                    let map_from_base = self.events.truth_at(stamp_ns).context("reading the log")?;
                    return Ok(Some((stamp_ns, Message::TruePose(TruePose { map_from_base }))));
                }
                LogEvent::Scan { stamp_ns, readings } => return Ok(Some((stamp_ns, Message::Scan(readings)))),
                // Given with the odometry, at its stamps.
                LogEvent::TruePose { .. } => {}
            }
        }
        Ok(None)
    }

    fn total(&self) -> Option<u64> {
        let true_poses = if self.knows_truth() { self.survey.odometry_count } else { 0 };
        Some(self.survey.odometry_count + true_poses + self.survey.scan_count + 1)
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run_sensor("replay", OUTPUTS, Replay::from_plan)
}
