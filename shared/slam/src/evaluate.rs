//! How far off a path is: against relations between its poses, and against the true path.

use echogrid_core::{Pose2, wrap_angle};

use crate::matrix::{self, Matrix};

/// Errors of one kind: metres or radians.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spread {
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation.
    pub std: f64,
    /// The square root of the mean of their squares.
    pub rms: f64,
    /// The middle one.
    pub median: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Of these errors, none of which is negative. All zero where there is none.
    #[must_use]
    pub fn of(errors: &[f64]) -> Self {
        let count = errors.len() as f64;
        if errors.is_empty() {
            return Self::default();
        }
        let mean = errors.iter().sum::<f64>() / count;
        let square = errors.iter().map(|error| error * error).sum::<f64>() / count;
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self {
            mean,
            std: (square - mean * mean).max(0.0).sqrt(),
            rms: square.sqrt(),
            median: sorted[sorted.len() / 2],
            max: sorted[sorted.len() - 1],
        }
    }
}

/// How far a pose that should lie at `is`, seen from another, is off where it was believed to lie: metres, radians (Kümmerle et al. 2009).
#[must_use]
pub fn relative(is: Pose2, believed: Pose2) -> (f64, f64) {
    let off = is.inverse() * believed;
    (libm::hypot(off.x, off.y), off.theta.abs())
}

/// The rigid motion that lays the first positions of these pairs on the second ones with the least squares (Horn 1987).
#[must_use]
pub fn alignment(pairs: &[(Pose2, Pose2)]) -> Pose2 {
    let count = pairs.len().max(1) as f64;
    let mean = |of: &dyn Fn(&(Pose2, Pose2)) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let from = [mean(&|(a, _)| a.x), mean(&|(a, _)| a.y)];
    let to = [mean(&|(_, b)| b.x), mean(&|(_, b)| b.y)];
    let (mut dot, mut cross) = (0.0, 0.0);
    for (a, b) in pairs {
        let (ax, ay, bx, by) = (a.x - from[0], a.y - from[1], b.x - to[0], b.y - to[1]);
        dot += ax * bx + ay * by;
        cross += ax * by - ay * bx;
    }
    let theta = libm::atan2(cross, dot);
    let [x, y] = Pose2::new(0.0, 0.0, theta).transform(from);
    Pose2::new(to[0] - x, to[1] - y, theta)
}

/// What a path is worth, against the true one.
#[derive(Debug, Clone, PartialEq)]
pub struct PathError {
    /// How the path was laid on the true one.
    pub alignment: Pose2,
    /// ATE: from each position to the true one, once the paths are laid on each other, metres.
    pub absolute_m: Spread,
    /// Of heading, likewise, radians.
    pub heading_rad: Spread,
    /// Over each metre of true way: how far off its end is, seen from its beginning, metres per metre.
    pub per_metre_m: Spread,
    /// Of heading, likewise, radians per metre.
    pub per_metre_rad: Spread,
}

impl PathError {
    /// Of pairs of a pose and the true one, in the order of time. None where there are fewer than two.
    #[must_use]
    pub fn of(pairs: &[(Pose2, Pose2)]) -> Option<Self> {
        if pairs.len() < 2 {
            return None;
        }
        let alignment = alignment(pairs);
        let off: Vec<(f64, f64)> = pairs
            .iter()
            .map(|(pose, is)| {
                let laid = alignment * *pose;
                (laid.distance_m(*is), wrap_angle(laid.theta - is.theta).abs())
            })
            .collect();
        let mut steps = Vec::new();
        let (mut begin, mut way_m) = (0, 0.0);
        for index in 1..pairs.len() {
            way_m += pairs[index - 1].1.distance_m(pairs[index].1);
            if way_m >= 1.0 {
                let ((a, a_is), (b, b_is)) = (pairs[begin], pairs[index]);
                let (metres, radians) = relative(a_is.inverse() * b_is, a.inverse() * b);
                steps.push((metres / way_m, radians / way_m));
                (begin, way_m) = (index, 0.0);
            }
        }
        let spread = |of: &[(f64, f64)], second: bool| {
            Spread::of(&of.iter().map(|(a, b)| if second { *b } else { *a }).collect::<Vec<_>>())
        };
        Some(Self {
            alignment,
            absolute_m: spread(&off, false),
            heading_rad: spread(&off, true),
            per_metre_m: spread(&steps, false),
            per_metre_rad: spread(&steps, true),
        })
    }
}

/// NEES: eᵀ C⁻¹ e of a pose that is off by e and whose covariance was claimed to be C, both of (x, y, θ): 3 in the mean where the claim is
/// right, more where it is too bold. None where C says that there is no doubt.
#[must_use]
pub fn nees(pose: Pose2, covariance: &Matrix, is: Pose2) -> Option<f64> {
    let inverse = matrix::inverse(covariance);
    let off = [pose.x - is.x, pose.y - is.y, wrap_angle(pose.theta - is.theta)];
    let nees = matrix::quadratic(&inverse, &off);
    (nees.is_finite() && nees >= 0.0).then_some(nees)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(index: u32) -> Pose2 {
        let angle = 0.01 * f64::from(index);
        Pose2::new(5.0 * libm::cos(angle), 5.0 * libm::sin(angle), angle + core::f64::consts::FRAC_PI_2)
    }

    #[test]
    fn a_path_in_another_frame_is_no_error() {
        let frame = Pose2::new(3.0, -7.0, 2.0);
        let pairs: Vec<(Pose2, Pose2)> = (0..500).map(|index| (frame * round(index), round(index))).collect();
        let error = PathError::of(&pairs).unwrap();
        assert!(error.absolute_m.max < 1e-9 && error.heading_rad.max < 1e-9 && error.per_metre_m.max < 1e-9);
        assert!(error.alignment.distance_m(frame.inverse()) < 1e-9);
    }

    #[test]
    fn a_drive_that_counts_too_much_is_off_by_so_much_a_metre() {
        let pairs: Vec<(Pose2, Pose2)> = (0..1000)
            .map(|index| {
                (Pose2::new(0.0105 * f64::from(index), 0.0, 0.0), Pose2::new(0.01 * f64::from(index), 0.0, 0.0))
            })
            .collect();
        let error = PathError::of(&pairs).unwrap();
        assert!((error.per_metre_m.mean - 0.05).abs() < 1e-9 && error.per_metre_m.std < 1e-6);
        // Laid middle on middle: off by 5 % of half the way at the ends.
        assert!((error.absolute_m.max - 0.25).abs() < 0.01);
    }

    #[test]
    fn spreads() {
        let spread = Spread::of(&[3.0, 1.0, 2.0]);
        assert_eq!((spread.mean, spread.median, spread.max), (2.0, 2.0, 3.0));
        assert!((spread.std - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(Spread::of(&[]), Spread::default());
    }

    #[test]
    fn what_is_claimed_counts() {
        let claimed = matrix::diagonal([0.04, 0.01, 0.0001]);
        let nees = nees(Pose2::new(0.2, 0.1, 0.02), &claimed, Pose2::IDENTITY).unwrap();
        assert!((nees - 6.0).abs() < 1e-9);
        assert_eq!(super::nees(Pose2::IDENTITY, &matrix::ZERO, Pose2::IDENTITY), None);
    }
}
