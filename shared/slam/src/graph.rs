//! The pose graph: poses, what was measured between them, and the scales of the odometry.
//!
//! An edge measures how pose j lies, seen from pose i: e = z⁻¹ (xᵢ⁻¹ xⱼ), of information Ω. Edges that may be wrong have a kernel
//! ρ(χ²) = k χ²/(k + χ²) (Geman and McClure), which counts less what does not fit; it is made narrow in steps (graduated
//! non-convexity: Yang, Antonante, Tzoumas, Carlone 2020), as a narrow one would throw out every true loop closure of a long drive. What the
//! odometry measures too much is an unknown constant of the whole drive: two more variables, with a prior.

use echogrid_core::{Increment, Pose2, move_by, wrap_angle};
use serde::{Deserialize, Serialize};

use crate::matrix::{self, Matrix, Vector};
use crate::solver::{Factors, Place, Structure, System};

/// Where an edge comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Kind {
    /// The drive measured this step, which the scales correct.
    Odometry(Increment),
    /// A scan was laid on those shortly before.
    Match,
    /// A place was recognised; its number among all closures.
    Closure(u32),
    /// Two scans of one place were laid on each other when all was known.
    Refined,
}

/// What was measured between two poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// i.
    pub from: u32,
    /// j.
    pub to: u32,
    /// z: how j lies, seen from i.
    pub measured: Pose2,
    /// Ω, of (along, across, turn), seen from j.
    pub information: Matrix,
    /// k of the kernel, in units of χ²; 0: without.
    pub kernel: f64,
    /// Where it comes from.
    pub kind: Kind,
}

/// A pose that is known from elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Anchor {
    /// The number of the node.
    pub node: u32,
    /// Where it is.
    pub pose: Pose2,
    /// Ω, of (along, across, turn).
    pub information: Matrix,
}

/// What is solved for, and from what.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Graph {
    /// The poses of the nodes, in order.
    pub poses: Vec<Pose2>,
    /// What the odometry measures too much, as a share: of translation, of rotation.
    pub scales: [f64; 2],
    /// One standard deviation of what they may be; 0: they are known to be 0.
    pub scale_sigma: f64,
    /// What was measured.
    pub edges: Vec<Edge>,
    /// What is known from elsewhere. Without one the first pose is held.
    pub anchors: Vec<Anchor>,
}

/// How far the kernels are opened at first, and by how much less each time.
const OPENED: f64 = 1e5;
const STEPS: usize = 5;

impl Edge {
    /// z with the scales taken out.
    #[must_use]
    pub fn expected(&self, scales: [f64; 2]) -> Pose2 {
        match self.kind {
            Kind::Odometry(increment) => move_by(Pose2::IDENTITY, increment.corrected(scales[0], scales[1])),
            _ => self.measured,
        }
    }

    /// e.
    #[must_use]
    pub fn error(&self, graph: &Graph) -> Vector {
        let between = graph.poses[self.from as usize].inverse() * graph.poses[self.to as usize];
        let z = self.expected(graph.scales);
        let (s, c) = libm::sincos(z.theta);
        let (dx, dy) = (between.x - z.x, between.y - z.y);
        [c * dx + s * dy, c * dy - s * dx, wrap_angle(between.theta - z.theta)]
    }

    /// χ² = eᵀ Ω e.
    #[must_use]
    pub fn chi2(&self, graph: &Graph) -> f64 {
        matrix::quadratic(&self.information, &self.error(graph))
    }

    /// How e changes with xᵢ and xⱼ (the numbers themselves, not a step on the group).
    fn jacobians(&self, graph: &Graph) -> (Matrix, Matrix) {
        let (a, b) = (graph.poses[self.from as usize], graph.poses[self.to as usize]);
        let (s, c) = libm::sincos(a.theta);
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let of_a = [[-c, -s, -s * dx + c * dy], [s, -c, -c * dx - s * dy], [0.0, 0.0, -1.0]];
        let of_b = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
        let (s, c) = libm::sincos(self.expected(graph.scales).theta);
        let back = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
        (matrix::product(&back, &of_a), matrix::product(&back, &of_b))
    }

    /// How e changes with the scales, if it does; the third column is empty.
    fn scale_jacobian(&self, scales: [f64; 2]) -> Option<Matrix> {
        let Kind::Odometry(measured) = self.kind else { return None };
        let z = self.expected(scales);
        let whole = 1.0 / (1.0 - scales[0]);
        let (x, y) = (z.x * whole, z.y * whole);
        let half_turn = 0.5 * measured.turn_rad;
        let (s, c) = libm::sincos(z.theta);
        // −Rᵀ ∂z/∂s, of the translation; −∂θ/∂s of the turn.
        let (ax, ay) = (-half_turn * z.y, half_turn * z.x);
        Some([
            [c * x + s * y, c * ax + s * ay, 0.0],
            [c * y - s * x, c * ay - s * ax, 0.0],
            [0.0, measured.turn_rad, 0.0],
        ])
    }
}

