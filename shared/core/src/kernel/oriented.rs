//! The fast way to the numbers of [`crate::oriented`].
//!
//! As in `first_echo.rs`, of the cells in front of the echo S counts only as a product, and only those around it are sorted. What is
//! known of the states of a cell lies in its tile ([`crate::shares`]); its log-odds are what they come to. Where somebody else has
//! moved the log-odds since (a lidar, by a rule of its own; the robot, by being there), all states are moved alike first.
//!
//! **Bound.** Of the cells of the cone nearer than the end and r_cap, and only of these, each state gains what [`Oriented::gains`]
//! says, times the weight, to within [`ORIENTED_BOUND`] and what the code of a state is rounded by. Of two cells around
//! the echo whose squared distances differ by less than 1e-6 of what they span either may come first.

use super::first_echo::{BEFORE, FINEST_SIGMA_Z_M, LEFT_OUT, peak};
use super::geometry::{ANGLE, Geometry};
use super::layout::Beam;
use super::oriented_answers::Answers;
use super::oriented_cells::Profile;
use super::oriented_pass::{Scratch, Weighing};
use super::tempered::Tempered;
use super::wide::Width;
use super::{Apex, OffMap, Place, cells_around};
use crate::first_echo::BEHIND;
use crate::grid::{CellIndex, Grid, Tile};
use crate::oriented::{DIRECTIONS, FacedCell, Oriented, STATES, left_by_looks};
use crate::pose::Pose2;
use crate::shares::{CUT, LEAST, MOST};

/// How far the gain of a state may be from that of the reference model, per reading.
pub const ORIENTED_BOUND: f64 = 1e-3;

/// A reading of which a grid learns by the oriented model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedCone {
    /// What came back.
    pub reading: Oriented,
    /// r0: how probably a cell answers that is occupied and does not mirror, in (0, 1).
    pub detection: f64,
    /// To where a cone without an echo is looked at, metres.
    pub clear_m: f64,
    /// β: full aperture, radians.
    pub aperture_rad: f64,
    /// ln(p0/(1 − p0)): what the log-odds of the grid are relative to.
    pub prior_log_odds: f64,
    /// What is left of a gain, in [0, 1].
    pub weight: f64,
    /// n of [`crate::oriented::left_by_looks`], 0 or more; infinite: looks may take all of a wall.
    pub looks: f64,
    /// Whether there are gaps between the beam and its neighbours: as of [`crate::sensor_model::Cone::leaves_gaps`].
    pub leaves_gaps: bool,
    /// By what the states are rounded: another one for each reading, evenly spread.
    pub draw: u32,
}

impl OrientedCone {
    /// min(z + 3σ_z, r_cap), metres; where nothing came back, as far as that clears.
    #[must_use]
    pub fn far_m(&self) -> f64 {
        let Oriented { range_m, sigma_z_m, range_cap_m, .. } = self.reading;
        range_m.map_or(self.clear_m, |range_m| range_m + BEHIND * sigma_z_m).min(range_cap_m)
    }

    /// From where on a cell may have given the echo, metres.
    fn near_m(&self) -> f64 {
        let Oriented { range_m, sigma_z_m, range_cap_m, .. } = self.reading;
        // Beyond the end where no cell has.
        let Some(range_m) = range_m else { return 2.0 * range_cap_m };
        let most = self.detection * peak(sigma_z_m) / (LEFT_OUT * self.nobodys());
        range_m - sigma_z_m * BEFORE.max((2.0 * libm::log(most)).max(0.0).sqrt())
    }

    /// c, or m where nothing came back.
    pub(super) fn nobodys(&self) -> f64 {
        let Oriented { range_m, clutter, range_cap_m, lost, .. } = self.reading;
        range_m.map_or(lost, |_| clutter / range_cap_m)
    }

    /// Whether its numbers are such that every gain is finite.
    fn is_sound(&self) -> bool {
        let Oriented { range_m, sigma_z_m, clutter, range_cap_m, lost } = self.reading;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let probability = |x: f64| x > 0.0 && x < 1.0;
        range_m.is_none_or(positive)
            && sigma_z_m >= FINEST_SIGMA_Z_M
            && sigma_z_m.is_finite()
            && positive(range_cap_m)
            && positive(self.clear_m)
            && positive(self.aperture_rad)
            && probability(self.detection)
            && probability(clutter)
            && probability(lost)
            && self.prior_log_odds.abs() <= 100.0
            && (0.0..=1.0).contains(&self.weight)
            && self.looks >= 0.0
    }
}

/// Of which states a cell may be, and within what its evidence stays.
#[derive(Debug, Clone, Copy)]
pub(super) struct States {
    /// l0.
    pub(super) start: f32,
    /// l_max.
    pub(super) max: f32,
    /// How probable each state is before any reading, if the cell is occupied: diffuse, and each direction.
    pub(super) diffuse: f32,
    pub(super) facing: f32,
    /// Within what each state stays.
    pub(super) least: f32,
    pub(super) most: f32,
}

