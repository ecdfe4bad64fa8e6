//! When a recorded message is due.

use std::time::{Duration, Instant};

/// A longer time in which a recording says nothing is not waited out.
const SILENCE_NS: u64 = 60_000_000_000;

/// Plays stamps at a rate, from the first one on.
#[derive(Debug)]
pub struct Pace {
    rate: Option<f64>,
    start: Option<(Instant, u64)>,
    last_ns: u64,
}

impl Pace {
    /// A pace of so many times real time (none: everything is due at once) that starts with its first stamp.
    #[must_use]
    pub fn new(rate: Option<f64>) -> Self {
        Self { rate, start: None, last_ns: 0 }
    }

    /// From here on, as if the first stamp were this one: what came before was played by somebody else.
    pub fn skip_to(&mut self, stamp_ns: u64, now: Instant) {
        self.start = Some((now, stamp_ns));
    }

    /// How long until a message of this stamp is due; zero if it is. The first after a minute's silence, or more, is due at
    /// once: nobody waits for a robot that slept, or for a clock that was set.
    pub fn until(&mut self, stamp_ns: u64, now: Instant) -> Duration {
        let Some(times) = self.rate else { return Duration::ZERO };
        if self.start.is_some() && stamp_ns > self.last_ns.saturating_add(SILENCE_NS) {
            self.skip_to(stamp_ns, now);
        }
        self.last_ns = self.last_ns.max(stamp_ns);
        let (start, first_ns) = *self.start.get_or_insert((now, stamp_ns));
        let seconds = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9 / times;
        // A stamp too far off for the clock is due in a year.
        let due = start + Duration::try_from_secs_f64(seconds).unwrap_or(Duration::from_secs(31_557_600));
        due.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_divides_the_time_between_stamps() {
        let now = Instant::now();
        let mut pace = Pace::new(Some(20.0));
        assert_eq!(pace.until(5_000_000_000, now), Duration::ZERO);
        assert_eq!(pace.until(7_000_000_000, now), Duration::from_millis(100));
        assert_eq!(pace.until(7_000_000_000, now + Duration::from_secs(1)), Duration::ZERO);
        assert_eq!(Pace::new(None).until(u64::MAX, now), Duration::ZERO);
        // Nobody waits for who sleeps.
        assert_eq!(pace.until(700_000_000_000, now), Duration::ZERO);
        assert_eq!(pace.until(702_000_000_000, now), Duration::from_millis(100));
    }
}
