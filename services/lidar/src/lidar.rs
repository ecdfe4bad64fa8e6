//! The driver: a lidar over a line that may be cut, as a sensor.

use core::time::Duration;
use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use echogrid_core::{Robot, SensorKind};
use echogrid_line::{Address, Link};
use echogrid_service::{Plan, Sensor};
use echogrid_topics::{Message, Topic};

use crate::OUTPUTS;
use crate::codec::Decoder;
use crate::config::LidarConfig;
use crate::turns::Turns;

/// Between two attempts to open a line.
const OPENED_AGAIN: Duration = Duration::from_millis(300);
/// What has come is read in pieces of at most so many bytes.
const PIECE_BYTES: usize = 1024;

/// A lidar over a serial line, as a sensor.
#[derive(Debug)]
pub struct Lidar {
    config: LidarConfig,
    address: Address,
    link: Option<Link>,
    try_again: Instant,
    /// When a beam was heard last, or the line was opened.
    heard: Instant,
    /// Where it was found last, and what else was there then.
    found_at: Option<PathBuf>,
    others: BTreeSet<PathBuf>,
    decoder: Box<dyn Decoder>,
    turns: Turns,
    scans: VecDeque<(u64, Message)>,
    count: u64,
    /// Why there are no scans, said once.
    trouble: String,
    is_closed: bool,
}

impl Lidar {
    /// A lidar that has not been called yet; where it sits and which bearings it has, `robot` says of its first lidar.
    ///
    /// # Errors
    /// A value is out of range, or the robot has no lidar.
    pub fn new(config: LidarConfig, robot: &Robot) -> Result<Self> {
        config.validate().map_err(|error| anyhow!("lidar.{error}"))?;
        let address = Address::parse(&config.port).context("lidar.port names no line")?;
        let sensor = robot.sensors.iter().find(|sensor| sensor.kind == SensorKind::Lidar);
        let sensor = sensor.with_context(|| {
            format!(
                "robot {:?} has no lidar: its file says in [lidar] where it sits and which beams it has",
                robot.name
            )
        })?;
        let now = Instant::now();
        Ok(Self {
            address,
            link: None,
            try_again: now,
            heard: now,
            found_at: None,
            others: BTreeSet::new(),
            decoder: config.model.decoder(),
            turns: Turns::new(sensor.clone()),
            scans: VecDeque::new(),
            count: 0,
            trouble: String::new(),
            is_closed: false,
            config,
        })
    }

    /// Makes the lidar from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong, or the robot has no lidar.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let robot: Robot = plan.section("robot").context("the robot must be described: run.robot names its file")?;
        Self::new(plan.section("lidar")?, &robot)
    }

    /// The number of scans so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Bytes so far that belonged to nothing whole.
    #[must_use]
    pub fn skipped_bytes(&self) -> u64 {
        self.decoder.skipped()
    }

    /// One look at the line; waits for it a little.
    fn pump(&mut self) {
        if self.link.is_none() && !self.open() {
            return;
        }
        let mut bytes = [0; PIECE_BYTES];
        let Some(link) = &mut self.link else { return };
        match link.read(&mut bytes) {
            Ok(count) => {
                let came_ns = now_ns();
                self.decoder.push(bytes.get(..count).unwrap_or_default());
                while let Some(beam) = self.decoder.next_beam() {
                    self.heard = Instant::now();
                    self.trouble.clear();
                    if let Some((began_ns, readings)) = self.turns.take(&beam, came_ns) {
                        self.count += 1;
                        self.scans.push_back((began_ns, Message::Scan(readings)));
                    }
                }
                if self.heard.elapsed().as_secs_f64() > self.config.silence_s {
                    self.lose("the lidar says nothing that is understood");
                }
            }
            Err(error) => self.lose(&error.to_string()),
        }
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
        let baud = if self.config.baud == 0 { self.config.model.baud() } else { self.config.baud };
        for address in self.places() {
            match Link::open(&address, baud).and_then(|link| self.greet(link)) {
                Ok(link) => {
                    tracing::info!(port = %address, "the line is open");
                    self.link = Some(link);
                    if let Address::Device(path) = &address {
                        self.found_at = Some(path.clone());
                    }
                    self.others = self.address.relatives();
                    self.heard = now;
                    return true;
                }
                Err(error) => self.complain(format!("{address}: {error}")),
            }
        }
        false
    }

    fn greet(&self, mut link: Link) -> std::io::Result<Link> {
        // The motor turns while the wire is low.
        link.set_terminal_ready(false);
        self.config.model.greeting().iter().try_for_each(|piece| link.send(piece))?;
        Ok(link)
    }

    /// Where it may be: where it was said to be, where it was last, and where something of its kind came up since.
    fn places(&self) -> Vec<Address> {
        let mut places = vec![self.address.clone()];
        if self.count > 0 {
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
        self.decoder.clear();
        self.turns.clear();
        self.others.retain(|path| path.exists());
        self.try_again = Instant::now() + OPENED_AGAIN;
        let place = self.found_at.as_deref().map_or(self.address.to_string(), |at| at.display().to_string());
        self.complain(format!("{place}: {why}"));
    }
}

impl Sensor for Lidar {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_ready(&mut self) -> Result<bool> {
        if self.scans.is_empty() && !self.is_closed {
            self.pump();
        }
        Ok(!self.scans.is_empty() || self.is_closed)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        while self.scans.is_empty() && !self.is_closed {
            self.pump();
        }
        Ok(self.scans.pop_front())
    }

    fn note(&self) -> String {
        if !self.trouble.is_empty() {
            return self.trouble.clone();
        }
        let (skipped, given_up) = (self.decoder.skipped(), self.turns.given_up());
        match (self.count, skipped + given_up) {
            (0, _) => "looks for the lidar".to_owned(),
            (_, 0) => String::new(),
            _ => format!("{skipped} bytes belonged to nothing, {given_up} turns had a hole"),
        }
    }

    fn close(&mut self) {
        self.is_closed = true;
        if let Some(link) = &mut self.link {
            // It may be gone already, and then it rests.
            let _ = link.send(self.config.model.farewell());
            link.set_terminal_ready(true);
        }
        self.link = None;
    }
}

impl Drop for Lidar {
    fn drop(&mut self) {
        self.close();
    }
}

/// Time since the machine was started, nanoseconds: the same for all processes, whoever sets its clock.
fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}
