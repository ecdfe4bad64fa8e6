//! Where in a map to look at all: the ranges that sonars would hear, place by place and direction by direction, in a table.

use core::f64::consts::TAU;

use echogrid_core::{Pose2, wrap_angle};

use super::echoes::Echo;
use super::ground::{DIFFUSE, Ground, LEAST};
use super::{Prior, laid};

/// From one place to the next, metres; farther where there would be too many.
const SPACING_M: f64 = 0.2;
/// The most places.
const PLACES_MAX: usize = 150_000;
/// Directions of a place.
const DIRECTIONS: usize = 72;
/// Directions to either side that a cone takes in: 15°.
const BESIDE: usize = 3;
/// To where is looked, metres.
const REACH_M: f64 = 6.0;
/// A range in the table is a multiple of this, metres.
const UNIT_M: f64 = 0.05;
/// How exactly the table tells a range, metres: places and directions lie apart.
const SIGMA_M: f64 = 0.25;
/// What an echo that the map would not give is worth, as a share of one that it gives at its best.
const STRAY: f64 = 0.1;
/// Readings that are compared.
const READINGS: usize = 120;
/// Places that are looked at more closely.
const CANDIDATES: usize = 32;

/// The first echoes of a map, on a raster of places.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    spacing_m: f64,
    low: [f64; 2],
    columns: usize,
    rows: usize,
    /// Of each place and direction, in units; 0: none.
    ranges: Vec<u8>,
    /// Of each place, whether a robot may stand there.
    stands: Vec<bool>,
    /// What a reading is worth by how far it is off, in units.
    worth: Vec<f32>,
}

/// A reading at a heading: where its transducer is, and which way it looks.
struct Turned {
    column: i32,
    row: i32,
    direction: usize,
    range: u8,
}

impl Coarse {
    pub(super) fn of(ground: &Ground) -> Self {
        let size = [ground.columns as f64 * ground.resolution_m, ground.rows as f64 * ground.resolution_m];
        let free = ground.free.iter().filter(|free| **free).count() as f64 * ground.resolution_m * ground.resolution_m;
        let spacing_m = SPACING_M.max((free / PLACES_MAX as f64).sqrt());
        let (columns, rows) = ((size[0] / spacing_m).ceil() as usize, (size[1] / spacing_m).ceil() as usize);
        let worth = |off: usize| {
            let sigmas = off as f64 * UNIT_M / SIGMA_M;
            libm::log(STRAY + libm::exp(-0.5 * sigmas * sigmas)) as f32
        };
        let mut coarse = Self {
            spacing_m,
            low: ground.low,
            columns,
            rows,
            ranges: vec![0; columns * rows * DIRECTIONS],
            stands: vec![false; columns * rows],
            worth: (0..=usize::from(u8::MAX)).map(worth).collect(),
        };
        for place in 0..columns * rows {
            let [x, y] = coarse.middle(place);
            let (column, row) = ground.cell(x, y);
            coarse.stands[place] = ground.place(column, row).is_some_and(|place| ground.free[place]);
            if coarse.stands[place] {
                let rays: [Option<(u8, bool)>; DIRECTIONS] =
                    core::array::from_fn(|direction| first_wall(ground, [x, y], direction));
                for direction in 0..DIRECTIONS {
                    let near = (0..=2 * BESIDE)
                        .filter_map(|beside| rays[(direction + DIRECTIONS + beside - BESIDE) % DIRECTIONS]);
                    let (faced, any) = near.fold((u8::MAX, u8::MAX), |(faced, any), (range, faces)| {
                        (if faces { faced.min(range) } else { faced }, any.min(range))
                    });
                    // What faces the sonar answers; else whatever is there.
                    let range = if faced < u8::MAX { faced } else { any };
                    coarse.ranges[place * DIRECTIONS + direction] = if range < u8::MAX { range } else { 0 };
                }
            }
        }
        coarse
    }

    fn middle(&self, place: usize) -> [f64; 2] {
        let (column, row) = (place % self.columns, place / self.columns);
        [self.low[0] + (column as f64 + 0.5) * self.spacing_m, self.low[1] + (row as f64 + 0.5) * self.spacing_m]
    }

    /// The poses at which the readings may have been taken, anywhere.
    pub(super) fn anywhere(&self, echoes: &[Echo]) -> Vec<Pose2> {
        self.candidates(echoes, |_| true)
    }

