//! The last step: all scans of one place are laid on each other, whenever they were taken, and the graph is solved by that.

use std::collections::BTreeMap;

use crate::cloud::Cloud;
use crate::graph::{Edge, Kind, Solver};
use crate::matching::point_to_line;
use crate::matrix::{self, Matrix};
use crate::slam::Slam;

/// Nodes farther apart than this share too little, metres.
const REACH_M: f64 = 3.0;
/// Side of the cells that nodes are sorted into, metres.
const CELL_M: f64 = 3.0;
/// Neighbours of other passes, at most, and how far apart on the way they are, metres.
const NEIGHBOURS: usize = 10;
const APART_M: f64 = 0.5;
/// Nodes nearer on the way than this are of the same pass, metres.
const SAME_PASS_M: f64 = 4.0;
/// What a match must be like.
const INLIERS_MIN: f64 = 0.5;
const LINES_MIN: usize = 30;
/// χ² from which an edge counts for little.
const KERNEL: f64 = 20.0;
/// Within which partners are looked for, metres: in the first round, and later.
const FIRST_RADII_M: [f64; 5] = [0.3, 0.25, 0.2, 0.15, 0.12];
const RADII_M: [f64; 4] = [0.15, 0.12, 0.1, 0.1];

impl Slam {
    /// One round: renews the matches before node `upto` at the poses as they are, and solves.
    pub(crate) fn refine(&mut self, round: u32, upto: usize) {
        let pairs = self.neighbours(upto);
        let prior: Matrix = matrix::diagonal([25.0, 25.0, 100.0]);
        let radii: &[f64] = if round == 0 { &FIRST_RADII_M } else { &RADII_M };
        let mut edges: Vec<Edge> = Vec::new();
        for (to, fixed) in &pairs {
            // The scan that several lie on is sorted once.
            let cloud =
                Cloud::of(self.drive.graph.poses[*to], [(self.drive.graph.poses[*to], &self.drive.nodes[*to].points)]);
            for from in fixed {
                let guess = self.drive.graph.poses[*to].inverse() * self.drive.graph.poses[*from];
                let found = point_to_line(&cloud, &self.drive.nodes[*from].points, guess, Some((guess, &prior)), radii);
                if found.inliers > INLIERS_MIN && found.lines > LINES_MIN {
                    edges.push(Edge {
                        from: *to as u32,
                        to: *from as u32,
                        measured: found.pose,
                        information: found.believed(),
                        kernel: KERNEL,
                        kind: Kind::Refined,
                    });
                }
            }
        }
        let keeps = |edge: &Edge| match edge.kind {
            // Not renewed yet.
            _ if edge.to as usize >= upto => true,
            Kind::Odometry(_) => true,
            // Where nothing else holds two nodes together, what the drive was followed by does.
            Kind::Match => edge.kernel == 0.0 && self.config.odometry == crate::UseOdometry::Ignore,
            // What somebody requires holds to the end.
            Kind::Closure(_) => round == 0 || edge.kernel == 0.0,
            Kind::Refined => false,
        };
        let mut graph = self.drive.graph.clone();
        graph.edges.retain(keeps);
        graph.edges.extend(edges);
        let solver = Solver::new(&graph);
        if round == 0 {
            solver.graduate(&mut graph)
        } else {
            solver.descend(&mut graph, 5, 1.0)
        }
        self.drive.graph.poses.clone_from(&graph.poses);
        self.drive.graph.scales = graph.scales;
        self.drive.refined = graph.edges;
        self.stored.solved();
    }

    /// Of each node the later ones before `upto` that are laid on it.
    fn neighbours(&self, upto: usize) -> BTreeMap<usize, Vec<usize>> {
        let poses = &self.drive.graph.poses;
        let cell = |index: usize| ((poses[index].x / CELL_M).floor() as i64, (poses[index].y / CELL_M).floor() as i64);
        let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for index in self.drive.settled.with_points(upto) {
            cells.entry(cell(index)).or_default().push(index);
        }
        let mut pairs: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for index in (self.drive.graph.settled as usize).max(1)..upto {
            let way_m = |other: usize| (self.drive.nodes[index].way_m - self.drive.nodes[other].way_m).abs();
            let mut partners = vec![index - 1];
            partners.extend(
                [2, 4, 8].iter().filter(|back| index >= **back).map(|back| index - back).filter(|at| way_m(*at) < 3.0),
            );
            let (x, y) = cell(index);
            let mut near: Vec<(f64, usize)> = Vec::new();
            for column in x - 1..=x + 1 {
                for row in y - 1..=y + 1 {
                    for &other in cells.get(&(column, row)).into_iter().flatten() {
                        let apart = poses[other].distance_m(poses[index]);
                        if other < index && way_m(other) > SAME_PASS_M && apart < REACH_M {
                            let turn = (poses[other].inverse() * poses[index]).theta.abs();
                            near.push((apart + 0.5 * turn, other));
                        }
                    }
                }
            }
            near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut chosen: Vec<usize> = Vec::new();
            for (_, other) in near {
                if chosen.len() >= NEIGHBOURS {
                    break;
                }
                let apart = |one: &usize| (self.drive.nodes[*one].way_m - self.drive.nodes[other].way_m).abs();
                if chosen.iter().all(|one| apart(one) > APART_M) {
                    chosen.push(other);
                }
            }
            for partner in partners.into_iter().chain(chosen) {
                pairs.entry(partner).or_default().push(index);
            }
        }
        pairs
    }
}