/// The places of the blocks of an edge.
#[derive(Debug, Clone, Copy)]
struct Places {
    poses: Place,
    scales: Option<(Place, Place)>,
}

/// A graph made ready to be solved, as long as its edges stay what they are.
#[derive(Debug)]
pub struct Solver {
    structure: Structure,
    places: Vec<Option<Places>>,
    has_scales: bool,
}

impl Solver {
    /// For this graph.
    #[must_use]
    pub fn new(graph: &Graph) -> Self {
        let nodes = graph.poses.len();
        let has_scales =
            graph.scale_sigma > 0.0 && graph.edges.iter().any(|edge| matches!(edge.kind, Kind::Odometry(_)));
        let pairs = graph.edges.iter().map(|edge| (edge.from as usize, edge.to as usize));
        let structure = Structure::new(nodes + usize::from(has_scales), pairs, has_scales);
        let places = graph.edges.iter().map(|edge| {
            let (from, to) = (edge.from as usize, edge.to as usize);
            let poses = structure.place(from, to)?;
            let is_scaled = has_scales && matches!(edge.kind, Kind::Odometry(_));
            let scales = || Some((structure.place(from, nodes)?, structure.place(to, nodes)?));
            Some(Places { poses, scales: if is_scaled { scales() } else { None } })
        });
        let places = places.collect();
        Self { structure, places, has_scales }
    }

    /// The normal equations at the poses as they are, kernels opened by `opened`.
    fn linearised(&self, graph: &Graph, opened: f64) -> (System<'_>, Vec<Vector>) {
        let nodes = graph.poses.len();
        let mut system = self.structure.system();
        let mut right = vec![[0.0; 3]; nodes + usize::from(self.has_scales)];
        let mut push = |variable: usize, gradient: Vector| {
            for row in 0..3 {
                right[variable][row] -= gradient[row];
            }
        };
        for (edge, places) in graph.edges.iter().zip(&self.places) {
            let Some(places) = places else { continue };
            let error = edge.error(graph);
            let weight = weight(edge, matrix::quadratic(&edge.information, &error), opened);
            let information = matrix::scaled(&edge.information, weight);
            let (from, to) = edge.jacobians(graph);
            let (from_i, to_i) =
                (matrix::transposed_product(&from, &information), matrix::transposed_product(&to, &information));
            system.add_diagonal(edge.from as usize, &matrix::product(&from_i, &from));
            system.add_diagonal(edge.to as usize, &matrix::product(&to_i, &to));
            system.add(places.poses, &matrix::product(&from_i, &to));
            push(edge.from as usize, matrix::apply(&from_i, &error));
            push(edge.to as usize, matrix::apply(&to_i, &error));
            if let (Some((a, b)), Some(scales)) = (places.scales, edge.scale_jacobian(graph.scales)) {
                let scales_i = matrix::transposed_product(&scales, &information);
                system.add(a, &matrix::product(&from_i, &scales));
                system.add(b, &matrix::product(&to_i, &scales));
                system.add_diagonal(nodes, &matrix::product(&scales_i, &scales));
                push(nodes, matrix::apply(&scales_i, &error));
            }
        }
        for anchor in &graph.anchors {
            let node = anchor.node as usize;
            let at = graph.poses[node];
            let (s, c) = libm::sincos(anchor.pose.theta);
            let (dx, dy) = (at.x - anchor.pose.x, at.y - anchor.pose.y);
            let error = [c * dx + s * dy, c * dy - s * dx, wrap_angle(at.theta - anchor.pose.theta)];
            let j = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
            let j_i = matrix::transposed_product(&j, &anchor.information);
            system.add_diagonal(node, &matrix::product(&j_i, &j));
            push(node, matrix::apply(&j_i, &error));
        }
        if graph.anchors.is_empty() {
            system.add_diagonal(0, &matrix::diagonal([1e9; 3]));
        }
        for node in 0..nodes {
            system.add_diagonal(node, &matrix::diagonal([1e-6; 3]));
        }
        if self.has_scales {
            let prior = 1.0 / (graph.scale_sigma * graph.scale_sigma);
            system.add_diagonal(nodes, &matrix::diagonal([prior, prior, 1.0]));
            push(nodes, [prior * graph.scales[0], prior * graph.scales[1], 0.0]);
        }
        (system, right)
    }

