//! A lidar in a known map: its points laid on the outlines of what is occupied.

use core::f64::consts::PI;

use echogrid_core::Pose2;

use super::ground::{DIFFUSE, FACINGS, Ground};
use super::{Gates, Located, Prior, Unlocated};
use crate::cloud::Cloud;
use crate::correlate::{Except, Field, Found, Window};
use crate::matching::{Match, point_to_line};
use crate::matrix::{self, Matrix};
use crate::scan::Points;

/// A cell is an outline if it is as probably occupied as this.
const WALL: f32 = 0.6;
/// Free cells within this tell on which side of a wall one may stand, metres.
const SIDE_M: f64 = 0.2;
/// Points farther from the robot are not compared, metres.
const REACH_M: f64 = 15.0;
/// Side of the blocks in which a whole map is searched, metres.
const BLOCK_M: f64 = 30.0;
/// How far from the middle of a block walls matter, metres.
const FIELD_M: f64 = 36.0;
/// Points that are compared in a search of a few metres, and of a whole map.
const POINTS_NEAR: usize = 250;
const POINTS_ANYWHERE: usize = 120;
/// The least number of points that a place is told by.
const POINTS_MIN: usize = 40;
/// Within which partners of points are looked for, metres, iteration by iteration.
const RADII_M: [f64; 7] = [0.4, 0.4, 0.3, 0.25, 0.2, 0.15, 0.15];
/// The share of points with a partner that makes a match.
const INLIERS_MIN: f64 = 0.6;
/// Of what was seen before, this share must lie on walls, within so many metres.
const SURE: f64 = 0.8;
const ON_WALL_M: f64 = 0.15;
/// Nearer than this is the same place, metres.
const ELSEWHERE_M: f64 = 0.8;
/// No pose is told more exactly than this: cells are so large. Metres and radians, one standard deviation.
const FLOOR: (f64, f64) = (0.02, 0.008);
/// Along the direction of which the points tell least it is looked how their score falls off, so far each way and by such steps, metres …
const SPREAD_M: f64 = 0.6;
const SPREAD_STEP_M: f64 = 0.05;
/// … and where they score so much less it is e times less likely.
const SPREAD_SCORE: f64 = 1.0 / 60.0;
/// Nor is anything told of a direction in which it would be less exact than this.
const OPEN: (f64, f64) = (2.0, 0.5);

/// A known map, for lidars.
#[derive(Debug, Clone)]
pub struct OutlineMap {
    at: Vec<[f64; 2]>,
    normals: Vec<[f64; 2]>,
    low: [f64; 2],
    high: [f64; 2],
}

