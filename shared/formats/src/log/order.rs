//! Lines into stamp order, within bounded memory.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// A line waits until one this much younger has been seen.
const WINDOW_NS: u64 = 2_000_000_000;
/// A jump ahead beyond this must be confirmed by the line after it.
const JUMP_NS: u64 = 60_000_000_000;
/// Readings (and lines) that may wait.
const WEIGHT_LIMIT: usize = 1 << 18;

/// A line on its way.
struct Waiting<T> {
    stamp_ns: u64,
    rank: u8,
    sequence: u64,
    weight: usize,
    payload: T,
}

impl<T> Waiting<T> {
    fn key(&self) -> (u64, u8, u64) {
        (self.stamp_ns, self.rank, self.sequence)
    }
}

impl<T> PartialEq for Waiting<T> {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl<T> Eq for Waiting<T> {}

impl<T> PartialOrd for Waiting<T> {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for Waiting<T> {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

/// What became of the lines' stamps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct OrderStatistics {
    /// Lines in all.
    pub(crate) lines: u64,
    /// Lines without a usable stamp.
    pub(crate) unstamped: u64,
    /// Changes of the stamp from one line to the next, and 1 for the first.
    pub(crate) changes: u64,
    /// Lines earlier than one before them.
    pub(crate) moved: u64,
    /// Of these, lines whose stamp had to be replaced.
    pub(crate) clamped: u64,
}

/// Puts lines into the order of stamp, rank and line; late ones take the last stamp given out.
pub(crate) struct Orderer<T> {
    waiting: BinaryHeap<Reverse<Waiting<T>>>,
    ready: VecDeque<(u64, T)>,
    /// A line after a jump ahead, not confirmed yet.
    suspect: Option<Waiting<T>>,
    weight: usize,
    previous_ns: Option<u64>,
    newest_ns: u64,
    last_out_ns: u64,
    statistics: OrderStatistics,
}

impl<T> Default for Orderer<T> {
    fn default() -> Self {
        Self {
            waiting: BinaryHeap::new(),
            ready: VecDeque::new(),
            suspect: None,
            weight: 0,
            previous_ns: None,
            newest_ns: 0,
            last_out_ns: 0,
            statistics: OrderStatistics::default(),
        }
    }
}

impl<T> Orderer<T> {
    /// A line, in the file's order. Without a stamp it goes right after the line before it.
    /// `rank` orders lines of equal stamps, `weight` is the number of its readings.
    pub(crate) fn push(&mut self, stamp_ns: Option<u64>, rank: u8, weight: usize, payload: T) {
        self.statistics.lines += 1;
        self.statistics.unstamped += u64::from(stamp_ns.is_none());
        let before = self.suspect.as_ref().map(|suspect| suspect.stamp_ns).or(self.previous_ns);
        let stamp_ns = stamp_ns.or(before).unwrap_or(0);
        let line =
            Waiting { stamp_ns, rank, sequence: self.statistics.lines, weight: weight.saturating_add(1), payload };
        if let Some(suspect) = self.suspect.take() {
            self.judge(suspect, Some(stamp_ns));
        }
        match self.previous_ns {
            Some(previous) if stamp_ns > previous.saturating_add(JUMP_NS) => self.suspect = Some(line),
            _ => self.admit(line),
        }
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        if let Some(suspect) = self.suspect.take() {
            self.judge(suspect, None);
        }
        while self.release() {}
    }

    /// The next line in order that is known to have its final place.
    pub(crate) fn pop(&mut self) -> Option<(u64, T)> {
        self.ready.pop_front()
    }

    pub(crate) fn statistics(&self) -> OrderStatistics {
        self.statistics
    }

    /// A jump ahead is real if the next line is nearer to it than to the line before.
    fn judge(&mut self, mut suspect: Waiting<T>, next_ns: Option<u64>) {
        let previous = self.previous_ns.unwrap_or(0);
        let confirmed = next_ns.is_some_and(|next| next.abs_diff(suspect.stamp_ns) <= next.abs_diff(previous));
        if !confirmed {
            suspect.stamp_ns = previous;
            self.statistics.moved += 1;
            self.statistics.clamped += 1;
        }
        self.admit(suspect);
    }

