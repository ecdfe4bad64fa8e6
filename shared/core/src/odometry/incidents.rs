//! What went wrong so often, since when, and how badly at worst.

use serde::{Deserialize, Serialize};

/// Events of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Incidents {
    /// The number of the events.
    pub count: u32,
    /// Stamp of the first, nanoseconds; 0 where there was none.
    pub first_ns: u64,
    /// The greatest distance among them, metres.
    pub largest_m: f64,
    /// The greatest angle among them, radians.
    pub largest_rad: f64,
}

impl Incidents {
    /// Counts one more event.
    pub fn add(&mut self, stamp_ns: u64, distance_m: f64, angle_rad: f64) {
        if self.count == 0 {
            self.first_ns = stamp_ns;
        }
        self.count = self.count.saturating_add(1);
        self.largest_m = self.largest_m.max(distance_m);
        self.largest_rad = self.largest_rad.max(angle_rad);
    }

    /// Whether the latest is worth a line where there may be thousands: the first, the tenth, the hundredth …
    #[must_use]
    pub fn is_worth_a_line(count: u32) -> bool {
        count > 0 && 10_u32.pow(count.ilog10()) == count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_and_the_worst() {
        let mut incidents = Incidents::default();
        incidents.add(7, 1.0, 0.5);
        incidents.add(9, 0.5, 2.0);
        assert_eq!(incidents, Incidents { count: 2, first_ns: 7, largest_m: 1.0, largest_rad: 2.0 });
    }

    #[test]
    fn thousands_are_a_few_lines() {
        let lines: Vec<u32> = (0..=10_000).filter(|count| Incidents::is_worth_a_line(*count)).collect();
        assert_eq!(lines, [1, 10, 100, 1000, 10_000]);
        assert!(!Incidents::is_worth_a_line(u32::MAX));
    }
}
