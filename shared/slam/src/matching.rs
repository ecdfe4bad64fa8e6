//! Matching a scan to points by the distance from point to line, with what was known before as prior.

use echogrid_core::Pose2;

use crate::cloud::Cloud;
use crate::matrix::{self, Matrix, Vector, ZERO};
use crate::scan::Points;

/// How far a point of a lidar lies off its surface, metres, one standard deviation.
pub const SIGMA_M: f64 = 0.015;
/// Normals that agree less than this do not belong to one surface.
const AGREE: f64 = 0.8;
/// The farthest that one iteration moves, metres and radians.
const STEP_MAX: (f64, f64) = (0.3, 0.15);

/// How a scan lies on other points.
#[derive(Debug, Clone, Copy)]
pub struct Match {
    /// The scan's frame seen from the cloud's.
    pub pose: Pose2,
    /// What the points alone tell about it: inverse of the covariance of (along, across, turn), seen from the scan.
    pub information: Matrix,
    /// The share of the points that have another within the last radius.
    pub inliers: f64,
    /// How far those lie off their lines, metres.
    pub rms_m: f64,
    /// Points that had a line.
    pub lines: usize,
    /// The smaller eigenvalue of the mean of n nᵀ: 0 in a corridor without ends, ½ in a round room.
    pub spread: f64,
}

/// Below, a scan slides along a corridor: what little its points tell of the way along it is chance.
const SPREAD_MIN: f64 = 0.03;

impl Match {
    /// Whether the points tell nothing of one direction, as in a corridor.
    #[must_use]
    pub fn slides(&self) -> bool {
        self.spread < SPREAD_MIN
    }

    /// `pose`, moved along the direction of which the points tell least to where `expected` is along it.
    #[must_use]
    pub fn as_expected_along(&self, pose: Pose2, expected: Pose2) -> Pose2 {
        let [x, y] = self.weak_direction();
        let along = (expected.x - pose.x) * x + (expected.y - pose.y) * y;
        Pose2::new(pose.x + along * x, pose.y + along * y, pose.theta)
    }

    /// How far it is to be believed: its points share errors; and never more exact than 1 cm and 3 mrad. Where it slides, of the
    /// direction along it nothing.
    #[must_use]
    pub fn believed(&self) -> Matrix {
        let believed = believed(&self.information);
        if !self.slides() {
            return believed;
        }
        let [x, y] = self.weak_direction();
        let (s, c) = libm::sincos(self.pose.theta);
        but_along(&believed, [c * x + s * y, c * y - s * x])
    }

    /// The direction in which the points tell least where the scan lies, in the frame of the cloud, of length 1.
    #[must_use]
    pub fn weak_direction(&self) -> [f64; 2] {
        let (a, b, d) = (self.information[0][0], self.information[0][1], self.information[1][1]);
        // Of the greater eigenvalue, and across it.
        let strong_rad = 0.5 * libm::atan2(2.0 * b, a - d);
        let (s, c) = libm::sincos(strong_rad + core::f64::consts::FRAC_PI_2 + self.pose.theta);
        [c, s]
    }
}

/// What was known before: where the scan should lie, and the inverse of the covariance of that.
pub type Prior<'a> = Option<(Pose2, &'a Matrix)>;

/// e = z⁻¹ x: how `x` lies, seen from `z`.
#[must_use]
pub fn seen_from(z: Pose2, x: Pose2) -> Vector {
    let Pose2 { x, y, theta } = z.inverse() * x;
    [x, y, theta]
}

