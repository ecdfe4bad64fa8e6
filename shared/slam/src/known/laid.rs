//! Laying readings of sonars on a map: a pattern search from each of some poses, and what the best of them is worth.

use echogrid_core::{Pose2, Scales, wrap_angle};

use super::echoes::{Echo, EchoMap};
use super::trail::Trail;
use super::{Gates, Located, Prior, Unlocated};
use crate::matrix::{self, Matrix, Vector};

/// Where the prior is this exact there is but one place to look at, metres and radians.
pub(super) const NEAR_M: f64 = 0.3;
pub(super) const NEAR_RAD: f64 = 0.15;
/// What a reading counts for: readings of one piece of way share its errors and those of the map.
const WEIGHT: f64 = 0.04;
/// The steps with which a search begins, metres and radians, at most and at least.
const STEP_MOST: (f64, f64) = (0.3, 0.1);
const STEP_LEAST: (f64, f64) = (0.04, 0.012);
/// Of many places so many are looked at with all readings; with every how manieth before.
const FINALISTS: usize = 10;
const SPARSE: usize = 4;
/// How often they are halved.
const HALVINGS: usize = 5;
/// The most times that a search turns to another pose at one size of its steps.
const MOVES_MAX: usize = 12;
/// What the drive measures too much, as a share, besides what is believed: one standard deviation, and the step that a search begins with.
const SCALE_SIGMA: f64 = 0.04;
const SCALE_STEP: f64 = 0.03;
/// Farther apart than this, metres or radians, are two places.
pub(super) const ELSEWHERE: (f64, f64) = (0.8, 0.5);
/// How far the second differences reach that the covariance is taken from, metres and radians.
const DIFFERENCE: (f64, f64) = (0.06, 0.02);
/// No pose is told more exactly than this, metres and radians, one standard deviation.
const FLOOR: (f64, f64) = (0.04, 0.03);
/// Nor is anything told of a direction in which it would be less exact than this.
const OPEN: (f64, f64) = (2.0, 0.5);

/// A place, what the drive measures too much there besides what is believed, and how probable that is: ln, but for a constant.
#[derive(Debug, Clone, Copy)]
struct Place {
    value: f64,
    pose: Pose2,
    more: Scales,
}

/// A place that counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Laid {
    pub(super) located: Located,
    /// What the drive measures too much besides what is believed.
    pub(super) more: Scales,
}

/// The best of the places that searches from `starts` lead to.
pub(super) fn best(
    map: &EchoMap,
    trail: &Trail,
    prior: Option<&Prior>,
    starts: &[Pose2],
    gates: &Gates,
) -> Result<Laid, Unlocated> {
    let search = Search::new(map, trail, prior, 1);
    let at = |pose: &Pose2| Place { value: 0.0, pose: *pose, more: Scales::default() };
    let mut found: Vec<Place> = starts.iter().map(at).collect();
    if found.len() > FINALISTS {
        // With a part of the readings first: of many places most are none.
        let search = Search::new(map, trail, prior, SPARSE);
        found.iter_mut().for_each(|place| *place = search.from(*place));
        best_first(&mut found);
        found.truncate(FINALISTS);
    }
    found.iter_mut().for_each(|place| *place = search.from(*place));
    best_first(&mut found);
    let none = Unlocated::NoFit { evidence: 0.0, needed: gates.evidence_min };
    let Some(Place { pose, more, .. }) = found.first().copied() else { return Err(none) };
    let evidence = |place: &Place| map.evidence(place.pose, &trail.echoes(place.more, 1));
    let of_best = evidence(&found[0]);
    if of_best < gates.evidence_min {
        return Err(Unlocated::NoFit { evidence: of_best, needed: gates.evidence_min });
    }
    let elsewhere = |other: &&Place| {
        pose.distance_m(other.pose) > ELSEWHERE.0 || wrap_angle(pose.theta - other.pose.theta).abs() > ELSEWHERE.1
    };
    let rivals = found.iter().filter(elsewhere).map(|other| (evidence(other), other.pose));
    if let Some((second, other)) = rivals.max_by(|a, b| a.0.total_cmp(&b.0))
        && of_best - second < gates.margin_min
    {
        let (apart_m, margin) = (pose.distance_m(other), of_best - second);
        return Err(Unlocated::Ambiguous { apart_m, margin, needed: gates.margin_min });
    }
    let covariance = covariance(map, &trail.echoes(more, 1), pose);
    // What the readings alone say, so that with the prior it comes to the best pose.
    let pose = prior.map_or(pose, |prior| without(prior, pose, &covariance));
    Ok(Laid { located: Located { pose, covariance, evidence: of_best }, more })
}

/// Stable: of equals the first stays the first.
fn best_first(found: &mut [Place]) {
    found.sort_by(|a, b| b.value.total_cmp(&a.value));
}

/// The measurement that, taken together with the prior, gives `pose`.
fn without(prior: &Prior, pose: Pose2, covariance: &Matrix) -> Pose2 {
    let off = [pose.x - prior.pose.x, pose.y - prior.pose.y, wrap_angle(pose.theta - prior.pose.theta)];
    let more = matrix::apply(covariance, &matrix::apply(&prior.information(), &off));
    Pose2::new(pose.x + more[0], pose.y + more[1], pose.theta + more[2])
}

struct Search<'a> {
    map: &'a EchoMap,
    trail: &'a Trail,
    /// Every how manieth reading counts, for all of them.
    every: usize,
    prior: Option<(Pose2, Matrix)>,
    step: (f64, f64),
}

