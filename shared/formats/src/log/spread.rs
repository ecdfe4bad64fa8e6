//! Lines of one stamp: those of one source can't have come at one time.
//!
//! Clocks that count whole seconds, that stand still, and lines without stamps all end as several messages of one source at
//! one stamp. The file's order decides: a new *instant* begins where a source comes for the second time, and the instants
//! share the time until the next stamp; a clock that stood still and did not make up for it goes on later by what it lost.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::clock::{DEFAULT_PERIOD_NS, Stamped, WINDOW_NS};
use super::clock_report::ClockReport;
use super::timeline::{Source, TimedLine};

/// Readings (and lines) that may wait for the next stamp.
const WEIGHT_LIMIT: usize = 1 << 18;

/// Gives the instants of one stamp stamps of their own.
pub(crate) struct Spread<T> {
    /// Lines of one stamp, in the file's order.
    group: Vec<TimedLine<T>>,
    group_weight: usize,
    /// The stamp that they have in common.
    shared_ns: u64,
    /// Added to all stamps, as the clock stood still.
    shift_ns: u64,
    /// No instant may come before this.
    free_ns: u64,
    periods: Periods,
    ready: VecDeque<Stamped<T>>,
    /// Different stamps so far.
    stamps: u64,
    first_ns: Option<u64>,
    report: ClockReport,
}

impl<T> Default for Spread<T> {
    fn default() -> Self {
        Self {
            group: Vec::new(),
            group_weight: 0,
            shared_ns: 0,
            shift_ns: 0,
            free_ns: 0,
            periods: Periods::default(),
            ready: VecDeque::new(),
            stamps: 0,
            first_ns: None,
            report: ClockReport::default(),
        }
    }
}

impl<T> Spread<T> {
    /// A line, in the order of stamps.
    pub(crate) fn push(&mut self, Stamped { stamp_ns, line }: Stamped<T>) {
        if stamp_ns != self.shared_ns || self.stamps == 0 {
            self.close(Some(stamp_ns));
            self.shared_ns = stamp_ns;
            self.stamps += 1;
            self.first_ns.get_or_insert(stamp_ns);
        }
        self.group_weight += line.weight + 1;
        self.group.push(line);
        if self.group_weight > WEIGHT_LIMIT {
            self.close(None);
        }
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        self.close(None);
    }

    /// The next line; at equal stamps odometry first, then true poses, then scans.
    pub(crate) fn pop(&mut self) -> Option<Stamped<T>> {
        self.ready.pop_front()
    }

    /// How many different stamps there were.
    pub(crate) fn stamps(&self) -> u64 {
        self.stamps
    }

    /// Average time from one stamp to the next, nanoseconds.
    pub(crate) fn resolution_ns(&self) -> u64 {
        let steps = self.stamps.saturating_sub(1).max(1);
        self.first_ns.map_or(0, |first_ns| self.shared_ns.saturating_sub(first_ns) / steps)
    }

    /// What was made of equal stamps.
    pub(crate) fn report(&self) -> &ClockReport {
        &self.report
    }

    /// Gives out the group; the next stamp of the clock, if it is known, bounds the time that it may take.
    fn close(&mut self, next_ns: Option<u64>) {
        if self.group.is_empty() {
            return;
        }
        self.group_weight = 0;
        let mut instants = instants(core::mem::take(&mut self.group));
        let count = instants.len() as u64;
        let start_ns = self.shared_ns.saturating_add(self.shift_ns).max(self.free_ns);
        let period_ns = self.periods.usual_ns().unwrap_or(DEFAULT_PERIOD_NS);
        let longest_ns = self.periods.usual_ns().map_or(WINDOW_NS / 2, |period_ns| 2 * period_ns);
        let room_ns = next_ns.map(|next_ns| next_ns.saturating_add(self.shift_ns).saturating_sub(start_ns));
        let spacing_ns = match room_ns {
            None => period_ns,
            Some(room_ns) => {
                let wanted_ns = count.saturating_mul(period_ns);
                let lost_ns = wanted_ns.saturating_sub(room_ns);
                if lost_ns > WINDOW_NS && room_ns / count < period_ns / 4 {
                    self.shift_ns = self.shift_ns.saturating_add(lost_ns);
                    self.report.stood_still_s += lost_ns as f64 * 1e-9;
                    period_ns
                } else {
                    (room_ns / count).min(longest_ns)
                }
            }
        };
        self.tell(&instants, spacing_ns);
        for (index, instant) in (0..).zip(&mut instants) {
            let stamp_ns = start_ns.saturating_add(spacing_ns.saturating_mul(index));
            // A stable sort: several of one rank keep the file's order.
            instant.sort_by_key(|line| line.rank);
            instant.iter().for_each(|line| self.periods.add(line.source, stamp_ns));
            self.free_ns = stamp_ns;
            self.ready.extend(instant.drain(..).map(|line| Stamped { stamp_ns, line }));
        }
        if room_ns.is_none() {
            // More of the same stamp may follow.
            self.free_ns = start_ns.saturating_add(spacing_ns.saturating_mul(count));
        }
    }
}

impl<T> Spread<T> {
    /// Counts what was spread; that a scan's pose is restated is no fault of the clock.
    fn tell(&mut self, instants: &[Vec<TimedLine<T>>], spacing_ns: u64) {
        let odd = instants.iter().skip(1).filter(|instant| !instant.iter().any(|line| line.restates));
        let first = odd.clone().flatten().next().map(|line| line.number);
        if first.is_some() {
            self.report.first_spread = self.report.first_spread.or(first);
            self.report.spread += odd.map(Vec::len).sum::<usize>() as u64;
            let over_s = (instants.len() as u64 - 1).saturating_mul(spacing_ns) as f64 * 1e-9;
            self.report.longest_spread_s = self.report.longest_spread_s.max(over_s);
        }
    }
}

