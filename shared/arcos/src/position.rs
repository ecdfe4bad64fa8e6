//! Positions that the robot counts in 15 bits.

/// Follows a position that wraps around at 2¹⁵ counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counter {
    last: Option<u16>,
    /// Counts since the first that was seen.
    counts: i64,
}

impl Counter {
    /// The position now, in counts since the first one: the nearest to the one before that looks so in 15 bits.
    pub fn follow(&mut self, raw: u16) -> i64 {
        let raw = raw & 0x7FFF;
        if let Some(last) = self.last.replace(raw) {
            let ahead = i64::from(raw.wrapping_sub(last) & 0x7FFF);
            self.counts += if ahead >= 0x4000 { ahead - 0x8000 } else { ahead };
        }
        self.counts
    }

    /// Goes on from where it is at the next position, whichever that is: the robot began to count anew.
    pub fn restart(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_wraps_both_ways() {
        let mut counter = Counter::default();
        assert_eq!([0x7FFE, 1, 0xFFFE, 0x7000, 0x1000].map(|raw| counter.follow(raw)), [0, 3, 0, -4094, 4098]);
        counter.restart();
        assert_eq!(counter.follow(12), 4098);
        assert_eq!(counter.follow(13), 4099);
    }

    /// Firmware that sends a signed position is followed, too.
    #[test]
    fn the_highest_bit_says_nothing() {
        let mut counter = Counter::default();
        counter.follow(0);
        assert_eq!(counter.follow((-5_i16).cast_unsigned()), -5);
    }
}
