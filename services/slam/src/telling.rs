//! What was told of the drive, and telling more of it.

use echogrid_core::parts::{Parts, Saved, SavedError};
use echogrid_core::{Estimate, Incidents, JointCovariance, Pose2};
use echogrid_service::Outbox;
use echogrid_topics::{Message, PoseEstimate};
use serde::{Deserialize, Serialize};

use crate::history::Stretch;

/// How far a pose is off among its neighbours, one standard deviation, metres and radians. (How far all are off together is no matter
/// to the map.)
const AMONG_NEIGHBOURS: (f64, f64) = (0.01, 0.003);
/// Under what the path is stored, by so many.
const PATH: (&str, u64) = ("path/", 512);

/// What was told so far.
#[derive(Debug, Default)]
pub(crate) struct Telling {
    /// Whether the first estimate was told.
    has_begun: bool,
    /// The last pose that was told or left out, and the way until there, metres.
    last: Option<(Pose2, f64)>,
    /// What was told before the end, for the file.
    path: Stretch<(u64, Pose2)>,
}

/// What is stored besides the path.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct TellingState {
    has_begun: bool,
    last: Option<(Pose2, f64)>,
    path: [u64; 2],
}

impl Telling {
    /// Whether the first estimate is yet to be told; from now on it is not.
    pub(crate) fn begins(&mut self) -> bool {
        !std::mem::replace(&mut self.has_begun, true)
    }

    /// What was told before the end.
    pub(crate) fn path(&self) -> impl Iterator<Item = (u64, Pose2)> {
        self.path.list.iter().copied()
    }

    /// Tells poses that are settled while the drive goes on.
    pub(crate) fn settled(&mut self, path: &[(u64, Pose2)], leaps: Incidents, out: &mut Outbox) {
        self.tell_poses(path, leaps, out);
        self.path.list.extend(path);
    }

    /// Tells poses that are as exact as lidars make them.
    pub(crate) fn tell_poses(&mut self, path: &[(u64, Pose2)], leaps: Incidents, out: &mut Outbox) {
        let estimate = |(stamp_ns, pose): &(u64, Pose2)| (*stamp_ns, told(*pose, 0.0, leaps).estimate);
        let estimates: Vec<(u64, Estimate)> = path.iter().map(estimate).collect();
        self.tell(&estimates, |_| 1.0, leaps, out);
    }

    /// Tells the estimates of a drive, and how far each can be trusted, but for the first, which was told when it began.
    pub(crate) fn tell(
        &mut self,
        estimates: &[(u64, Estimate)],
        trust: impl Fn(&Estimate) -> f64,
        leaps: Incidents,
        out: &mut Outbox,
    ) {
        for (stamp_ns, estimate) in estimates {
            let Some((before, way_m)) = self.last else {
                self.last = Some((estimate.pose, 0.0));
                continue;
            };
            let distance_m = way_m + before.distance_m(estimate.pose);
            self.last = Some((estimate.pose, distance_m));
            let plain = PoseEstimate::plain(*estimate, trust(estimate), distance_m);
            out.send(*stamp_ns, Message::Estimate(PoseEstimate { leaps, ..plain }));
        }
    }

    /// Saves what changed since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> TellingState {
        TellingState { has_begun: self.has_begun, last: self.last, path: self.path.save(parts, PATH) }
    }

    /// What was saved.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(saved: &Saved, state: TellingState) -> Result<Self, SavedError> {
        let TellingState { has_begun, last, path } = state;
        Ok(Self { has_begun, last, path: Stretch::restore(saved, PATH, path)? })
    }
}

/// A pose as it is told.
pub(crate) fn told(pose: Pose2, distance_m: f64, leaps: Incidents) -> PoseEstimate {
    let (metres, radians) = AMONG_NEIGHBOURS;
    let mut covariance = JointCovariance::zeros();
    for (place, deviation) in [metres, metres, radians].into_iter().enumerate() {
        covariance[(place, place)] = deviation * deviation;
    }
    let estimate = Estimate { covariance, ..Estimate::certain(pose) };
    PoseEstimate { leaps, ..PoseEstimate::plain(estimate, 1.0, distance_m) }
}
