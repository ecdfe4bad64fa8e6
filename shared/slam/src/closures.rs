//! Loop closures: that the robot is where it was before, found by what its lidar sees.

use echogrid_core::Pose2;
use serde::{Deserialize, Serialize};

use crate::by_hand::{Found, said_of, unknown};
use crate::cloud::Cloud;
use crate::correlate::{Except, Field, Window};
use crate::graph::{Edge, Kind};
use crate::matching::{believed, but_along, point_to_line, seen_from};
use crate::matrix::{self, Matrix};
use crate::scan::Points;
use crate::slam::Slam;

/// Way each way about a node whose scans make the place that is recognised, metres, and the most scans each way.
pub(crate) const PLACE_M: f64 = 3.0;
pub(crate) const PLACE_SCANS: usize = 30;
/// The scans that are laid on it: of the last so many metres, at most so many.
const QUERY_M: f64 = 2.5;
const QUERY_SCANS: usize = 5;
/// Places that are tried each time, and how far apart on the way they are, metres.
const PLACES: usize = 3;
const PLACES_APART_M: f64 = 6.0;
/// Points farther away than this are not used, metres.
const POINT_REACH_M: f64 = 15.0;
/// Within which partners are looked for, metres, iteration by iteration.
const RADII_M: [f64; 8] = [0.35, 0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1];
/// What a match must be like to be trusted when one other agrees.
const INLIERS_STRONG: f64 = 0.75;
/// What it must be like to count at all, as a share of what makes it strong.
const WEAK: f64 = 0.75;
const RMS_MAX_M: f64 = 0.04;
/// Where a scan slides, what it says across is believed within so many metres and radians of what was expected: the next corridor is
/// farther away.
const ACROSS_MAX_M: f64 = 0.7;
const TURN_MAX_RAD: f64 = 0.15;
/// χ² from which an edge counts for little.
const KERNEL: f64 = 50.0;
/// Two places are two if they are farther apart than this, metres.
const ELSEWHERE_M: f64 = 0.8;
/// Two closures speak of the same loop if there is less way between them than this, at both ends, metres.
const SAME_LOOP_M: f64 = 15.0;
/// Weak closures that must agree with another before they count, and the way over which they must be spread, metres: what looks alike
/// from one place looks alike from the next, too.
const WEAK_SUPPORT: usize = 2;
const WEAK_SPAN_M: f64 = 3.0;

/// What became of a closure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Too few others agree with it so far: not applied.
    Alone,
    /// In the graph.
    Applied,
    /// Applied once, and taken back: the rest of the graph is against it.
    TakenBack,
    /// Somebody says that it is none.
    Forbidden,
    /// Somebody says that it is one: in the graph, whatever the rest says.
    Required,
}

impl Standing {
    /// Whether it is in the graph.
    #[must_use]
    pub fn counts(self) -> bool {
        matches!(self, Self::Applied | Self::Required)
    }
}

/// Two scans that show the same place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Closure {
    /// The node that was visited first.
    pub from: u32,
    /// The node from which it was recognised.
    pub to: u32,
    /// How `to` lies, seen from `from`.
    pub measured: Pose2,
    /// Ω of it.
    pub information: Matrix,
    /// The share of points that lie on walls, by the correlative search.
    pub score: f64,
    /// The share of points with a partner.
    pub inliers: f64,
    /// How far they lie off their lines, metres.
    pub rms_m: f64,
    /// Where it says nothing along a direction, as in a corridor: that direction, seen from `from`.
    pub slides: Option<[f64; 2]>,
    /// The shortest known way between the two, when it was found, metres.
    pub loop_m: f64,
    /// By how much the place was off where it was believed to be: metres and radians.
    pub off: (f64, f64),
    /// Whether it needs but one other to agree.
    pub is_strong: bool,
    /// How many other closures agree with it.
    pub support: u32,
    /// What became of it.
    pub standing: Standing,
}

impl Slam {
    /// Looks whether this node is at a place that was visited before it; whether something was found.
    pub(crate) fn look_for_closures(&mut self, last: usize) -> bool {
        let query = self.query(last);
        if query.len() < 40 {
            return false;
        }
        let ways_mm = self.ways_mm(last);
        let mut found = false;
        for place in self.places(last, &ways_mm) {
            let is_known = |closure: &Closure| closure.to as usize == last && closure.from as usize == place;
            if self.drive.closures.iter().any(is_known) {
                continue;
            }
            if let Some(closure) = self.recognise(place, last, &query, ways_mm[place] as f64 * 1e-3) {
                found |= self.judge(closure);
            }
        }
        found
    }

