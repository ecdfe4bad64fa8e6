//! A look at one topic that disturbs nobody: it acknowledges nothing, so nobody waits for it.

use std::os::fd::BorrowedFd;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::Plan;
use echogrid_service::signals::Signals;
use echogrid_topics::{Health, Input, Output, Participant, Received, ServiceState, Topic};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;

use super::super::talk;

/// How often it is looked whether the graph is still there: nobody tells a mere onlooker.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// What there is.
#[expect(clippy::large_enum_variant, reason = "nearly all are messages")]
pub(super) enum Next {
    /// A message, or what else came.
    Received(Received),
    /// Not in time.
    Nothing,
    /// The graph is gone, or whoever started us wants us to leave.
    Over,
}

/// A topic that is looked at.
pub(super) struct Reader {
    port: Input,
    signals: Signals,
    plan: PathBuf,
    /// Another one: the graph was made anew, and this memory is nobody's any more.
    inode: u64,
    // What it said would go with it.
    _greeting: Output<Health>,
    // Last: ports go before the process leaves the domain.
    _participant: Participant,
}

impl Reader {
    pub(super) fn open(domain: Option<&str>, topic: Topic) -> Result<Self> {
        // Killed at once, it would leave its port in shared memory.
        let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
        let (domain, participant, _) = talk::running(domain, "echogrid topic")?;
        let plan = domain.dir().join("plan.toml");
        let inode = std::fs::metadata(&plan).context("looking for the graph")?.ino();
        let port = Input::open(&participant, topic)?;
        let greeting = greet(&participant, &Plan::read(&domain)?)?;
        Ok(Self { port, signals, plan, inode, _greeting: greeting, _participant: participant })
    }

    /// Messages that were not read in time.
    pub(super) fn lost(&self) -> u64 {
        self.port.lost()
    }

    /// Waits for the next message, at most until `deadline`.
    pub(super) fn next(&mut self, deadline: Option<Instant>) -> Result<Next> {
        loop {
            if self.signals.next()?.is_some() {
                return Ok(Next::Over);
            }
            if let Some(received) = self.port.receive()? {
                return Ok(Next::Received(received));
            }
            // A message between that look and this would ring again.
            self.port.hush()?;
            if let Some(received) = self.port.receive()? {
                return Ok(Next::Received(received));
            }
            if std::fs::metadata(&self.plan).map(|plan| plan.ino()).ok() != Some(self.inode) {
                return Ok(Next::Over);
            }
            let left = deadline.map_or(LOOK_EVERY, |deadline| deadline.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                return Ok(Next::Nothing);
            }
            self.wait(left.min(LOOK_EVERY))?;
        }
    }

    fn wait(&self, patience: Duration) -> Result<()> {
        let fds: Vec<BorrowedFd<'_>> = std::iter::once(self.signals.fd()).chain(self.port.fd()).collect();
        let mut fds: Vec<_> = fds.into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        // Rounded up: waiting for 0 ms until 0.9 ms have passed would spin.
        let millis = patience.as_micros().div_ceil(1000) as u16;
        match poll(&mut fds, PollTimeout::from(millis)) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => Err(errno).context("waiting for messages"),
        }
    }
}

/// Says that somebody came: producers then hand over what they keep for that, which they would else do when they next have
/// something to say.
fn greet(participant: &Participant, plan: &Plan) -> Result<Output<Health>> {
    let mut greeting = Output::typed(participant, plan.max_readings, plan.epoch, &[])?;
    let health = Health::new("echogrid topic", std::process::id(), ServiceState::Running);
    greeting.send(0, &health)?;
    greeting.ring()?;
    Ok(greeting)
}
