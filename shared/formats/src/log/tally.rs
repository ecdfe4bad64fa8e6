//! What the survey learns of the order of events, without keeping them.

use std::collections::BTreeMap;

use echogrid_core::{Pose2, Sideways};

use super::StampQuality;
use super::order::Orderer;
use super::timeline::{ORDER_STEP_NS, Rank, quality};

/// Events by class; the same order is made of them as when they are read.
pub(crate) struct EventTally<C> {
    tracks: BTreeMap<C, Track>,
    orderer: Orderer<(C, Option<Pose2>)>,
}

/// Events of one class.
#[derive(Debug, Default)]
struct Track {
    /// Place of the first among all events.
    first: u64,
    /// Place of the first with a pose.
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
    pub(crate) stamps: StampQuality,
    pub(crate) first_stamp_ns: u64,
    pub(crate) last_stamp_ns: u64,
    pub(crate) distance_m: f64,
}

impl<C: Copy + Ord> EventTally<C> {
    pub(crate) fn new() -> Self {
        Self { tracks: BTreeMap::new(), orderer: Orderer::default() }
    }

    /// A line, in the file's order, with the odometry that it holds.
    pub(crate) fn add(&mut self, class: C, rank: Rank, odometry: Option<Pose2>, stamp_ns: Option<u64>, weight: usize) {
        let place = self.orderer.statistics().lines;
        let track = self.tracks.entry(class).or_insert_with(|| Track { first: place, ..Track::default() });
        track.lines += 1;
        if let Some(pose) = odometry {
            track.poses += 1;
            track.first_pose.get_or_insert(place);
            track.in_line_order.add(pose);
            track.sideways.add(pose);
        }
        self.orderer.push(stamp_ns, rank as u8, weight, (class, odometry));
        self.take_ordered();
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        self.orderer.finish();
        self.take_ordered();
    }

    fn take_ordered(&mut self) {
        while let Some((stamp_ns, (class, odometry))) = self.orderer.pop() {
            let track = self.tracks.entry(class).or_default();
            track.first_ns.get_or_insert(stamp_ns);
            track.last_ns = stamp_ns;
            if let Some(pose) = odometry {
                track.in_stamp_order.add(pose);
            }
        }
    }

    /// Lines of a class.
    pub(crate) fn lines(&self, class: C) -> u64 {
        self.tracks.get(&class).map_or(0, |track| track.lines)
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
        let stamps = quality(self.orderer.statistics());
        let tracks = || self.tracks.iter().filter(|(class, _)| in_use(**class)).map(|(_, track)| track);
        let Some(odometry) = self.tracks.get(&odometry) else {
            return Summary { stamps, first_stamp_ns: 0, last_stamp_ns: 0, distance_m: 0.0 };
        };
        if stamps == StampQuality::OrderOnly {
            let begins_with_odometry =
                odometry.first_pose.is_some_and(|pose| tracks().all(|track| track.first >= pose));
            return Summary {
                stamps,
                first_stamp_ns: if begins_with_odometry { ORDER_STEP_NS } else { 0 },
                last_stamp_ns: odometry.poses.saturating_mul(ORDER_STEP_NS),
                distance_m: odometry.in_line_order.metres,
            };
        }
        Summary {
            stamps,
            first_stamp_ns: tracks().filter_map(|track| track.first_ns).min().unwrap_or(0),
            last_stamp_ns: tracks().map(|track| track.last_ns).max().unwrap_or(0),
            distance_m: odometry.in_stamp_order.metres,
        }
    }
}
