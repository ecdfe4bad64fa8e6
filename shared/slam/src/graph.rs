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
    /// What they were believed to be before, and one standard deviation of that; 0: they are known to be 0.
    pub scales_before: [f64; 2],
    /// See [`Self::scales_before`].
    pub scale_sigma: f64,
    /// So many of the first poses are settled: they stay what they are, and what was measured between them counts no more.
    pub settled: u32,
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
    /// None where one of the poses is settled.
    poses: Option<Place>,
    /// Of each pose that is not.
    scales: [Option<Place>; 2],
}

/// A graph made ready to be solved, as long as its edges stay what they are.
#[derive(Debug)]
pub struct Solver {
    structure: Structure,
    places: Vec<Option<Places>>,
    has_scales: bool,
    /// The first pose that is solved for.
    first: usize,
}

impl Solver {
    /// For this graph.
    #[must_use]
    pub fn new(graph: &Graph) -> Self {
        let first = graph.settled as usize;
        let nodes = graph.poses.len() - first;
        let has_scales =
            graph.scale_sigma > 0.0 && graph.edges.iter().any(|edge| matches!(edge.kind, Kind::Odometry(_)));
        let variable = |node: u32| (node as usize).checked_sub(first);
        let pairs = graph.edges.iter().filter_map(|edge| variable(edge.from).zip(variable(edge.to)));
        let structure = Structure::new(nodes + usize::from(has_scales), pairs, has_scales);
        let places = graph.edges.iter().map(|edge| {
            let ends = [variable(edge.from), variable(edge.to)];
            let is_scaled = has_scales && matches!(edge.kind, Kind::Odometry(_));
            let scales = ends.map(|end| end.filter(|_| is_scaled).and_then(|end| structure.place(end, nodes)));
            let [Some(from), Some(to)] = ends else {
                return ends.iter().flatten().next().map(|_| Places { poses: None, scales });
            };
            Some(Places { poses: Some(structure.place(from, to)?), scales })
        });
        let places = places.collect();
        Self { structure, places, has_scales, first }
    }

    /// The normal equations at the poses as they are, kernels opened by `opened`.
    fn linearised(&self, graph: &Graph, opened: f64) -> (System<'_>, Vec<Vector>) {
        let nodes = graph.poses.len() - self.first;
        let variable = |node: u32| (node as usize).checked_sub(self.first);
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
            let scaled = edge.scale_jacobian(graph.scales).filter(|_| self.has_scales);
            for (node, place, j, j_i) in
                [(edge.from, places.scales[0], &from, &from_i), (edge.to, places.scales[1], &to, &to_i)]
            {
                let Some(variable) = variable(node) else { continue };
                system.add_diagonal(variable, &matrix::product(j_i, j));
                push(variable, matrix::apply(j_i, &error));
                if let Some((place, scales)) = place.zip(scaled.as_ref()) {
                    system.add(place, &matrix::product(j_i, scales));
                }
            }
            if let Some(place) = places.poses {
                system.add(place, &matrix::product(&from_i, &to));
            }
            if let Some(scales) = scaled {
                let scales_i = matrix::transposed_product(&scales, &information);
                system.add_diagonal(nodes, &matrix::product(&scales_i, &scales));
                push(nodes, matrix::apply(&scales_i, &error));
            }
        }
        self.anchored(graph, &mut system, &mut push);
        if graph.anchors.is_empty() && self.first == 0 {
            system.add_diagonal(0, &matrix::diagonal([1e9; 3]));
        }
        for node in 0..nodes {
            system.add_diagonal(node, &matrix::diagonal([1e-6; 3]));
        }
        if self.has_scales {
            let prior = 1.0 / (graph.scale_sigma * graph.scale_sigma);
            system.add_diagonal(nodes, &matrix::diagonal([prior, prior, 1.0]));
            let [lin, ang] = [0, 1].map(|axis| prior * (graph.scales[axis] - graph.scales_before[axis]));
            push(nodes, [lin, ang, 0.0]);
        }
        (system, right)
    }

    /// What is known of poses from elsewhere, added to the normal equations.
    fn anchored(&self, graph: &Graph, system: &mut System<'_>, push: &mut impl FnMut(usize, Vector)) {
        for anchor in &graph.anchors {
            let Some(node) = (anchor.node as usize).checked_sub(self.first) else { continue };
            let at = graph.poses[anchor.node as usize];
            let (s, c) = libm::sincos(anchor.pose.theta);
            let (dx, dy) = (at.x - anchor.pose.x, at.y - anchor.pose.y);
            let error = [c * dx + s * dy, c * dy - s * dx, wrap_angle(at.theta - anchor.pose.theta)];
            let j = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
            let j_i = matrix::transposed_product(&j, &anchor.information);
            system.add_diagonal(node, &matrix::product(&j_i, &j));
            push(node, matrix::apply(&j_i, &error));
        }
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
            for (pose, step) in graph.poses[self.first..].iter_mut().zip(&step) {
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
        debug_assert_eq!(self.first, 0, "of settled poses nothing is told");
        Marginals { factors: self.linearised(graph, 1.0).0.factor(), graph }
    }

    /// Covariances of poses at the solution, seen from those that are settled: of (x, y, θ) in the frame of the map. What is settled
    /// itself has none.
    #[must_use]
    pub fn covariances(&self, graph: &Graph, nodes: impl IntoIterator<Item = usize>) -> Vec<Matrix> {
        let factors: Factors<'_> = self.linearised(graph, 1.0).0.factor();
        let of =
            |node: usize| node.checked_sub(self.first).map_or(matrix::ZERO, |variable| factors.covariance(variable));
        nodes.into_iter().map(of).collect()
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
