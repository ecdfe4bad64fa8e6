//! The drive as a graph: nodes, odometry, closures; and what comes of it.

use std::collections::BTreeMap;

use echogrid_core::config::Systematic;
use echogrid_core::{Estimate, Increment, MapperConfig, Matrix3, OdometryConfig, Pose2, Robot, Scales, move_by};

use super::closures::Closure;
use super::place::Place;
use super::rings::{Drive, Ring};
use crate::config::SlamConfig;
use crate::graph::{Edge, Graph, Kind, Solver};
use crate::matrix::{self, Matrix};
use crate::path::{self, Knot};
use crate::report::Unrecognised;

/// From node to node, metres and radians.
const NODE_EVERY: (f64, f64) = (0.28, 0.25);
/// A turn of a radian counts as so many metres of way.
const METRES_PER_RAD: f64 = 0.3;
/// From one place to the next, metres.
const PLACE_EVERY_M: f64 = 2.0;
/// What a drive measures too much or too little as a share, one standard deviation, where nobody says.
const SCALE_SIGMA: f64 = 0.05;

/// A pose of the drive that is solved for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Node {
    pub(super) stamp_ns: u64,
    pub(super) odom_from_base: Pose2,
    /// Until here, metres.
    pub(super) way_m: f64,
    pub(super) left_open: [f64; 2],
    /// The ring that was heard there.
    ring: usize,
}

/// A drive of sonars, from its end.
#[derive(Debug)]
pub struct SonarSlam<'a> {
    pub(super) config: SlamConfig,
    pub(super) mapper: MapperConfig,
    pub(super) robot: Robot,
    rings: &'a [Ring],
    pub(super) nodes: Vec<Node>,
    pub(super) graph: Graph,
    /// So many edges of the graph are odometry, one before each node but the first; then come closures.
    steps: usize,
    /// The nodes about which there are places.
    pub(super) centres: Vec<usize>,
    pub(super) places: BTreeMap<usize, Place>,
    pub(super) closures: Vec<Closure>,
    /// How often a place was compared with.
    pub(super) tries: u64,
    /// Why it was not recognised.
    pub(super) unrecognised: Unrecognised,
}

impl<'a> SonarSlam<'a> {
    /// A drive to be corrected, of all that was heard; poses are as the odometry says.
    #[must_use]
    pub fn new(
        config: &SlamConfig,
        mapper: &MapperConfig,
        odometry: &OdometryConfig,
        robot: &Robot,
        drive: &'a Drive,
    ) -> Self {
        let carried = if odometry.systematic == Systematic::Carry {
            odometry.lin_scale.abs().max(odometry.ang_scale.abs())
        } else {
            0.0
        };
        let mut slam = Self {
            config: config.clone(),
            mapper: mapper.clone(),
            robot: robot.clone(),
            rings: &drive.rings,
            nodes: Vec::new(),
            graph: Graph { scale_sigma: SCALE_SIGMA.max(carried), ..Graph::default() },
            steps: 0,
            centres: Vec::new(),
            places: BTreeMap::new(),
            closures: Vec::new(),
            tries: 0,
            unrecognised: Unrecognised::default(),
        };
        for (index, ring) in drive.rings.iter().enumerate() {
            slam.add(index, ring, odometry);
        }
        slam.steps = slam.graph.edges.len();
        slam
    }

    /// Adds a node where a ring was heard, if the robot has come far enough.
    fn add(&mut self, index: usize, ring: &Ring, odometry: &OdometryConfig) {
        let Ring { stamp_ns, odom_from_base, left_open, .. } = *ring;
        let mut node = Node { stamp_ns, odom_from_base, way_m: 0.0, left_open, ring: index };
        if let (Some(last), Some(pose)) = (self.nodes.last(), self.graph.poses.last().copied()) {
            let step = Increment::between(last.odom_from_base, odom_from_base);
            if step.length_m() < NODE_EVERY.0 && step.turn_rad.abs() < NODE_EVERY.1 {
                return;
            }
            node.way_m = last.way_m + step.length_m() + METRES_PER_RAD * step.turn_rad.abs();
            let to = self.nodes.len() as u32;
            let measured = move_by(Pose2::IDENTITY, step);
            let open = [left_open[0] - last.left_open[0], left_open[1] - last.left_open[1]];
            self.graph.edges.push(Edge {
                from: to - 1,
                to,
                measured,
                information: information(odometry, step, open),
                kernel: 0.0,
                kind: Kind::Odometry(step),
            });
            self.graph.poses.push(pose * measured);
        } else {
            self.graph.poses.push(odom_from_base);
        }
        if self.centres.last().is_none_or(|centre| node.way_m - self.nodes[*centre].way_m >= PLACE_EVERY_M) {
            self.centres.push(self.nodes.len());
        }
        self.nodes.push(node);
    }

    /// Finds the poses: looks for places that are heard again twice, as what was too far off to be recognised at first may not be any more.
    pub fn finish(&mut self) {
        self.look_along(true);
        self.closures.clear();
        (self.tries, self.unrecognised) = (0, Unrecognised::default());
        self.look_along(false);
        if self.take_back() {
            self.solve();
        }
    }

