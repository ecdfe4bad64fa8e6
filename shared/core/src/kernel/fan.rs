//! The beams of a scan that stand side by side and begin at one place: one pass over the cells that they see.
//!
//! Side by side they leave nothing out and nothing twice: each cell belongs to the one beam in which its centre lies. So a scan is not a
//! set-up and a layout for every beam, most of them with a cell or two in a row, but one for a *wedge* of beams next to each other
//! (`fan_pass.rs`): its rows are long, the beam of each cell is told by the cell's bearing, and what the beam says it looks up. Wedges
//! are counted from the lidar's first beam, whichever beams are there, and what a cell gains depends on its beam alone; so beams that
//! are added together and one by one give the same bits.
//!
//! **Bound.** As of [`super::Kernel::add`], with a cone as wide as the step from beam to beam; but which of two beams next to each other
//! a cell belongs to is known to 2e-4 of the step, and which side of a border of the regions, to 1e-6 of its distance.

use super::chosen::{PLACES, Table};
use super::fan_pass::{AddingWedge, FanScratch};
use super::fit::fit;
use super::geometry::ANGLE;
use super::paper::{ARTANH, Limits, artanh, shortened};
use super::wide::Width;
use super::{Apex, OffMap, Place, is_sound};
use crate::grid::Grid;
use crate::pose::Pose2;
use crate::sensor_model::Cone;

/// Beams of a wedge: with a place more at either end.
const BEAMS_MAX: usize = PLACES - 2;
/// A wedge is no wider, radians.
const WIDEST_RAD: f64 = 0.6;
/// So many of them are looked at together to see how far the wedge reaches.
const PART: u16 = 6;
/// Coefficients of atan(t)/t as a function of t².
pub(super) const ATAN: usize = 4;

/// Steps from beam to beam that are added so, radians: wider beams are cones, and of narrower ones single precision can't tell which is
/// which.
pub const FAN_STEP_RAD: core::ops::RangeInclusive<f64> = 1e-3..=0.04;

/// Adds beams that stand side by side to a grid.
#[derive(Debug, Clone)]
pub struct FanKernel {
    limits: Limits,
    curves: Curves,
    /// The peak of region I that `curves.artanh` is for.
    p_free: f64,
    // By itself, so that its alignment is not that of all mappers: who keeps one need not be able to align so (Python).
    wedge: Box<Wedge>,
    scratch: FanScratch,
    pub(super) width: Width,
}

/// Polynomials.
#[derive(Debug, Clone)]
pub(super) struct Curves {
    pub(super) atan: [f32; ATAN],
    /// exp(−½ x) up to x = 1.
    pub(super) angle: [f32; ANGLE],
    pub(super) short_angle: [f32; ANGLE - 1],
    /// None where the peak of region I is too close to certainty.
    pub(super) artanh: Option<[f32; ARTANH]>,
}

/// Some beams next to each other, by their places: that of the first one is 1, and those at either end are there twice.
#[derive(Debug, Clone, Default)]
pub(super) struct Wedge {
    pub(super) sin: f64,
    pub(super) cos: f64,
    /// The place that the axis has.
    pub(super) middle: f64,
    pub(super) step_rad: f64,
    /// Some beams each, from the first to the last that there is.
    pub(super) parts: Vec<WedgePart>,
    /// (z + kσ_z)², below 0 where there is no beam.
    pub(super) far_squared: Table,
    /// −2 w (½ − p_free), and what of it a distance squared takes away: below 0 in region I, and nowhere if there is none.
    pub(super) minus_peak: Table,
    pub(super) fading: Table,
    /// (step / σ_θ)².
    pub(super) narrowness: Table,
    pub(super) range: Table,
    /// z², and what single precision leaves of it.
    pub(super) range_squared: Table,
    pub(super) range_squared_rest: Table,
    /// √½ / σ_z.
    pub(super) steepness: Table,
    /// 2 w (p_occ − ½).
    pub(super) echo_peak: Table,
}

/// A few beams next to each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct WedgePart {
    pub(super) left_rad: f64,
    pub(super) right_rad: f64,
    /// As far as the farthest of them.
    pub(super) far_m: f64,
}

