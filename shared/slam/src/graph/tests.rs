use proptest::prelude::*;

use super::*;

/// Between two poses, exactly.
fn edge(graph: &Graph, from: u32, to: u32, kind: Kind) -> Edge {
    let measured = graph.poses[from as usize].inverse() * graph.poses[to as usize];
    let information = matrix::diagonal([400.0, 400.0, 4000.0]);
    Edge { from, to, measured, information, kernel: 0.0, kind }
}

/// Twice round a square of 5 m, a node each metre.
fn square() -> Graph {
    let mut pose = Pose2::new(1.0, 2.0, 0.3);
    let mut graph = Graph::default();
    for step in 0..41 {
        graph.poses.push(pose);
        let turn = if step % 5 == 4 { core::f64::consts::FRAC_PI_2 } else { 0.0 };
        pose = pose * Pose2::new(1.0, 0.0, turn);
    }
    graph
}

fn farthest_m(graph: &Graph, truth: &[Pose2]) -> f64 {
    graph.poses.iter().zip(truth).map(|(pose, is)| pose.distance_m(*is)).fold(0.0, f64::max)
}

#[test]
fn what_fits_is_found_from_afar() {
    let mut graph = square();
    let truth = graph.poses.clone();
    for node in 1..41 {
        graph.edges.push(edge(&graph, node - 1, node, Kind::Match));
    }
    for node in 20..41 {
        graph.edges.push(edge(&graph, node - 20, node, Kind::Closure(0)));
    }
    for (node, pose) in graph.poses.iter_mut().enumerate().skip(1) {
        *pose = *pose * Pose2::new(0.02 * node as f64, -0.01 * node as f64, 0.004 * node as f64);
    }
    let solver = Solver::new(&graph);
    solver.descend(&mut graph, 10, 1.0);
    assert!(farthest_m(&graph, &truth) < 1e-6 && graph.cost() < 1e-9);
}

#[test]
fn loops_calibrate_the_odometry() {
    let mut graph = Graph { scale_sigma: 0.05, ..square() };
    let truth = graph.poses.clone();
    for node in 1..41 {
        let made = Increment::between(truth[node - 1], truth[node]);
        let measured = Increment { forward_m: made.forward_m / 0.97, turn_rad: made.turn_rad / 1.02, ..made };
        graph.edges.push(edge(&graph, node as u32 - 1, node as u32, Kind::Odometry(measured)));
    }
    for (from, to) in [(0, 20), (5, 25), (10, 30), (20, 40)] {
        graph.edges.push(edge(&graph, from, to, Kind::Closure(0)));
    }
    let solver = Solver::new(&graph);
    solver.descend(&mut graph, 10, 1.0);
    // Turns close a loop whatever its size: of translation a loop alone tells nothing, of turns all.
    assert!((graph.scales[1] + 0.02).abs() < 0.002, "{:?}", graph.scales);
}

#[test]
fn a_false_closure_counts_for_nothing() {
    let mut graph = square();
    let truth = graph.poses.clone();
    for node in 1..41 {
        graph.edges.push(edge(&graph, node - 1, node, Kind::Match));
    }
    for node in 20..41 {
        graph.edges.push(Edge { kernel: 50.0, ..edge(&graph, node - 20, node, Kind::Closure(0)) });
    }
    let wrong = Edge { kernel: 50.0, ..edge(&graph, 3, 11, Kind::Closure(1)) };
    graph.edges.push(Edge { measured: Pose2::new(0.1, 0.0, 0.05), ..wrong });
    let solver = Solver::new(&graph);
    solver.graduate(&mut graph);
    assert!(farthest_m(&graph, &truth) < 0.02, "{}", farthest_m(&graph, &truth));
    assert!(graph.edges[graph.edges.len() - 1].chi2(&graph) > 50.0);
}