    /// The rings that were heard from a node on until the next, each with its number.
    pub(super) fn rings_of(&self, node: usize) -> impl Iterator<Item = (u64, &'a Ring)> {
        let until = self.nodes.get(node + 1).map_or(self.rings.len(), |next| next.ring);
        let rings = self.rings;
        (self.nodes[node].ring..until).map(move |index| (index as u64 + 1, &rings[index]))
    }

    /// The nodes of the way about a node, and how each lies seen from it, by the odometry alone.
    pub(super) fn way_about(&self, about: usize, half_m: f64) -> Vec<(usize, Pose2)> {
        let middle = &self.nodes[about];
        let is_of = |node: &Node| (node.way_m - middle.way_m).abs() <= half_m && node.left_open == middle.left_open;
        let step = |from: usize| {
            let measured = Increment::between(self.nodes[from].odom_from_base, self.nodes[from + 1].odom_from_base);
            move_by(Pose2::IDENTITY, self.scales().correct(measured))
        };
        let mut way = vec![(about, Pose2::IDENTITY)];
        let mut pose = Pose2::IDENTITY;
        for node in (0..about).rev().take_while(|node| is_of(&self.nodes[*node])) {
            pose = pose * step(node).inverse();
            way.push((node, pose));
        }
        way.reverse();
        pose = Pose2::IDENTITY;
        for node in (about + 1..self.nodes.len()).take_while(|node| is_of(&self.nodes[*node])) {
            pose = pose * step(node - 1);
            way.push((node, pose));
        }
        way
    }

    /// What the odometry is believed to measure too much.
    pub(super) fn scales(&self) -> Scales {
        let [lin, ang] = self.graph.scales;
        Scales { lin, ang }
    }

    /// Solves the graph with the closures that are applied.
    pub(super) fn solve(&mut self) {
        self.graph.edges.truncate(self.steps);
        let applied = self.closures.iter().zip(0..).filter(|(closure, _)| closure.standing.counts());
        self.graph.edges.extend(applied.map(|(closure, number)| closure.edge(number)));
        let solver = Solver::new(&self.graph);
        solver.graduate(&mut self.graph);
    }

    /// Whether any place was recognised, so that the poses are others than the odometry's.
    #[must_use]
    pub fn is_corrected(&self) -> bool {
        self.applied() > 0
    }

    /// The corrected poses at these stamps, `odom`: where the odometry said that the robot was, in order of stamps; each with its covariance
    /// in the frame of the map, in which the first is certain.
    #[must_use]
    pub fn estimates(&self, odom: &[(u64, Pose2)]) -> Vec<(u64, Estimate)> {
        let covariances = Solver::new(&self.graph).covariances(&self.graph, 1..self.nodes.len());
        let covariances: Vec<Matrix> = core::iter::once(matrix::ZERO).chain(covariances).collect();
        let knots: Vec<Knot> = self.nodes.iter().zip(&self.graph.poses).map(|(node, pose)| node.knot(*pose)).collect();
        let poses = path::through(&knots, odom);
        let told = |(stamp_ns, pose): (u64, Pose2)| {
            let after = self.nodes.partition_point(|node| node.stamp_ns <= stamp_ns);
            let (before, after) = (after.saturating_sub(1), after.min(self.nodes.len() - 1));
            let [from_ns, to_ns] = [before, after].map(|node| self.nodes[node].stamp_ns);
            let share = stamp_ns.saturating_sub(from_ns) as f64 / to_ns.saturating_sub(from_ns).max(1) as f64;
            let share = if before == after { 0.0 } else { share.min(1.0) };
            let [a, b] = [covariances[before], covariances[after]];
            let covariance = Matrix3::from_fn(|row, column| (1.0 - share) * a[row][column] + share * b[row][column]);
            (stamp_ns, Estimate::with_covariance(pose, &covariance))
        };
        if self.nodes.is_empty() { Vec::new() } else { poses.into_iter().map(told).collect() }
    }

    /// The graph as it was solved last.
    #[must_use]
    pub fn graph(&self) -> &Graph {
        &self.graph
    }
}

impl Node {
    fn knot(&self, pose: Pose2) -> Knot {
        Knot { stamp_ns: self.stamp_ns, odom_from_base: self.odom_from_base, pose }
    }
}

/// The inverse of the covariance of a step, of (along, across, turn) at its end. (Eqs 3, 4; and what a leap left open.)
fn information(odometry: &OdometryConfig, step: Increment, [lin_m2, ang_rad2]: [f64; 2]) -> Matrix {
    let (length, turn) = (step.length_m(), step.turn_rad.abs());
    let along = odometry.k_ll * length + odometry.k_lt * turn;
    let heading = odometry.k_tt * turn + odometry.k_tl * length;
    let across = length * length * heading / 3.0;
    let of = |variance: f64, least: f64| 1.0 / (variance + least);
    matrix::diagonal([of(along + lin_m2, 1e-7), of(across + lin_m2, 1e-6), of(heading + ang_rad2, 1e-8)])
}
