//! Where the robot hears again what it has heard before.

use std::collections::BTreeSet;

use echogrid_core::{Pose2, wrap_angle};

use super::place::HALF_M;
use super::slam::SonarSlam;
use super::window::WINDOW_M;
use crate::by_hand::{Found, said_of, unknown};
use crate::closures::Standing;
use crate::graph::{Edge, Kind, Solver};
use crate::known::{Gates, Located, Prior, Unlocated};
use crate::matrix;

/// Places that are tried from each end, and how far apart on the way they are at least, metres.
const PLACES: usize = 2;
const PLACES_APART_M: f64 = 6.0;
/// A place is tried that may be so near to the middle of the last metres, metres; and where it is known to so much, one standard deviation.
const NEAR_M: f64 = 2.0;
const FAR_MAX_M: f64 = 12.0;
const SIGMA_MAX_M: f64 = 3.0;
/// What the odometry may be off by besides what the graph says, as a factor of its deviations.
const WIDER: f64 = 1.5;
/// What a closure counts for: windows overlap, and those of one loop share a place.
const WEIGHT: f64 = 0.25;
/// χ² from which an edge counts for little, and is taken back.
const KERNEL: f64 = 20.0;
/// Closures from so many other ends of the way must agree with one before it counts.
const SUPPORT: usize = 2;
/// Two closures speak of the same loop if there is less way between them than this: between their places, and between their ends, metres.
const SAME_LOOP_M: (f64, f64) = (15.0, 10.0);
/// They agree if they lead round within this, and so much more for each metre of way between them; metres and radians.
const ROUND_M: (f64, f64) = (0.2, 0.03);
const ROUND_RAD: (f64, f64) = (0.1, 0.008);
/// The graph is solved when so many closures have come, or one of this χ².
const SOLVE_EVERY: usize = 8;
const SURPRISE: f64 = 1.0;

/// A place that was heard again.
#[derive(Debug, Clone, Copy)]
pub(super) struct Closure {
    /// The node in the middle of the place.
    pub(super) from: usize,
    /// The node from which it was heard again.
    pub(super) to: usize,
    /// How `to` lies, seen from `from`.
    pub(super) located: Located,
    /// How it was believed to lie.
    pub(super) believed: Pose2,
    pub(super) standing: Standing,
    /// How many other closures agree.
    pub(super) support: u32,
}

impl Closure {
    /// As an edge of the graph.
    pub(super) fn edge(&self, number: u32) -> Edge {
        let Located { pose, covariance, .. } = self.located;
        // An edge is seen from its end.
        let covariance = matrix::turned(&covariance, -pose.theta);
        Edge {
            from: self.from as u32,
            to: self.to as u32,
            measured: pose,
            information: matrix::scaled(&matrix::inverse(&covariance), WEIGHT),
            kernel: if self.standing == Standing::Required { 0.0 } else { KERNEL },
            kind: Kind::Closure(number),
        }
    }
}

