//! A drive, scan by scan: nodes, graph, closures.

use core::ops::Range;

use echogrid_core::{Increment, OdometryConfig, Pose2};
use serde::{Deserialize, Serialize};

use crate::closures::Closure;
use crate::config::{SlamConfig, UseOdometry};
use crate::front::Noise;
use crate::graph::{Edge, Graph, Kind, Solver};
use crate::matrix::{self, Matrix};
use crate::saving::Stored;
use crate::scan::Points;
use crate::settling::Settled;

/// What a drive measures too much or too little as a share, one standard deviation, where nobody says.
const SCALE_SIGMA: f64 = 0.05;

/// How many closures are found before the graph is solved, when the drive is over.
const SOLVE_EVERY: u32 = 10;
/// Before, it is solved when one of such χ² has come, or so many.
const SURPRISE: f64 = 1.0;
const SOLVE_MOST: usize = 16;

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

/// A drive so far: all of it that is not configuration.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drive {
    /// Poses and what was measured between them.
    pub graph: Graph,
    /// One for each pose.
    pub nodes: Vec<Node>,
    /// All that were found, applied or not.
    pub closures: Vec<Closure>,
    /// What was measured between the poses at the end; empty before it. (When a drive has ended nothing of it is needed any more: it is
    /// not stored.)
    pub refined: Vec<Edge>,
    /// What of it can't change any more.
    pub settled: Settled,
    /// Scans that could not be laid on those before them.
    pub lost: u64,
    /// Places that were tried.
    pub tries: u64,
    /// Places that were recognised, but not told apart from others.
    pub ambiguous: u64,
    /// Without odometry: m/s along and across, rad/s.
    pub(crate) speed: [f64; 3],
    pub(crate) searched_at_m: f64,
    /// So many edges there were when it was solved last.
    pub(crate) solved: usize,
}

impl Drive {
    /// Whether most scans could not be laid on others, and no place was recognised.
    #[must_use]
    pub fn recognises_nothing(&self) -> bool {
        2 * self.lost > self.nodes.len() as u64 && !self.closures.iter().any(|closure| closure.standing.counts())
    }
}

/// Simultaneous localization and mapping.
#[derive(Debug, Clone)]
pub struct Slam {
    pub(crate) config: SlamConfig,
    pub(crate) noise: Noise,
    /// What it knows.
    pub drive: Drive,
    /// What of it is stored.
    pub(crate) stored: Stored,
}

impl Slam {
    /// Before the first scan.
    #[must_use]
    pub fn new(config: &SlamConfig, odometry: &OdometryConfig) -> Self {
        let scale_sigma = SCALE_SIGMA.max(odometry.lin_scale).max(odometry.ang_scale);
        let graph = Graph { scale_sigma, ..Graph::default() };
        let noise = Noise::of(odometry, scale_sigma);
        Self { config: config.clone(), noise, drive: Drive { graph, ..Drive::default() }, stored: Stored::default() }
    }

    /// Whether a scan taken at this pose of the odometry is worth a node.
    #[must_use]
    pub fn wants(&self, odom_from_base: Pose2) -> bool {
        let Some(last) = self.drive.nodes.last() else { return true };
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
        let way_m = self.drive.nodes.last().map_or(0.0, |node| node.way_m);
        if way_m - self.drive.searched_at_m <= self.config.closure_every_m {
            return false;
        }
        self.drive.searched_at_m = way_m;
        let found = self.look_for_closures(self.drive.nodes.len() - 1);
        let is_due = found && self.is_due();
        if is_due {
            self.solve();
        }
        is_due
    }

    /// Whether closures that came since the graph was solved say something that it does not know, or are many. In a building that is driven for
    /// hours nearly all of them say what it knows.
    fn is_due(&self) -> bool {
        let new = || {
            let edges = self.drive.graph.edges[self.drive.solved..].iter();
            edges.filter(|edge| matches!(edge.kind, Kind::Closure(_)))
        };
        new().count() >= SOLVE_MOST || new().any(|edge| edge.chi2(&self.drive.graph) > SURPRISE)
    }

    /// Solves the graph as it is.
    pub fn solve(&mut self) {
        let solver = Solver::new(&self.drive.graph);
        solver.graduate(&mut self.drive.graph);
        self.drive.solved = self.drive.graph.edges.len();
        self.stored.solved();
    }

    /// Ends the drive: what was seen twice is laid on each other, and closures that the rest is against are taken back.
    pub fn finish(&mut self) {
        if self.drive.nodes.len() < 2 {
            return;
        }
        self.end(self.drive.nodes.len());
    }

    /// Makes the poses before node `upto` what they are in the end.
    pub(crate) fn end(&mut self, upto: usize) {
        self.solve();
        self.look_again(upto);
        for round in 0..self.config.refine_rounds {
            self.refine(round, upto);
        }
        self.take_back();
    }

    /// Looks for closures once more along the drive, but for what is settled: what was too far off to be recognised then may not be any
    /// more.
    fn look_again(&mut self, upto: usize) {
        let first = self.drive.graph.settled as usize;
        let mut searched_at_m = self.drive.nodes.get(first).map_or(0.0, |node| node.way_m);
        let mut found = 0;
        for index in first..upto {
            let way_m = self.drive.nodes[index].way_m;
            if way_m - searched_at_m > self.config.closure_every_m {
                searched_at_m = way_m;
                if self.look_for_closures(index) {
                    found += 1;
                    if found % SOLVE_EVERY == 0 {
                        self.solve();
                    }
                }
            }
        }
        if found > 0 {
            self.solve();
        }
    }

    /// How sure some of the nodes are, at most so many of them: stamps and covariances in the frame of the map, in which the first is certain.
    #[must_use]
    pub fn doubts(&self, most: usize) -> Vec<(u64, Matrix)> {
        let first = self.drive.graph.settled as usize;
        let mut doubts = self.drive.settled.doubts.clone();
        doubts.extend(self.doubts_of(first.max(1)..self.drive.nodes.len(), most));
        let every = doubts.len() / most.max(1) + 1;
        if doubts.len() <= most { doubts } else { doubts.into_iter().step_by(every).collect() }
    }

    /// The same of some of these nodes, none of them settled.
    pub(crate) fn doubts_of(&self, nodes: Range<usize>, most: usize) -> Vec<(u64, Matrix)> {
        let every = nodes.end.saturating_sub(self.drive.graph.settled as usize) / most.max(1) + 1;
        let chosen: Vec<usize> = nodes.step_by(every).collect();
        let covariances = self.covariances(&chosen);
        chosen.iter().map(|node| self.drive.nodes[*node].stamp_ns).zip(covariances).collect()
    }

    /// The covariance of the last pose in the frame of the map, in which the first is certain.
    #[must_use]
    pub fn doubt_at_the_end(&self) -> Option<Matrix> {
        let last = self.drive.nodes.len().checked_sub(1)?;
        self.covariances(&[last]).pop()
    }

    /// Of these nodes, in the frame of the map.
    pub(crate) fn covariances(&self, nodes: &[usize]) -> Vec<Matrix> {
        let mut graph = self.drive.graph.clone();
        if !self.drive.refined.is_empty() {
            graph.edges.clone_from(&self.drive.refined);
        }
        let mut covariances = Solver::new(&graph).covariances(&graph, nodes.iter().copied());
        covariances.iter_mut().for_each(|covariance| matrix::add(covariance, &self.drive.settled.doubt));
        covariances
    }
}
