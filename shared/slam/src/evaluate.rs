//! How far off a path is: against relations between its poses, and against the true path.

use echogrid_core::{Pose2, wrap_angle};

use crate::matrix::{self, Matrix};

/// Errors of one kind: metres or radians.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spread {
    /// The mean of the errors.
    pub mean: f64,
    /// The standard deviation of the errors.
    pub std: f64,
    /// The square root of the mean of the squares of the errors.
    pub rms: f64,
    /// The median of the errors.
    pub median: f64,
    /// The largest of the errors.
    pub max: f64,
}

impl Spread {
    /// The spread of these errors, none of which is negative. All zero where there is none.
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
    /// The errors of the heading, once the paths are laid on each other, radians.
    pub heading_rad: Spread,
    /// Over each metre of true way: how far off its end is, seen from its beginning, metres per metre.
    pub per_metre_m: Spread,
    /// The errors of the heading over each metre of true way, radians per metre.
    pub per_metre_rad: Spread,
}

impl PathError {
    /// The errors of a path, of pairs of a pose and the true one in the order of time; none where there are fewer than two.
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

/// Whether what a path claims of its own error is so: the normalized squared error of its poses, eᵀ C⁻¹ e / 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consistency {
    /// How many poses were compared.
    pub poses: usize,
    /// NEES, the mean over the poses: 1 where the claims are right; above, too little doubt is claimed.
    pub mean: f64,
    /// The share of them whose position and heading lie within three claimed deviations, in each direction that there is.
    pub within_three_sigmas: f64,
}

/// Within which NEES of a single pose lies in 95 of 100 cases, if its covariance is right: χ² of three, by three.
pub const NEES_OF_ONE: (f64, f64) = (0.072, 3.116);

impl Consistency {
    /// The consistency of poses, each with the true one and the covariance that was claimed; none where none claims anything.
    ///
    /// Covariances are of (x, y, θ) in the frame of the map, in which the first pose is certain and is laid on its true one.
    #[must_use]
    pub fn of(claims: &[(Pose2, Pose2, Matrix)]) -> Option<Self> {
        let (first, is, _) = claims.first()?;
        let map_from_world = *first * is.inverse();
        let errors = claims.iter().filter_map(|(pose, is, covariance)| {
            let is = map_from_world * *is;
            // One that is certain claims nothing that could be measured.
            let is_certain = (0..3).any(|axis| covariance[axis][axis] <= 0.0);
            let off = [pose.x - is.x, pose.y - is.y, wrap_angle(pose.theta - is.theta)];
            (!is_certain).then(|| matrix::quadratic(&matrix::inverse(covariance), &off)).filter(|chi2| chi2.is_finite())
        });
        let errors: Vec<f64> = errors.collect();
        let share = |count: usize| count as f64 / errors.len() as f64;
        (!errors.is_empty()).then(|| Self {
            poses: errors.len(),
            mean: errors.iter().sum::<f64>() / (3.0 * errors.len() as f64),
            within_three_sigmas: share(errors.iter().filter(|chi2| **chi2 <= 9.0).count()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_claims_what_it_is_off_by_is_consistent() {
        let frame = Pose2::new(3.0, -1.0, 0.7);
        let claim = matrix::diagonal([0.04, 0.01, 0.0025]);
        let at = |x: f64, off: [f64; 3]| {
            let pose = Pose2::new(x, 0.5, 0.1);
            (Pose2::new(pose.x + off[0], pose.y + off[1], pose.theta + off[2]), frame * pose, claim)
        };
        let mut claims = vec![(Pose2::new(0.0, 0.5, 0.1), frame * Pose2::new(0.0, 0.5, 0.1), matrix::ZERO)];
        claims.extend([at(1.0, [0.2, -0.1, 0.05]), at(2.0, [-0.2, 0.1, -0.05]), at(3.0, [0.0; 3])]);
        let found = Consistency::of(&claims).unwrap();
        assert!((found.mean - 2.0 / 3.0).abs() < 1e-9 && found.poses == 3, "{found:?}");
        assert_eq!(found.within_three_sigmas, 1.0);
        claims.push(at(4.0, [0.7, 0.0, 0.0]));
        assert_eq!(Consistency::of(&claims).unwrap().within_three_sigmas, 0.75);
        assert_eq!(Consistency::of(&claims[..1]), None, "what is certain claims nothing");
    }

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