impl SonarSlam<'_> {
    /// Looks for places along the whole way, and solves: at the end, and if `often` on the way.
    pub(super) fn look_along(&mut self, often: bool) {
        let (mut looked_m, mut pending) = (0.0, 0);
        for end in 0..self.nodes.len() {
            if self.nodes[end].way_m - looked_m < self.config.closure_every_m {
                continue;
            }
            looked_m = self.nodes[end].way_m;
            let known = self.closures.len();
            let applied = self.look(end);
            pending += applied;
            let surprises = |closure: &Closure| closure.edge(0).chi2(&self.graph) > SURPRISE;
            if often && applied > 0 && (pending >= SOLVE_EVERY || self.closures[known..].iter().any(surprises)) {
                self.solve();
                pending = 0;
            }
        }
        self.solve();
    }

    /// Looks for the places that may be near where the way ends at a node. So many closures were applied.
    fn look(&mut self, end: usize) -> usize {
        let mut applied = 0;
        let gates = Gates { evidence_min: self.config.sonar_evidence_nat, margin_min: self.config.sonar_margin_nat };
        let trail = self.window(end);
        for (from, prior) in self.near(end) {
            self.tries += 1;
            let Some(map) = self.place(from) else {
                self.unrecognised.too_few += 1;
                continue;
            };
            match map.track(&trail, &prior, &gates) {
                Ok(located) => applied += self.judge(self.seen_from_nearest(from, end, located)),
                Err(Unlocated::TooFew { .. }) => self.unrecognised.too_few += 1,
                Err(Unlocated::NoFit { .. }) => self.unrecognised.no_fit += 1,
                Err(Unlocated::Ambiguous { .. }) => self.unrecognised.ambiguous += 1,
            }
        }
        applied
    }

    /// A closure that says how the robot lies, seen from the node of the place that it is nearest to: how far the others are from there the
    /// odometry alone has drawn, and a place drawn too large must not say that it is not.
    fn seen_from_nearest(&self, about: usize, end: usize, located: Located) -> Closure {
        let way = self.way_about(about, HALF_M);
        let nearest =
            way.into_iter().min_by(|a, b| located.pose.distance_m(a.1).total_cmp(&located.pose.distance_m(b.1)));
        let (from, about_from_node) = nearest.unwrap_or((about, Pose2::IDENTITY));
        let located = Located {
            pose: about_from_node.inverse() * located.pose,
            covariance: matrix::turned(&located.covariance, -about_from_node.theta),
            ..located
        };
        let believed = self.graph.poses[from].inverse() * self.graph.poses[end];
        Closure { from, to: end, located, believed, standing: Standing::Alone, support: 0 }
    }

    /// The places that were left long ago and may be near, and how the end of the way lies seen from each.
    fn near(&self, end: usize) -> Vec<(usize, Prior)> {
        let here_m = self.nodes[end].way_m;
        let middle = self.nodes[..end].partition_point(|node| node.way_m < here_m - 0.5 * WINDOW_M);
        let at = self.graph.poses[middle];
        let is_old =
            |centre: &&usize| self.nodes[**centre].way_m + HALF_M < here_m - WINDOW_M.max(self.config.closure_after_m);
        let old = self.centres.iter().take_while(is_old);
        let mut near: Vec<(f64, usize)> =
            old.map(|centre| (at.distance_m(self.graph.poses[*centre]), *centre)).collect();
        near.retain(|(apart_m, _)| *apart_m < FAR_MAX_M);
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if near.is_empty() {
            return Vec::new();
        }
        let solver = Solver::new(&self.graph);
        let marginals = solver.marginals(&self.graph);
        let mut chosen: Vec<(usize, Prior)> = Vec::new();
        for (apart_m, centre) in near {
            let is_chosen = |(other, _): &(usize, Prior)| {
                (self.nodes[*other].way_m - self.nodes[centre].way_m).abs() < PLACES_APART_M
            };
            if chosen.iter().any(is_chosen) {
                continue;
            }
            let covariance = matrix::scaled(&marginals.relative(centre, end), WIDER * WIDER);
            let sigma_m = covariance[0][0].max(covariance[1][1]).sqrt();
            if sigma_m <= SIGMA_MAX_M && apart_m < NEAR_M + 2.0 * sigma_m {
                let pose = self.graph.poses[centre].inverse() * self.graph.poses[end];
                chosen.push((centre, Prior { pose, covariance }));
                if chosen.len() >= PLACES {
                    break;
                }
            }
        }
        chosen
    }

    /// Takes a closure down, and applies it with those that agree with it. So many were applied.
    fn judge(&mut self, mut closure: Closure) -> usize {
        let said = said_of(&self.config, [closure.from as u32, closure.to as u32], |node| self.way_m(node));
        if said == Some(Standing::Forbidden) {
            self.closures.push(Closure { standing: Standing::Forbidden, ..closure });
            return 0;
        }
        let number = self.closures.len();
        let mut agreeing: Vec<usize> =
            (0..number).filter(|index| self.agree(&self.closures[*index], &closure)).collect();
        closure.support = agreeing.len() as u32;
        agreeing.iter().for_each(|index| self.closures[*index].support += 1);
        closure.standing = said.unwrap_or(Standing::Alone);
        self.closures.push(closure);
        agreeing.push(number);
        let required = usize::from(said.is_some());
        let ends: BTreeSet<usize> = agreeing.iter().map(|index| self.closures[*index].to).collect();
        if ends.len() <= SUPPORT {
            return required;
        }
        let mut applied = required;
        for index in agreeing {
            let standing = &mut self.closures[index].standing;
            if !standing.counts() {
                applied += 1;
                *standing = Standing::Applied;
            }
        }
        applied
    }

    /// What is wrong with what was forbidden or required by hand, when all was looked for.
    #[must_use]
    pub fn unknown_by_hand(&self) -> Option<String> {
        let found =
            |closure: &Closure| Found { nodes: [closure.from as u32, closure.to as u32], standing: closure.standing };
        let found: Vec<Found> = self.closures.iter().map(found).collect();
        unknown(&self.config, &found, |node| self.way_m(node))
    }

    fn way_m(&self, node: u32) -> Option<f64> {
        Some(self.nodes.get(node as usize)?.way_m)
    }

    /// Whether two closures of one loop lead round it to where it began.
    fn agree(&self, a: &Closure, b: &Closure) -> bool {
        let way_m = |i: usize, j: usize| (self.nodes[i].way_m - self.nodes[j].way_m).abs();
        let (near_m, far_m) = (way_m(a.from, b.from), way_m(a.to, b.to));
        if near_m > SAME_LOOP_M.0 || far_m > SAME_LOOP_M.1 || a.to == b.to || a.standing == Standing::Forbidden {
            return false;
        }
        let between = |i: usize, j: usize| self.graph.poses[i].inverse() * self.graph.poses[j];
        let round = between(b.from, a.from) * a.located.pose * between(a.to, b.to) * b.located.pose.inverse();
        let way_m = near_m + far_m;
        libm::hypot(round.x, round.y) < ROUND_M.0 + ROUND_M.1 * way_m
            && wrap_angle(round.theta).abs() < ROUND_RAD.0 + ROUND_RAD.1 * way_m
    }

    /// Takes back what the graph, solved, is against; whether anything was.
    pub(super) fn take_back(&mut self) -> bool {
        let mut any = false;
        for (closure, number) in self.closures.iter_mut().zip(0..) {
            if closure.standing == Standing::Applied && closure.edge(number).chi2(&self.graph) > KERNEL {
                closure.standing = Standing::TakenBack;
                any = true;
            }
        }
        any
    }
}
