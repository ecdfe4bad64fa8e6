//! Sonars in a known map: ln T of each reading, the sum over the first echoes that the map would give.
//!
//! A cone is looked at along rays. Along it, cell after cell: something is there and answers (a), nothing before it did (S), what it says
//! of the range (L): T = c + Σ S a L, with c = clutter/r_cap what echoes of nothing in the map have. A wall whose facing the map shows
//! answers near its normal, as in `core::oriented`; c alone is T where nothing is.

use core::f64::consts::{PI, TAU};

use echogrid_core::oriented::Response;
use echogrid_core::{Pose2, Scales};

use super::coarse::Coarse;
use super::ground::{DIFFUSE, FACINGS, Ground, LEAST};
use super::trail::Trail;
use super::{Gates, Located, Prior, Unlocated, laid};
use crate::matrix;

/// Rays that stand for a cone.
const RAYS: usize = 5;
/// Directions of rays that are told apart when a wall answers.
const SECTORS: usize = 64;
/// How probably what is there answers at its best.
const DETECTION: f64 = 0.6;
/// Of walls that face a direction: the share that answers whatever the angle.
const ROUGH: f64 = 0.2;
/// Of what faces no way: the share of the best answer.
const FACELESS: f64 = 0.4;
/// Up to so far from its normal a wall answers, radians: 20°, and what the map is off by.
const CRITICAL_RAD: f64 = 25.0 * PI / 180.0;
/// How probably an echo is nobody's.
const CLUTTER: f64 = 0.4;
/// The least deviation of a range, metres: what cells, and poses among each other, are off by.
const SIGMA_MIN_M: f64 = 0.06;
/// Cells farther than this many deviations behind the echo are not looked at.
const BEHIND: f64 = 3.0;
/// So little is left of the sound that what comes after does not matter.
const SPENT: f64 = 1e-3;
/// Variances of a place that was found anywhere are larger by this.
const UNTAUGHT: f64 = 4.0;
/// The least number of readings that a place is told by.
const READINGS_MIN: usize = 60;

/// A reading of a sonar, and where it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    /// The transducer, x along its axis, seen from the base.
    pub base_from_transducer: Pose2,
    /// z, metres.
    pub range_m: f64,
    /// η: its error as a share.
    pub range_error_ratio: f64,
    /// β: full aperture, radians.
    pub aperture_rad: f64,
    /// r_cap, metres.
    pub range_cap_m: f64,
}

/// A known map, for sonars.
#[derive(Debug, Clone)]
pub struct EchoMap {
    pub(super) ground: Ground,
    /// How probably a wall of each facing answers along rays of each sector.
    answers: Vec<[f64; SECTORS]>,
    coarse: Option<Coarse>,
}

impl EchoMap {
    /// A map for sonars, from a map as an array.
    #[must_use]
    pub fn new(ground: Ground) -> Self {
        let response = Response::new(CRITICAL_RAD, FACINGS);
        let of_sector = |sector: usize| TAU * sector as f64 / SECTORS as f64;
        let of_facing = |facing: usize| {
            core::array::from_fn(|sector| {
                DETECTION * (ROUGH + (1.0 - ROUGH) * response.share(facing, of_sector(sector)))
            })
        };
        Self { ground, answers: (0..FACINGS).map(of_facing).collect(), coarse: None }
    }

    /// How probably a cell is occupied and answers along a ray of a sector.
    #[inline]
    pub(super) fn answer(&self, place: usize, sector: usize) -> f64 {
        let response = match self.ground.facing[place] {
            DIFFUSE => DETECTION * FACELESS,
            facing => self.answers[usize::from(facing)][sector],
        };
        f64::from(self.ground.occupied[place]) * response
    }

    /// The sector of a ray's direction.
    pub(super) fn sector(ray_rad: f64) -> usize {
        let turns = ray_rad / TAU;
        ((turns - turns.floor()) * SECTORS as f64).round() as usize % SECTORS
    }

