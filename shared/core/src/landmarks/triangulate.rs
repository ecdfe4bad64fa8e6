//! From sightings to a pose.

use core::f64::consts::PI;

use nalgebra::Matrix3;

use super::error::TriangulationError;
use super::fit::{Passed, Point, Problem};
use super::geometry::{blurred, covariance};
use super::sighting::{Sighting, check};
use super::starts::starts;
use crate::pose::Pose2;

/// Variance given to a heading that nothing is known of: that of any angle in (-π, π] being as likely as any other, rad².
pub const UNKNOWN_HEADING_VARIANCE_RAD2: f64 = PI * PI / 3.0;

/// Poses whose chi² is this near to the best one's fit as well: one is e⁻⁸ times as likely as the other, or more.
const CHI2_RIVAL: f64 = 16.0;
/// Rivals nearer to each other than this are one blurred pose, not two: standard deviations.
const SEPARATION_MIN: f64 = 4.0;
/// Something that fits within this of the best pose's chi² is within about 3 standard deviations of a minimum …
const CHI2_NEAR: f64 = 9.0;
/// … and beyond this many only if there is no minimum worth the name, but a valley that leads away from it.
const FAR: f64 = 9.0;
/// The guess settles which of two it is when it is this many times nearer to one of them.
const GUESS_NEARER: f64 = 3.0;
/// Standard normal quantile of 99.9 %.
const GATE_QUANTILE: f64 = 3.090_232;
/// How far from the landmarks a robot is looked for, as a multiple of their spread and the ranges.
const REACH: f64 = 1e3;

/// Where a robot is, and how far to believe it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Localization {
    /// `map_from_base`. The heading is that of the guess unless `heading_known`.
    pub pose: Pose2,
    /// Covariance of (x, y, θ) in the map frame, (HᵀWH)⁻¹ at the pose; m², m rad, rad². A heading that is not known has
    /// [`UNKNOWN_HEADING_VARIANCE_RAD2`] and no correlation with the position.
    pub covariance: Matrix3<f64>,
    /// Whether the heading comes from the sightings. False if there was no bearing; the position always does.
    pub heading_known: bool,
    /// Sum of the squared residuals over their variances.
    pub chi2: f64,
    /// Measurements more than unknowns: what `chi2` is on average.
    pub degrees_of_freedom: usize,
    /// Whether another pose fitted too, and the guess was what decided.
    pub guess_decided: bool,
}

/// The pose that fits sightings of surveyed landmarks best: weighted least squares.
///
/// It takes ranges to two landmarks for a position, and three measurements (a bearing among them, not all of one landmark) for a
/// pose with its heading. The search starts from many places, so the guess does not have to be good: it is one of the starts, and it
/// settles which it is when two places fit (two ranges always leave two places, mirrored). For that it must be three times nearer to
/// one of them than to the other.
///
/// The best pose's chi² must be within the 99.9 % limit of its degrees of freedom (of 1 if there is none), and the standard
/// deviation of the position within 15 % of the distance of the landmarks: beyond that the covariance would promise too much.
///
/// # Errors
/// Whenever the sightings do not settle where the robot is; see [`TriangulationError`]. Any input comes to an end without panic,
/// and all numbers of a [`Localization`] are finite.
pub fn triangulate(sightings: &[Sighting], guess: Pose2) -> Result<Localization, TriangulationError> {
    check(sightings, guess)?;
    let (problem, origin, spread_m) = centred(sightings);
    let guess_at = [guess.x - origin[0], guess.y - origin[1]];
    let mut way = Vec::new();
    let minima = minima(&problem, &starts(&problem, guess_at, spread_m), &mut way);
    let best = minima.first().ok_or(TriangulationError::NoConvergence)?;
    let degrees_of_freedom = problem.measurements().saturating_sub(problem.unknowns());
    let limit = chi2_limit(degrees_of_freedom);
    if best.chi2 > limit {
        return Err(inconsistent(&problem, best, limit, degrees_of_freedom));
    }
    covariance(&problem, best)?;
    let rivals: Vec<&Point> = minima.iter().filter(|point| point.chi2 <= limit.min(best.chi2 + CHI2_RIVAL)).collect();
    is_settled(&problem, &rivals, &way, limit)?;
    let chosen = choose(&problem, &rivals, guess_at, origin)?;
    let mut covariance = covariance(&problem, chosen)?;
    let theta = if problem.with_heading { chosen.pose.z } else { guess.theta };
    if !problem.with_heading {
        covariance[(2, 2)] = UNKNOWN_HEADING_VARIANCE_RAD2;
    }
    Ok(Localization {
        pose: Pose2::new(chosen.pose.x + origin[0], chosen.pose.y + origin[1], theta),
        covariance,
        heading_known: problem.with_heading,
        chi2: chosen.chi2,
        degrees_of_freedom,
        guess_decided: rivals.len() > 1,
    })
}

