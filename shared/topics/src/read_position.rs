//! A reader's place in a stream: what is new, what was there before, what is missing, what can't be.

use crate::contract::Fault;
use crate::topic::Delivery;
use crate::wire::Header;

/// A sequence that is further ahead than this is taken for a fault, not for a loss.
const LONGEST_GAP: u64 = 1 << 20;
/// Producers' lives that are told apart: the one that died may still have messages in the queue.
const LIVES: usize = 4;

/// What a message is to a reader.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Step {
    /// The next one.
    New,
    /// It was here before: a restarted producer sends again what may be missing somewhere.
    Known,
    /// Its header can't be right.
    Faulty(Fault),
}

/// Where a reader is in a stream.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReadPosition {
    /// 0 before the first message.
    pub(crate) epoch: u64,
    pub(crate) sequence: u64,
    /// Messages that never arrived, by the gaps in the sequence.
    pub(crate) lost: u64,
    /// The only epoch that is right, if that is known.
    expected: Option<u64>,
    stamp_ns: u64,
    /// Lives of producers, the latest last, and the last sequence of each.
    lives: Vec<(u32, u64)>,
    /// The epoch before this one.
    retired: u64,
    /// Life of the producer that said something right last; 0: none yet.
    life: u32,
}

impl ReadPosition {
    /// After message `sequence` of the run `epoch`, whose stamp was `stamp_ns`.
    pub(crate) fn after(epoch: u64, sequence: u64, stamp_ns: u64) -> Self {
        Self { epoch, sequence, stamp_ns, expected: Some(epoch), ..Self::default() }
    }

    /// Stamp of the latest message, nanoseconds.
    pub(crate) fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }

    /// Takes note of a message; `is_good`: what it says can be.
    pub(crate) fn follow(&mut self, delivery: Delivery, header: &Header, is_good: bool) -> Step {
        match delivery {
            // A stranger that talks nonsense must not use up the number of a message that is still to come.
            Delivery::Lossless if !is_good && self.life != 0 && header.life != self.life => Step::New,
            Delivery::Lossless => {
                let step = self.follow_run(header);
                if is_good && step == Step::New {
                    self.life = header.life;
                }
                step
            }
            Delivery::Relayed => self.follow_life(header),
            Delivery::Latest | Delivery::Droppable => {
                (self.epoch, self.sequence, self.stamp_ns) = (header.epoch, header.sequence, header.stamp_ns);
                Step::New
            }
        }
    }

    /// A stream that is numbered through all lives of its producer.
    fn follow_run(&mut self, header: &Header) -> Step {
        let Header { sequence, epoch, stamp_ns, life, .. } = *header;
        if self.expected.is_some_and(|expected| epoch != expected) || epoch == 0 {
            return fault("epoch", epoch, "that of the run, as the plan says");
        }
        if epoch != self.epoch {
            // Whoever only looks on takes any run; what was before it came is not lost.
            let come_at = if self.expected.is_none() { sequence.saturating_sub(1) } else { 0 };
            *self = Self { epoch, lost: self.lost, expected: self.expected, sequence: come_at, ..Self::default() };
        }
        match self.lives.iter_mut().find(|(known, _)| *known == life) {
            Some((_, last)) if sequence <= *last => return fault("sequence", sequence, "more than the one before"),
            Some((_, last)) => *last = sequence,
            None => {
                if self.lives.len() == LIVES {
                    self.lives.remove(0);
                }
                self.lives.push((life, sequence));
            }
        }
        if sequence <= self.sequence {
            if stamp_ns > self.stamp_ns {
                return fault(
                    "sequence",
                    sequence,
                    "to go on where the run was: numbered anew, it can't be told apart",
                );
            }
            return Step::Known;
        }
        let gap = sequence - self.sequence - 1;
        if gap > LONGEST_GAP {
            return fault("sequence", sequence, "at most 2^20 ahead of the one before");
        }
        self.lost = self.lost.saturating_add(gap);
        self.sequence = sequence;
        if stamp_ns < self.stamp_ns {
            return fault("stamp_ns", stamp_ns, "a stamp not before that of the message before");
        }
        self.stamp_ns = stamp_ns;
        Step::New
    }

    /// A stream that is numbered in each life of its producer.
    fn follow_life(&mut self, header: &Header) -> Step {
        let Header { sequence, epoch, stamp_ns, .. } = *header;
        if epoch == 0 {
            return fault("epoch", epoch, "not 0");
        }
        if epoch == self.retired {
            // Of a producer that is dead: its successor has told it all once more.
            return Step::Known;
        }
        if epoch == self.epoch {
            if sequence <= self.sequence {
                return fault("sequence", sequence, "more than the one before");
            }
            self.lost = self.lost.saturating_add((sequence - self.sequence - 1).min(LONGEST_GAP));
        } else {
            self.retired = self.epoch;
        }
        (self.epoch, self.sequence, self.stamp_ns) = (epoch, sequence, stamp_ns);
        Step::New
    }
}

