//! The launcher's own time: while it does not run itself, nobody is late.

use std::time::{Duration, Instant};

/// The launcher looks ten times a second; what passes beyond this from one look to the next, it did not get the processor for
/// (it was stopped, its container paused, the machine asleep), and the services most likely did not either.
const LONGEST_TICK: Duration = Duration::from_secs(1);

/// Time in which the launcher ran.
#[derive(Debug)]
pub struct Clock {
    looked: Instant,
    lost: Duration,
    begun: Instant,
}

impl Clock {
    /// A clock that begins now.
    #[must_use]
    pub fn new(now: Instant) -> Self {
        Self { looked: now, lost: Duration::ZERO, begun: now }
    }

    /// What time it is for deadlines, when it is `now` on the wall.
    pub fn look(&mut self, now: Instant) -> Instant {
        self.lost += now.saturating_duration_since(self.looked).saturating_sub(LONGEST_TICK);
        self.looked = now;
        now.checked_sub(self.lost).map_or(self.begun, |now| now.max(self.begun))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stands_still_while_the_launcher_does() {
        let start = Instant::now();
        let mut clock = Clock::new(start);
        let mut passed = |seconds: f64| {
            clock.look(start + Duration::from_secs_f64(seconds)).saturating_duration_since(start).as_secs_f64()
        };
        assert_eq!([passed(0.1), passed(0.9)], [0.1, 0.9]);
        // A night in a closed lid is a tick.
        assert_eq!([passed(30_000.9), passed(30_001.4)], [1.9, 2.4]);
    }
}
