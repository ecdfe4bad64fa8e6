//! A process that looks on at a running graph: it acknowledges nothing, so nobody waits for it, and where it does not keep up it
//! misses messages, never another process.

use std::collections::BTreeMap;
use std::os::fd::BorrowedFd;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use echogrid_topics::{
    Command, Domain, Health, Input, Message, Output, Participant, Received, ServiceState, Topic, control,
};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde::Deserialize;

use crate::plan::{Plan, SERVICE_VARIABLE};
use crate::signals::Signals;

/// How often it is looked whether the graph is still there: nobody tells a mere onlooker.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Messages are taken in bunches: a processor that wakes for each would be missed by the mapper.
const BUNCH: Duration = Duration::from_millis(15);
/// The launcher hears of it this often, where it is a service of the graph.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// The whole map is asked for again after this, where tiles are missing.
const ASK_AGAIN_AFTER: Duration = Duration::from_secs(2);

/// A service answers an order between two of its steps.
pub const ANSWER_WITHIN: Duration = Duration::from_secs(10);

/// A graph that is looked at.
#[derive(Debug)]
pub struct Onlooker {
    ports: Vec<Input>,
    plan: Plan,
    plan_file: PathBuf,
    /// Another one: the graph was made anew, and this memory is nobody's any more.
    inode: u64,
    /// Whether a mapper runs that could tell the map.
    is_mapping: bool,
    /// Tiles known to be missing when the whole map was asked for last.
    tiles_lost: Option<u64>,
    asked: Instant,
    /// What it calls itself.
    name: String,
    /// What it says of itself; what it said would go with it.
    mouth: Output,
    /// When it said so last; none: nobody watches over it.
    said: Option<Instant>,
    // Last: ports go before the process leaves the domain.
    _participant: Participant,
}

impl Onlooker {
    /// Enters the graph that runs in `domain` as `name`, to look at `topics`.
    ///
    /// # Errors
    /// There is no such graph, or shared memory refuses.
    pub fn enter(domain: &Domain, name: &str, topics: &[Topic]) -> Result<Self> {
        // As a service of the graph it has the name that it has there, and the launcher watches over it.
        let given = std::env::var(SERVICE_VARIABLE).ok();
        let name = given.as_deref().unwrap_or(name);
        let participant = Participant::join(domain, name)?;
        let plan_file = domain.dir().join("plan.toml");
        let inode = std::fs::metadata(&plan_file).context("looking for the graph")?.ino();
        let plan = Plan::read(domain)?;
        // Listening before anything is said of it.
        let ports = topics.iter().map(|topic| Input::open(&participant, *topic)).collect::<Result<Vec<_>, _>>()?;
        let mouth = greet(&participant, name, &plan)?;
        Ok(Self {
            ports,
            plan,
            plan_file,
            inode,
            is_mapping: false,
            tiles_lost: None,
            asked: Instant::now(),
            name: name.to_owned(),
            mouth,
            said: given.as_ref().map(|_| Instant::now()),
            _participant: participant,
        })
    }

    /// The plan of the run.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Whether the graph is still there, and not made anew.
    #[must_use]
    pub fn is_there(&self) -> bool {
        std::fs::metadata(&self.plan_file).map(|plan| plan.ino()).ok() == Some(self.inode)
    }

