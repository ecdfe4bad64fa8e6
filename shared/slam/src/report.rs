//! What SLAM did, for people and programs: every closure with its evidence, and how sure the end is.

use serde::{Deserialize, Serialize};

use crate::closures::Standing;
use crate::slam::Slam;

/// What SLAM did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Scans that were laid on others.
    pub nodes: u64,
    /// Of those, how many could not be.
    pub lost: u64,
    /// Corrected way, metres.
    pub way_m: f64,
    /// How often a place was compared with one that was visited before.
    pub places_tried: u64,
    /// Places that looked alike, but could not be told apart from others.
    pub ambiguous: u64,
    /// What the odometry measured too much, as a share: of translation, of rotation.
    pub scales: [f64; 2],
    /// The pose at the end, one standard deviation in the frame of the map: x and y in metres, heading in radians. None without a pose.
    pub end_sigma: Option<[f64; 3]>,
    /// Every closure, in the order in which they were found.
    pub closures: Vec<Evidence>,
}

/// A closure with its evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// When the place was visited first, nanoseconds.
    pub from_ns: u64,
    /// When it was recognised, nanoseconds.
    pub to_ns: u64,
    /// How the robot lay then, seen from where it was at first: metres, metres, radians.
    pub measured: [f64; 3],
    /// What became of it.
    pub standing: Standing,
    /// The way between the two, as far as it was known by no other closure, metres.
    pub loop_m: f64,
    /// By how much the place was off where it was believed to be, metres and radians.
    pub off: (f64, f64),
    /// The share of points that lie on walls.
    pub score: f64,
    /// The share of points with a partner within 10 cm.
    pub inliers: f64,
    /// How far they lie off the walls, metres.
    pub rms_m: f64,
    /// Whether it says nothing along a corridor.
    pub slides: bool,
    /// How many other closures agree with it.
    pub support: u32,
}

impl Report {
    /// Of a drive.
    #[must_use]
    pub fn of(slam: &Slam) -> Self {
        let drive = &slam.drive;
        let stamp_ns = |node: u32| drive.nodes.get(node as usize).map_or(0, |node| node.stamp_ns);
        let evidence = drive.closures.iter().map(|closure| Evidence {
            from_ns: stamp_ns(closure.from),
            to_ns: stamp_ns(closure.to),
            measured: [closure.measured.x, closure.measured.y, closure.measured.theta],
            standing: closure.standing,
            loop_m: closure.loop_m,
            off: closure.off,
            score: closure.score,
            inliers: closure.inliers,
            rms_m: closure.rms_m,
            slides: closure.slides.is_some(),
            support: closure.support,
        });
        Self {
            nodes: drive.nodes.len() as u64,
            lost: drive.lost,
            way_m: drive.nodes.last().map_or(0.0, |node| node.way_m),
            places_tried: drive.tries,
            ambiguous: drive.ambiguous,
            scales: drive.graph.scales,
            end_sigma: slam.doubt_at_the_end().map(|c| [c[0][0].sqrt(), c[1][1].sqrt(), c[2][2].sqrt()]),
            closures: evidence.collect(),
        }
    }

    /// How many closures stand.
    #[must_use]
    pub fn applied(&self) -> usize {
        self.closures.iter().filter(|closure| closure.standing == Standing::Applied).count()
    }
}