/// Lines in the file's order, parted where a source comes again.
fn instants<T>(group: Vec<TimedLine<T>>) -> Vec<Vec<TimedLine<T>>> {
    let mut instants: Vec<Vec<TimedLine<T>>> = Vec::new();
    let mut seen: BTreeSet<Source> = BTreeSet::new();
    for line in group {
        if !seen.insert(line.source) || instants.is_empty() {
            seen.clear();
            seen.insert(line.source);
            instants.push(Vec::new());
        }
        if let Some(instant) = instants.last_mut() {
            instant.push(line);
        }
    }
    instants
}

/// How often sources send.
#[derive(Debug, Default)]
struct Periods(BTreeMap<Source, Beat>);

#[derive(Debug, Default)]
struct Beat {
    last_ns: u64,
    flown_ns: u64,
    gaps: u64,
}

impl Periods {
    fn add(&mut self, source: Source, stamp_ns: u64) {
        let Some(beat) = self.0.get_mut(&source) else {
            self.0.insert(source, Beat { last_ns: stamp_ns, ..Beat::default() });
            return;
        };
        let gap_ns = stamp_ns.saturating_sub(beat.last_ns);
        if gap_ns <= WINDOW_NS {
            beat.flown_ns += gap_ns;
            beat.gaps += 1;
        }
        beat.last_ns = stamp_ns;
    }

    /// Average period of the source that sends most, nanoseconds; at least 1 µs.
    fn usual_ns(&self) -> Option<u64> {
        let most = self.0.values().max_by_key(|beat| beat.gaps).filter(|beat| beat.gaps > 0);
        most.map(|beat| (beat.flown_ns / beat.gaps).max(1000))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::timeline::tests::line;

    /// Stamps in milliseconds, by `(stamp in ms, source)`.
    fn spread(lines: &[(u64, u16)]) -> (Vec<u64>, ClockReport) {
        let mut spread = Spread::default();
        for (number, (stamp_ms, source)) in (1..).zip(lines) {
            spread.push(Stamped { stamp_ns: stamp_ms * 1_000_000, line: line(number, *source, None) });
        }
        spread.finish();
        let report = spread.report().clone();
        (std::iter::from_fn(|| spread.pop()).map(|out| out.stamp_ns / 1_000_000).collect(), report)
    }

    #[test]
    fn several_sources_may_share_a_stamp() {
        let (found, report) = spread(&[(100, 0), (100, 3), (200, 3), (200, 0)]);
        assert_eq!(found, [100, 100, 200, 200]);
        assert_eq!(report, ClockReport::default());
    }

    #[test]
    fn whole_seconds_are_shared() {
        let seconds = (5..9).flat_map(|second| (0..4).map(move |_| (second * 1000, 0)));
        let (found, report) = spread(&seconds.collect::<Vec<_>>());
        assert_eq!(found[..8], [5000, 5250, 5500, 5750, 6000, 6250, 6500, 6750], "{found:?}");
        assert!(found.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!((report.spread, report.first_spread), (12, Some(2)));
    }

    #[test]
    fn a_clock_that_stands_still_and_makes_up_for_it() {
        let mut lines: Vec<_> = (0..20).map(|tenth| (100 * tenth, 0)).collect();
        lines.extend([(2000, 0); 30]);
        lines.extend((50..60).map(|tenth| (100 * tenth, 0)));
        let (found, report) = spread(&lines);
        assert_eq!(found, (0..60).map(|tenth| 100 * tenth).collect::<Vec<_>>());
        assert_eq!((report.spread, report.stood_still_s), (29, 0.0));
    }

    #[test]
    fn a_clock_that_stands_still_and_loses_time() {
        let mut lines: Vec<_> = (0..20).map(|tenth| (100 * tenth, 0)).collect();
        lines.extend([(2000, 0); 30]);
        lines.extend((21..30).map(|tenth| (100 * tenth, 0)));
        let (found, report) = spread(&lines);
        assert_eq!(found, (0..59).map(|tenth| 100 * tenth).collect::<Vec<_>>());
        assert!((report.stood_still_s - 2.9).abs() < 1e-9);
    }

    #[test]
    fn what_ends_without_stamps_goes_on_as_before() {
        let mut lines: Vec<_> = (0..20).map(|tenth| (100 * tenth, 0)).collect();
        lines.extend([(1900, 0); 10]);
        let (found, _) = spread(&lines);
        assert_eq!(found, (0..30).map(|tenth| 100 * tenth).collect::<Vec<_>>());
    }

    #[test]
    fn what_waits_is_bounded_and_stamps_never_fall() {
        let mut spread = Spread::default();
        let mut last_ns = 0;
        for number in 0..2000 {
            let mut line = line(number, 0, None);
            line.weight = 1000;
            spread.push(Stamped { stamp_ns: if number < 1500 { 7 } else { 8 }, line });
            assert!(spread.group.len() <= WEIGHT_LIMIT / 1000 + 1);
            while let Some(out) = spread.pop() {
                assert!(out.stamp_ns >= last_ns);
                last_ns = out.stamp_ns;
            }
        }
    }
}
