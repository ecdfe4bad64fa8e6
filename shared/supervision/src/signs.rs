//! Whether a process works, as its system sees it: who works, or is stopped by somebody, does not hang, however long it is silent.

use std::time::{Duration, Instant};

/// Between two looks at a process.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// A heartbeat takes less of the processor between two looks; in ticks of the system, a hundredth of a second.
const TICKS_OF_WORK: u64 = 2;
/// Likewise of what is read and written, bytes.
const BYTES_OF_WORK: u64 = 4096;

/// What was seen of a process.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Signs {
    looked: Option<Instant>,
    last: Usage,
    /// When it was last seen at work, or stopped.
    excused: Option<Instant>,
    /// Since when it is stopped (SIGSTOP, a debugger).
    stopped: Option<Instant>,
}

/// What the system shows of a process.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Usage {
    /// The letter of its state, as `/proc/PID/stat` has it: R, S, D, T …
    pub state: char,
    /// Processor time that it has had, in hundredths of a second.
    pub ticks: u64,
    /// What it has read and written, bytes.
    pub bytes: u64,
}

impl Signs {
    /// Takes note of what is shown of it, unless that was done a moment ago.
    pub(crate) fn look(&mut self, usage: impl FnOnce() -> Option<Usage>, now: Instant) {
        if self.looked.is_some_and(|looked| now.saturating_duration_since(looked) < LOOK_EVERY) {
            return;
        }
        if let Some(usage) = usage() {
            self.note(usage, now);
        }
    }

    fn note(&mut self, usage: Usage, now: Instant) {
        let is_first = self.looked.replace(now).is_none();
        let last = std::mem::replace(&mut self.last, usage);
        let has_worked = !is_first
            && (usage.ticks.saturating_sub(last.ticks) >= TICKS_OF_WORK
                || usage.bytes.saturating_sub(last.bytes) >= BYTES_OF_WORK);
        match usage.state {
            'T' | 't' => drop(self.stopped.get_or_insert(now)),
            _ => self.stopped = None,
        }
        // It has, or wants, a processor, or the system does something for it.
        if has_worked || self.stopped.is_some() || matches!(usage.state, 'R' | 'D') {
            self.excused = Some(now);
        }
    }

    /// When it was last seen at work, or stopped.
    pub(crate) fn excused(&self) -> Option<Instant> {
        self.excused
    }

    /// Since when it is stopped, if it is.
    pub(crate) fn stopped(&self) -> Option<Instant> {
        self.stopped
    }

    /// Whether it was seen at work, or stopped, when it was looked at last.
    pub(crate) fn is_excused(&self) -> bool {
        self.excused.is_some() && self.excused == self.looked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLEEPS: char = 'S';

    fn seen(looks: &[(char, u64, u64)]) -> Signs {
        let start = Instant::now();
        let mut signs = Signs::default();
        for (at, (state, ticks, bytes)) in (0..).zip(looks) {
            signs.note(Usage { state: *state, ticks: *ticks, bytes: *bytes }, start + Duration::from_secs(at));
        }
        signs
    }

    #[test]
    fn who_works_or_is_stopped_is_told_from_who_sleeps() {
        // What it did before it was looked at is long ago.
        assert!(!seen(&[(SLEEPS, 500, 1 << 20)]).is_excused());
        // A heartbeat is no work.
        assert!(!seen(&[(SLEEPS, 5, 100), (SLEEPS, 6, 200)]).is_excused());
        assert!(seen(&[(SLEEPS, 5, 100), (SLEEPS, 25, 100)]).is_excused());
        assert!(seen(&[(SLEEPS, 5, 100), (SLEEPS, 5, 100_000)]).is_excused());
        for state in ['R', 'D', 'T', 't'] {
            assert!(seen(&[(state, 0, 0)]).is_excused(), "{state}");
        }
        let stopped = seen(&[('T', 0, 0), ('T', 0, 0)]);
        assert!(stopped.stopped().is_some() && stopped.stopped() < stopped.excused());
        let goes_on = seen(&[('T', 0, 0), (SLEEPS, 0, 0)]);
        assert!(goes_on.stopped().is_none() && !goes_on.is_excused() && goes_on.excused().is_some());
    }
}