    /// ln T of a reading at this pose of its transducer, less that where nothing is; nat.
    #[must_use]
    pub fn evidence_of(&self, map_from_transducer: Pose2, echo: &Echo) -> f64 {
        let sigma_m = (echo.range_error_ratio * echo.range_m).max(SIGMA_MIN_M);
        let step_m = self.ground.resolution_m;
        let nobodys = CLUTTER / echo.range_cap_m;
        let rays: [([f64; 2], usize); RAYS] = core::array::from_fn(|ray| {
            let off = (ray as f64 - (RAYS - 1) as f64 / 2.0) / RAYS as f64 * echo.aperture_rad;
            let (s, c) = libm::sincos(map_from_transducer.theta + off);
            ([c * step_m, s * step_m], Self::sector(map_from_transducer.theta + off))
        });
        let bins = ((echo.range_m + BEHIND * sigma_m) / step_m) as usize + 1;
        let wide = echo.aperture_rad / RAYS as f64;
        let (mut unanswered, mut total) = (1.0_f64, nobodys);
        for bin in 2..bins {
            let along = bin as f64 + 0.5;
            let mut passes = 1.0;
            for (way, sector) in &rays {
                let (column, row) =
                    self.ground.cell(map_from_transducer.x + along * way[0], map_from_transducer.y + along * way[1]);
                let Some(place) = self.ground.place(column, row) else { continue };
                if self.ground.occupied[place] < LEAST {
                    continue;
                }
                // Cells side by side that the ray stands for.
                let beside = (along * wide).max(1.0);
                passes *= libm::pow(1.0 - self.answer(place, *sector), beside);
            }
            if passes > 1.0 - 1e-9 {
                continue;
            }
            let off = (echo.range_m - along * step_m) / sigma_m;
            if off.abs() < 5.0 {
                total += unanswered * (1.0 - passes) * libm::exp(-0.5 * off * off) / (sigma_m * TAU.sqrt());
            }
            unanswered *= passes;
            if unanswered < SPENT {
                break;
            }
        }
        libm::log(total / nobodys)
    }

    /// The mean of the evidence of all readings at a pose of the robot, nat a reading.
    #[must_use]
    pub fn evidence(&self, map_from_base: Pose2, echoes: &[Echo]) -> f64 {
        self.sum(map_from_base, echoes) / echoes.len().max(1) as f64
    }

    pub(super) fn sum(&self, map_from_base: Pose2, echoes: &[Echo]) -> f64 {
        echoes.iter().map(|echo| self.evidence_of(map_from_base * echo.base_from_transducer, echo)).sum()
    }

    /// Where the robot is near where it was believed to be.
    ///
    /// # Errors
    /// That can't be told, and why.
    pub fn track(&mut self, trail: &Trail, prior: &Prior, gates: &Gates) -> Result<Located, Unlocated> {
        enough(trail)?;
        let (metres, radians) = prior.sigmas();
        let mut starts = vec![prior.pose];
        if metres > laid::NEAR_M || radians > laid::NEAR_RAD {
            starts.extend(self.coarse().near(&trail.echoes(Scales::default(), 1), prior));
        }
        laid::best(self, trail, Some(prior), &starts, gates).map(|laid| laid.located)
    }

    /// Where the robot is, anywhere in the map: the readings of both halves of the way must fit.
    ///
    /// # Errors
    /// That can't be told, and why.
    pub fn find(&mut self, trail: &Trail, gates: &Gates) -> Result<Located, Unlocated> {
        enough(trail)?;
        let starts = self.coarse().anywhere(&trail.echoes(Scales::default(), 1));
        let found = laid::best(self, trail, None, &starts, gates)?;
        let echoes = trail.echoes(found.more, 1);
        let (first, second) = echoes.split_at(trail.older.min(echoes.len()));
        for part in [first, second].into_iter().filter(|part| !part.is_empty()) {
            let evidence = self.evidence(found.located.pose, part);
            // A part may have less to tell than the whole.
            let needed = 0.75 * gates.evidence_min;
            if evidence < needed {
                return Err(Unlocated::NoFit { evidence, needed });
            }
        }
        // What the drive measures too much is not known yet either.
        let covariance = matrix::scaled(&found.located.covariance, UNTAUGHT);
        Ok(Located { covariance, ..found.located })
    }

    fn coarse(&mut self) -> &Coarse {
        self.coarse.get_or_insert_with(|| Coarse::of(&self.ground))
    }
}

fn enough(trail: &Trail) -> Result<(), Unlocated> {
    let (readings, needed) = (trail.len(), READINGS_MIN);
    if readings < needed { Err(Unlocated::TooFew { readings, needed }) } else { Ok(()) }
}