/// Adds readings to a grid by the oriented model. Allocates nothing once it has seen a cone as large as any to come and the grid has
/// the tiles.
#[derive(Debug, Clone)]
pub struct OrientedKernel {
    states: States,
    answers: Answers,
    // By itself, so that its alignment is not that of all mappers (Python).
    tempered: Box<Tempered>,
    scratch: Scratch,
    width: Width,
}

impl OrientedKernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`; of those that are occupied, the share
    /// `diffuse` is no smooth wall; these answer up to `critical_rad` from their normal.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64, diffuse: f64, critical_rad: f64) -> Self {
        let facing = (1.0 - diffuse) / DIRECTIONS as f64;
        let most = libm::exp(log_odds_max - log_odds_prior) / facing.min(diffuse).max(1e-6);
        // Such as have a code, so that what stays as it is need not be looked at.
        let with_code = |x: f32| f32::from_bits(x.clamp(LEAST, MOST).to_bits() & !CUT);
        Self {
            states: States {
                start: log_odds_prior as f32,
                max: log_odds_max as f32,
                diffuse: diffuse as f32,
                facing: facing as f32,
                least: with_code(libm::exp(-log_odds_max - log_odds_prior) as f32),
                most: with_code(most as f32),
            },
            answers: Answers::new(critical_rad),
            tempered: Box::default(),
            scratch: Scratch::default(),
            width: Width::of_this_processor(),
        }
    }

    /// Lets every cell of the cone of a transducer at `map_from_transducer` gain what the reading says of it. The tiles that
    /// changed get `revision`.
    ///
    /// # Errors
    /// When the cone or the pose is not finite or no reading at all, or the cone leaves the grid; nothing is changed then.
    pub fn add(
        &mut self,
        grid: &mut Grid,
        map_from_transducer: Pose2,
        cone: &OrientedCone,
        revision: u64,
    ) -> Result<(), OffMap> {
        if !cone.is_sound() {
            return Err(OffMap);
        }
        let resolution_m = grid.resolution_m();
        let apex = Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, resolution_m)?;
        let mut place = Place { grid, revision };
        if !Answers::are_smooth(cone.aperture_rad) {
            self.add_by_reference(&mut place, map_from_transducer, cone, apex);
            return Ok(());
        }
        let axis_rad = map_from_transducer.theta;
        let geometry = Geometry::new(resolution_m, &apex, axis_rad, cone.aperture_rad, [0.0; ANGLE]);
        let beam = Beam {
            direction_rad: axis_rad,
            aperture_rad: cone.aperture_rad,
            near_m: cone.near_m(),
            far_m: cone.far_m(),
            leaves_gaps: cone.leaves_gaps,
        };
        let is_tempered = cone.weight < 1.0;
        if is_tempered {
            self.tempered.turn_to(cone.weight);
        }
        let Self { states, answers, tempered, scratch, width } = self;
        let tempered = is_tempered.then_some(&**tempered);
        let profile = Profile { geometry, cone: *cone, states: *states, tempered };
        width.run(Weighing { scratch, answers, profile: &profile, beam, apex, place });
        Ok(())
    }

    /// a: how probably a cell answers, whose states have these shares in an answer along the ray to it.
    pub(crate) fn answers(&self, grid: &Grid, cell: CellIndex, cone: &OrientedCone, shares: &[f64; STATES]) -> f64 {
        let mut weights: [f64; STATES] = core::array::from_fn(|state| self.states.prior(state));
        let mut occupied = libm::exp(cone.prior_log_odds);
        if let Some(tile) = grid.tile(cell.tile())
            && !tile.log_odds[cell.offset_in_tile()].is_nan()
        {
            let offset = cell.offset_in_tile();
            if let Some(shares) = &tile.shares {
                weights.iter_mut().zip(shares.of(offset)).for_each(|(weight, value)| *weight *= f64::from(value));
            }
            // Somebody else may have moved it since.
            let States { start, max, .. } = self.states;
            let [least, most] = [-max - start, max - start].map(|odds| libm::exp(f64::from(odds)));
            let sum = weights.iter().sum::<f64>().clamp(least, most);
            occupied *= libm::exp(f64::from(tile.log_odds[offset] - start)) / sum;
        }
        let answering: f64 = weights.iter().zip(shares).map(|(weight, share)| weight * share).sum();
        let sum: f64 = weights.iter().sum();
        cone.detection * occupied * answering / (1.0 + occupied * sum)
    }

    /// For apertures wider than a sensor's.
    fn add_by_reference(&self, place: &mut Place<'_>, map_from_transducer: Pose2, cone: &OrientedCone, apex: Apex) {
        let far_m = cone.far_m();
        let mut seen: Vec<(CellIndex, f64, [f64; STATES], [f64; STATES])> = Vec::new();
        for (cell, distance_m, bearing_rad) in cells_around(place.grid, map_from_transducer, apex, far_m) {
            if distance_m > 0.0 && distance_m <= far_m && bearing_rad.abs() <= 0.5 * cone.aperture_rad {
                let tile = place.grid.tile(cell.tile());
                let weights = self.states.log_weights(tile, cell.offset_in_tile());
                let ray_rad = map_from_transducer.theta + bearing_rad;
                seen.push((cell, distance_m, weights, self.answers.of_ray(ray_rad, cone.detection)));
            }
        }
        let relative = |(_, distance_m, weights, responses): &(_, f64, [f64; STATES], [f64; STATES])| {
            (*distance_m, weights.map(|v| v + cone.prior_log_odds), *responses)
        };
        let cells: Vec<(f64, [f64; STATES], [f64; STATES])> = seen.iter().map(relative).collect();
        let faced: Vec<FacedCell<'_>> = cells
            .iter()
            .map(|(distance_m, log_weights, responses)| FacedCell { distance_m: *distance_m, log_weights, responses })
            .collect();
        for ((cell, _, weights, responses), gains) in seen.iter().zip(cone.reading.gains(&faced)) {
            let offset = cell.offset_in_tile();
            let tile = place.tile(cell.tile());
            let values = core::array::from_fn(|s| {
                let before = libm::exp(weights[s]) / self.states.prior(s);
                let value = before * libm::exp(cone.weight * gains[s]);
                let left = if s == 0 { 0.0 } else { left_by_looks(responses[s], cone.looks) };
                (value.max(before.min(left)) as f32).clamp(self.states.least, self.states.most)
            });
            let shares = tile.shares.get_or_insert_default();
            shares.set(offset, &values, cone.draw);
            tile.log_odds[offset] = self.states.log_odds(&shares.of(offset));
        }
    }
}

impl States {
    fn prior(&self, state: usize) -> f64 {
        f64::from(if state == 0 { self.diffuse } else { self.facing })
    }

    /// What a cell of these states comes to.
    fn log_odds(&self, values: &[f32; STATES]) -> f32 {
        let sum: f64 = values.iter().enumerate().map(|(s, value)| self.prior(s) * f64::from(*value)).sum();
        (self.start + libm::log(sum) as f32).clamp(-self.max, self.max)
    }

    /// ln of the weight of each state of a cell, which come to its log-odds less l0 together.
    fn log_weights(&self, tile: Option<&Tile>, offset: usize) -> [f64; STATES] {
        let values = tile.and_then(|tile| tile.shares.as_ref()).map_or([1.0; STATES], |shares| shares.of(offset));
        let now = self.log_odds(&values);
        let known = tile.map_or(f32::NAN, |tile| tile.log_odds[offset]);
        let moved = if known.is_nan() { 0.0 } else { f64::from(known - now) };
        let [least, most] = [self.least, self.most].map(|limit| libm::log(f64::from(limit)));
        let of = |s: usize| (libm::log(f64::from(values[s])) + moved).clamp(least, most);
        core::array::from_fn(|s| libm::log(self.prior(s)) + of(s))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_alike;
    use super::*;

    /// All that this processor can do, on a drive of cones of all kinds, thin and wide.
    #[test]
    fn all_processors_give_the_same_bytes() {
        let maps = Width::all().into_iter().map(|width| {
            let mut grid = Grid::new(0.05);
            let mut kernel = OrientedKernel { width, ..OrientedKernel::new(0.0, 8.0, 0.3, 0.44) };
            for k in 0..500u32 {
                let aperture_rad = if k % 3 == 0 { 0.003 } else { 0.02 + 0.0013 * f64::from(k) };
                let reading = Oriented {
                    range_m: (k % 7 > 0).then(|| 0.3 + 0.008 * f64::from(k)),
                    sigma_z_m: 0.02 + 0.003 * f64::from(k % 100),
                    clutter: 0.4,
                    range_cap_m: 5.0,
                    lost: 0.5,
                };
                let cone = OrientedCone {
                    reading,
                    detection: if k % 5 == 0 { 0.6 } else { 0.95 },
                    clear_m: 2.5,
                    aperture_rad,
                    prior_log_odds: -4.6,
                    weight: if k % 2 == 0 { 1.0 } else { 0.9 },
                    looks: if k % 4 < 2 { f64::INFINITY } else { 10.0 },
                    leaves_gaps: k % 3 == 0,
                    draw: 977 * k,
                };
                let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
                assert!(kernel.add(&mut grid, pose, &cone, 1).is_ok());
                // Somebody else moves some cells.
                for (n, value) in grid.tile_mut(CellIndex { i: 3, j: 2 }.tile()).log_odds.iter_mut().enumerate() {
                    *value += if n % 7 == k as usize % 7 { 0.3 } else { 0.0 };
                }
            }
            grid
        });
        let maps: Vec<Grid> = maps.collect();
        assert_alike(&maps);
        let states = |grid: &Grid| {
            let mut bytes = Vec::new();
            grid.tiles().filter_map(|(_, tile)| tile.shares.as_ref()).for_each(|shares| shares.append_to(&mut bytes));
            bytes
        };
        assert!(!states(&maps[0]).is_empty() && maps.windows(2).all(|pair| states(&pair[0]) == states(&pair[1])));
    }
}
