//! The parent watch: a service never outlives its launcher.
//!
//! The launcher holds the other end of the service's standard input. When the launcher is gone,
//! however it went, that end closes. The main loop sees it and saves what there is; a thread makes
//! sure that a loop which hangs does not stay.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

/// Set by the launcher: standard input is a lifeline (by hand it is a terminal).
pub const LIFELINE_VARIABLE: &str = "ECHOGRID_LIFELINE";
/// How long a service may take to save and leave when its launcher is gone.
const LEAVE_WITHIN: Duration = Duration::from_millis(1500);

/// Standard input as a lifeline.
#[derive(Debug)]
pub struct Lifeline {
    stdin: std::io::Stdin,
}

impl Lifeline {
    /// The lifeline, if a launcher holds the other end; starts the thread that enforces it.
    #[must_use]
    pub fn attach() -> Option<Self> {
        (std::env::var(LIFELINE_VARIABLE).as_deref() == Ok("stdin")).then(|| {
            // If no thread can be had, the main loop still sees the lifeline.
            let _ = std::thread::Builder::new().name("lifeline".into()).spawn(enforce);
            Self { stdin: std::io::stdin() }
        })
    }

    /// Whether the launcher is gone.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        let mut fds = [PollFd::new(self.stdin.as_fd(), PollFlags::empty())];
        let polled = poll(&mut fds, PollTimeout::ZERO);
        polled.is_ok() && fds[0].revents().is_some_and(|events| !events.is_empty())
    }

    /// Hangs up when the launcher is gone.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.stdin.as_fd()
    }
}

fn enforce() {
    let stdin = std::io::stdin();
    loop {
        let mut fds = [PollFd::new(stdin.as_fd(), PollFlags::empty())];
        match poll(&mut fds, PollTimeout::NONE) {
            Ok(_) if fds[0].revents().is_some_and(|events| !events.is_empty()) => break,
            _ => {}
        }
    }
    // A deadline for the main loop, which is leaving by itself meanwhile.
    std::thread::sleep(LEAVE_WITHIN);
    std::process::exit(1);
}