    /// The same within three standard deviations of where the robot was believed to be.
    pub(super) fn near(&self, echoes: &[Echo], prior: &Prior) -> Vec<Pose2> {
        let (metres, radians) = prior.sigmas();
        let (metres, radians) = (3.0 * metres + self.spacing_m, 3.0 * radians + TAU / DIRECTIONS as f64);
        self.candidates(echoes, |pose| {
            pose.distance_m(prior.pose) < metres && wrap_angle(pose.theta - prior.pose.theta).abs() < radians
        })
    }

    fn candidates(&self, echoes: &[Echo], counts: impl Fn(Pose2) -> bool) -> Vec<Pose2> {
        let stride = echoes.len().div_ceil(READINGS).max(1);
        let sparse: Vec<&Echo> = echoes.iter().step_by(stride).collect();
        let mut scored: Vec<(f32, Pose2)> = Vec::new();
        for heading in 0..DIRECTIONS {
            let theta = heading as f64 * TAU / DIRECTIONS as f64;
            let turned: Vec<Turned> = sparse.iter().map(|echo| self.turned(echo, theta)).collect();
            for place in (0..self.stands.len()).filter(|place| self.stands[*place]) {
                let [x, y] = self.middle(place);
                let pose = Pose2::new(x, y, theta);
                if counts(pose) {
                    scored.push((self.score(place, &turned), pose));
                }
            }
        }
        scored.sort_by(|a, b| {
            let key = |pose: &Pose2| [pose.x, pose.y, pose.theta];
            let tie = || key(&a.1).iter().zip(key(&b.1)).map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
            b.0.total_cmp(&a.0).then_with(|| tie().unwrap_or(core::cmp::Ordering::Equal))
        });
        let mut chosen: Vec<Pose2> = Vec::new();
        for (_, pose) in scored {
            let is_new = |other: &Pose2| {
                other.distance_m(pose) > 0.6 * laid::ELSEWHERE.0
                    || wrap_angle(other.theta - pose.theta).abs() > 0.5 * laid::ELSEWHERE.1
            };
            if chosen.iter().all(is_new) {
                chosen.push(pose);
                if chosen.len() >= CANDIDATES {
                    break;
                }
            }
        }
        chosen
    }

    fn turned(&self, echo: &Echo, theta: f64) -> Turned {
        let Pose2 { x, y, theta } = Pose2::new(0.0, 0.0, theta) * echo.base_from_transducer;
        let turns = theta / TAU;
        Turned {
            column: (x / self.spacing_m).round() as i32,
            row: (y / self.spacing_m).round() as i32,
            direction: ((turns - turns.floor()) * DIRECTIONS as f64).round() as usize % DIRECTIONS,
            range: (echo.range_m / UNIT_M).round().clamp(1.0, f64::from(u8::MAX - 1)) as u8,
        }
    }

    fn score(&self, place: usize, turned: &[Turned]) -> f32 {
        let (column, row) = ((place % self.columns) as i32, (place / self.columns) as i32);
        let stray = self.worth[usize::from(u8::MAX)];
        let of = |reading: &Turned| {
            let (column, row) = (column + reading.column, row + reading.row);
            if column < 0 || row < 0 || column >= self.columns as i32 || row >= self.rows as i32 {
                return stray;
            }
            let place = row as usize * self.columns + column as usize;
            match self.ranges[place * DIRECTIONS + reading.direction] {
                0 => stray,
                range => self.worth[usize::from(range.abs_diff(reading.range))],
            }
        };
        turned.iter().map(of).sum()
    }
}

/// How far it is to the first wall in a direction, in units, and whether that faces here; none within reach.
fn first_wall(ground: &Ground, [x, y]: [f64; 2], direction: usize) -> Option<(u8, bool)> {
    let ray_rad = direction as f64 * TAU / DIRECTIONS as f64;
    let (s, c) = libm::sincos(ray_rad);
    let steps = (REACH_M / UNIT_M) as usize;
    (1..steps).find_map(|step| {
        let along_m = step as f64 * UNIT_M;
        let (column, row) = ground.cell(x + along_m * c, y + along_m * s);
        let place = ground.place(column, row)?;
        if ground.occupied[place] < 0.3_f32.max(LEAST) {
            return None;
        }
        let faces = match ground.facing[place] {
            DIFFUSE => true,
            facing => {
                let off = ray_rad - f64::from(facing) * core::f64::consts::PI / super::ground::FACINGS as f64;
                libm::cos(off).abs() > 0.85
            }
        };
        Some((step as u8, faces))
    })
}
