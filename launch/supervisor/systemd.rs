//! What systemd is told, where it started us (`Type=notify`, `WatchdogSec=`).

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// Whoever started us, if it is systemd.
#[derive(Debug)]
pub(super) struct Systemd {
    /// How often it wants to hear that we are alive.
    every: Option<Duration>,
    last: Instant,
}

impl Systemd {
    pub(super) fn new() -> Self {
        // Half of what it waits: one late word is no reason to be killed.
        Self { every: sd_notify::watchdog_enabled().map(|within| within / 2), last: Instant::now() }
    }

    pub(super) fn ready(&self) {
        say(&[NotifyState::Ready]);
    }

    pub(super) fn stopping(&self) {
        say(&[NotifyState::Stopping]);
    }

    /// Called about ten times a second from the main loop, so that it ends when that hangs.
    pub(super) fn watchdog(&mut self) {
        if self.every.is_some_and(|every| self.last.elapsed() >= every) {
            self.last = Instant::now();
            say(&[NotifyState::Watchdog]);
        }
    }
}

fn say(states: &[NotifyState<'_>]) {
    // Without systemd it goes nowhere; that systemd does not listen is its own affair.
    let _ = sd_notify::notify(states);
}