impl Wedge {
    /// Those of `beams` that lie within the wedge of `first`; beam n looks along `first_rad` + n × `step_rad`.
    fn fill(&mut self, first_rad: f64, step_rad: f64, first: u16, count: u16, beams: &[(u16, Cone)]) {
        // What single precision takes for a beam's is looked at whenever that beam is there.
        const SLACK: f64 = 1.0 / 64.0;
        const FAR_SLACK: f64 = 1e-6;
        let along = |beam: f64| first_rad + beam * step_rad;
        let (first, count) = (f64::from(first), f64::from(count));
        (self.sin, self.cos) = libm::sincos(along(first + 0.5 * (count - 1.0)));
        (self.middle, self.step_rad) = (0.5 * (count + 1.0), step_rad);
        self.far_squared.0.fill(-1.0);
        for (beam, cone) in beams {
            let place = usize::from(*beam) - first as usize + 1;
            self.put(place, cone);
            if place == 1 {
                self.put(0, cone);
            }
            if place == count as usize {
                self.put(place + 1, cone);
            }
        }
        self.parts.clear();
        let edge = |beam: f64| along(beam.clamp(first - 0.5, first + count - 0.5));
        for some in beams.chunk_by(|a, b| a.0 / PART == b.0 / PART) {
            let [begins, ends] =
                [some.first(), some.last()].map(|beam| beam.map_or(first, |(beam, _)| f64::from(*beam)));
            let edges = [edge(begins - 0.5 - SLACK), edge(ends + 0.5 + SLACK)];
            let [right_rad, left_rad] = if step_rad > 0.0 { edges } else { [edges[1], edges[0]] };
            let far_m = some.iter().fold(0.0, |far_m: f64, (_, cone)| far_m.max(cone.far_m()));
            self.parts.push(WedgePart { left_rad, right_rad, far_m: far_m * (1.0 + FAR_SLACK) });
        }
    }

    fn put(&mut self, place: usize, cone: &Cone) {
        let (near_m, far_m, deviations) = (cone.near_m(), cone.far_m(), cone.deviations);
        // Even if it is nothing, it has a sign.
        let free_peak = (2.0 * deviations.trust * (0.5 - cone.p_free)).max(1e-30);
        let inverse_sigma = 1.0 / deviations.sigma_z_m;
        let narrowness = self.step_rad / deviations.sigma_theta_rad;
        let (minus_peak, fading) = if near_m > 0.0 { (-free_peak, free_peak / (near_m * near_m)) } else { (1.0, 0.0) };
        let range_squared = cone.range_m * cone.range_m;
        self.far_squared.0[place] = (far_m * far_m) as f32;
        self.minus_peak.0[place] = minus_peak as f32;
        self.fading.0[place] = fading as f32;
        self.narrowness.0[place] = (narrowness * narrowness) as f32;
        self.range.0[place] = cone.range_m as f32;
        self.range_squared.0[place] = range_squared as f32;
        self.range_squared_rest.0[place] = (range_squared - f64::from(range_squared as f32)) as f32;
        self.steepness.0[place] = (core::f64::consts::FRAC_1_SQRT_2 * inverse_sigma) as f32;
        self.echo_peak.0[place] = (2.0 * deviations.trust * (cone.p_occupied - 0.5)) as f32;
    }
}

