//! SIGINT, SIGTERM and SIGHUP, as something to poll.

use std::os::fd::{AsFd, BorrowedFd};

use anyhow::{Context, Result};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd, siginfo};

/// A signal that came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Caught {
    /// The signal that came.
    pub signal: Signal,
    /// The process that sent it; 0: the kernel, or a process of another container.
    pub sender: u32,
}

/// From now on a file that grows beyond what this process may write (`ulimit -f`) is an error of writing it, not the end of
/// the process (SIGXFSZ). Call before any thread is started: threads inherit it.
pub fn survive_file_size_limit() {
    // What can't be blocked is as before.
    let _ = SigSet::from(Signal::SIGXFSZ).thread_block();
}

/// Lets every signal come: for a process that is about to become another program, which would inherit what is blocked here and never
/// hear that it is to end. May be called between fork and exec.
///
/// # Errors
/// The system refuses.
pub fn unblock() -> std::io::Result<()> {
    Ok(SigSet::empty().thread_set_mask()?)
}

/// Signals that this process reads instead of being interrupted by.
#[derive(Debug)]
pub struct Signals {
    fd: SignalFd,
}

impl Signals {
    /// Blocks the signals and collects them. Call before any thread is started: threads inherit it.
    ///
    /// # Errors
    /// The system refuses.
    pub fn collect(signals: &[Signal]) -> Result<Self> {
        let mut set = SigSet::empty();
        for signal in signals {
            set.add(*signal);
        }
        set.thread_block().context("blocking signals")?;
        let fd = SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC).context("signalfd")?;
        Ok(Self { fd })
    }

    /// The next signal that came, if any.
    ///
    /// # Errors
    /// The system refuses.
    pub fn next(&self) -> Result<Option<Caught>> {
        let info = self.fd.read_signal().context("reading a signal")?;
        let caught = |info: siginfo| {
            Signal::try_from(info.ssi_signo as i32).ok().map(|signal| Caught { signal, sender: info.ssi_pid })
        };
        Ok(info.and_then(caught))
    }

    /// Readable when a signal came.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}