fn fault(field: &'static str, value: u64, expected: &'static str) -> Step {
    Step::Faulty(Fault { field, value: value.to_string(), expected })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn header(life: u32, sequence: u64) -> Header {
        Header { sequence, epoch: 7, stamp_ns: sequence.saturating_mul(10), life, ..Header::default() }
    }

    fn follow(place: &mut ReadPosition, header: &Header) -> Step {
        place.follow(Delivery::Lossless, header, true)
    }

    fn is_faulty(step: &Step, field: &str) -> bool {
        matches!(step, Step::Faulty(fault) if fault.field == field)
    }

    #[test]
    fn gaps_are_counted_and_jumps_refused() {
        let mut place = ReadPosition::after(7, 0, 0);
        assert_eq!(follow(&mut place, &header(1, 1)), Step::New);
        assert_eq!(follow(&mut place, &header(1, 4)), Step::New);
        assert_eq!(place.lost, 2);
        assert!(is_faulty(&follow(&mut place, &header(1, 3)), "sequence"));
        assert!(is_faulty(&follow(&mut place, &header(2, u64::MAX)), "sequence"));
        assert!(is_faulty(&follow(&mut place, &Header { epoch: 8, ..header(1, 5) }), "epoch"));
        assert!(is_faulty(&follow(&mut place, &Header { stamp_ns: 39, ..header(1, 5) }), "stamp_ns"));
        // That one was refused, not lost.
        assert_eq!(follow(&mut place, &header(1, 6)), Step::New);
        assert_eq!((place.sequence, place.lost), (6, 2));
    }

    #[test]
    fn nonsense_of_a_stranger_takes_nobodys_place() {
        let mut place = ReadPosition::after(7, 0, 0);
        assert_eq!(follow(&mut place, &header(1, 1)), Step::New);
        assert_eq!(place.follow(Delivery::Lossless, &header(2, 2), false), Step::New);
        assert_eq!((place.sequence, follow(&mut place, &header(1, 2))), (1, Step::New));
        // Its own nonsense is followed: it waits until that is acknowledged.
        assert_eq!(place.follow(Delivery::Lossless, &header(1, 3), false), Step::New);
        // A life that begins with nonsense is followed once it says something right.
        assert_eq!(place.follow(Delivery::Lossless, &header(3, 4), false), Step::New);
        assert_eq!((place.sequence, follow(&mut place, &header(3, 5))), (3, Step::New));
        assert_eq!((place.sequence, place.lost), (5, 1));
    }

    #[test]
    fn a_producer_that_numbers_anew_is_told() {
        let mut place = ReadPosition::after(7, 100, 1000);
        assert_eq!(follow(&mut place, &header(2, 99)), Step::Known);
        assert!(is_faulty(&follow(&mut place, &Header { stamp_ns: 1001, ..header(3, 1) }), "sequence"));
    }

    #[test]
    fn a_relayed_stream_begins_anew_with_its_producer() {
        let relayed = |place: &mut ReadPosition, epoch, sequence| {
            place.follow(Delivery::Relayed, &Header { sequence, epoch, ..Header::default() }, true)
        };
        let mut place = ReadPosition::default();
        assert_eq!(relayed(&mut place, 5, 17), Step::New);
        assert_eq!(relayed(&mut place, 5, 19), Step::New);
        assert_eq!(relayed(&mut place, 6, 1), Step::New);
        assert_eq!(relayed(&mut place, 5, 20), Step::Known);
        assert!(is_faulty(&relayed(&mut place, 6, 1), "sequence"));
        assert_eq!((place.sequence, place.lost), (1, 1));
    }

    proptest! {
        /// However the queues of a producer's lives are read, every message is new once, in order, and none is missed.
        #[test]
        fn lives_make_one_stream(
            first_lives in prop::collection::vec((1_u64..40, 1_u64..40), 1..4),
            picks in prop::collection::vec(any::<prop::sample::Index>(), 400),
        ) {
            // Each life begins no later than where the one before ended, as what was stored lies before that.
            let mut queues: Vec<std::collections::VecDeque<Header>> = Vec::new();
            let mut end = 0_u64;
            for (life, (back, count)) in (1..).zip(first_lives) {
                let start = (end + 1).saturating_sub(back).max(1);
                queues.push((start..start + count).map(|sequence| header(life, sequence)).collect());
                end = end.max(start + count - 1);
            }
            let mut place = ReadPosition::after(7, 0, 0);
            let mut seen = Vec::new();
            for pick in picks {
                let full: Vec<usize> = (0..queues.len()).filter(|i| !queues[*i].is_empty()).collect();
                if full.is_empty() { break }
                // A later life's queue is read only once what came before its start is here: nobody stored it else.
                let ready: Vec<usize> =
                    full.into_iter().filter(|i| queues[*i][0].sequence <= place.sequence + 1).collect();
                let header = queues[ready[pick.index(ready.len())]].pop_front().unwrap();
                if follow(&mut place, &header) == Step::New { seen.push(header.sequence) }
            }
            prop_assert_eq!(seen, (1..=place.sequence).collect::<Vec<_>>());
            prop_assert_eq!(place.lost, 0);
        }
    }
}
