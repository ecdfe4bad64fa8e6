//! From lines in the file's order to events in stamp order: what the survey and the replay of a log have in common.

use std::collections::VecDeque;

use echogrid_core::Pose2;

use super::LogEvent;
use super::carried::Carried;
use super::clock::{Clock, Stamped};
use super::clock_report::ClockReport;
use super::order::Orderer;
use super::spread::Spread;

/// Made-up time from one odometry line to the next where the stamps are useless.
pub(crate) const ORDER_STEP_NS: u64 = 100_000_000;
/// Stamps that hardly ever change are useless if they do so less often than this.
const RESOLUTION_MAX_NS: u64 = 10_000_000_000;

/// Order of lines at equal stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    Odometry,
    TruePose,
    Scan,
}

/// Which kind of message a line is: a sensor does not send twice at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Source(pub(crate) u16);

impl Source {
    pub(crate) const ODOMETRY: Self = Self(0);
    pub(crate) const TRUE_POSE: Self = Self(1);
    /// Scans are numbered from here on.
    pub(crate) const FIRST_SCAN: u16 = 2;
}

/// A line of a log, with all that decides when it was.
#[derive(Debug, Clone)]
pub(crate) struct TimedLine<T> {
    /// Its number in the file.
    pub(crate) number: u64,
    pub(crate) source: Source,
    pub(crate) rank: Rank,
    pub(crate) stamp_ns: Option<u64>,
    /// The robot by its odometry, where the line says it.
    pub(crate) pose: Option<Pose2>,
    /// Number of readings.
    pub(crate) weight: usize,
    /// Whether it only restates the pose of a scan.
    pub(crate) restates: bool,
    pub(crate) payload: T,
}

/// Lines into the order of time.
pub(crate) struct Timeline<T> {
    carried: Carried<T>,
    clock: Clock<T>,
    orderer: Orderer<T>,
    spread: Spread<T>,
    /// Lines in the file's order, where the stamps are useless.
    in_file_order: Option<VecDeque<TimedLine<T>>>,
}

impl<T> Timeline<T> {
    /// By the log's stamps; `order_only`: whatever they are.
    pub(crate) fn new(order_only: bool) -> Self {
        Self {
            carried: Carried::default(),
            clock: Clock::default(),
            orderer: Orderer::default(),
            spread: Spread::default(),
            in_file_order: order_only.then(VecDeque::new),
        }
    }

    /// A line, in the file's order.
    pub(crate) fn push(&mut self, line: TimedLine<T>) {
        let placed = self.carried.push(line);
        placed.into_iter().flatten().for_each(|line| self.enter(line));
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        if let Some(scan) = self.carried.finish() {
            self.enter(scan);
        }
        self.clock.finish();
        self.pass_on();
        self.orderer.finish();
        self.pass_on();
        self.spread.finish();
    }

    /// The next line that is known to have its final place, and its stamp (0 where the stamps are useless).
    pub(crate) fn pop(&mut self) -> Option<(u64, TimedLine<T>)> {
        match &mut self.in_file_order {
            Some(lines) => lines.pop_front().map(|line| (0, line)),
            None => self.spread.pop().map(|Stamped { stamp_ns, line }| (stamp_ns, line)),
        }
    }

    /// What happened to the clock, and whether the stamps are of any use: useless are those that most lines lack, that contradict
    /// each other all the time, or that hardly ever change (some converters keep six digits of 1 018 930 000 s).
    pub(crate) fn report(&self) -> ClockReport {
        let spread = self.spread.report().clone();
        let mut report = self.clock.report().clone();
        let lines = report.lines;
        let hardly_change = self.spread.stamps() < 2
            || (lines / self.spread.stamps().max(1) >= 16 && self.spread.resolution_ns() > RESOLUTION_MAX_NS)
            || (spread.spread > lines / 2 && spread.longest_spread_s > RESOLUTION_MAX_NS as f64 * 1e-9);
        report.order_only = report.unstamped + report.strays > lines / 2
            || report.set_count + self.clock.contradictions() > lines / 20 + 1
            || (lines > 2 && hardly_change);
        let report = report.with_spread(spread);
        report.with_carried(self.carried.tally())
    }

    fn enter(&mut self, line: TimedLine<T>) {
        match &mut self.in_file_order {
            Some(lines) => lines.push_back(line),
            None => {
                self.clock.push(line);
                self.pass_on();
            }
        }
    }

    fn pass_on(&mut self) {
        while let Some(line) = self.clock.pop() {
            self.orderer.push(line);
        }
        while let Some(line) = self.orderer.pop() {
            self.spread.push(line);
        }
    }
}

