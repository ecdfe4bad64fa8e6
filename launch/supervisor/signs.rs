//! Whether a process works, as its system sees it: who works, or is stopped by somebody, does not hang, however long it is silent.

use std::fs;
use std::time::{Duration, Instant};

/// Between two looks at a process.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// A heartbeat takes less of the processor between two looks; in ticks of the system, a hundredth of a second.
const TICKS_OF_WORK: u64 = 2;
/// Likewise of what is read and written, bytes.
const BYTES_OF_WORK: u64 = 4096;

/// What was seen of a process.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Signs {
    looked: Option<Instant>,
    last: Usage,
    /// When it was last seen at work, or stopped.
    excused: Option<Instant>,
    /// Since when it is stopped (SIGSTOP, a debugger).
    stopped: Option<Instant>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Usage {
    ticks: u64,
    bytes: u64,
}

impl Signs {
    /// Looks at process `pid`, unless it was looked at a moment ago.
    pub(super) fn look(&mut self, pid: u32, now: Instant) {
        if self.looked.is_some_and(|looked| now.saturating_duration_since(looked) < LOOK_EVERY) {
            return;
        }
        let Some((state, ticks)) = fs::read_to_string(format!("/proc/{pid}/stat")).ok().as_deref().and_then(stat)
        else {
            return;
        };
        // Who may not be looked at so closely has the processor to show.
        let bytes = fs::read_to_string(format!("/proc/{pid}/io")).map_or(self.last.bytes, |text| io(&text));
        let usage = Usage { ticks, bytes };
        self.note(state, usage, now);
    }

    fn note(&mut self, state: char, usage: Usage, now: Instant) {
        let is_first = self.looked.replace(now).is_none();
        let last = std::mem::replace(&mut self.last, usage);
        let has_worked = !is_first
            && (usage.ticks.saturating_sub(last.ticks) >= TICKS_OF_WORK
                || usage.bytes.saturating_sub(last.bytes) >= BYTES_OF_WORK);
        match state {
            'T' | 't' => drop(self.stopped.get_or_insert(now)),
            _ => self.stopped = None,
        }
        // It has, or wants, a processor, or the system does something for it.
        if has_worked || self.stopped.is_some() || matches!(state, 'R' | 'D') {
            self.excused = Some(now);
        }
    }

    /// When it was last seen at work, or stopped.
    pub(super) fn excused(&self) -> Option<Instant> {
        self.excused
    }

    /// Since when it is stopped, if it is.
    pub(super) fn stopped(&self) -> Option<Instant> {
        self.stopped
    }

    /// Whether it was seen at work, or stopped, when it was looked at last.
    pub(super) fn is_excused(&self) -> bool {
        self.excused.is_some() && self.excused == self.looked
    }
}

/// State and processor time of `/proc/PID/stat`; a name may hold spaces and parentheses.
fn stat(text: &str) -> Option<(char, u64)> {
    let (_, fields) = text.rsplit_once(')')?;
    let fields: Vec<&str> = fields.split_whitespace().collect();
    let state = fields.first()?.chars().next()?;
    let ticks = |field: usize| fields.get(field)?.parse::<u64>().ok();
    Some((state, ticks(11)?.saturating_add(ticks(12)?)))
}

/// Bytes read and written, of `/proc/PID/io`.
fn io(text: &str) -> u64 {
    let counts = ["rchar: ", "wchar: ", "read_bytes: ", "write_bytes: "];
    let of = |line: &str| counts.iter().find_map(|name| line.strip_prefix(name))?.trim().parse().ok();
    text.lines().filter_map(of).fold(0, |sum: u64, count: u64| sum.saturating_add(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLEEPS: char = 'S';

    fn seen(looks: &[(char, u64, u64)]) -> Signs {
        let start = Instant::now();
        let mut signs = Signs::default();
        for (at, (state, ticks, bytes)) in (0..).zip(looks) {
            signs.note(*state, Usage { ticks: *ticks, bytes: *bytes }, start + Duration::from_secs(at));
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

    #[test]
    fn the_system_is_understood() {
        let text = "7 (a) b (c) R 1 7 7 0 -1 4194304 99 0 0 0 12 30 0 0 20 0 1 0 55 1 2";
        assert_eq!(stat(text), Some(('R', 42)));
        assert_eq!(stat("7 (cut) R 1"), None);
        assert_eq!(io("rchar: 10\nwchar: 20\nsyscr: 3\nread_bytes: 5\nwrite_bytes: x\n"), 35);
        let own = fs::read_to_string("/proc/self/stat").unwrap();
        assert!(matches!(stat(&own), Some(('R' | 'S', _))), "{own}");
    }
}
