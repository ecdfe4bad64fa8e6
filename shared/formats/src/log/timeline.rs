//! From timed lines to stamped events.

use std::collections::VecDeque;

use super::order::{OrderStatistics, Orderer};
use super::{LogEvent, StampQuality};

/// Made-up time from one odometry line to the next where the stamps are useless.
pub(crate) const ORDER_STEP_NS: u64 = 100_000_000;

/// Order of lines at equal stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    Odometry,
    TruePose,
    Scan,
}

/// The events of one line, with its place in the order.
pub(crate) struct TimedLine {
    pub(crate) stamp_ns: Option<u64>,
    pub(crate) rank: Rank,
    /// Number of readings.
    pub(crate) weight: usize,
    /// Stamps still to be put in.
    pub(crate) events: Vec<LogEvent>,
}

/// Gives events their stamps and their order.
pub(crate) struct Timeline {
    stamps: Stamps,
    ready: VecDeque<LogEvent>,
}

enum Stamps {
    /// From the lines, put in order.
    Read(Orderer<Vec<LogEvent>>),
    /// From the order of lines.
    MadeUp { latest_ns: u64 },
}

impl Timeline {
    pub(crate) fn new(quality: StampQuality) -> Self {
        let stamps = match quality {
            StampQuality::OrderOnly => Stamps::MadeUp { latest_ns: 0 },
            StampQuality::Usable | StampQuality::Reordered { .. } => Stamps::Read(Orderer::default()),
        };
        Self { stamps, ready: VecDeque::new() }
    }

    /// A line, in the file's order.
    pub(crate) fn push(&mut self, line: TimedLine) {
        match &mut self.stamps {
            Stamps::Read(orderer) => {
                orderer.push(line.stamp_ns, line.rank as u8, line.weight, line.events);
                take_ordered(orderer, &mut self.ready);
            }
            Stamps::MadeUp { latest_ns } => {
                for event in line.events {
                    if matches!(event, LogEvent::Odometry { .. }) {
                        *latest_ns = latest_ns.saturating_add(ORDER_STEP_NS);
                    }
                    self.ready.push_back(stamped(event, *latest_ns));
                }
            }
        }
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        if let Stamps::Read(orderer) = &mut self.stamps {
            orderer.finish();
            take_ordered(orderer, &mut self.ready);
        }
    }

    /// The next event that is known to have its final place.
    pub(crate) fn pop(&mut self) -> Option<LogEvent> {
        self.ready.pop_front()
    }
}

fn take_ordered(orderer: &mut Orderer<Vec<LogEvent>>, ready: &mut VecDeque<LogEvent>) {
    while let Some((stamp_ns, events)) = orderer.pop() {
        ready.extend(events.into_iter().map(|event| stamped(event, stamp_ns)));
    }
}

fn stamped(mut event: LogEvent, at_ns: u64) -> LogEvent {
    match &mut event {
        LogEvent::Odometry { stamp_ns, .. } | LogEvent::Scan { stamp_ns, .. } | LogEvent::TruePose { stamp_ns, .. } => {
            *stamp_ns = at_ns;
        }
    }
    event
}

/// Stamps are useless if most lines have none, if more than one line in twenty had to be given
/// another stamp, or if they hardly ever change (some converters keep six digits of 1 018 930 000 s).
pub(crate) fn quality(order: OrderStatistics) -> StampQuality {
    let OrderStatistics { lines, unstamped, changes, moved, clamped } = order;
    let hardly_change = lines > 2 && (changes < 2 || lines > changes.saturating_mul(16));
    if unstamped > lines / 2 || clamped > lines / 20 + 1 || hardly_change {
        StampQuality::OrderOnly
    } else if moved > 0 {
        StampQuality::Reordered { count: moved, clamped }
    } else {
        StampQuality::Usable
    }
}
