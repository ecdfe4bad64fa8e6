//! The poses that scans carry, beside those of the odometry: they tell when a scan was taken where its stamp does not.
//!
//! - *Restated*: an odometry line after a scan that carries the same pose, without a stamp or with one far from the scan's, belongs
//!   to that scan. Corrected logs restate it so.
//! - *Displaced*: a scan that carries the pose of the odometry line before it was taken there. If its stamp says otherwise, by more than
//!   a pose and a half, it is of another clock (or of one that stands still), and counts for nothing.

use std::collections::BTreeMap;

use echogrid_core::{Pose2, wrap_angle};

use super::clock::{DEFAULT_PERIOD_NS, LEAP_NS, WINDOW_NS};
use super::timeline::{Rank, Source, TimedLine};

/// Poses nearer than this are one pose, metres and radians: as many digits as logs have.
const SAME: f64 = 1e-5;

/// Lines, in the file's order, with the stamps that their poses say.
pub(crate) struct Carried<T> {
    /// A scan that the next line may restate the pose of.
    scan: Option<TimedLine<T>>,
    /// The last odometry line: its pose and stamp, and whether the robot had moved.
    last: Option<(Pose2, Option<u64>, bool)>,
    /// Time between odometry lines, nanoseconds, and their number.
    flown_ns: u64,
    steps: u64,
    /// Whether the latest scan of a source was displaced: a robot at rest tells nothing of that.
    displaced: BTreeMap<Source, bool>,
    tally: Tally,
}

/// What was made of carried poses.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    pub(crate) restated: u64,
    pub(crate) displaced: u64,
    pub(crate) first_displaced: Option<u64>,
    /// Sum of what the stamps were off, seconds; positive: late.
    pub(crate) off_s: f64,
}

impl<T> Default for Carried<T> {
    fn default() -> Self {
        Self { scan: None, last: None, flown_ns: 0, steps: 0, displaced: BTreeMap::new(), tally: Tally::default() }
    }
}

impl<T> Carried<T> {
    /// A line, in the file's order; the lines that have their place now.
    pub(crate) fn push(&mut self, mut line: TimedLine<T>) -> [Option<TimedLine<T>>; 2] {
        let scan = self.scan.take();
        if let Some(scan) = scan.as_ref().filter(|scan| restates(&line, scan)) {
            self.tally.restated += 1;
            line.restates = true;
            line.stamp_ns = scan.stamp_ns;
        }
        if line.source == Source::ODOMETRY {
            self.odometry(&line);
        } else {
            self.place(&mut line);
        }
        if line.restates {
            [Some(line), scan]
        } else if line.rank == Rank::Scan && line.pose.is_some() {
            self.scan = Some(line);
            [scan, None]
        } else {
            [scan, Some(line)]
        }
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) -> Option<TimedLine<T>> {
        self.scan.take()
    }

    /// What was made of carried poses so far.
    pub(crate) fn tally(&self) -> Tally {
        self.tally
    }

    fn odometry(&mut self, line: &TimedLine<T>) {
        let Some(pose) = line.pose else { return };
        let before = self.last;
        if let (Some((_, Some(before_ns), _)), Some(now_ns)) = (before, line.stamp_ns) {
            let step_ns = now_ns.saturating_sub(before_ns);
            if step_ns <= WINDOW_NS {
                self.flown_ns += step_ns;
                self.steps += 1;
            }
        }
        // What only restates another line's pose is no step of the robot.
        let moved = before.is_some_and(|(before, _, moved)| if line.restates { moved } else { !same(before, pose) });
        self.last = Some((pose, line.stamp_ns.filter(|stamp_ns| *stamp_ns != 0), moved));
    }

    /// Gives a scan the stamp of the odometry line whose pose it carries, if its own says otherwise.
    fn place(&mut self, line: &mut TimedLine<T>) {
        let (Some(carried), Some((pose, Some(pose_ns), moved))) = (line.pose, self.last) else { return };
        let Some(stamp_ns) = line.stamp_ns.filter(|stamp_ns| *stamp_ns != 0) else { return };
        if !same(carried, pose) {
            self.displaced.insert(line.source, false);
            return;
        }
        let period_ns = if self.flown_ns == 0 { DEFAULT_PERIOD_NS } else { self.flown_ns / self.steps.max(1) };
        let is_off = stamp_ns > pose_ns.saturating_add(period_ns + period_ns / 2)
            || stamp_ns.saturating_add(period_ns / 2) < pose_ns;
        let displaced = self.displaced.entry(line.source).or_default();
        // Nobody carries a pose long before it was: to know that no motion is needed.
        if moved || stamp_ns.saturating_add(WINDOW_NS) < pose_ns {
            *displaced = is_off;
        }
        if is_off && *displaced {
            self.tally.displaced += 1;
            self.tally.first_displaced.get_or_insert(line.number);
            self.tally.off_s += (stamp_ns as f64 - pose_ns as f64) * 1e-9;
            line.stamp_ns = Some(pose_ns);
        }
    }
}

/// Whether a line, the next after a scan, only says once more where the scan was taken.
fn restates<T>(line: &TimedLine<T>, scan: &TimedLine<T>) -> bool {
    let is_far = |stamp_ns: u64| {
        let scan_ns = scan.stamp_ns.unwrap_or(0);
        stamp_ns == 0 || stamp_ns.saturating_add(WINDOW_NS) < scan_ns || stamp_ns > scan_ns.saturating_add(LEAP_NS)
    };
    line.source == Source::ODOMETRY && line.pose == scan.pose && line.stamp_ns.is_none_or(is_far)
}

fn same(a: Pose2, b: Pose2) -> bool {
    a.distance_m(b) <= SAME && wrap_angle(a.theta - b.theta).abs() <= SAME
}
