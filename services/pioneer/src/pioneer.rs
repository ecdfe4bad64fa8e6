//! The driver: a session over a line that may be cut, as a sensor.

use core::time::Duration;
use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail, ensure};
use echogrid_arcos::{Baud, Command, Configuration, Identity, Parameters, Sip};
use echogrid_core::Robot;
use echogrid_line::{Address, Link};
use echogrid_service::{Plan, Sensor};
use echogrid_topics::{Command as Order, Message, Topic};

use crate::config::PioneerConfig;
use crate::models::{model_of, parameters_of, robot_of};
use crate::reports::Reports;
use crate::session::{Event, Out, Session, SessionSettings};
use crate::{OUTPUTS, now_ns};

/// Between two attempts to open a line.
const OPENED_AGAIN: Duration = Duration::from_millis(300);
/// A line that gives nothing but noise for so long is given up, and opened anew.
const ANSWERED_WITHIN: Duration = Duration::from_secs(30);
/// Arrivals of pieces of the stream that are remembered.
const ARRIVALS_MAX: usize = 256;
/// Between two commands to drive that say the same.
const COMMANDED_EVERY: Duration = Duration::from_millis(200);

/// A Pioneer over a line, as a sensor.
#[derive(Debug)]
pub struct Pioneer {
    config: PioneerConfig,
    address: Address,
    /// What the user says: believed over what the robot says of itself.
    told_robot: Option<Robot>,
    told_parameters: Option<Parameters>,
    /// Robots that can be told by their model.
    known: Vec<(String, Robot)>,
    epoch: Instant,
    link: Option<Link>,
    try_again: Instant,
    opened: Instant,
    /// Where it was found last, and what else was there then.
    found_at: Option<PathBuf>,
    others: BTreeSet<PathBuf>,
    session: Session,
    identity: Option<Identity>,
    /// Bytes read of this line, and when which of them came.
    read: u64,
    arrivals: VecDeque<(u64, u64)>,
    reports: Option<Reports>,
    configuration: Option<Configuration>,
    messages: VecDeque<(u64, Message)>,
    drive: Option<Drive>,
    health: RobotHealth,
    /// Why the line is not open, said once.
    trouble: String,
    packets: u64,
    implausible: u64,
    is_closed: bool,
}

/// What the robot was told last.
#[derive(Debug)]
struct Drive {
    speed_mmps: i32,
    turn_degps: i32,
    until: Instant,
    again: Instant,
}

/// What the user is told.
#[derive(Debug, Default, Clone, PartialEq)]
struct RobotHealth {
    battery_dv: i64,
    stalls: [bool; 2],
    bumpers: u16,
    low_battery_dv: i64,
}

impl Pioneer {
    /// A robot that has not been called yet. `robot`, if given, is believed over the robot's model; `known` are robots by name.
    ///
    /// # Errors
    /// The parameters can't be read.
    pub fn new(config: PioneerConfig, robot: Option<Robot>, known: Vec<(String, Robot)>) -> Result<Self> {
        config.validate().map_err(|error| anyhow!("pioneer.{error}"))?;
        let address = Address::parse(&config.port).context("pioneer.port names no line")?;
        let told_parameters = if config.parameters.as_os_str().is_empty() {
            None
        } else {
            let path = &config.parameters;
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            Some(Parameters::read(&text).with_context(|| path.display().to_string())?)
        };
        let first = Baud::of_bits_per_s(config.baud).context("pioneer.baud is no speed of a line")?;
        let is_serial = matches!(address, Address::Device(_));
        let more = Baud::ALL.into_iter().filter(|baud| *baud != first && is_serial);
        let settings = SessionSettings {
            motors: config.motors,
            bauds: core::iter::once(first).chain(more).collect(),
            silence: Duration::from_secs_f64(config.silence_s),
        };
        let now = Instant::now();
        Ok(Self {
            address,
            told_robot: robot,
            told_parameters,
            known,
            epoch: now,
            link: None,
            try_again: now,
            opened: now,
            found_at: None,
            others: BTreeSet::new(),
            session: Session::new(settings),
            identity: None,
            read: 0,
            arrivals: VecDeque::new(),
            reports: None,
            configuration: None,
            messages: VecDeque::new(),
            drive: None,
            health: RobotHealth::default(),
            trouble: String::new(),
            packets: 0,
            implausible: 0,
            is_closed: false,
            config,
        })
    }