/// Lays `scan` on `cloud`, beginning at `start` in the frame of the cloud: by Gauss and Newton, once for each of `radii_m`, within which a
/// point's partner must lie.
#[must_use]
pub fn point_to_line(cloud: &Cloud, scan: &Points, start: Pose2, prior: Prior<'_>, radii_m: &[f64]) -> Match {
    let weight = 1.0 / (SIGMA_M * SIGMA_M);
    let mut found = Match { pose: start, information: ZERO, inliers: 0.0, rms_m: 0.0, lines: 0, spread: 0.0 };
    for radius_m in radii_m {
        let sums = Sums::of(cloud, scan, found.pose, *radius_m);
        found.information = matrix::scaled(&sums.h, weight);
        found.lines = sums.lines;
        found.inliers = sums.near as f64 / scan.len().max(1) as f64;
        found.rms_m = (sums.squares / sums.weights.max(1e-9)).sqrt();
        found.spread = sums.spread();
        if sums.lines < 10 && prior.is_none() {
            break;
        }
        let mut h = found.information;
        let mut g = sums.g.map(|value| value * weight);
        if let Some((expected, information)) = prior {
            let pull = matrix::apply(information, &seen_from(expected, found.pose));
            for row in 0..3 {
                g[row] += pull[row];
            }
            matrix::add(&mut h, information);
        }
        for (row, line) in h.iter_mut().enumerate() {
            line[row] += 1e-3;
        }
        let step = matrix::apply(&matrix::inverse(&h), &g);
        let length = libm::hypot(step[0], step[1]);
        let shorter = if length > STEP_MAX.0 { STEP_MAX.0 / length } else { 1.0 };
        let turn = (-step[2]).clamp(-STEP_MAX.1, STEP_MAX.1);
        if !length.is_finite() || !turn.is_finite() {
            break;
        }
        found.pose = found.pose * Pose2::new(-step[0] * shorter, -step[1] * shorter, turn);
    }
    found
}

/// Ω of a match: of what its points say a part.
pub(crate) fn believed(information: &Matrix) -> Matrix {
    let shared = matrix::sum(&matrix::scaled(information, 0.3), &matrix::diagonal([1.0; 3]));
    let floor = matrix::diagonal([1e-4, 1e-4, 9e-6]);
    matrix::symmetric(&matrix::inverse(&matrix::sum(&matrix::inverse(&shared), &floor)))
}

/// Without what it tells of the direction `along`, both seen from the scan.
pub(crate) fn but_along(information: &Matrix, along: [f64; 2]) -> Matrix {
    let [x, y] = along;
    let across = [[1.0 - x * x, -x * y, 0.0], [-x * y, 1.0 - y * y, 0.0], [0.0, 0.0, 1.0]];
    matrix::symmetric(&matrix::product(&matrix::product(&across, information), &across))
}

/// The normal equations of one iteration, in units of σ².
struct Sums {
    h: Matrix,
    g: Vector,
    lines: usize,
    near: usize,
    squares: f64,
    weights: f64,
}

impl Sums {
    fn of(cloud: &Cloud, scan: &Points, pose: Pose2, radius_m: f64) -> Self {
        let mut sums = Self { h: ZERO, g: [0.0; 3], lines: 0, near: 0, squares: 0.0, weights: 0.0 };
        let kernel_m = (0.33 * radius_m).max(0.03);
        let (s, c) = libm::sincos(pose.theta);
        for (p, n) in scan.iter() {
            let (x, y) = (pose.x + c * p[0] - s * p[1], pose.y + s * p[0] + c * p[1]);
            let Some(nearest) = cloud.nearest([x, y], radius_m) else { continue };
            sums.near += 1;
            let q = nearest.normal;
            // Where either has no normal it is zero, and they do not agree.
            if (c * n[0] - s * n[1]) * q[0] + (s * n[0] + c * n[1]) * q[1] < AGREE {
                continue;
            }
            let r = q[0] * (x - nearest.at[0]) + q[1] * (y - nearest.at[1]);
            let off = r / kernel_m;
            let weight = 1.0 / ((1.0 + off * off) * (1.0 + off * off));
            let (mx, my) = (c * q[0] + s * q[1], -s * q[0] + c * q[1]);
            let j = [mx, my, -mx * p[1] + my * p[0]];
            for row in 0..3 {
                sums.g[row] += weight * j[row] * r;
                for column in 0..3 {
                    sums.h[row][column] += weight * j[row] * j[column];
                }
            }
            sums.lines += 1;
            sums.squares += weight * r * r;
            sums.weights += weight;
        }
        sums
    }

    fn spread(&self) -> f64 {
        let (a, b, d) = (self.h[0][0], self.h[0][1], self.h[1][1]);
        let smaller = (a + d - ((a - d) * (a - d) + 4.0 * b * b).sqrt()) / 2.0;
        smaller.max(0.0) / (self.lines.max(1)) as f64
    }
}