impl<'a> Search<'a> {
    fn new(map: &'a EchoMap, trail: &'a Trail, prior: Option<&Prior>, every: usize) -> Self {
        let wide = |sigma: f64, least: f64, most: f64| (1.5 * sigma).clamp(least, most);
        let step = prior.map_or((0.2, 0.06), |prior| {
            let (metres, radians) = prior.sigmas();
            (wide(metres, STEP_LEAST.0, STEP_MOST.0), wide(radians, STEP_LEAST.1, STEP_MOST.1))
        });
        Self { map, trail, every, prior: prior.map(|prior| (prior.pose, prior.information())), step }
    }

    /// How probable a place is where this was heard on the way to it.
    fn value(&self, pose: Pose2, more: Scales, echoes: &[Echo]) -> f64 {
        let mut pull = 0.5 * (more.lin * more.lin + more.ang * more.ang) / (SCALE_SIGMA * SCALE_SIGMA);
        if let Some((expected, information)) = &self.prior {
            let off = [pose.x - expected.x, pose.y - expected.y, wrap_angle(pose.theta - expected.theta)];
            pull += 0.5 * matrix::quadratic(information, &off);
        }
        WEIGHT * self.every as f64 * self.map.sum(pose, echoes) - pull
    }

    /// The best place that is reached from another.
    fn from(&self, start: Place) -> Place {
        let Place { pose, more, .. } = start;
        let mut echoes = self.trail.echoes(more, self.every);
        let mut best = Place { value: self.value(pose, more, &echoes), ..start };
        let (mut metres, mut radians) = self.step;
        let mut share = SCALE_STEP;
        for _ in 0..=HALVINGS {
            for _ in 0..MOVES_MAX {
                let mut moved = false;
                for way in 0..5 {
                    for sign in [1.0, -1.0] {
                        let (s, c) = libm::sincos(best.pose.theta);
                        let (mut pose, mut more) = (best.pose, best.more);
                        match way {
                            0 => pose = Pose2::new(pose.x + sign * c * metres, pose.y + sign * s * metres, pose.theta),
                            1 => pose = Pose2::new(pose.x - sign * s * metres, pose.y + sign * c * metres, pose.theta),
                            2 => pose = Pose2::new(pose.x, pose.y, pose.theta + sign * radians),
                            3 => more.lin += sign * share,
                            _ => more.ang += sign * share,
                        }
                        let reshaped = (way > 2).then(|| self.trail.echoes(more, self.every));
                        let value = self.value(pose, more, reshaped.as_ref().unwrap_or(&echoes));
                        if value > best.value {
                            best = Place { value, pose, more };
                            echoes = reshaped.unwrap_or(echoes);
                            moved = true;
                            break;
                        }
                    }
                }
                if !moved {
                    break;
                }
            }
            (metres, radians, share) = (0.5 * metres, 0.5 * radians, 0.5 * share);
        }
        best
    }
}

/// How exactly the readings tell the pose, by how their likelihood falls off around it.
fn covariance(map: &EchoMap, echoes: &[Echo], pose: Pose2) -> Matrix {
    let steps = [DIFFERENCE.0, DIFFERENCE.0, DIFFERENCE.1];
    let at = |moved: Vector| {
        let pose = Pose2::new(pose.x + moved[0], pose.y + moved[1], pose.theta + moved[2]);
        WEIGHT * map.sum(pose, echoes)
    };
    let moved = |axes: &[(usize, f64)]| {
        let mut moved = [0.0; 3];
        axes.iter().for_each(|(axis, sign)| moved[*axis] += sign * steps[*axis]);
        at(moved)
    };
    let middle = at([0.0; 3]);
    let mut falls = matrix::ZERO;
    for a in 0..3 {
        falls[a][a] = (2.0 * middle - moved(&[(a, 1.0)]) - moved(&[(a, -1.0)])) / (steps[a] * steps[a]);
        for b in 0..a {
            let crossed = moved(&[(a, 1.0), (b, 1.0)]) + moved(&[(a, -1.0), (b, -1.0)])
                - moved(&[(a, 1.0), (b, -1.0)])
                - moved(&[(a, -1.0), (b, 1.0)]);
            falls[a][b] = -0.25 * crossed / (steps[a] * steps[b]);
            falls[b][a] = falls[a][b];
        }
    }
    covariance_of(&falls)
}

/// The covariance that goes with second derivatives; what they leave open stays open.
fn covariance_of(falls: &Matrix) -> Matrix {
    let open = [1.0 / (OPEN.0 * OPEN.0), 1.0 / (OPEN.0 * OPEN.0), 1.0 / (OPEN.1 * OPEN.1)];
    let mut information = *falls;
    // Where the likelihood rises it tells nothing.
    for (axis, line) in information.iter_mut().enumerate() {
        line[axis] = line[axis].max(0.0);
    }
    // A correlation that is no correlation is left out.
    for a in 0..3 {
        for b in 0..a {
            let most = 0.9 * (information[a][a] * information[b][b]).sqrt();
            let value = information[a][b].clamp(-most, most);
            (information[a][b], information[b][a]) = (value, value);
        }
    }
    let determinant_fits = |m: &Matrix| {
        let minor = m[0][0] * m[1][1] - m[0][1] * m[0][1];
        let all = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[1][2]) - m[0][1] * (m[0][1] * m[2][2] - m[1][2] * m[0][2])
            + m[0][2] * (m[0][1] * m[1][2] - m[1][1] * m[0][2]);
        minor >= 0.0 && all >= 0.0
    };
    if !determinant_fits(&information) {
        information = matrix::diagonal([information[0][0], information[1][1], information[2][2]]);
    }
    let told = matrix::inverse(&matrix::sum(&information, &matrix::diagonal(open)));
    let floor = matrix::diagonal([FLOOR.0 * FLOOR.0, FLOOR.0 * FLOOR.0, FLOOR.1 * FLOOR.1]);
    matrix::symmetric(&matrix::sum(&told, &floor))
}