    /// Makes the Pioneer from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong, or the parameters can't be read.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let robot = plan.config.contains_key("robot").then(|| plan.section("robot")).transpose()?;
        let known: std::collections::BTreeMap<String, Robot> =
            if plan.config.contains_key("robots") { plan.section("robots")? } else { Default::default() };
        Self::new(plan.section("pioneer")?, robot, known.into_iter().collect())
    }

    /// Information packets taken in so far.
    #[must_use]
    pub fn packets(&self) -> u64 {
        self.packets
    }

    fn time(&self) -> Duration {
        self.epoch.elapsed()
    }

    /// One look at the line; waits for it a little.
    fn pump(&mut self) -> Result<()> {
        if self.link.is_none() && !self.open() {
            return Ok(());
        }
        self.send();
        let mut bytes = [0; 1024];
        let Some(link) = &mut self.link else { return Ok(()) };
        match link.read(&mut bytes) {
            Ok(count) => {
                if count > 0 {
                    self.arrivals.push_back((self.read, now_ns()));
                    self.arrivals.drain(..self.arrivals.len().saturating_sub(ARRIVALS_MAX));
                    self.read += count as u64;
                }
                let now = self.time();
                self.session.take(&bytes[..count], now);
                self.events()?;
                self.drive_on();
                self.send();
                if !self.session.is_running() && self.opened.elapsed() > ANSWERED_WITHIN {
                    self.lose("it does not answer");
                }
            }
            Err(error) => self.lose(&error.to_string()),
        }
        Ok(())
    }

    /// Opens the line, where it is now; whether it could.
    fn open(&mut self) -> bool {
        let now = Instant::now();
        if now < self.try_again {
            // Orders and heartbeats are due before.
            std::thread::park_timeout((self.try_again - now).min(Duration::from_millis(50)));
            return false;
        }
        self.try_again = now + OPENED_AGAIN;
        let bits_per_s = self.session.baud().bits_per_s();
        for address in self.places() {
            match Link::open(&address, bits_per_s) {
                Ok(link) => {
                    tracing::info!(port = %address, "the line is open");
                    self.link = Some(link);
                    if let Address::Device(path) = &address {
                        self.found_at = Some(path.clone());
                    }
                    self.others = self.address.relatives();
                    self.trouble.clear();
                    self.opened = now;
                    self.read = 0;
                    self.arrivals.clear();
                    let time = self.time();
                    self.session.begin(time);
                    return true;
                }
                Err(error) => self.complain(format!("{address}: {error}")),
            }
        }
        false
    }

    /// Where the robot may be: where it was said to be, where it was last, and where something of its kind came up since.
    fn places(&self) -> Vec<Address> {
        let mut places = vec![self.address.clone()];
        if self.identity.is_some() {
            let new = self.address.relatives().into_iter().filter(|path| !self.others.contains(path));
            places.extend(self.found_at.iter().cloned().chain(new).map(Address::Device));
            places.dedup();
        }
        places.retain(|place| !matches!(place, Address::Device(path) if !path.exists()) || *place == self.address);
        places
    }

    fn complain(&mut self, trouble: String) {
        if self.trouble != trouble {
            tracing::warn!("{trouble}");
            self.trouble = trouble;
        }
    }

    fn lose(&mut self, why: &str) {
        self.link = None;
        // What is not there can be another when it is there again.
        self.others.retain(|path| path.exists());
        self.try_again = Instant::now() + OPENED_AGAIN;
        self.complain(format!(
            "{}: {why}",
            self.found_at.as_deref().map_or(self.address.to_string(), |at| at.display().to_string())
        ));
    }

    fn send(&mut self) {
        while let Some(out) = self.session.next_out() {
            let Some(link) = &mut self.link else { return };
            let sent = match &out {
                Out::Bytes(bytes) => link.send(bytes),
                Out::Baud(baud) => link.set_baud(baud.bits_per_s()),
            };
            if let Err(error) = sent {
                return self.lose(&error.to_string());
            }
        }
    }

    fn events(&mut self) -> Result<()> {
        while let Some(event) = self.session.next_event() {
            match event {
                Event::Opened { identity, was_open } => self.opened(identity, was_open)?,
                Event::Configured(told) => {
                    tracing::info!(?told, "configuration");
                    self.health.low_battery_dv = i64::from(told.low_battery);
                    let cycle_s = if self.config.sonar_cycle_s > 0.0 {
                        self.config.sonar_cycle_s
                    } else {
                        f64::from(told.sonar_cycle_ms) * 1e-3
                    };
                    if let Some(reports) = self.reports.as_mut().filter(|_| cycle_s > 0.0) {
                        reports.set_sonar_cycle_ns((cycle_s * 1e9) as u64);
                    }
                    self.configuration = Some(told);
                }
                Event::Sip { at, sip } => self.sip(at, &sip),
                Event::Silent => self.complain(format!("{}: the robot does not answer", self.address)),
            }
        }
        Ok(())
    }

    fn opened(&mut self, identity: Identity, was_open: bool) -> Result<()> {
        self.trouble.clear();
        tracing::info!(name = identity.name, model = identity.subclass, was_open, "connected");
        if let Some(before) = self.identity.replace(identity.clone())
            && before != identity
        {
            // Another one may have been plugged in where this one was.
            bail!(
                "this is {:?} ({}), and was {:?} ({})",
                identity.name,
                identity.subclass,
                before.name,
                before.subclass
            );
        }
        match &mut self.reports {
            Some(reports) if !was_open => reports.begin_anew(),
            Some(_) => {}
            None => self.describe(&identity)?,
        }
        Ok(())
    }

    /// Says which robot it is.
    fn describe(&mut self, identity: &Identity) -> Result<()> {
        let subclass = &identity.subclass;
        let parameters = match (&self.told_parameters, parameters_of(subclass)) {
            (Some(told), _) => {
                if !told.subclass.eq_ignore_ascii_case(subclass) {
                    tracing::warn!("the robot is a {subclass}; pioneer.parameters are of a {}", told.subclass);
                }
                told.clone()
            }
            (None, Some(known)) => known,
            (None, None) => bail!(
                "the robot is a {subclass:?} ({}), whose counts echogrid does not know; \
                 --set pioneer.parameters=FILE.p names its parameter file",
                identity.class
            ),
        };
        let model = model_of(subclass);
        let known = |name: &str| self.known.iter().find(|(known, _)| known == name).map(|(_, robot)| robot.clone());
        let robot = if let Some(robot) = &self.told_robot {
            if model.is_some_and(|model| robot.name != model) {
                tracing::warn!("the robot is a {subclass}; run.robot is {:?}", robot.name);
            }
            robot.clone()
        } else if !parameters.sonars.is_empty() {
            robot_of(&parameters)
        } else if let Some(robot) = model.and_then(known) {
            robot
        } else {
            bail!(
                "the robot is a {subclass:?}: where its sonars sit must be said, by --robot FILE or pioneer.parameters"
            );
        };
        if let Some(baud) = Baud::of_bits_per_s(self.config.switch_baud).or(Baud::of_bits_per_s(parameters.baud)) {
            self.session.switch_to(baud);
        }
        ensure!(robot.transducer_count() > 0, "robot {:?} has no sonar", robot.name);
        let mut reports = Reports::new(parameters, robot.clone());
        if self.config.sonar_cycle_s > 0.0 {
            reports.set_sonar_cycle_ns((self.config.sonar_cycle_s * 1e9) as u64);
        }
        self.reports = Some(reports);
        self.messages.push_back((now_ns(), Message::Robot(robot)));
        Ok(())
    }

    fn sip(&mut self, at: u64, sip: &Sip) {
        self.packets += 1;
        let arrived = self.arrivals.iter().rev().find(|(first, _)| *first <= at).or(self.arrivals.front());
        let stamp_ns = arrived.map_or_else(now_ns, |(_, stamp_ns)| *stamp_ns);
        let Some(messages) = self.reports.as_mut().map(|reports| reports.sip(stamp_ns, sip)) else { return };
        match messages {
            Some(messages) => self.messages.extend(messages),
            None => {
                self.implausible += 1;
                tracing::warn!(?sip, "a packet says what can't be: left out");
                return;
            }
        }
        let before = self.health.clone();
        self.health.battery_dv = (sip.battery_v() * 10.0).round() as i64;
        (self.health.stalls, self.health.bumpers) = (sip.stalls(), sip.bumpers());
        if before.stalls != self.health.stalls && self.health.stalls != [false; 2] {
            tracing::warn!("wheels stall");
        }
        if before.bumpers == 0 && self.health.bumpers != 0 {
            tracing::warn!("a bumper is pressed");
        }
    }

    /// What the robot was told to do counts for a moment only.
    fn drive_on(&mut self) {
        let Some(drive) = &mut self.drive else { return };
        let now = Instant::now();
        if now >= drive.until {
            self.drive = None;
            self.session.send(&Command::Velocity.with(0));
            self.session.send(&Command::TurnRate.with(0));
            tracing::debug!("nobody drives any more");
        } else if now >= drive.again {
            drive.again = now + COMMANDED_EVERY;
            let (speed, turn) = (drive.speed_mmps, drive.turn_degps);
            self.session.send(&Command::Velocity.with(speed));
            self.session.send(&Command::TurnRate.with(turn));
        }
    }
}

