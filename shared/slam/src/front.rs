//! The front end: where a scan lies, by those before it and by what the odometry says.

use echogrid_core::{Increment, OdometryConfig, Pose2, move_by};

use crate::cloud::Cloud;
use crate::config::UseOdometry;
use crate::correlate::{Field, Window};
use crate::graph::{Edge, Kind};
use crate::matching::{Match, believed, point_to_line};
use crate::matrix::{self, Matrix};
use crate::scan::Points;
use crate::slam::{Node, Slam};

/// Way back that scans are laid on, metres, and the most of them.
const LOCAL_MAP_M: f64 = 5.0;
const LOCAL_MAP_SCANS: usize = 25;
/// Scans nearer to each other than this show the same, metres or radians.
const SAME: f64 = 0.05;
/// Within which partners of points are looked for, metres, iteration by iteration.
const RADII_M: [f64; 7] = [0.5, 0.5, 0.35, 0.25, 0.2, 0.15, 0.15];
/// The correlative search is believed where its share of points with a partner is larger by this.
const BETTER: f64 = 0.01;
/// The share of points with a partner that makes a match.
const INLIERS_MIN: f64 = 0.3;
/// Without odometry more is asked for.
const INLIERS_ALONE_MIN: f64 = 0.5;
/// The least noise of a drive that nobody calibrated, variance per metre and per radian: larger than the paper's, as a scan
/// that lies badly is worse than one that is laid by the lidar alone.
const NOISE_MIN: [f64; 4] = [2e-3, 1e-4, 5e-3, 5e-4];
/// What remains of a speed without odometry until the next scan: it may brake.
const KEEPS_ON: f64 = 0.5;
/// The fastest robot that is followed without odometry, m/s and rad/s.
const FASTEST: (f64, f64) = (1.5, 1.5);

/// How exact the odometry's steps are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    k: [f64; 4],
    scale_sigma: f64,
}

impl Noise {
    pub(crate) fn of(odometry: &OdometryConfig, scale_sigma: f64) -> Self {
        let given = [odometry.k_ll, odometry.k_lt, odometry.k_tt, odometry.k_tl];
        let mut k = NOISE_MIN;
        for (least, given) in k.iter_mut().zip(given) {
            *least = least.max(given);
        }
        Self { k, scale_sigma }
    }

    /// The inverse of the covariance of a step, of (along, across, turn) at its end; `scaled`: with the doubt of the scales.
    pub(crate) fn information(&self, step: Increment, scaled: bool) -> Matrix {
        let [k_ll, k_lt, k_tt, k_tl] = self.k;
        let (length, turn) = (step.length_m(), step.turn_rad.abs());
        let scale = if scaled { self.scale_sigma } else { 0.0 };
        let along = k_ll * length + k_lt * turn;
        let heading = k_tt * turn + k_tl * length + scale * turn * scale * turn;
        let across = 0.25 * along + 0.3 * length * length * heading;
        matrix::diagonal([
            1.0 / (along + scale * length * scale * length + 1e-6),
            1.0 / (across + 1e-6),
            1.0 / (heading + 1e-7),
        ])
    }
}

