//! A drive, scan by scan: nodes, graph, closures.

use echogrid_core::{Increment, OdometryConfig, Pose2};
use serde::{Deserialize, Serialize};

use crate::closures::Closure;
use crate::config::{SlamConfig, UseOdometry};
use crate::front::Noise;
use crate::graph::{Edge, Graph, Solver};
use crate::scan::Points;

/// What a drive measures too much or too little as a share, one standard deviation, where nobody says.
const SCALE_SIGMA: f64 = 0.05;

/// A scan that was laid on others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// When it was taken, nanoseconds.
    pub stamp_ns: u64,
    /// Where the odometry said the robot was.
    pub odom_from_base: Pose2,
    /// What was seen.
    pub points: Points,
    /// Way until here, metres.
    pub way_m: f64,
}

/// A drive so far.
#[derive(Debug, Clone)]
pub struct Slam {
    pub(crate) config: SlamConfig,
    pub(crate) noise: Noise,
    /// Poses and what was measured between them.
    pub graph: Graph,
    /// One for each pose.
    pub nodes: Vec<Node>,
    /// All that were found, applied or not.
    pub closures: Vec<Closure>,
    pub(crate) refined: Vec<Edge>,
    /// Without odometry: m/s along and across, rad/s.
    pub(crate) speed: [f64; 3],
    /// Scans that could not be laid on those before them.
    pub lost: u64,
    /// Places that were tried.
    pub tries: u64,
    /// Places that were recognised, but not told apart from others.
    pub ambiguous: u64,
    searched_at_m: f64,
}

impl Slam {
    /// Before the first scan.
    #[must_use]
    pub fn new(config: &SlamConfig, odometry: &OdometryConfig) -> Self {
        let scale_sigma = SCALE_SIGMA.max(odometry.lin_scale).max(odometry.ang_scale);
        Self {
            config: config.clone(),
            noise: Noise::of(odometry, scale_sigma),
            graph: Graph { scale_sigma, ..Graph::default() },
            nodes: Vec::new(),
            closures: Vec::new(),
            refined: Vec::new(),
            speed: [0.0; 3],
            lost: 0,
            tries: 0,
            ambiguous: 0,
            searched_at_m: 0.0,
        }
    }

    /// Whether a scan taken at this pose of the odometry is worth a node.
    #[must_use]
    pub fn wants(&self, odom_from_base: Pose2) -> bool {
        let Some(last) = self.nodes.last() else { return true };
        let step = Increment::between(last.odom_from_base, odom_from_base);
        self.config.odometry == UseOdometry::Ignore
            || step.length_m() >= self.config.node_every_m
            || step.turn_rad.abs() >= self.config.node_every_rad
    }

    /// Takes the next scan, if it is worth a node; whether poses of the past are others now.
    pub fn add(&mut self, stamp_ns: u64, odom_from_base: Pose2, points: Points) -> bool {
        if !self.wants(odom_from_base) {
            return false;
        }
        self.track(Node { stamp_ns, odom_from_base, points, way_m: 0.0 });
        let way_m = self.nodes[self.nodes.len() - 1].way_m;
        if way_m - self.searched_at_m <= self.config.closure_every_m {
            return false;
        }
        self.searched_at_m = way_m;
        let found = self.look_for_closures();
        if found {
            self.solve();
        }
        found
    }

    /// Solves the graph as it is.
    pub fn solve(&mut self) {
        let solver = Solver::new(&self.graph);
        solver.graduate(&mut self.graph);
    }

    /// Ends the drive: what was seen twice is laid on each other.
    pub fn finish(&mut self) {
        if self.nodes.len() < 2 {
            return;
        }
        self.solve();
        for round in 0..self.config.refine_rounds {
            self.refine(round);
        }
    }
}