impl Sensor for Pioneer {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_ready(&mut self) -> Result<bool> {
        if self.messages.is_empty() && !self.is_closed {
            self.pump()?;
        }
        Ok(!self.messages.is_empty() || self.is_closed)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        while self.messages.is_empty() && !self.is_closed {
            self.pump()?;
        }
        Ok(self.messages.pop_front())
    }

    fn is_live(&self) -> bool {
        true
    }

    fn note(&self) -> String {
        if !self.trouble.is_empty() {
            return self.trouble.clone();
        }
        let Some(identity) = &self.identity else { return "looks for the robot".to_owned() };
        let RobotHealth { battery_dv, stalls, bumpers, low_battery_dv } = &self.health;
        let mut note = format!("{} ({}), battery {:.1} V", identity.name, identity.subclass, *battery_dv as f64 * 0.1);
        if *battery_dv < *low_battery_dv {
            note += ", low";
        }
        for (side, stalls) in ["left", "right"].into_iter().zip(stalls) {
            if *stalls {
                note += &format!(", {side} wheels stall");
            }
        }
        if *bumpers != 0 {
            note += &format!(", bumpers {bumpers:#06x}");
        }
        if self.implausible > 0 {
            note += &format!(", {} packets left out", self.implausible);
        }
        note
    }