/// Steps of a straight way add up: the doubt at its end is that of them all, along the way; across it grows with the heading's.
#[test]
fn doubt_adds_up_along_the_way() {
    let mut graph = Graph { poses: (0..11).map(|x| Pose2::new(f64::from(x), 0.0, 0.0)).collect(), ..Graph::default() };
    for node in 1..11 {
        graph.edges.push(edge(&graph, node - 1, node, Kind::Match));
    }
    let covariance = Solver::new(&graph).covariances(&graph, [10]).pop().unwrap();
    let (step, turn) = (1.0 / 400.0, 1.0 / 4000.0);
    assert!((covariance[0][0] - 10.0 * step).abs() < 1e-6 && (covariance[2][2] - 10.0 * turn).abs() < 1e-6);
    // Σ k² turn over the steps before the last.
    assert!((covariance[1][1] - 10.0 * step - 285.0 * turn).abs() < 1e-5, "{covariance:?}");
}

proptest! {
    #[test]
    fn jacobians_are_those_of_the_error(
        a in prop::array::uniform3(-2.0..2.0f64), b in prop::array::uniform3(-2.0..2.0f64),
        f in -1.0..1.0f64, l in -1.0..1.0f64, turn_rad in -1.0..1.0f64, lin in -0.2..0.2f64, ang in -0.2..0.2f64,
    ) {
        const H: f64 = 1e-6;
        let measured = Increment { forward_m: f, lateral_m: l, turn_rad };
        let z = move_by(Pose2::IDENTITY, measured.corrected(lin, ang));
        let at = Pose2::new(a[0], a[1], a[2]);
        // Near to what was measured: what else the Jacobian of the scales leaves out is of second order.
        let to = at * z * Pose2::new(1e-3 * b[0], 1e-3 * b[1], 1e-3 * b[2]);
        let graph = Graph { poses: vec![at, to], scales: [lin, ang], ..Graph::default() };
        let edge = edge(&graph, 0, 1, Kind::Odometry(measured));
        let (of_from, of_to) = edge.jacobians(&graph);
        let of_scales = edge.scale_jacobian(graph.scales).unwrap();
        let slope = |change: &dyn Fn(&mut Graph, f64)| {
            let [up, down] = [H, -H].map(|h| {
                let mut changed = graph.clone();
                change(&mut changed, h);
                edge.error(&changed)
            });
            [0, 1, 2].map(|row| wrap_angle(up[row] - down[row]) / (2.0 * H))
        };
        fn axis(pose: &mut Pose2, column: usize) -> &mut f64 {
            match column { 0 => &mut pose.x, 1 => &mut pose.y, _ => &mut pose.theta }
        }
        for column in 0..3 {
            for (node, jacobian) in [(0, &of_from), (1, &of_to)] {
                let expected = slope(&|graph, h| *axis(&mut graph.poses[node], column) += h);
                for row in 0..3 {
                    prop_assert!((jacobian[row][column] - expected[row]).abs() < 1e-6);
                }
            }
        }
        for column in 0..2 {
            let expected = slope(&|graph, h| graph.scales[column] += h);
            for (row, (line, expected)) in of_scales.iter().zip(expected).enumerate() {
                prop_assert!((line[column] - expected).abs() < 4e-3, "{} {}", row, column);
            }
        }
    }
}

/// Seen from the middle of a chain, the end is as doubtful as the steps between; what lies before adds nothing.
#[test]
fn how_one_pose_lies_seen_from_another_is_known_by_the_way_between() {
    let mut graph = square();
    graph.edges = (1..41).map(|node| edge(&graph, node - 1, node, Kind::Match)).collect();
    let solver = Solver::new(&graph);
    let marginals = solver.marginals(&graph);
    // The covariance of a step is told at its end; that of the relative pose in the frame that it is seen from.
    let step = matrix::diagonal([1.0 / 400.0, 1.0 / 400.0, 1.0 / 4000.0]);
    for from in [0, 7, 31] {
        let (mut expected, mut pose) = (matrix::ZERO, Pose2::IDENTITY);
        for node in from..from + 6 {
            let next = pose * (graph.poses[node].inverse() * graph.poses[node + 1]);
            let (dx, dy) = (next.x - pose.x, next.y - pose.y);
            let carry = [[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]];
            let carried = matrix::product(&matrix::product(&carry, &expected), &matrix::transpose(&carry));
            expected = matrix::sum(&carried, &matrix::turned(&step, next.theta));
            pose = next;
        }
        let found = marginals.relative(from, from + 6);
        for (line, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((line - expected).abs() < 1e-5, "{found:?} {expected:?}");
        }
    }
}
