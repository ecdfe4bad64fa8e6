//! Cleans up after a dead process, in a helper process: what it does can hang.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_topics::Domain;
use echogrid_topics::janitor::residents;

use super::child::{OWN, pidfd};

/// Cleaning takes milliseconds.
const WITHIN: Duration = Duration::from_secs(3);

/// Tools that were killed hold their places for so long at most.
const LOOKS_EVERY: Duration = Duration::from_secs(5);

/// Processes that are not of the graph, and look on: when it was last looked whether there are any.
#[derive(Debug, Default)]
pub(super) struct Visitors {
    looked: Option<Instant>,
}

impl Visitors {
    /// Whether it is time to clean up after those that may be dead: there are more than the graph's own `processes`.
    pub(super) fn may_be_dead(&mut self, domain: &Domain, processes: usize, now: Instant) -> bool {
        let is_time = self.looked.is_none_or(|looked| now.saturating_duration_since(looked) >= LOOKS_EVERY);
        if is_time {
            self.looked = Some(now);
        }
        is_time && residents(domain) > processes
    }
}

/// The helper at work.
#[derive(Debug)]
pub(super) struct Janitor {
    /// A service died, and is not started before all is clean.
    pub(super) is_for_services: bool,
    child: Child,
    pidfd: OwnedFd,
    deadline: Instant,
}

/// How it went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cleaned {
    /// Still at it.
    NotYet,
    /// All that the dead left is gone.
    Done,
    /// It could not.
    Failed,
}

impl Janitor {
    pub(super) fn start(domain: &Domain, is_for_services: bool) -> Result<Self> {
        let child = Command::new(OWN)
            .arg("janitor")
            .env(DOMAIN_VARIABLE, domain.name())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("starting the janitor")?;
        let pidfd = pidfd(&child)?;
        Ok(Self { is_for_services, child, pidfd, deadline: Instant::now() + WITHIN })
    }

    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        self.pidfd.as_fd()
    }

    pub(super) fn look(&mut self) -> Cleaned {
        match self.child.try_wait() {
            Ok(Some(status)) if status.success() => Cleaned::Done,
            Ok(None) if Instant::now() < self.deadline => Cleaned::NotYet,
            _ => Cleaned::Failed,
        }
    }
}

impl Drop for Janitor {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
