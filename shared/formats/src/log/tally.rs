//! What the survey learns of the order of events, without keeping them.

use std::collections::BTreeMap;

use echogrid_core::{Pose2, Sideways};

use super::clock_report::ClockReport;
use super::timeline::{ORDER_STEP_NS, TimedLine, Timeline};

/// Stamps are wrong that make the way longer than that in the file's order by this factor, and so many metres.
const LONGER: f64 = 1.02;
const LONGER_M: f64 = 0.1;
/// So many lines are no accident.
const MANY: u64 = 10;

/// Events by class; the same order is made of them as when they are read.
pub(crate) struct EventTally<C> {
    tracks: BTreeMap<C, Track>,
    places: u64,
    timeline: Timeline<C>,
}

/// Events of one class.
#[derive(Debug, Default)]
struct Track {
    /// CountedBy of the first among all events.
    first: u64,
    /// CountedBy of the last.
    last: u64,
    /// CountedBy of the first with a pose.
    first_pose: Option<u64>,
    lines: u64,
    poses: u64,
    first_ns: Option<u64>,
    last_ns: u64,
    in_stamp_order: Distance,
    in_line_order: Distance,
    sideways: Sideways,
}

/// The way along poses.
#[derive(Debug, Default)]
struct Distance {
    metres: f64,
    last: Option<Pose2>,
}

impl Distance {
    fn add(&mut self, pose: Pose2) {
        self.metres += self.last.map_or(0.0, |last| last.distance_m(pose));
        self.last = Some(pose);
    }
}

/// What the tally comes to.
pub(crate) struct Summary {
    pub(crate) clock: ClockReport,
    pub(crate) first_stamp_ns: u64,
    pub(crate) last_stamp_ns: u64,
    pub(crate) distance_m: f64,
}

impl<C: Copy + Ord> EventTally<C> {
    pub(crate) fn new() -> Self {
        Self { tracks: BTreeMap::new(), places: 0, timeline: Timeline::new(false) }
    }

    /// A line, in the file's order; its payload is the class that it counts for.
    pub(crate) fn add(&mut self, line: TimedLine<C>) {
        let place = self.places;
        self.places += 1;
        let track = self.tracks.entry(line.payload).or_insert_with(|| Track { first: place, ..Track::default() });
        track.lines += 1;
        track.last = place;
        if let Some(pose) = line.pose {
            track.poses += 1;
            track.first_pose.get_or_insert(place);
            track.in_line_order.add(pose);
            track.sideways.add(pose);
        }
        self.timeline.push(line);
        self.take_timed();
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        self.timeline.finish();
        self.take_timed();
    }

    fn take_timed(&mut self) {
        while let Some((stamp_ns, line)) = self.timeline.pop() {
            let track = self.tracks.entry(line.payload).or_default();
            track.first_ns.get_or_insert(stamp_ns);
            track.last_ns = stamp_ns;
            if let Some(pose) = line.pose {
                track.in_stamp_order.add(pose);
            }
        }
    }

    /// Lines of a class.
    pub(crate) fn lines(&self, class: C) -> u64 {
        self.tracks.get(&class).map_or(0, |track| track.lines)
    }

    /// Whether all lines of one class stand before, or behind, all of another, where both are many: two logs, one after the other.
    pub(crate) fn are_apart(&self, a: C, b: C) -> bool {
        let (Some(a), Some(b)) = (self.tracks.get(&a), self.tracks.get(&b)) else { return false };
        a.lines.min(b.lines) >= MANY && (a.last < b.first || b.last < a.first)
    }

    /// Lines of a class that hold odometry.
    pub(crate) fn poses(&self, class: C) -> u64 {
        self.tracks.get(&class).map_or(0, |track| track.poses)
    }

    /// Whether the odometry of a class slides sideways.
    pub(crate) fn sideways(&self, class: C) -> Sideways {
        self.tracks.get(&class).map_or_else(Sideways::default, |track| track.sideways)
    }

    /// Over the classes in use, with the odometry of one of them.
    pub(crate) fn summary(&self, odometry: C, in_use: impl Fn(C) -> bool) -> Summary {
        let mut clock = self.timeline.report();
        let tracks = || self.tracks.iter().filter(|(class, _)| in_use(**class)).map(|(_, track)| track);
        let Some(odometry) = self.tracks.get(&odometry) else {
            return Summary { clock, first_stamp_ns: 0, last_stamp_ns: 0, distance_m: 0.0 };
        };
        let (by_stamp_m, by_line_m) = (odometry.in_stamp_order.metres, odometry.in_line_order.metres);
        if !clock.order_only && by_stamp_m > LONGER * by_line_m + LONGER_M {
            // Time takes no detours: stamps that make the robot jump to and fro are wrong, whatever they look like.
            clock.order_only = true;
            clock.detour_m = by_stamp_m - by_line_m;
        }
        if clock.order_only {
            let begins_with_odometry =
                odometry.first_pose.is_some_and(|pose| tracks().all(|track| track.first >= pose));
            return Summary {
                clock,
                first_stamp_ns: if begins_with_odometry { ORDER_STEP_NS } else { 0 },
                last_stamp_ns: odometry.poses.saturating_mul(ORDER_STEP_NS),
                distance_m: odometry.in_line_order.metres,
            };
        }
        Summary {
            clock,
            first_stamp_ns: tracks().filter_map(|track| track.first_ns).min().unwrap_or(0),
            last_stamp_ns: tracks().map(|track| track.last_ns).max().unwrap_or(0),
            distance_m: odometry.in_stamp_order.metres,
        }
    }
}
