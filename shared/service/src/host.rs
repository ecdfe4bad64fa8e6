//! What a process has of the system: a clock, a number, something to wait on, the word of its launcher and of its user.

use std::os::fd::BorrowedFd;
use std::task::Poll;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_topics::{Command, ControlServer, TopicError};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;

use crate::lifeline::Lifeline;
use crate::signals::{Caught, Signals};

/// The system that a process runs on.
pub trait Host: core::fmt::Debug {
    /// What time it is.
    fn now(&self) -> Instant;

    /// The number of the process.
    fn pid(&self) -> u32;

    /// Whether a launcher started it, and watches over it.
    fn is_launched(&self) -> bool;

    /// Waits until one of `fds` is readable or something else happened, at most for `patience`; not ready where somebody
    /// else decides when that is, and asks again.
    ///
    /// # Errors
    /// The system refuses.
    fn poll_wait(&mut self, fds: &[BorrowedFd<'_>], patience: Duration) -> Poll<Result<Woken>>;
}

/// What happened while a process waited.
#[derive(Debug, Default)]
pub struct Woken {
    /// Signals that came, in order.
    pub told: Vec<Told>,
    /// The launcher is gone.
    pub orphaned: bool,
}

/// What a signal says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// By the launcher, or by hand where there is none: end.
    Stop,
    /// By somebody else, who does not know whether the others have heard the last of this service.
    Leave(Caught),
}

/// Where the orders of the user arrive.
pub trait Orders: core::fmt::Debug {
    /// Answers the orders that have come; `carry_out`, which hears the number of the order, too, says what was done, or why not. What
    /// a planner says again and again has no number.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn serve(
        &mut self,
        carry_out: &mut dyn FnMut(Option<u64>, Command) -> Result<String, String>,
    ) -> Result<(), TopicError>;

    /// Readable when there may be an order; none where nobody could wait for it.
    fn fds(&self) -> Vec<BorrowedFd<'_>>;
}

impl Orders for ControlServer {
    fn serve(
        &mut self,
        carry_out: &mut dyn FnMut(Option<u64>, Command) -> Result<String, String>,
    ) -> Result<(), TopicError> {
        Self::serve(self, &mut |order, command| carry_out(Some(order), command))
    }

    fn fds(&self) -> Vec<BorrowedFd<'_>> {
        vec![Self::fd(self)]
    }
}

/// The system itself.
#[derive(Debug)]
pub(crate) struct System {
    signals: Signals,
    /// None where nobody started the process but its user, or when who did is gone.
    lifeline: Option<Lifeline>,
    is_launched: bool,
}

impl System {
    /// Blocks the signals that ask to end, and watches over the launcher. Call before any thread is started.
    ///
    /// # Errors
    /// The system refuses.
    pub(crate) fn attach() -> Result<Self> {
        let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
        let lifeline = Lifeline::attach();
        Ok(Self { signals, is_launched: lifeline.is_some(), lifeline })
    }

    fn wait(&mut self, others: &[BorrowedFd<'_>], patience: Duration) -> Result<Woken> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![self.signals.fd()];
        fds.extend(self.lifeline.as_ref().map(Lifeline::fd));
        let has_lifeline = self.lifeline.is_some();
        fds.extend(others);
        let mut fds: Vec<PollFd<'_>> = fds.into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        // Rounded up: a loop that waits for 0 ms until 0.9 ms have passed would spin.
        let millis = patience.as_micros().div_ceil(1000);
        let timeout = PollTimeout::try_from(i32::try_from(millis).unwrap_or(i32::MAX)).unwrap_or(PollTimeout::MAX);
        match poll(&mut fds, timeout) {
            Ok(_) | Err(Errno::EINTR) => {}
            Err(errno) => return Err(errno).context("waiting for messages"),
        }
        let ready = |index: usize| fds[index].revents().is_some_and(|events| !events.is_empty());
        let (signalled, orphaned) = (ready(0), has_lifeline && ready(1));
        let mut told = Vec::new();
        while let Some(caught) = if signalled { self.signals.next()? } else { None } {
            let is_ours = !self.is_launched || caught.sender == std::os::unix::process::parent_id();
            told.push(if is_ours { Told::Stop } else { Told::Leave(caught) });
        }
        if orphaned {
            self.lifeline = None;
        }
        Ok(Woken { told, orphaned })
    }
}

impl Host for System {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn pid(&self) -> u32 {
        std::process::id()
    }

    fn is_launched(&self) -> bool {
        self.is_launched
    }

    fn poll_wait(&mut self, fds: &[BorrowedFd<'_>], patience: Duration) -> Poll<Result<Woken>> {
        Poll::Ready(self.wait(fds, patience))
    }
}