    fn command(&mut self, command: Order) -> Result<String> {
        let Order::Drive { v_mps, w_radps } = command else { bail!("this sensor has nothing to {}", command.word()) };
        ensure!(self.config.motors, "its motors are off; start the graph with --set pioneer.motors=true");
        ensure!(self.session.is_running(), "the robot is not connected: {}", self.note());
        let fastest = |told: f64, or: f64| if told > 0.0 { told } else { or };
        let (mut v_max, mut w_max) = (0.75, 1.75);
        if let Some(told) = &self.configuration {
            v_max = fastest(f64::from(told.speed_max) * 1e-3, v_max);
            w_max = fastest(f64::from(told.turn_rate_max).to_radians(), w_max);
        }
        ensure!(v_mps.abs() <= v_max, "speed {v_mps} m/s: expected at most {v_max} m/s either way");
        ensure!(w_radps.abs() <= w_max, "turn rate {w_radps} rad/s: expected at most {w_max:.2} rad/s either way");
        let now = Instant::now();
        let (speed_mmps, turn_degps) = ((v_mps * 1e3).round() as i32, w_radps.to_degrees().round() as i32);
        let until = now + Duration::from_secs_f64(self.config.dead_man_s);
        self.drive = Some(Drive { speed_mmps, turn_degps, until, again: now });
        self.drive_on();
        self.send();
        Ok(format!("drives at {v_mps} m/s and {w_radps} rad/s for {} s", self.config.dead_man_s))
    }

    fn close(&mut self) {
        if core::mem::replace(&mut self.is_closed, true) {
            return;
        }
        self.session.close();
        self.send();
        if let Some(link) = &mut self.link {
            // The bytes are on their way before the port is closed.
            let _ = link.set_baud(self.session.baud().bits_per_s());
        }
        self.link = None;
    }
}

impl Drop for Pioneer {
    fn drop(&mut self) {
        self.close();
    }
}