    /// The nodes to try: the nearest of each pass.
    fn places(&self, last: usize, ways_mm: &[u64]) -> Vec<usize> {
        let at = self.drive.graph.poses[last];
        let mut near: Vec<(f64, usize)> = Vec::new();
        for index in self.drive.settled.with_points(last) {
            let node = &self.drive.nodes[index];
            if self.drive.nodes[last].way_m - node.way_m < self.config.closure_after_m {
                break;
            }
            let apart = self.drive.graph.poses[index].distance_m(at);
            if apart < 2.0 + drift_m(ways_mm[index] as f64 * 1e-3) {
                near.push((apart, index));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        for (_, index) in near {
            if chosen.len() >= PLACES {
                break;
            }
            let apart = |other: &usize| (self.drive.nodes[*other].way_m - self.drive.nodes[index].way_m).abs();
            if chosen.iter().all(|other| apart(other) > PLACES_APART_M) {
                chosen.push(index);
            }
        }
        chosen
    }

    /// The points of the last scans, seen from the last node.
    fn query(&self, last: usize) -> Points {
        let mut chosen = vec![last];
        for index in (0..last).rev() {
            let nearest = chosen[chosen.len() - 1];
            if chosen.len() >= QUERY_SCANS || self.drive.nodes[last].way_m - self.drive.nodes[index].way_m > QUERY_M {
                break;
            }
            if self.drive.nodes[nearest].way_m - self.drive.nodes[index].way_m > 0.4 {
                chosen.push(index);
            }
        }
        let back = self.drive.graph.poses[last].inverse();
        let mut query = Points::default();
        for (turn, index) in chosen.iter().enumerate() {
            let pose = back * self.drive.graph.poses[*index];
            let (s, c) = libm::sincos(pose.theta);
            let points = &self.drive.nodes[*index].points;
            let each = points.iter().skip(turn % chosen.len()).step_by(chosen.len().min(2));
            for (p, n) in each.filter(|(p, _)| p[0] * p[0] + p[1] * p[1] < POINT_REACH_M * POINT_REACH_M) {
                let at = [pose.x + c * p[0] - s * p[1], pose.y + s * p[0] + c * p[1]];
                query.push(at, [c * n[0] - s * n[1], s * n[0] + c * n[1]]);
            }
        }
        query
    }

    /// The scans about a node, seen from it.
    fn place(&self, about: usize, before: usize) -> Cloud {
        if about < self.drive.graph.settled as usize {
            return self.settled_place(about);
        }
        let way_m = |index: usize| self.drive.nodes[index].way_m;
        let (mut low, mut high) = (about, about);
        while low > 0 && way_m(about) - way_m(low) < PLACE_M && about - low < PLACE_SCANS {
            low -= 1;
        }
        while high + 1 < before && way_m(high) - way_m(about) < PLACE_M && high - about < PLACE_SCANS {
            high += 1;
        }
        let scans = (low..=high).map(|index| (self.drive.graph.poses[index], &self.drive.nodes[index].points));
        Cloud::of(self.drive.graph.poses[about], scans)
    }

    fn recognise(&mut self, place: usize, last: usize, query: &Points, loop_m: f64) -> Option<Closure> {
        self.drive.tries += 1;
        let cloud = self.place(place, last);
        let guess = self.drive.graph.poses[place].inverse() * self.drive.graph.poses[last];
        let window =
            Window { guess, half_side_m: 0.6 + drift_m(loop_m), half_turn_rad: (0.12 + 0.001 * loop_m).min(0.5) };
        let sparse: Vec<[f64; 2]> = query.iter().step_by(query.len() / 250 + 1).map(|(at, _)| at).collect();
        let mut field = Field::of(cloud.points(), 25.0);
        let strong = self.config.closure_score_min;
        let best = field.search(&sparse, &window, WEAK * strong, None)?;
        let laid = point_to_line(&cloud, query, best.pose, None, &RADII_M);
        if laid.inliers < WEAK * INLIERS_STRONG || laid.rms_m > RMS_MAX_M || !laid.pose.is_finite() {
            return None;
        }
        let along = laid.weak_direction();
        let off = guess.inverse() * laid.pose;
        // Elsewhere it may lie as well: along a corridor, which is no harm if nothing is said along it, or at another place.
        let mut slides = laid.slides();
        let except = Except { pose: best.pose, half_side_m: ELSEWHERE_M };
        let second_min = best.score - self.config.closure_margin;
        if let Some(second) = field.search(&sparse, &window, second_min, Some(&except)) {
            let (dx, dy) = (second.pose.x - laid.pose.x, second.pose.y - laid.pose.y);
            let across = (along[0] * dy - along[1] * dx).abs();
            let turn = (laid.pose.inverse() * second.pose).theta.abs();
            if across > 0.2 + 0.1 * libm::hypot(dx, dy) || turn > 0.1 {
                self.drive.ambiguous += 1;
                return None;
            }
            slides = true;
        }
        if slides {
            let (dx, dy) = (guess.x - laid.pose.x, guess.y - laid.pose.y);
            if (along[0] * dy - along[1] * dx).abs() > ACROSS_MAX_M || off.theta.abs() > TURN_MAX_RAD {
                self.drive.ambiguous += 1;
                return None;
            }
        }
        let information = if slides {
            // Seen from `to`.
            let (s, c) = libm::sincos(laid.pose.theta);
            but_along(&believed(&laid.information), [c * along[0] + s * along[1], c * along[1] - s * along[0]])
        } else {
            believed(&laid.information)
        };
        Some(Closure {
            from: place as u32,
            to: last as u32,
            measured: laid.pose,
            information,
            score: best.score,
            inliers: laid.inliers,
            rms_m: laid.rms_m,
            slides: slides.then_some(along),
            loop_m,
            off: (libm::hypot(off.x, off.y), off.theta),
            is_strong: best.score > strong && laid.inliers > INLIERS_STRONG,
            support: 0,
            standing: Standing::Alone,
        })
    }

    /// Takes a closure down, and applies it with those that agree with it; whether the graph is another now.
    fn judge(&mut self, mut closure: Closure) -> bool {
        let said = said_of(&self.config, [closure.from, closure.to], |node| self.way_m(node));
        if said == Some(Standing::Forbidden) {
            self.drive.closures.push(Closure { standing: Standing::Forbidden, ..closure });
            return false;
        }
        let agreeing: Vec<usize> =
            (0..self.drive.closures.len()).filter(|index| self.agree(&self.drive.closures[*index], &closure)).collect();
        closure.support = agreeing.len() as u32;
        let number = self.drive.closures.len();
        self.drive.closures.push(closure);
        for index in &agreeing {
            self.drive.closures[*index].support += 1;
            self.stored.closures.replace(*index as u64);
        }
        if said.is_some() {
            self.apply(number, Standing::Required);
        }
        let all = || agreeing.iter().chain([&number]).map(|index| &self.drive.closures[*index]);
        let way_m = |closure: &Closure| self.drive.nodes[closure.to as usize].way_m;
        let span_m =
            all().map(way_m).fold(f64::NEG_INFINITY, f64::max) - all().map(way_m).fold(f64::INFINITY, f64::min);
        let strong = all().filter(|closure| closure.is_strong).count();
        if agreeing.is_empty() || strong == 0 && (agreeing.len() < WEAK_SUPPORT || span_m < WEAK_SPAN_M) {
            return said.is_some();
        }
        for index in agreeing.iter().copied().chain([number]) {
            if self.drive.closures[index].standing == Standing::Alone {
                self.apply(index, Standing::Applied);
            }
        }
        true
    }

    fn apply(&mut self, index: usize, standing: Standing) {
        let closure = &mut self.drive.closures[index];
        closure.standing = standing;
        self.stored.closures.replace(index as u64);
        self.drive.graph.edges.push(Edge {
            from: closure.from,
            to: closure.to,
            measured: closure.measured,
            information: closure.information,
            kernel: if standing == Standing::Required { 0.0 } else { KERNEL },
            kind: Kind::Closure(index as u32),
        });
    }

    /// What is wrong with what was forbidden or required by hand, when all was looked for.
    #[must_use]
    pub fn unknown_by_hand(&self) -> Option<String> {
        let found = |closure: &Closure| Found { nodes: [closure.from, closure.to], standing: closure.standing };
        let found: Vec<Found> = self.drive.closures.iter().map(found).collect();
        unknown(&self.config, &found, |node| self.way_m(node))
    }

    fn way_m(&self, node: u32) -> Option<f64> {
        Some(self.drive.nodes.get(node as usize)?.way_m)
    }

    /// Takes back what the graph, solved, is against. (It counts for hardly anything there by then: the kernel saw to it.)
    pub(crate) fn take_back(&mut self) {
        for (closure, index) in self.drive.closures.iter_mut().zip(0..) {
            let (from, to) = (closure.from as usize, closure.to as usize);
            let lies = self.drive.graph.poses[from].inverse() * self.drive.graph.poses[to];
            let chi2 = matrix::quadratic(&closure.information, &seen_from(closure.measured, lies));
            if closure.standing == Standing::Applied && chi2 > KERNEL {
                closure.standing = Standing::TakenBack;
                self.stored.closures.replace(index);
            }
        }
    }

    /// Whether two closures of one loop lead round it to where it began.
    fn agree(&self, a: &Closure, b: &Closure) -> bool {
        let way = |i: u32, j: u32| (self.drive.nodes[i as usize].way_m - self.drive.nodes[j as usize].way_m).abs();
        let (near, far) = (way(a.from, b.from), way(a.to, b.to));
        if near > SAME_LOOP_M || far > SAME_LOOP_M || a.to == b.to || a.standing == Standing::Forbidden {
            return false;
        }
        let between =
            |i: u32, j: u32| self.drive.graph.poses[i as usize].inverse() * self.drive.graph.poses[j as usize];
        let there = between(b.from, a.from);
        let round = there * a.measured * between(a.to, b.to) * b.measured.inverse();
        let mut off = [round.x, round.y];
        let (s, c) = libm::sincos(there.theta);
        let of_a = a.slides.map(|[x, y]| [c * x - s * y, s * x + c * y]);
        for [x, y] in [of_a, b.slides].into_iter().flatten() {
            let along = off[0] * x + off[1] * y;
            off = [off[0] - along * x, off[1] - along * y];
        }
        let way_m = near + far;
        libm::hypot(off[0], off[1]) < 0.15 + 0.02 * way_m && round.theta.abs() < 0.04 + 0.004 * way_m
    }
}

/// How far off a place may be after so much way, metres.
fn drift_m(loop_m: f64) -> f64 {
    (0.025 * loop_m).min(10.0)
}