impl OutlineMap {
    /// A map for lidars, from a map as an array.
    #[must_use]
    pub fn new(ground: &Ground) -> Self {
        let mut map =
            Self { at: Vec::new(), normals: Vec::new(), low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        for place in (0..ground.occupied.len()).filter(|place| ground.occupied[*place] > WALL) {
            let at = ground.centre(place);
            map.at.push(at);
            map.normals.push(normal(ground, place));
            for (axis, value) in at.into_iter().enumerate() {
                (map.low[axis], map.high[axis]) = (map.low[axis].min(value), map.high[axis].max(value));
            }
        }
        map
    }

    /// Where the robot is near where it was believed to be; `seen` from the base.
    ///
    /// # Errors
    /// That can't be told, and why.
    pub fn track(&self, seen: &Points, prior: &Prior, gates: &Gates) -> Result<Located, Unlocated> {
        enough(seen)?;
        let (metres, radians) = prior.sigmas();
        let Pose2 { x, y, theta } = prior.pose;
        let guess = Pose2::new(0.0, 0.0, theta);
        let half_side_m = (3.0 * metres).clamp(0.3, 6.0);
        let window = Window { guess, half_side_m, half_turn_rad: (3.0 * radians).clamp(0.05, PI) };
        let sparse = thinned(seen, POINTS_NEAR);
        let mut field = self.field([x, y], REACH_M + half_side_m);
        let Some(best) = field.search(&sparse, &window, 0.5 * gates.evidence_min, None) else {
            return Err(Unlocated::NoFit { evidence: 0.5 * gates.evidence_min, needed: gates.evidence_min });
        };
        let except = Except { pose: best.pose, half_side_m: ELSEWHERE_M };
        let second = field.search(&sparse, &window, best.score - gates.margin_min, Some(&except));
        self.judge([x, y], seen, (&field, &sparse), (best, second), gates).map(|(located, _)| located)
    }

    /// Where the robot is, anywhere in the map; of what was seen before, from the same frame, as much must lie on walls.
    ///
    /// # Errors
    /// That can't be told, and why.
    pub fn find(&self, seen: &Points, before: &Points, gates: &Gates) -> Result<Located, Unlocated> {
        enough(seen)?;
        let sparse = thinned(seen, POINTS_ANYWHERE);
        let window = Window { guess: Pose2::IDENTITY, half_side_m: 0.5 * BLOCK_M, half_turn_rad: PI };
        let mut best: Option<([f64; 2], Found)> = None;
        let mut fields: Vec<([f64; 2], Field)> = self.blocks().map(|at| (at, self.field(at, FIELD_M))).collect();
        for (at, field) in &mut fields {
            let least = best.map_or(0.5 * gates.evidence_min, |(_, best)| best.score);
            best = field.search(&sparse, &window, least, None).map(|found| (*at, found)).or(best);
        }
        let Some((origin, best)) = best else {
            return Err(Unlocated::NoFit { evidence: 0.5 * gates.evidence_min, needed: gates.evidence_min });
        };
        let mut second: Option<Found> = None;
        for (at, field) in &mut fields {
            let of_block = |pose: Pose2| Pose2::new(pose.x + origin[0] - at[0], pose.y + origin[1] - at[1], pose.theta);
            let except = Except { pose: of_block(best.pose), half_side_m: ELSEWHERE_M };
            let least = second.map_or(best.score - gates.margin_min, |second| second.score);
            let found = field.search(&sparse, &window, least, Some(&except));
            let to_origin = |found: Found| Found {
                pose: Pose2::new(found.pose.x + at[0] - origin[0], found.pose.y + at[1] - origin[1], found.pose.theta),
                ..found
            };
            second = found.map(to_origin).or(second);
        }
        let Some((_, field)) = fields.iter().find(|(at, _)| *at == origin) else {
            return Err(Unlocated::NoFit { evidence: 0.0, needed: gates.evidence_min });
        };
        let (located, slides) = self.judge(origin, seen, (field, &sparse), (best, second), gates)?;
        if slides {
            // A place in a corridor is none.
            return Err(Unlocated::Ambiguous { apart_m: ELSEWHERE_M, margin: 0.0, needed: gates.margin_min });
        }
        enough(before)?;
        let evidence = self.share_on_walls(before, located.pose);
        if evidence < SURE {
            return Err(Unlocated::NoFit { evidence, needed: SURE });
        }
        Ok(located)
    }

    /// The share of points that lie on walls, at a pose of the robot.
    fn share_on_walls(&self, points: &Points, pose: Pose2) -> f64 {
        let cloud = self.cloud(Pose2::new(pose.x, pose.y, 0.0));
        let turned = Pose2::new(0.0, 0.0, pose.theta);
        let on = points.iter().filter(|(at, _)| cloud.nearest(turned.transform(*at), ON_WALL_M).is_some());
        on.count() as f64 / points.len().max(1) as f64
    }

    /// Whether a place that was found, seen from `origin`, counts, and where it is exactly.
    fn judge(
        &self,
        origin: [f64; 2],
        seen: &Points,
        (field, sparse): (&Field, &[[f64; 2]]),
        (best, second): (Found, Option<Found>),
        gates: &Gates,
    ) -> Result<(Located, bool), Unlocated> {
        let no_fit = |evidence| Err(Unlocated::NoFit { evidence, needed: gates.evidence_min });
        if best.score < gates.evidence_min {
            return no_fit(best.score);
        }
        let [x, y] = origin;
        let cloud = self.cloud(Pose2::new(x, y, 0.0));
        let laid = point_to_line(&cloud, seen, best.pose, None, &RADII_M);
        let off = best.pose.inverse() * laid.pose;
        if laid.inliers < INLIERS_MIN || !laid.pose.is_finite() || libm::hypot(off.x, off.y) > 0.3 {
            return no_fit(best.score * laid.inliers);
        }
        let mut slides = laid.slides();
        if let Some(second) = second {
            // Along a corridor it may lie anywhere, which is no harm if nothing is said along it.
            let along = laid.weak_direction();
            let (dx, dy) = (second.pose.x - laid.pose.x, second.pose.y - laid.pose.y);
            let across = (along[0] * dy - along[1] * dx).abs();
            if across > 0.2 + 0.1 * libm::hypot(dx, dy) || (laid.pose.inverse() * second.pose).theta.abs() > 0.1 {
                let (apart_m, margin) = (libm::hypot(dx, dy), best.score - second.score);
                return Err(Unlocated::Ambiguous { apart_m, margin, needed: gates.margin_min });
            }
            slides = true;
        }
        let spread_m2 = spread_m2(field, sparse, laid.pose, laid.weak_direction());
        let covariance = covariance(&laid, slides, spread_m2);
        let pose = Pose2::new(laid.pose.x + x, laid.pose.y + y, laid.pose.theta);
        Ok((Located { pose, covariance, evidence: best.score }, slides))
    }

    fn blocks(&self) -> impl Iterator<Item = [f64; 2]> {
        let along = |axis: usize| {
            let blocks = ((self.high[axis] - self.low[axis]) / BLOCK_M).ceil().max(1.0);
            let (middle, blocks) = (0.5 * (self.low[axis] + self.high[axis]), blocks as usize);
            (0..blocks).map(move |block| middle + (block as f64 - 0.5 * (blocks - 1) as f64) * BLOCK_M)
        };
        along(0).flat_map(move |x| along(1).map(move |y| [x, y]))
    }

    fn field(&self, [x, y]: [f64; 2], reach_m: f64) -> Field {
        let near: Vec<[f64; 2]> = self.at.iter().map(|at| [at[0] - x, at[1] - y]).collect();
        Field::of(&near, reach_m)
    }

    fn cloud(&self, origin: Pose2) -> Cloud {
        let mut points = Points::default();
        for (at, normal) in self.at.iter().zip(&self.normals) {
            let (x, y) = (at[0] - origin.x, at[1] - origin.y);
            if x * x + y * y < FIELD_M * FIELD_M {
                points.push([x, y], *normal);
            }
        }
        Cloud::of(Pose2::IDENTITY, [(Pose2::IDENTITY, &points)])
    }
}

/// Which way a wall faces, towards where it is free; zero where there is no telling.
fn normal(ground: &Ground, place: usize) -> [f64; 2] {
    if ground.facing[place] == DIFFUSE {
        return [0.0; 2];
    }
    let (s, c) = libm::sincos(f64::from(ground.facing[place]) * PI / FACINGS as f64);
    let [x, y] = ground.centre(place);
    let steps = (SIDE_M / ground.resolution_m).ceil() as i32;
    let free_along = |sign: f64| {
        let is_free = |step: &i32| {
            let along = sign * f64::from(*step) * ground.resolution_m;
            let (column, row) = ground.cell(x + along * c, y + along * s);
            ground.place(column, row).is_some_and(|place| ground.free[place])
        };
        (1..=steps).filter(is_free).count()
    };
    match free_along(1.0).cmp(&free_along(-1.0)) {
        core::cmp::Ordering::Greater => [c, s],
        core::cmp::Ordering::Less => [-c, -s],
        core::cmp::Ordering::Equal => [0.0; 2],
    }
}

/// How far along a direction the points may lie as well, by how their score falls off: a variance. That the match is exact where it is says nothing
/// of the next door post, which is like this one.
fn spread_m2(field: &Field, sparse: &[[f64; 2]], pose: Pose2, [x, y]: [f64; 2]) -> f64 {
    let steps = (SPREAD_M / SPREAD_STEP_M) as i32;
    let score = |along_m: f64| field.score(sparse, Pose2::new(pose.x + along_m * x, pose.y + along_m * y, pose.theta));
    let here = score(0.0);
    let (mut weights, mut squares) = (0.0, 0.0);
    for step in -steps..=steps {
        let along_m = f64::from(step) * SPREAD_STEP_M;
        let weight = libm::exp((score(along_m) - here).min(0.0) / SPREAD_SCORE);
        weights += weight;
        squares += weight * along_m * along_m;
    }
    squares / weights
}

/// In the frame of the map.
fn covariance(laid: &Match, slides: bool, spread_m2: f64) -> Matrix {
    let mut information = matrix::turned(&laid.believed(), laid.pose.theta);
    if slides {
        let [x, y] = laid.weak_direction();
        information = crate::matching::but_along(&information, [x, y]);
    }
    let open = [1.0 / (OPEN.0 * OPEN.0), 1.0 / (OPEN.0 * OPEN.0), 1.0 / (OPEN.1 * OPEN.1)];
    let told = matrix::inverse(&matrix::sum(&information, &matrix::diagonal(open)));
    let floor = matrix::diagonal([FLOOR.0 * FLOOR.0, FLOOR.0 * FLOOR.0, FLOOR.1 * FLOOR.1]);
    let [x, y] = laid.weak_direction();
    let along = [[x * x, x * y, 0.0], [x * y, y * y, 0.0], [0.0; 3]];
    let spread = matrix::scaled(&along, spread_m2);
    matrix::symmetric(&matrix::sum(&matrix::sum(&told, &floor), &spread))
}

fn thinned(seen: &Points, most: usize) -> Vec<[f64; 2]> {
    let near: Vec<[f64; 2]> =
        seen.iter().map(|(at, _)| at).filter(|at| at[0] * at[0] + at[1] * at[1] < REACH_M * REACH_M).collect();
    let stride = near.len().div_ceil(most).max(1);
    near.into_iter().step_by(stride).collect()
}

fn enough(seen: &Points) -> Result<(), Unlocated> {
    let (readings, needed) = (seen.len(), POINTS_MIN);
    if readings < needed { Err(Unlocated::TooFew { readings, needed }) } else { Ok(()) }
}