impl Slam {
    /// Adds a node for this scan, and the edges to the node before.
    pub(crate) fn track(&mut self, node: Node) {
        let Some(last) = self.drive.nodes.last() else {
            self.drive.graph.poses.push(node.odom_from_base);
            self.drive.nodes.push(node);
            return;
        };
        let seconds = node.stamp_ns.saturating_sub(last.stamp_ns) as f64 * 1e-9;
        let measured = Increment::between(last.odom_from_base, node.odom_from_base);
        let is_alone = self.config.odometry == UseOdometry::Ignore;
        let guess = if is_alone {
            let (share, way) = (KEEPS_ON * seconds.min(0.5), self.drive.speed);
            Pose2::new(way[0] * share, way[1] * share, way[2] * share)
        } else {
            let [lin, ang] = self.drive.graph.scales;
            move_by(Pose2::IDENTITY, measured.corrected(lin, ang))
        };
        let prior =
            if is_alone { matrix::diagonal([25.0, 100.0, 50.0]) } else { self.noise.information(measured, true) };
        let found = self.lay(&node.points, guess, &prior, if is_alone { Some(seconds) } else { None });
        let is_slow = |pose: Pose2| {
            libm::hypot(pose.x, pose.y) < 0.1 + FASTEST.0 * seconds && pose.theta.abs() < 0.1 + FASTEST.1 * seconds
        };
        let holds = match found {
            Some(found) if is_alone => found.inliers > INLIERS_ALONE_MIN && is_slow(found.pose),
            Some(found) => found.inliers > INLIERS_MIN,
            None => false,
        };
        let step = match found {
            Some(found) if holds => found.pose,
            _ if is_alone => Pose2::IDENTITY,
            _ => guess,
        };
        if seconds > 0.0 {
            self.drive.speed = [step.x / seconds, step.y / seconds, step.theta / seconds];
        }
        let (from, to) = (self.drive.nodes.len() as u32 - 1, self.drive.nodes.len() as u32);
        let edge = |measured, information, kind| Edge { from, to, measured, information, kernel: 0.0, kind };
        self.drive.graph.edges.push(if is_alone {
            edge(step, matrix::diagonal(if holds { [1.0; 3] } else { [100.0; 3] }), Kind::Match)
        } else {
            edge(guess, self.noise.information(measured, false), Kind::Odometry(measured))
        });
        if let Some(found) = found.filter(|_| holds) {
            // Without odometry nothing else tells of the way along a corridor.
            let information = if is_alone { believed(&found.information) } else { found.believed() };
            self.drive.graph.edges.push(edge(found.pose, information, Kind::Match));
        } else {
            self.drive.lost += 1;
        }
        let pose = self.drive.graph.poses[from as usize] * step;
        self.drive.graph.poses.push(pose);
        let way_m = last.way_m + libm::hypot(step.x, step.y);
        self.drive.nodes.push(Node { way_m, ..node });
    }

    /// The scans of the last metres, seen from the last node.
    fn local_map(&self) -> Cloud {
        let last = self.drive.nodes.len() - 1;
        let mut chosen: Vec<usize> = Vec::new();
        for index in (0..=last).rev() {
            if chosen.len() >= LOCAL_MAP_SCANS
                || self.drive.nodes[last].way_m - self.drive.nodes[index].way_m >= LOCAL_MAP_M
            {
                break;
            }
            let is_new = chosen.last().is_none_or(|&near| {
                self.drive.nodes[near].way_m - self.drive.nodes[index].way_m > SAME
                    || (self.drive.graph.poses[near].inverse() * self.drive.graph.poses[index]).theta.abs() > SAME
            });
            if is_new {
                chosen.push(index);
            }
        }
        let scans = chosen.iter().map(|&index| (self.drive.graph.poses[index], &self.drive.nodes[index].points));
        Cloud::of(self.drive.graph.poses[last], scans)
    }

    fn lay(&self, points: &Points, guess: Pose2, prior: &Matrix, alone_s: Option<f64>) -> Option<Match> {
        let cloud = self.local_map();
        if points.len() < 20 || cloud.points().len() < 20 {
            return None;
        }
        let (half_side_m, half_turn_rad) = match alone_s {
            Some(seconds) => ((0.1 + 0.5 * seconds).min(0.6), (0.08 + 0.5 * seconds).min(0.5)),
            None => (0.15 + 0.1 * libm::hypot(guess.x, guess.y), 0.08 + 0.1 * guess.theta.abs()),
        };
        let seen: Vec<[f64; 2]> =
            points.iter().step_by(2).map(|(p, _)| p).filter(|p| p[0] * p[0] + p[1] * p[1] < 121.0).collect();
        let by_guess = point_to_line(&cloud, points, guess, Some((guess, prior)), &RADII_M);
        if seen.len() > 20 {
            let mut field = Field::of(cloud.points(), 12.0);
            let window = Window { guess, half_side_m, half_turn_rad };
            if let Some(found) = field.search(&seen, &window, 0.3, None) {
                // Along a corridor all poses score alike, and the best is anywhere.
                let start = if by_guess.slides() { by_guess.as_expected_along(found.pose, guess) } else { found.pose };
                let by_search = point_to_line(&cloud, points, start, Some((guess, prior)), &RADII_M);
                if by_search.inliers > by_guess.inliers + BETTER {
                    return Some(by_search);
                }
            }
        }
        Some(by_guess)
    }
}