    fn admit(&mut self, mut line: Waiting<T>) {
        let stamp_ns = line.stamp_ns;
        self.statistics.changes += u64::from(self.previous_ns != Some(stamp_ns));
        self.statistics.moved += u64::from(stamp_ns < self.newest_ns);
        // A line from long ago says nothing about where the next ones should be.
        if self.previous_ns.is_none_or(|previous| stamp_ns.saturating_add(JUMP_NS) >= previous) {
            self.previous_ns = Some(stamp_ns);
        }
        self.newest_ns = self.newest_ns.max(stamp_ns);
        if stamp_ns < self.last_out_ns {
            line.stamp_ns = self.last_out_ns;
            self.statistics.clamped += 1;
        }
        self.weight += line.weight;
        self.waiting.push(Reverse(line));
        while self.weight > WEIGHT_LIMIT
            || self
                .waiting
                .peek()
                .is_some_and(|Reverse(oldest)| oldest.stamp_ns.saturating_add(WINDOW_NS) < self.newest_ns)
        {
            if !self.release() {
                break;
            }
        }
    }

    fn release(&mut self) -> bool {
        let Some(Reverse(line)) = self.waiting.pop() else { return false };
        self.weight -= line.weight;
        self.last_out_ns = line.stamp_ns;
        self.ready.push_back((line.stamp_ns, line.payload));
        true
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn order(seconds: &[Option<f64>]) -> (Vec<(f64, usize)>, OrderStatistics) {
        let mut orderer = Orderer::default();
        let mut out = Vec::new();
        for (number, stamp) in seconds.iter().enumerate() {
            orderer.push(stamp.map(|s| (s * 1e9) as u64), 0, 1, number);
            while let Some((stamp, number)) = orderer.pop() {
                out.push((stamp as f64 / 1e9, number));
            }
        }
        orderer.finish();
        while let Some((stamp, number)) = orderer.pop() {
            out.push((stamp as f64 / 1e9, number));
        }
        (out, orderer.statistics())
    }

    #[test]
    fn a_little_disorder_is_sorted() {
        let (out, statistics) = order(&[Some(1.0), Some(1.5), Some(1.2), Some(9.0)]);
        assert_eq!(out, [(1.0, 0), (1.2, 2), (1.5, 1), (9.0, 3)]);
        assert_eq!((statistics.moved, statistics.clamped), (1, 0));
    }

    #[test]
    fn too_late_is_clamped() {
        let (out, statistics) = order(&[Some(1.0), Some(2.0), Some(5.0), Some(0.5)]);
        assert_eq!(out, [(1.0, 0), (2.0, 1), (2.0, 3), (5.0, 2)]);
        assert_eq!((statistics.moved, statistics.clamped), (1, 1));
    }

    #[test]
    fn one_absurd_stamp_does_not_drag_the_rest_along() {
        let (out, statistics) = order(&[Some(1.0), Some(9e8), Some(2.0), None, Some(3.0)]);
        assert_eq!(out, [(1.0, 0), (1.0, 1), (2.0, 2), (2.0, 3), (3.0, 4)]);
        assert_eq!((statistics.clamped, statistics.unstamped), (1, 1));
    }

    #[test]
    fn a_confirmed_jump_is_real() {
        let (out, statistics) = order(&[Some(0.0), Some(9e8), Some(9e8 + 1.0)]);
        assert_eq!(out, [(0.0, 0), (9e8, 1), (9e8 + 1.0, 2)]);
        assert_eq!(statistics.moved, 0);
    }

    #[test]
    fn rank_orders_equal_stamps() {
        let mut orderer = Orderer::default();
        orderer.push(Some(SECOND), 2, 1, "scan");
        orderer.push(Some(SECOND), 0, 0, "odometry");
        orderer.finish();
        assert_eq!(orderer.pop(), Some((SECOND, "odometry")));
        assert_eq!(orderer.pop(), Some((SECOND, "scan")));
        assert_eq!(orderer.pop(), None);
    }

    #[test]
    fn what_waits_is_bounded() {
        let mut orderer = Orderer::default();
        for number in 0..10_000_u32 {
            orderer.push(Some(SECOND), 0, 1000, number);
            assert!(orderer.waiting.len() <= WEIGHT_LIMIT / 1000 + 1);
            assert!(orderer.pop().is_none_or(|(stamp, _)| stamp == SECOND));
        }
    }

    proptest! {
        #[test]
        fn nothing_is_lost_and_stamps_never_fall(stamps in prop::collection::vec(prop::option::of(0.0..400.0), 0..60)) {
            let (out, _) = order(&stamps);
            prop_assert_eq!(out.len(), stamps.len());
            prop_assert!(out.windows(2).all(|pair| pair[0].0 <= pair[1].0));
            let mut numbers: Vec<_> = out.iter().map(|(_, number)| *number).collect();
            numbers.sort_unstable();
            prop_assert_eq!(numbers, (0..stamps.len()).collect::<Vec<_>>());
        }
    }
}
