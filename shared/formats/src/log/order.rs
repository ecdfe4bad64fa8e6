//! Stamped lines into stamp order, within bounded memory.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use super::clock::{SORT_NS, Stamped};
use super::timeline::TimedLine;

/// Readings (and lines) that may wait.
const WEIGHT_LIMIT: usize = 1 << 18;

/// A line on its way.
struct Waiting<T> {
    stamp_ns: u64,
    /// CountedBy in the file.
    place: u64,
    line: TimedLine<T>,
}

impl<T> Waiting<T> {
    fn key(&self) -> (u64, u64) {
        (self.stamp_ns, self.place)
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

/// Puts lines into the order of stamps; lines of equal stamps keep that of the file, and what comes too late to be put in
/// order takes the last stamp given out.
pub(crate) struct Orderer<T> {
    waiting: BinaryHeap<Reverse<Waiting<T>>>,
    ready: VecDeque<Stamped<T>>,
    weight: usize,
    places: u64,
    newest_ns: u64,
    last_out_ns: u64,
}

impl<T> Default for Orderer<T> {
    fn default() -> Self {
        Self { waiting: BinaryHeap::new(), ready: VecDeque::new(), weight: 0, places: 0, newest_ns: 0, last_out_ns: 0 }
    }
}

impl<T> Orderer<T> {
    /// A line, in the file's order.
    pub(crate) fn push(&mut self, Stamped { stamp_ns, line }: Stamped<T>) {
        self.places += 1;
        self.newest_ns = self.newest_ns.max(stamp_ns);
        self.weight = self.weight.saturating_add(line.weight).saturating_add(1);
        let stamp_ns = stamp_ns.max(self.last_out_ns);
        self.waiting.push(Reverse(Waiting { stamp_ns, place: self.places, line }));
        while self.weight > WEIGHT_LIMIT || self.oldest_is_due() {
            if !self.release() {
                break;
            }
        }
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        while self.release() {}
    }

    /// The next line in order that is known to have its final place.
    pub(crate) fn pop(&mut self) -> Option<Stamped<T>> {
        self.ready.pop_front()
    }

    fn oldest_is_due(&self) -> bool {
        let oldest = self.waiting.peek();
        oldest.is_some_and(|Reverse(oldest)| oldest.stamp_ns.saturating_add(SORT_NS) < self.newest_ns)
    }

    fn release(&mut self) -> bool {
        let Some(Reverse(Waiting { stamp_ns, line, .. })) = self.waiting.pop() else { return false };
        self.weight = self.weight.saturating_sub(line.weight).saturating_sub(1);
        self.last_out_ns = stamp_ns;
        self.ready.push_back(Stamped { stamp_ns, line });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::timeline::tests::line;

    fn order(stamps: &[u64]) -> Vec<(u64, u64)> {
        let mut orderer = Orderer::default();
        for (number, stamp_ns) in (0..).zip(stamps) {
            orderer.push(Stamped { stamp_ns: *stamp_ns, line: line(number, 0, None) });
        }
        orderer.finish();
        std::iter::from_fn(|| orderer.pop()).map(|out| (out.stamp_ns, out.line.number)).collect()
    }

    #[test]
    fn by_stamp_and_then_by_line() {
        const S: u64 = 1_000_000_000;
        assert_eq!(
            order(&[S, 15 * S / 10, 12 * S / 10, S, 9 * S]),
            [(S, 0), (S, 3), (12 * S / 10, 2), (15 * S / 10, 1), (9 * S, 4)]
        );
        assert_eq!(order(&[S, 2 * S, 39 * S, S / 2]), [(S, 0), (2 * S, 1), (2 * S, 3), (39 * S, 2)]);
    }

    #[test]
    fn what_waits_is_bounded() {
        let mut orderer = Orderer::default();
        for number in 0..10_000 {
            let mut line = line(number, 0, None);
            line.weight = 1000;
            orderer.push(Stamped { stamp_ns: 1, line });
            assert!(orderer.waiting.len() <= WEIGHT_LIMIT / 1000 + 1);
            while orderer.pop().is_some() {}
        }
    }
}
