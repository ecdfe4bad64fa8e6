//! Lines as messages.

use core::time::Duration;
use std::collections::VecDeque;

use anyhow::{Context, Result};
use echogrid_core::Robot;
use echogrid_formats::log::LogEvent;
use echogrid_formats::log::carmen::{LineStream, RangeUnit};
use echogrid_service::live_clock::LiveClock;
use echogrid_service::plan::SERVICE_VARIABLE;
use echogrid_service::{Plan, Sensor};
use echogrid_topics::{Message, RawOdometry, Topic, TruePose};

use crate::OUTPUTS;
use crate::program::{Binder, Called, Printed, Program};

/// How long a line is waited for before heartbeats are due.
const PATIENCE: Duration = Duration::from_millis(50);

/// A program that prints lines, as a sensor.
#[derive(Debug)]
pub struct Lines {
    /// None when it is told to end.
    program: Option<Program>,
    stream: LineStream,
    replays: bool,
    /// Stamps of a program that replays never run backwards either.
    clock: LiveClock,
    is_described: bool,
    has_ended: bool,
    messages: VecDeque<(u64, Message)>,
}

impl Lines {
    /// Starts a program. `name` is who prints, in what is said of its lines; `replays` says that it prints the same whenever it is
    /// started; `robot`, if given, is believed over what the lines say of the sensors.
    ///
    /// # Errors
    /// It can't be started.
    pub fn start(name: &str, replays: bool, robot: Option<Robot>, binder: &Binder, called: &Called) -> Result<Self> {
        Ok(Self {
            program: Some(Program::start(binder, called, !replays)?),
            stream: LineStream::new(name, RangeUnit::Metres, robot),
            replays,
            clock: LiveClock::default(),
            is_described: false,
            has_ended: false,
            messages: VecDeque::new(),
        })
    }

    /// Makes the sensor from the plan of a run.
    ///
    /// # Errors
    /// A section is wrong, or the program can't be started.
    pub fn from_plan(plan: &Plan, replays: bool, binder: &Binder, called: &Called) -> Result<Self> {
        let robot = plan.config.contains_key("robot").then(|| plan.section("robot")).transpose()?;
        let name = std::env::var(SERVICE_VARIABLE).unwrap_or_else(|_| "sensor".to_owned());
        let mut lines = Self::start(&name, replays, robot.clone(), binder, called)?;
        if !plan.writes(&name, Topic::RangeScan) {
            let robot = robot.context("its lines say nothing of sensors here: run.robot must name the robot's file")?;
            lines.stream = LineStream::of_odometry(&name, robot);
        }
        Ok(lines)
    }

    /// Reads on, and waits a little where there is nothing to read.
    fn pump(&mut self) -> Result<()> {
        let printed = match &mut self.program {
            Some(program) => program.next_line(PATIENCE)?,
            None => Printed::End,
        };
        match printed {
            Printed::Line(line) => self.stream.push(line)?,
            Printed::Nothing => return Ok(()),
            Printed::End => {
                self.has_ended = true;
                self.stream.finish()?;
                for fault in self.stream.faults() {
                    tracing::warn!("lines: {fault}");
                }
            }
        }
        for fault in self.stream.new_faults().into_iter().filter(|_| !self.has_ended) {
            tracing::warn!("line {}: {}: \"{}\"", fault.first_line, fault.kind, fault.sample);
        }
        while let Some(event) = self.stream.pop() {
            self.event(event);
        }
        Ok(())
    }

    fn event(&mut self, event: LogEvent) {
        let stamp_ns = event.stamp_ns();
        if !self.is_described
            && let Some(robot) = self.stream.robot()
        {
            self.is_described = true;
            self.messages.push_back((stamp_ns, Message::Robot(robot.clone())));
        }
        let message = match event {
            LogEvent::Odometry { odom_from_base, v_mps, w_radps, .. } => {
                Message::Odometry(RawOdometry { odom_from_base, v_mps, w_radps })
            }
            LogEvent::Scan { readings, .. } => Message::Scan(readings),
            LogEvent::TruePose { map_from_base, .. } => {
                Message::TruePose(TruePose { map_from_base: Some(map_from_base) })
            }
        };
        let stamp_ns = if self.replays { self.clock.stamp_ns(message.topic(), stamp_ns) } else { stamp_ns };
        self.messages.push_back((stamp_ns, message));
    }
}

impl Sensor for Lines {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_live(&self) -> bool {
        !self.replays
    }

    fn is_ready(&mut self) -> Result<bool> {
        if self.messages.is_empty() && !self.has_ended {
            self.pump()?;
        }
        Ok(!self.messages.is_empty() || self.has_ended)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        while self.messages.is_empty() && !self.has_ended {
            self.pump()?;
        }
        Ok(self.messages.pop_front())
    }

    fn close(&mut self) {
        self.program = None;
        self.has_ended = true;
    }

    fn note(&self) -> String {
        let faults = self.stream.faults();
        let count: u64 = faults.iter().map(|fault| fault.count).sum();
        match faults.iter().min_by_key(|fault| fault.first_line) {
            None => String::new(),
            Some(first) => format!("{count} lines or readings left out or doubtful; {first}"),
        }
    }
}
