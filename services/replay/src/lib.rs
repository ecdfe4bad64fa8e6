//! A recorded drive as a sensor of the graph.

pub mod config;

use std::process::ExitCode;

use anyhow::{Context, Result};
use config::ReplayConfig;
use echogrid_core::Robot;
use echogrid_formats::log::{self, LogEvent, LogReader, LogSurvey};
use echogrid_service::{Plan, Sensor, process};
use echogrid_topics::{Message, RawOdometry, Topic};

/// What it writes.
pub const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];

/// Plays a log.
#[derive(Debug)]
pub struct Replay {
    /// Goes out first.
    robot: Option<Robot>,
    survey: LogSurvey,
    events: LogReader,
}

impl Replay {
    /// Plays the log that the configuration names; `robot`, if given, is believed over what the
    /// log says of its sensors.
    ///
    /// # Errors
    /// The log can't be read, or nothing can be mapped from it.
    pub fn new(config: &ReplayConfig, robot: Option<Robot>) -> Result<Self> {
        let survey = log::survey(&config.log)?;
        let events = log::open(&config.log, &survey)?;
        Ok(Self { robot: Some(robot.unwrap_or_else(|| survey.robot.clone())), survey, events })
    }

    /// From the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong, or the log is.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let robot = plan.config.contains_key("robot").then(|| plan.section("robot")).transpose()?;
        Self::new(&plan.section("replay")?, robot)
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
        for event in self.events.by_ref() {
            match event.context("reading the log")? {
                LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps } => {
                    return Ok(Some((stamp_ns, Message::Odometry(RawOdometry { odom_from_base, v_mps, w_radps }))));
                }
                LogEvent::Scan { stamp_ns, readings } => return Ok(Some((stamp_ns, Message::Scan(readings)))),
                // Where the robot really was is not for the mapper to know.
                LogEvent::TruePose { .. } => {}
            }
        }
        Ok(None)
    }

    fn total(&self) -> Option<u64> {
        Some(self.survey.odometry_count + self.survey.scan_count + 1)
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run_sensor("replay", OUTPUTS, Replay::from_plan)
}
