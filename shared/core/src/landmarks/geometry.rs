//! Whether landmarks, where they lie, settle a pose; and what is wrong with them if they do not.

use nalgebra::{Matrix3, Vector3};

use super::error::{Degeneracy, TriangulationError};
use super::fit::{Point, Problem, inverse};

/// Largest standard deviation of the position, as a share of the distance of the landmarks: beyond it the straight-line
/// reckoning that says how uncertain the pose is no longer holds.
const POSITION_SHARE_MAX: f64 = 0.15;
/// Largest standard deviation of the heading, for the same reason, radians.
const HEADING_SIGMA_MAX_RAD: f64 = 0.35;
/// Measurements must hold the pose in every direction by this share of how they hold it in all (squared), whatever their sigmas.
const HOLD_MIN: f64 = 1e-8;
/// How flat points are that count as lying on one line: smaller over larger variance.
const FLAT: f64 = 0.01;

/// (HᵀWH)⁻¹ at a pose.
///
/// # Errors
/// When the measurements do not hold the pose there in every direction, or not firmly.
pub(super) fn covariance(problem: &Problem, point: &Point) -> Result<Matrix3<f64>, TriangulationError> {
    let distance_m = distance(problem, &point.pose);
    let refuse = |position_sigma_m| TriangulationError::Degenerate {
        geometry: degeneracy(problem, &point.pose),
        position_sigma_m,
        distance_m,
    };
    if !holds(problem, point, distance_m) {
        return Err(refuse(None));
    }
    let covariance = inverse(&point.information).ok_or_else(|| refuse(None))?;
    let position_sigma_m = (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();
    let heading_too_open = problem.with_heading && covariance[(2, 2)].sqrt() > HEADING_SIGMA_MAX_RAD;
    if position_sigma_m > POSITION_SHARE_MAX * distance_m || heading_too_open {
        return Err(refuse(Some(position_sigma_m)));
    }
    Ok(covariance)
}

/// Why a pose that fits is none, when another one that fits hardly worse is not to be told from it.
pub(super) fn blurred(problem: &Problem, pose: &Vector3<f64>, other: &Vector3<f64>) -> TriangulationError {
    TriangulationError::Degenerate {
        geometry: degeneracy(problem, other),
        position_sigma_m: Some(0.5 * libm::hypot(pose.x - other.x, pose.y - other.y)),
        distance_m: distance(problem, other),
    }
}

/// Root mean square distance from the pose to the landmarks, metres.
fn distance(problem: &Problem, pose: &Vector3<f64>) -> f64 {
    let square = seen_from(problem, pose).map(|[x, y]| x * x + y * y).sum::<f64>();
    (square / problem.sightings.len() as f64).sqrt()
}

fn seen_from(problem: &Problem, pose: &Vector3<f64>) -> impl Iterator<Item = [f64; 2]> {
    let (x, y) = (pose.x, pose.y);
    problem.sightings.iter().map(move |sighting| [sighting.landmark[0] - x, sighting.landmark[1] - y])
}

/// Whether the measurements, all of one weight, hold the pose in every direction.
fn holds(problem: &Problem, point: &Point, distance_m: f64) -> bool {
    let mut grip = Matrix3::zeros();
    for row in problem.sightings.iter().flat_map(|sighting| Problem::rows(sighting, &point.pose)) {
        // Turning by one radian counts like moving by the distance of the landmarks.
        let slope = Vector3::new(row.slope.x, row.slope.y, row.slope.z / distance_m);
        let length = slope.norm();
        if length > 0.0 {
            grip += slope * slope.transpose() / (length * length);
        }
    }
    grip /= problem.measurements() as f64;
    if !problem.with_heading {
        grip[(2, 2)] = 1.0;
    }
    inverse(&grip).is_some_and(|inverse| inverse.trace() < 1.0 / HOLD_MIN)
}

/// What is wrong with the place of the landmarks, seen from a pose.
fn degeneracy(problem: &Problem, pose: &Vector3<f64>) -> Degeneracy {
    let landmarks: Vec<[f64; 2]> = seen_from(problem, pose).filter(|[x, y]| x * x + y * y > 0.0).collect();
    let directions = landmarks.iter().map(|[x, y]| {
        let square = x * x + y * y;
        // As twice the angle: to and fro are one line.
        [(x * x - y * y) / square, 2.0 * x * y / square]
    });
    let count = landmarks.len().max(1) as f64;
    let [x, y] = directions.fold([0.0, 0.0], |sum, [x, y]| [sum[0] + x / count, sum[1] + y / count]);
    if x * x + y * y > 1.0 - FLAT {
        return Degeneracy::OneLine;
    }
    let bearings_only = problem.sightings.iter().all(|sighting| sighting.range_m.is_none());
    // A circle through the robot is a straight line once distances are turned into their inverses.
    let inverted = landmarks.iter().map(|[x, y]| [x / (x * x + y * y), y / (x * x + y * y)]);
    if bearings_only && is_flat(&inverted.collect::<Vec<_>>()) { Degeneracy::OneCircle } else { Degeneracy::Weak }
}

/// Whether points lie about on one line.
fn is_flat(points: &[[f64; 2]]) -> bool {
    let count = points.len().max(1) as f64;
    let mean = points.iter().fold([0.0, 0.0], |sum, [x, y]| [sum[0] + x / count, sum[1] + y / count]);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for [x, y] in points {
        let (dx, dy) = (x - mean[0], y - mean[1]);
        xx += dx * dx;
        yy += dy * dy;
        xy += dx * dy;
    }
    // Smaller over larger eigenvalue, about.
    let trace = xx + yy;
    xx * yy - xy * xy < FLAT * trace * trace
}