    /// Takes in what has come; each message with its stamp. Whether the graph was still there before that: what is said last is
    /// in the ports when it is not.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn take_in(&mut self, mut take: impl FnMut(u64, Message)) -> Result<bool> {
        self.take_in_numbered(|_, stamp_ns, message| take(stamp_ns, message))
    }

    /// Takes in what has come, as [`Onlooker::take_in`] does; each message with its number before its stamp.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn take_in_numbered(&mut self, mut take: impl FnMut(u64, u64, Message)) -> Result<bool> {
        let was_there = self.is_there();
        for index in 0..self.ports.len() {
            let taken = self.take_topic(index, &mut take);
            // What fails because the graph goes is no fault, and what the other ports hold counts.
            if was_there && self.is_there() {
                taken?;
            } else if let Err(error) = taken {
                tracing::debug!(?error, "a topic went with its graph");
            }
        }
        Ok(was_there)
    }

    fn take_topic(&mut self, index: usize, take: &mut impl FnMut(u64, u64, Message)) -> Result<()> {
        let port = &mut self.ports[index];
        port.hush()?;
        while let Some(received) = port.receive()? {
            let Received::Message(header, message) = received else { continue };
            if let Message::Health(health) = &message
                && health.acks.iter().any(|ack| ack.topic == Topic::RangeScan)
            {
                self.is_mapping = health.state == ServiceState::Running;
            }
            take(header.sequence, header.stamp_ns, message);
        }
        Ok(())
    }

    /// Messages that were sent since it came, and that it did not get.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.ports.iter().map(Input::lost).sum()
    }

    /// Whether tiles are missing that were not asked for: they were missed at the end, when nobody answers any more.
    #[must_use]
    pub fn lacks_tiles(&self) -> bool {
        self.tiles_lost != self.ports.iter().find(|port| port.topic() == Topic::MapTiles).map(Input::lost)
    }

    /// Whether the whole map is to be asked for now ([`Command::Tiles`]): who came late, or fell behind, has only part of it. Health
    /// must be among what is looked at, as only a mapper that runs can answer.
    pub fn misses_tiles(&mut self) -> bool {
        let tiles = self.ports.iter().find(|port| port.topic() == Topic::MapTiles);
        let lost = tiles.map_or(0, Input::lost);
        let is_due = self.tiles_lost.is_none() || self.asked.elapsed() > ASK_AGAIN_AFTER;
        let misses = self.is_mapping && is_due && self.tiles_lost != Some(lost);
        if misses {
            (self.tiles_lost, self.asked) = (Some(lost), Instant::now());
        }
        misses
    }

    /// Waits until something may have come.
    ///
    /// # Errors
    /// The system refuses.
    pub fn wait(&mut self, signals: &Signals) -> Result<()> {
        if self.said.is_some_and(|said| said.elapsed() >= HEARTBEAT) && self.is_there() {
            say(&mut self.mouth, &self.name)?;
            self.said = Some(Instant::now());
        }
        let mut fds: Vec<BorrowedFd<'_>> = vec![signals.fd()];
        // Who is told of one message waits a moment for the others.
        sleep_until_readable(&fds, BUNCH)?;
        fds.extend(self.ports.iter().filter_map(Input::fd));
        sleep_until_readable(&fds, LOOK_EVERY)
    }
}

fn sleep_until_readable(fds: &[BorrowedFd<'_>], patience: Duration) -> Result<()> {
    let mut fds: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::new(*fd, PollFlags::POLLIN)).collect();
    match poll(&mut fds, PollTimeout::from(patience.as_millis() as u16)) {
        Ok(_) | Err(Errno::EINTR) => Ok(()),
        Err(errno) => Err(errno).context("waiting for messages"),
    }
}

/// Says that somebody came: producers then hand over what they keep for that.
fn greet(participant: &Participant, name: &str, plan: &Plan) -> Result<Output> {
    let mut greeting = Output::open(participant, Topic::Health, plan.max_readings, plan.epoch, &[])?;
    say(&mut greeting, name)?;
    Ok(greeting)
}

fn say(mouth: &mut Output, name: &str) -> Result<()> {
    mouth.send(0, &Message::Health(Health::new(name, std::process::id(), ServiceState::Running)))?;
    Ok(mouth.ring()?)
}

/// One who gives orders to the services of a graph.
#[derive(Debug)]
pub struct Operator {
    participant: Participant,
    plan: Plan,
    services: BTreeMap<String, Service>,
}

/// What is read of a service's table.
#[derive(Debug, Deserialize)]
struct Service {
    kind: String,
}

impl Operator {
    /// Enters the graph that runs in `domain` as `name`.
    ///
    /// # Errors
    /// There is no such graph, or shared memory refuses.
    pub fn enter(domain: &Domain, name: &str) -> Result<Self> {
        let participant = Participant::join(domain, name)?;
        let plan = Plan::read(domain)?;
        let services = plan.section("services")?;
        Ok(Self { participant, plan, services })
    }

    /// The plan of the run.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Has every service of a kind do something; what they say.
    ///
    /// # Errors
    /// There is none, one refuses, or does not answer within `within`.
    pub fn order(&self, kind: &str, command: Command, within: Duration) -> Result<String> {
        let mut said = Vec::new();
        for (name, _) in self.services.iter().filter(|(_, service)| service.kind == kind) {
            let done = control::order(&self.participant, name, command, within)?;
            said.push(format!("{name}: {}", done.map_err(|why| anyhow!("{name}: {why}"))?));
        }
        ensure!(!said.is_empty(), "the graph has no {kind} to {}", command.word());
        Ok(said.join("; "))
    }
}
