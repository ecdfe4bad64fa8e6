//! Weighted least squares: from a start down to the pose that fits best (Levenberg and Marquardt).

use nalgebra::{Cholesky, Const, Matrix3, Vector3};

use super::sighting::Sighting;
use crate::angle::wrap_angle;

/// Most steps of a descent, those in vain included.
const STEPS_MAX: usize = 100;
/// Where no step this much damped leads down, it does not go down.
const DAMPING_MAX: f64 = 1e12;
/// A descent ends when the next step promises to take less than this off chi².
const CHI2_TOLERANCE: f64 = 1e-14;
/// Nearer than this to a landmark its direction says nothing, metres.
const TOUCHING_M: f64 = 1e-9;

/// Sightings to be fitted, in a frame whose origin is amid the landmarks.
pub(super) struct Problem {
    pub(super) sightings: Vec<Sighting>,
    /// Whether the heading is to be found: there are bearings.
    pub(super) with_heading: bool,
    /// A descent that leads farther out than this is given up, metres.
    pub(super) reach_m: f64,
}

/// A measurement against what a pose predicts.
pub(super) struct Row {
    /// Measured less predicted.
    pub(super) residual: f64,
    pub(super) sigma: f64,
    /// By x, y, θ.
    pub(super) slope: Vector3<f64>,
}

/// Where a descent has come to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// x, y, θ.
    pub(super) pose: Vector3<f64>,
    pub(super) chi2: f64,
    /// HᵀWH; 1 for a heading that is not to be found.
    pub(super) information: Matrix3<f64>,
    /// HᵀW times the residuals.
    gradient: Vector3<f64>,
}

/// A point on the way down.
#[derive(Debug, Clone, Copy)]
pub(super) struct Passed {
    /// x, y, θ.
    pub(super) pose: Vector3<f64>,
    pub(super) chi2: f64,
}

impl Point {
    /// How many standard deviations away another pose is, by what is known at this one.
    pub(super) fn separation(&self, pose: &Vector3<f64>) -> f64 {
        let difference = pose - self.pose;
        let difference = Vector3::new(difference.x, difference.y, wrap_angle(difference.z));
        difference.dot(&(self.information * difference)).max(0.0).sqrt()
    }
}

impl Problem {
    /// Number of measurements.
    pub(super) fn measurements(&self) -> usize {
        let count =
            |sighting: &Sighting| usize::from(sighting.range_m.is_some()) + usize::from(sighting.bearing_rad.is_some());
        self.sightings.iter().map(count).sum()
    }

    /// Number of numbers to be found.
    pub(super) fn unknowns(&self) -> usize {
        if self.with_heading { 3 } else { 2 }
    }

    /// The measurements of a sighting, range first, as seen from a pose.
    pub(super) fn rows(sighting: &Sighting, pose: &Vector3<f64>) -> impl Iterator<Item = Row> {
        let (dx, dy) = (sighting.landmark[0] - pose.x, sighting.landmark[1] - pose.y);
        let distance = libm::hypot(dx, dy);
        // Unit vector towards the landmark, and what moving across it does to the bearing.
        let (ux, uy, per_m) =
            if distance > TOUCHING_M { (dx / distance, dy / distance, 1.0 / distance) } else { (0.0, 0.0, 0.0) };
        let theta = pose.z;
        let range = sighting.range_m.map(|range_m| Row {
            residual: range_m - distance,
            sigma: sighting.range_sigma_m,
            slope: Vector3::new(-ux, -uy, 0.0),
        });
        let bearing = sighting.bearing_rad.map(|bearing_rad| Row {
            residual: wrap_angle(bearing_rad - (libm::atan2(dy, dx) - theta)),
            sigma: sighting.bearing_sigma_rad,
            slope: Vector3::new(uy * per_m, -ux * per_m, -1.0),
        });
        range.into_iter().chain(bearing)
    }

