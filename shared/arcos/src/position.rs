//! Positions that the robot counts in 15 bits.

/// Follows a position that wraps around at 2¹⁵ counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counter {
    last: Option<u16>,
    /// Counts since the robot began to count, as near as 15 bits tell.
    counts: i64,
    /// Whether the robot began to count anew: what it says next is where it was.
    restarted: bool,
}

impl Counter {
    /// The position now, in counts: the nearest to the one before that looks so in 15 bits. The first is the robot's own, so that
    /// whoever takes over an open session goes on where the one before was.
    pub fn follow(&mut self, raw: u16) -> i64 {
        let raw = raw & 0x7FFF;
        let restarted = std::mem::take(&mut self.restarted);
        match self.last.replace(raw) {
            Some(last) => self.counts += centred(raw.wrapping_sub(last)),
            None if !restarted => self.counts = centred(raw),
            None => {}
        }
        self.counts
    }

    /// Goes on from where it is at the next position, whichever that is: the robot began to count anew.
    pub fn restart(&mut self) {
        self.restarted = self.last.take().is_some() || self.restarted;
    }
}

/// 15 bits as a number with a sign.
fn centred(raw: u16) -> i64 {
    let counts = i64::from(raw & 0x7FFF);
    if counts >= 0x4000 { counts - 0x8000 } else { counts }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_wraps_both_ways() {
        let mut counter = Counter::default();
        assert_eq!([0x7FFE, 1, 0xFFFE, 0x7000, 0x1000].map(|raw| counter.follow(raw)), [-2, 1, -2, -4096, 4096]);
        counter.restart();
        assert_eq!(counter.follow(12), 4096);
        assert_eq!(counter.follow(13), 4097);
    }

    /// Firmware that sends a signed position is followed, too.
    #[test]
    fn the_highest_bit_says_nothing() {
        let mut counter = Counter::default();
        counter.follow(0);
        assert_eq!(counter.follow((-5_i16).cast_unsigned()), -5);
    }
}
