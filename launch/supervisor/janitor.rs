//! Cleans up after a dead process, in a helper process: what it does can hang.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::plan::DOMAIN_VARIABLE;

use super::child::{OWN, pidfd};

/// Cleaning takes milliseconds.
const WITHIN: Duration = Duration::from_secs(3);

/// The helper at work.
#[derive(Debug)]
pub(super) struct Janitor {
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
    pub(super) fn start(domain: &str) -> Result<Self> {
        let child = Command::new(OWN)
            .arg("janitor")
            .env(DOMAIN_VARIABLE, domain)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("starting the janitor")?;
        let pidfd = pidfd(&child)?;
        Ok(Self { child, pidfd, deadline: Instant::now() + WITHIN })
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