    /// How well a pose fits, and which way down it goes.
    pub(super) fn at(&self, pose: Vector3<f64>) -> Point {
        let mut point = Point { pose, chi2: 0.0, information: Matrix3::zeros(), gradient: Vector3::zeros() };
        for row in self.sightings.iter().flat_map(|sighting| Self::rows(sighting, &pose)) {
            let slope = row.slope / row.sigma;
            let residual = row.residual / row.sigma;
            point.chi2 += residual * residual;
            point.gradient += slope * residual;
            point.information += slope * slope.transpose();
        }
        if !self.with_heading {
            point.information[(2, 2)] = 1.0;
        }
        point
    }

    /// The heading that fits the bearings best from a position (0 without bearings).
    pub(super) fn heading_at(&self, [x, y]: [f64; 2]) -> f64 {
        let (mut sum_s, mut sum_c) = (0.0, 0.0);
        for sighting in &self.sightings {
            if let Some(bearing_rad) = sighting.bearing_rad {
                let direction = libm::atan2(sighting.landmark[1] - y, sighting.landmark[0] - x);
                let (s, c) = libm::sincos(direction - bearing_rad);
                let weight = 1.0 / (sighting.bearing_sigma_rad * sighting.bearing_sigma_rad);
                sum_s += weight * s;
                sum_c += weight * c;
            }
        }
        libm::atan2(sum_s, sum_c)
    }

    /// Down from a position to a pose that fits better than all around it; none if there is none within reach.
    /// `way` gets the points it comes by.
    pub(super) fn descend(&self, start: [f64; 2], way: &mut Vec<Passed>) -> Option<Point> {
        let mut here = self.at(Vector3::new(start[0], start[1], self.heading_at(start)));
        let mut damping = 1e-3;
        for _ in 0..STEPS_MAX {
            way.push(Passed { pose: here.pose, chi2: here.chi2 });
            let there = damped_step(&here, damping).map(|step| (step, self.at(here.pose + step)));
            match there {
                Some((step, there)) if there.chi2 <= here.chi2 => {
                    let promised = step.dot(&here.gradient);
                    here = there;
                    here.pose.z = wrap_angle(here.pose.z);
                    if libm::hypot(here.pose.x, here.pose.y) > self.reach_m {
                        return None;
                    }
                    if damping <= 1e-3 && promised <= CHI2_TOLERANCE * (1.0 + here.chi2) {
                        return Some(here);
                    }
                    damping = (damping * 0.1).max(1e-12);
                }
                _ => {
                    damping *= 10.0;
                    if damping > DAMPING_MAX {
                        // As low as rounding lets it come.
                        return here.chi2.is_finite().then_some(here);
                    }
                }
            }
        }
        None
    }
}

fn damped_step(here: &Point, damping: f64) -> Option<Vector3<f64>> {
    let diagonal = here.information.diagonal();
    let least = 1e-15 * diagonal.sum();
    let damped = here.information + Matrix3::from_diagonal(&diagonal.map(|value| damping * value.max(least)));
    let (factor, scale) = factor(&damped)?;
    let step = factor.solve(&here.gradient.component_mul(&scale)).component_mul(&scale);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

/// Inverse of a symmetric matrix without a direction in which it is zero or negative; none for any other.
pub(super) fn inverse(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let (factor, scale) = factor(matrix)?;
    let inverse = scaled(&factor.inverse(), &scale);
    let inverse = (inverse + inverse.transpose()) * 0.5;
    inverse.iter().all(|value| value.is_finite()).then_some(inverse)
}

/// Cholesky's factor of the matrix scaled to a diagonal of ones, as the units of the three may differ by much; and that scale.
fn factor(matrix: &Matrix3<f64>) -> Option<(Cholesky<f64, Const<3>>, Vector3<f64>)> {
    let diagonal = matrix.diagonal();
    if !diagonal.iter().all(|value| *value > 0.0 && value.is_finite()) {
        return None;
    }
    let scale = diagonal.map(|value| 1.0 / value.sqrt());
    Some((scaled(matrix, &scale).cholesky()?, scale))
}

/// Rows and columns times this.
fn scaled(matrix: &Matrix3<f64>, by: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| matrix[(row, column)] * by[row] * by[column])
}