/// The sightings in a frame whose origin is amid their landmarks, that origin, and how far the landmarks are spread about it.
fn centred(sightings: &[Sighting]) -> (Problem, [f64; 2], f64) {
    let count = sightings.len() as f64;
    let origin =
        sightings.iter().fold([0.0, 0.0], |sum, s| [sum[0] + s.landmark[0] / count, sum[1] + s.landmark[1] / count]);
    let sightings: Vec<Sighting> = sightings.iter().map(|s| s.moved([-origin[0], -origin[1]])).collect();
    let spread_m = sightings.iter().map(|s| libm::hypot(s.landmark[0], s.landmark[1])).fold(0.0, f64::max);
    let range_m = sightings.iter().filter_map(|sighting| sighting.range_m).fold(0.0, f64::max);
    let with_heading = sightings.iter().any(|sighting| sighting.bearing_rad.is_some());
    (Problem { sightings, with_heading, reach_m: REACH * (spread_m + range_m) }, origin, spread_m)
}

/// The different poses that the starts lead down to, the best first; `way` gets the points on the way.
fn minima(problem: &Problem, starts: &[[f64; 2]], way: &mut Vec<Passed>) -> Vec<Point> {
    let mut found: Vec<Point> = starts.iter().filter_map(|start| problem.descend(*start, way)).collect();
    found.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let mut different: Vec<Point> = Vec::new();
    for point in found {
        if !different.iter().any(|other| other.separation(&point.pose) < 1e-3 || is_same_place(problem, other, &point))
        {
            different.push(point);
        }
    }
    different
}

fn is_same_place(problem: &Problem, a: &Point, b: &Point) -> bool {
    libm::hypot(a.pose.x - b.pose.x, a.pose.y - b.pose.y) < 1e-6 * problem.reach_m / REACH
}

/// Whether the straight-line reckoning behind the covariance holds: whatever fits about as well as a minimum lies near one.
fn is_settled(problem: &Problem, rivals: &[&Point], way: &[Passed], limit: f64) -> Result<(), TriangulationError> {
    let Some(best) = rivals.first() else { return Ok(()) };
    let far = |passed: &&Passed| {
        passed.chi2 <= limit.min(best.chi2 + CHI2_NEAR)
            && rivals.iter().all(|point| point.separation(&passed.pose) > FAR)
    };
    way.iter().find(far).map_or(Ok(()), |passed| Err(blurred(problem, &best.pose, &passed.pose)))
}

/// Of poses that fit about equally well, the one that the guess is clearly nearer to.
fn choose<'a>(
    problem: &Problem,
    rivals: &[&'a Point],
    guess: [f64; 2],
    origin: [f64; 2],
) -> Result<&'a Point, TriangulationError> {
    let away = |point: &Point| libm::hypot(point.pose.x - guess[0], point.pose.y - guess[1]);
    let mut by_distance = rivals.to_vec();
    by_distance.sort_by(|a, b| away(a).total_cmp(&away(b)));
    match by_distance.as_slice() {
        [] => Err(TriangulationError::NoConvergence),
        [only] => Ok(only),
        [near, far, ..] => {
            if let Some(other) = by_distance[1..].iter().find(|other| near.separation(&other.pose) < SEPARATION_MIN) {
                return Err(blurred(problem, &near.pose, &other.pose));
            }
            if away(near) * GUESS_NEARER <= away(far) {
                Ok(near)
            } else {
                let places = [near, far].map(|point| [point.pose.x + origin[0], point.pose.y + origin[1]]);
                Err(TriangulationError::Ambiguous { places })
            }
        }
    }
}

fn inconsistent(problem: &Problem, best: &Point, limit: f64, degrees_of_freedom: usize) -> TriangulationError {
    let off = |sighting: &Sighting| {
        Problem::rows(sighting, &best.pose).map(|row| (row.residual / row.sigma).abs()).fold(0.0, f64::max)
    };
    let worst = problem.sightings.iter().map(off).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let (worst, worst_sigmas) = worst.unwrap_or_default();
    TriangulationError::Inconsistent { chi2: best.chi2, limit, degrees_of_freedom, worst, worst_sigmas }
}

/// What chi² stays below 99.9 % of the time (Wilson and Hilferty's approximation, within 4 % of the exact quantile).
fn chi2_limit(degrees_of_freedom: usize) -> f64 {
    let k = degrees_of_freedom.max(1) as f64;
    let root = 1.0 - 2.0 / (9.0 * k) + GATE_QUANTILE * (2.0 / (9.0 * k)).sqrt();
    k * root * root * root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_that_of_the_tables() {
        for (degrees, exact) in [(0, 10.828), (1, 10.828), (2, 13.816), (5, 20.515), (30, 59.703)] {
            let limit = chi2_limit(degrees);
            assert!((limit / exact - 1.0).abs() < 0.04, "{degrees}: {limit}");
        }
    }
}