impl FanKernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64) -> Self {
        let angle = fit(|x| libm::exp(-0.5 * x), 1.0).map(|c: f64| c as f32);
        let most = libm::tan(0.5 * WIDEST_RAD);
        let atan = fit(|square| libm::atan(square.sqrt()) / square.sqrt(), most * most).map(|c: f64| c as f32);
        Self {
            limits: Limits { prior: log_odds_prior as f32, max: log_odds_max as f32 },
            curves: Curves { atan, angle, short_angle: shortened(&angle), artanh: None },
            p_free: f64::NAN,
            wedge: Box::default(),
            scratch: FanScratch::default(),
            width: Width::of_this_processor(),
        }
    }

    /// Whether a beam whose transducer is at `map_from_transducer` can be added.
    #[must_use]
    pub fn takes(resolution_m: f64, map_from_transducer: Pose2, cone: &Cone) -> bool {
        is_sound(cone) && Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, resolution_m).is_ok()
    }

    /// Whether its numbers are such that every cell gets a probability within (0, 1).
    #[must_use]
    pub fn is_sound(cone: &Cone) -> bool {
        is_sound(cone)
    }

    /// Whether every beam of this aperture that ends within `far_m` of there lies within the map.
    #[must_use]
    pub fn reaches(resolution_m: f64, map_from_transducer: Pose2, far_m: f64, aperture_rad: f64) -> bool {
        Apex::of(map_from_transducer, far_m, aperture_rad, resolution_m).is_ok()
    }

    /// Adds ln(p / (1 − p)) − l0 to every cell of some beams, in the order of their numbers. Beam n begins where `map_from_first` is,
    /// looks along its axis + n × `step_rad`, and is as wide as the step, whatever its cone says. All have the same peak of region I. The
    /// tiles that changed get `revision`.
    ///
    /// # Errors
    /// A beam [is not taken](Self::takes), or the step is [too wide or too narrow](FAN_STEP_RAD), or the numbers do not rise; nothing is
    /// changed then.
    pub fn add(
        &mut self,
        grid: &mut Grid,
        map_from_first: Pose2,
        step_rad: f64,
        beams: &[(u16, Cone)],
        revision: u64,
    ) -> Result<(), OffMap> {
        let resolution_m = grid.resolution_m();
        let is_one = |(_, cone): &(u16, Cone)| Self::takes(resolution_m, map_from_first, cone);
        if !beams.iter().all(is_one) {
            return Err(OffMap);
        }
        self.add_taken(grid, map_from_first, step_rad, beams, revision)
    }

    /// Likewise, of beams that are known to be [taken](Self::takes).
    ///
    /// # Errors
    /// The step is [too wide or too narrow](FAN_STEP_RAD), or the numbers do not rise; nothing is changed then.
    pub(crate) fn add_taken(
        &mut self,
        grid: &mut Grid,
        map_from_first: Pose2,
        step_rad: f64,
        beams: &[(u16, Cone)],
        revision: u64,
    ) -> Result<(), OffMap> {
        if !FAN_STEP_RAD.contains(&step_rad.abs()) || !beams.is_sorted_by(|a, b| a.0 < b.0) {
            return Err(OffMap);
        }
        let resolution_m = grid.resolution_m();
        let Some((_, cone)) = beams.first() else { return Ok(()) };
        let apex = Apex::of(map_from_first, cone.far_m(), cone.aperture_rad, resolution_m)?;
        if self.p_free != cone.p_free {
            (self.p_free, self.curves.artanh) = (cone.p_free, artanh(cone.p_free));
        }
        let count = BEAMS_MAX.min((WIDEST_RAD / step_rad.abs()) as usize) as u16;
        let mut place = Place { grid, revision };
        for beams in beams.chunk_by(|a, b| a.0 / count == b.0 / count) {
            let first = beams[0].0 / count * count;
            self.wedge.fill(map_from_first.theta, step_rad, first, count, beams);
            let Self { scratch, wedge, curves, limits, .. } = self;
            let place = &mut place;
            self.width.run(AddingWedge { scratch, wedge, curves, apex, limits: *limits, resolution_m, place });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_alike;
    use super::*;
    use crate::sensor_model::Deviations;

    /// All that this processor can do, on scans of all kinds.
    #[test]
    fn all_processors_give_the_same_bytes() {
        let maps = Width::all().into_iter().map(|width| {
            let mut grid = Grid::new(0.05);
            let mut kernel = FanKernel { width, ..FanKernel::new(0.0, 8.0) };
            for k in 0..40u16 {
                let step_rad = if k % 3 == 0 { -0.006 } else { 0.004 + 0.0008 * f64::from(k) };
                let cone = |beam: u16| Cone {
                    range_m: 0.5 + f64::from(beam * 37 % 100) * 0.07,
                    aperture_rad: step_rad.abs(),
                    range_cap_m: 7.0,
                    deviations: Deviations { sigma_z_m: 0.04, sigma_theta_rad: 0.7 * step_rad.abs(), trust: 0.6 },
                    p_occupied: 0.85,
                    p_free: if k % 5 == 0 { 0.1 } else { 0.3 },
                    leaves_gaps: false,
                };
                let beams: Vec<_> = (0..150).filter(|beam| beam % 9 > 0).map(|beam| (beam, cone(beam))).collect();
                let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
                assert!(kernel.add(&mut grid, pose, step_rad, &beams, 1).is_ok());
            }
            grid
        });
        assert_alike(&maps.collect::<Vec<_>>());
    }
}
