//! What is known of the stamps of one source of messages.

use std::collections::VecDeque;

use super::clock::{DEFAULT_PERIOD_NS, WINDOW_NS};

/// Stamps that are remembered.
const RECENT: usize = 512;

/// What is known of the stamps of one source of messages.
#[derive(Debug, Default)]
pub(crate) struct Track {
    pub(crate) last_ns: u64,
    /// Stamps within the window, as they came.
    pub(crate) recent: VecDeque<u64>,
    /// Time that went by from stamp to stamp, gaps left out, and stamps.
    flown_ns: u64,
    pub(crate) count: u64,
    /// Messages whose stamps did not count.
    pub(crate) strays: u64,
}

impl Track {
    pub(crate) fn add(&mut self, stamp_ns: u64) {
        let gap_ns = stamp_ns.saturating_sub(self.last_ns);
        if self.count > 0 && gap_ns <= WINDOW_NS {
            self.flown_ns += gap_ns;
        }
        self.count += 1;
        self.last_ns = self.last_ns.max(stamp_ns);
        self.recent.push_back(stamp_ns);
        let from_ns = self.last_ns.saturating_sub(WINDOW_NS);
        while self.recent.len() > RECENT || self.recent.front().is_some_and(|oldest| *oldest < from_ns) {
            self.recent.pop_front();
        }
    }

    /// Typical time from one message to the next, nanoseconds.
    pub(crate) fn period_ns(&self) -> u64 {
        if self.count < 2 || self.flown_ns == 0 {
            return DEFAULT_PERIOD_NS;
        }
        (self.flown_ns / (self.count - 1)).max(1)
    }
}