    /// So many steps of Gauss and Newton; fewer when nothing moves any more.
    pub fn descend(&self, graph: &mut Graph, iterations: usize, opened: f64) {
        for _ in 0..iterations {
            let (system, right) = self.linearised(graph, opened);
            let step = system.factor().solve(&right);
            if step.iter().flatten().any(|value| !value.is_finite()) {
                return;
            }
            let mut farthest = 0.0_f64;
            for (pose, step) in graph.poses.iter_mut().zip(&step) {
                *pose = Pose2::new(pose.x + step[0], pose.y + step[1], pose.theta + step[2]);
                farthest = step.iter().fold(farthest, |far, value| far.max(value.abs()));
            }
            if let Some(step) = self.has_scales.then(|| step.last()).flatten() {
                for (scale, step) in graph.scales.iter_mut().zip(step) {
                    *scale = (*scale + step).clamp(-0.5, 0.5);
                }
            }
            if farthest < 1e-5 {
                break;
            }
        }
    }

    /// Solves with kernels that are narrowed in steps.
    pub fn graduate(&self, graph: &mut Graph) {
        if graph.edges.iter().all(|edge| edge.kernel == 0.0) {
            return self.descend(graph, 5, 1.0);
        }
        let narrower = libm::pow(OPENED, 1.0 / (STEPS - 1) as f64);
        let mut opened = OPENED;
        for step in 0..STEPS {
            let is_last = step + 1 == STEPS;
            self.descend(graph, if is_last { 5 } else { 2 }, if is_last { 1.0 } else { opened });
            opened /= narrower;
        }
    }

    /// What is known of the poses as they are.
    #[must_use]
    pub fn marginals<'a>(&'a self, graph: &'a Graph) -> Marginals<'a> {
        Marginals { factors: self.linearised(graph, 1.0).0.factor(), graph }
    }

    /// Covariances of poses at the solution: of (x, y, θ) in the frame of the map.
    #[must_use]
    pub fn covariances(&self, graph: &Graph, nodes: impl IntoIterator<Item = usize>) -> Vec<Matrix> {
        let factors: Factors<'_> = self.linearised(graph, 1.0).0.factor();
        nodes.into_iter().map(|node| factors.covariance(node)).collect()
    }
}

/// What is known of the poses of a graph as it is.
#[derive(Debug)]
pub struct Marginals<'a> {
    factors: Factors<'a>,
    graph: &'a Graph,
}

impl Marginals<'_> {
    /// The covariance of how node `to` lies, seen from node `from`: of (x, y, θ) in the frame of `from`.
    #[must_use]
    pub fn relative(&self, from: usize, to: usize) -> Matrix {
        let [of_from, of_to] = [from, to].map(|node| self.factors.columns(node));
        let block = |columns: &[Vec<Vector>; 3], row: usize| -> Matrix {
            core::array::from_fn(|i| core::array::from_fn(|j| columns[j][row][i]))
        };
        let (a, b) = (self.graph.poses[from], self.graph.poses[to]);
        let (s, c) = libm::sincos(a.theta);
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let by_from = [[-c, -s, -s * dx + c * dy], [s, -c, -c * dx - s * dy], [0.0, 0.0, -1.0]];
        let by_to = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
        let through = |left: &Matrix, of: Matrix, right: &Matrix| {
            matrix::product(&matrix::product(left, &of), &matrix::transpose(right))
        };
        let crossed = through(&by_from, block(&of_to, from), &by_to);
        let own = matrix::sum(
            &through(&by_from, block(&of_from, from), &by_from),
            &through(&by_to, block(&of_to, to), &by_to),
        );
        matrix::symmetric(&matrix::sum(&own, &matrix::sum(&crossed, &matrix::transpose(&crossed))))
    }
}

/// Of an edge in the normal equations.
fn weight(edge: &Edge, chi2: f64, opened: f64) -> f64 {
    if edge.kernel == 0.0 {
        return 1.0;
    }
    let k = edge.kernel * opened;
    (k / (k + chi2)) * (k / (k + chi2))
}

impl Graph {
    /// The sum of what the edges cost, each by its kernel.
    #[must_use]
    pub fn cost(&self) -> f64 {
        let of = |edge: &Edge| {
            let chi2 = edge.chi2(self);
            if edge.kernel == 0.0 { chi2 } else { edge.kernel * chi2 / (edge.kernel + chi2) }
        };
        self.edges.iter().map(of).sum()
    }
}

#[cfg(test)]
mod tests;
