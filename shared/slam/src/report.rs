//! What SLAM did, for people and programs: every closure with its evidence, and how sure the end is.

use serde::{Deserialize, Serialize};

use crate::closures::Standing;
use crate::slam::Slam;

/// What SLAM did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Scans that were laid on others.
    pub nodes: u64,
    /// How many of the nodes' scans could not be laid on those before them.
    pub lost: u64,
    /// Corrected way, metres.
    pub way_m: f64,
    /// How often a place was compared with one that was visited before.
    pub places_tried: u64,
    /// Places that looked alike, but could not be told apart from others.
    pub ambiguous: u64,
    /// Why places were not recognised that may have been near; none without sonars.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unrecognised: Option<Unrecognised>,
    /// Scans of the lidar that could not be laid on others, and all, where it recognised nothing, so that the sonars did it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instead_of_lidar: Option<[u64; 2]>,
    /// What the odometry measured too much, as a share: of translation, of rotation.
    pub scales: [f64; 2],
    /// The pose at the end, one standard deviation in the frame of the map: x and y in metres, heading in radians. None without a pose.
    pub end_sigma: Option<[f64; 3]>,
    /// Every closure, in the order in which they were found.
    pub closures: Vec<Evidence>,
}

/// How often a place was not recognised that may have been near, and why.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unrecognised {
    /// Too little was heard, then or now.
    pub too_few: u64,
    /// What was heard did not fit.
    pub no_fit: u64,
    /// It fitted elsewhere nearly as well.
    pub ambiguous: u64,
}

/// A closure with its evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// The node of the place, by its number in the pose graph: with the next its name.
    #[serde(default)]
    pub from: u32,
    /// The node from which it was recognised.
    #[serde(default)]
    pub to: u32,
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
    /// By what it was recognised.
    #[serde(flatten)]
    pub by: By,
    /// Whether it says nothing along a corridor.
    pub slides: bool,
    /// How many other closures agree with it.
    pub support: u32,
}

/// By what a place was recognised.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum By {
    /// A lidar.
    Points {
        /// The share of points that lie on walls.
        score: f64,
        /// The share of points with a partner within 10 cm.
        inliers: f64,
        /// How far they lie off the walls, metres.
        rms_m: f64,
    },
    /// Sonars.
    Echoes {
        /// How much better the readings fit the place than nothing, nat a reading.
        evidence_nat: f64,
        /// How exactly they tell how the robot lies: along the less exact axis, and of heading; one standard deviation, metres and radians.
        sigma: (f64, f64),
    },
}

impl Report {
    /// The report of a drive.
    #[must_use]
    pub fn of(slam: &Slam) -> Self {
        let drive = &slam.drive;
        let stamp_ns = |node: u32| drive.nodes.get(node as usize).map_or(0, |node| node.stamp_ns);
        let evidence = drive.closures.iter().map(|closure| Evidence {
            from: closure.from,
            to: closure.to,
            from_ns: stamp_ns(closure.from),
            to_ns: stamp_ns(closure.to),
            measured: [closure.measured.x, closure.measured.y, closure.measured.theta],
            standing: closure.standing,
            loop_m: closure.loop_m,
            off: closure.off,
            by: By::Points { score: closure.score, inliers: closure.inliers, rms_m: closure.rms_m },
            slides: closure.slides.is_some(),
            support: closure.support,
        });
        Self {
            nodes: drive.nodes.len() as u64,
            lost: drive.lost,
            way_m: drive.nodes.last().map_or(0.0, |node| node.way_m),
            places_tried: drive.tries,
            ambiguous: drive.ambiguous,
            unrecognised: None,
            instead_of_lidar: None,
            scales: drive.graph.scales,
            end_sigma: slam.doubt_at_the_end().map(|c| [c[0][0].sqrt(), c[1][1].sqrt(), c[2][2].sqrt()]),
            closures: evidence.collect(),
        }
    }

    /// How many closures stand.
    #[must_use]
    pub fn applied(&self) -> usize {
        self.closures.iter().filter(|closure| closure.standing.counts()).count()
    }
}