/// The events of a log, from its lines.
pub(crate) struct EventLine {
    timeline: Timeline<Vec<LogEvent>>,
    /// Made-up time so far, where the stamps are useless.
    made_up_ns: Option<u64>,
    ready: VecDeque<LogEvent>,
}

impl EventLine {
    pub(crate) fn new(clock: &ClockReport) -> Self {
        Self {
            timeline: Timeline::new(clock.order_only),
            made_up_ns: clock.order_only.then_some(0),
            ready: VecDeque::new(),
        }
    }

    /// A line, in the file's order; the stamps of its events are put in here.
    pub(crate) fn push(&mut self, line: TimedLine<Vec<LogEvent>>) {
        self.timeline.push(line);
        self.take_timed();
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        self.timeline.finish();
        self.take_timed();
    }

    /// The next event that is known to have its final place.
    pub(crate) fn pop(&mut self) -> Option<LogEvent> {
        self.ready.pop_front()
    }

    fn take_timed(&mut self) {
        while let Some((mut at_ns, line)) = self.timeline.pop() {
            for mut event in line.payload {
                if let Some(latest_ns) = &mut self.made_up_ns {
                    if matches!(event, LogEvent::Odometry { .. }) {
                        *latest_ns = latest_ns.saturating_add(ORDER_STEP_NS);
                    }
                    at_ns = *latest_ns;
                }
                event.set_stamp_ns(at_ns);
                self.ready.push_back(event);
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    pub(crate) fn line(number: u64, source: u16, stamp_ns: Option<u64>) -> TimedLine<()> {
        let source = Source(source);
        let rank = if source == Source::ODOMETRY { Rank::Odometry } else { Rank::Scan };
        TimedLine { number, source, rank, stamp_ns, pose: None, weight: 1, restates: false, payload: () }
    }

    fn run(lines: Vec<TimedLine<()>>) -> (Vec<(u64, u64)>, ClockReport) {
        let mut timeline = Timeline::new(false);
        lines.into_iter().for_each(|line| timeline.push(line));
        timeline.finish();
        let report = timeline.report();
        (std::iter::from_fn(|| timeline.pop()).map(|(stamp_ns, line)| (stamp_ns, line.number)).collect(), report)
    }

    /// As GMapping writes its corrected logs.
    #[test]
    fn a_pose_that_restates_that_of_a_scan_belongs_to_it() {
        let at = |number, source, seconds: Option<u64>, x: f64| TimedLine {
            pose: Some(Pose2::new(x, 0.0, 0.0)),
            ..line(number, source, seconds.map(|seconds| seconds * 1_000_000_000))
        };
        let (order, report) = run(vec![
            at(1, 0, Some(1), 1.0),
            at(2, 0, Some(2), 2.0),
            at(3, 5, Some(2), 2.1),
            at(4, 0, Some(0), 2.1),
            at(5, 0, Some(3), 3.0),
        ]);
        assert_eq!(order.iter().map(|(_, number)| *number).collect::<Vec<_>>(), [1, 2, 4, 3, 5]);
        assert_eq!(order[2].0, order[3].0);
        assert_eq!((report.restated, report.unstamped, report.order_only), (1, 0, false));
    }

    #[test]
    fn rank_orders_equal_stamps() {
        let (order, _) = run(vec![line(1, 2, Some(5)), line(2, 0, Some(5)), line(3, 0, Some(9))]);
        assert_eq!(order, [(5, 2), (5, 1), (9, 3)]);
    }

    #[test]
    fn stamps_that_hardly_change_are_useless() {
        let coarse = |lines: u64, each: u64| {
            let lines = (0..lines)
                .map(|number| line(number, 0, Some(1_018_930_000_000_000_000 + number / each * 100_000_000_000)));
            run(lines.collect()).1.order_only
        };
        assert!(coarse(100, 100) && coarse(1000, 500));
        assert!(!coarse(100, 1));
        let seconds = (0..3000).map(|number| line(number, 0, Some((1 + number / 60) * 1_000_000_000)));
        assert!(!run(seconds.collect()).1.order_only);
    }

    proptest! {
        #[test]
        fn nothing_is_lost_and_stamps_never_fall(
            lines in prop::collection::vec((prop::option::of(0..400_000_u64), 0..4_u16), 0..200)
        ) {
            let count = lines.len();
            let lines = (0..).zip(lines);
            let lines = lines.map(|(number, (stamp, source))| line(number, source, stamp.map(|ms| ms * 1_000_000)));
            let (order, _) = run(lines.collect());
            prop_assert!(order.windows(2).all(|pair| pair[0].0 <= pair[1].0));
            let mut numbers: Vec<_> = order.iter().map(|(_, number)| *number).collect();
            numbers.sort_unstable();
            prop_assert_eq!(numbers, (0..count as u64).collect::<Vec<_>>());
        }
    }
}
