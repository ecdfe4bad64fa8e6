//! The fast way to the numbers of [`crate::first_echo`].
//!
//! In front of the echo no cell can have given it: there S counts only as a product, and no order is needed. Only the cells around
//! the echo are sorted.
//!
//! **Bound.** Of the cells of the cone nearer than z + 3 σ_z and r_cap, and only of these, each gains what
//! [`FirstEcho::gains`] says, times the weight, to within [`super::BOUND`] of log-odds and half a unit in the last place of the stored
//! single-precision sum. Of two cells around the echo whose squared distances
//! differ by less than 1e-6 of what they span either may come first.

use super::along::{Along, Likelihood};
use super::fit::fit;
use super::functions::{exp, ln_1p, polynomial, reciprocal, splat_all};
use super::geometry::{Band, Geometry, Wide, make_room};
use super::lanes::Lanes;
use super::layout::{Beam, Layout, Piece};
use super::paper::{Limits, WideLimits, cells_of};
use super::wide::{Width, Work};
use super::{AngleFactor, Apex, OffMap, Place, WIDEST_HALF_APERTURE_RAD, cells_around};
use crate::first_echo::{BEHIND, FirstEcho, SeenCell};
use crate::grid::{Grid, Tile};
use crate::log_odds::probability_of;
use crate::pose::Pose2;

/// Cells nearer than this many σ_z before the echo did not give it, unless it is a very sure one.
pub(super) const BEFORE: f64 = 5.0;
/// What they may have given, compared with what is nobody's.
pub(super) const LEFT_OUT: f64 = 1e-5;

/// Of a range known better than this the likelihood would overflow, metres.
pub(super) const FINEST_SIGMA_Z_M: f64 = 1e-9;

/// Coefficients of ln(1 + x)/x.
const LOG: usize = 5;
/// They do for x from minus this on.
const MOST_FOR_SERIES: f64 = 0.25;

/// A reading of which a grid learns by the first-echo model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EchoCone {
    /// What came back, and how the sensor answers.
    pub reading: FirstEcho,
    /// β: full aperture, radians.
    pub aperture_rad: f64,
    /// ln(p0/(1 − p0)): what the log-odds of the grid are relative to.
    pub prior_log_odds: f64,
    /// What is left of a gain, in [0, 1].
    pub weight: f64,
    /// Whether there are gaps between the beam and its neighbours: as of [`crate::sensor_model::Cone::leaves_gaps`].
    pub leaves_gaps: bool,
}

impl EchoCone {
    /// min(z + 3σ_z, r_cap), metres; r_cap where nothing came back.
    #[must_use]
    pub fn far_m(&self) -> f64 {
        let FirstEcho { range_m, sigma_z_m, range_cap_m, .. } = self.reading;
        range_m.map_or(range_cap_m, |range_m| (range_m + BEHIND * sigma_z_m).min(range_cap_m))
    }

    /// From where on a cell may have given the echo, metres.
    fn near_m(&self) -> f64 {
        let FirstEcho { range_m, sigma_z_m, range_cap_m, detection, .. } = self.reading;
        // Beyond the end where no cell has.
        let Some(range_m) = range_m else { return 2.0 * range_cap_m };
        let most = detection * peak(sigma_z_m) / (LEFT_OUT * self.nobodys());
        range_m - sigma_z_m * BEFORE.max((2.0 * libm::log(most)).max(0.0).sqrt())
    }

    /// c, or m where nothing came back.
    fn nobodys(&self) -> f64 {
        let FirstEcho { range_m, clutter, range_cap_m, lost, .. } = self.reading;
        range_m.map_or(lost, |_| clutter / range_cap_m)
    }

    /// Whether its numbers are such that every gain is finite.
    fn is_sound(&self) -> bool {
        let FirstEcho { range_m, sigma_z_m, sigma_theta_rad, detection, clutter, range_cap_m, lost } = self.reading;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let probability = |x: f64| x > 0.0 && x < 1.0;
        range_m.is_none_or(positive)
            && sigma_z_m >= FINEST_SIGMA_Z_M
            && sigma_z_m.is_finite()
            && positive(range_cap_m)
            && positive(self.aperture_rad)
            && sigma_theta_rad >= 0.5 * self.aperture_rad
            && sigma_theta_rad.is_finite()
            && probability(detection)
            && probability(clutter)
            && probability(lost)
            && self.prior_log_odds.abs() <= 100.0
            && (0.0..=1.0).contains(&self.weight)
    }
}

/// L of a cell at the range.
pub(super) fn peak(sigma_z_m: f64) -> f64 {
    const FRAC_1_SQRT_TAU: f64 = 0.398_942_280_401_432_7;
    FRAC_1_SQRT_TAU / sigma_z_m
}

/// Adds readings to a grid by the first-echo model. Allocates nothing once it has seen a cone as large as any to come and the grid
/// has the tiles.
#[derive(Debug, Clone)]
pub struct FirstEchoKernel {
    /// l0.
    start: f64,
    /// l_max.
    max: f64,
    /// r0, and what it takes to compute the gains of free space.
    series: (f64, Option<[f32; LOG]>),
    angle: AngleFactor,
    scratch: Scratch,
    width: Width,
}

/// What is known of the cells of the cone at hand; kept for its memory.
#[derive(Debug, Clone, Default)]
struct Scratch {
    layout: Layout,
    places: Band,
    front: Cells,
    band: Cells,
    along: Along,
}

/// Cells, in the order of the layout.
#[derive(Debug, Clone, Default)]
struct Cells {
    count: usize,
    /// r: how probably each answers if it is there.
    answers: Vec<f32>,
    /// a = p r.
    probabilities: Vec<f32>,
    /// Log-odds that they have, or what they gain.
    log_odds: Vec<f32>,
}

/// What the cells of a reading have in common.
#[derive(Debug, Clone, Copy)]
struct Profile {
    geometry: Geometry,
    cone: EchoCone,
    series: Option<[f32; LOG]>,
    limits: Limits,
}

impl FirstEchoKernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64) -> Self {
        Self {
            start: log_odds_prior,
            max: log_odds_max,
            series: (f64::NAN, None),
            angle: AngleFactor::new(),
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
        cone: &EchoCone,
        revision: u64,
    ) -> Result<(), OffMap> {
        if !cone.is_sound() {
            return Err(OffMap);
        }
        let resolution_m = grid.resolution_m();
        let apex = Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, resolution_m)?;
        let mut place = Place { grid, revision };
        if 0.5 * cone.aperture_rad > WIDEST_HALF_APERTURE_RAD {
            self.add_by_reference(&mut place, map_from_transducer, cone, apex);
            return Ok(());
        }
        if self.series.0 != cone.reading.detection {
            self.series = (cone.reading.detection, series(cone.reading.detection));
        }
        let angle = self.angle.of(cone.aperture_rad, cone.reading.sigma_theta_rad);
        let axis_rad = map_from_transducer.theta;
        let geometry = Geometry::new(resolution_m, &apex, axis_rad, cone.aperture_rad, angle);
        let limits = Limits { prior: self.start as f32, max: self.max as f32 };
        let beam = Beam {
            direction_rad: axis_rad,
            aperture_rad: cone.aperture_rad,
            near_m: cone.near_m(),
            far_m: cone.far_m(),
            leaves_gaps: cone.leaves_gaps,
        };
        let profile = Profile { geometry, cone: *cone, series: self.series.1, limits };
        self.width.run(Weighing { scratch: &mut self.scratch, profile: &profile, beam, apex, place });
        Ok(())
    }

    /// For apertures wider than any sensor's.
    fn add_by_reference(&self, place: &mut Place<'_>, map_from_transducer: Pose2, cone: &EchoCone, apex: Apex) {
        let far_m = cone.far_m();
        let (mut indices, mut cells) = (Vec::new(), Vec::new());
        for (cell, distance_m, bearing_rad) in cells_around(place.grid, map_from_transducer, apex, far_m) {
            if distance_m > 0.0 && distance_m <= far_m && bearing_rad.abs() <= 0.5 * cone.aperture_rad {
                let log_odds = place.grid.log_odds(cell).map_or(self.start, f64::from) + cone.prior_log_odds;
                indices.push(cell);
                cells.push(SeenCell { distance_m, bearing_rad, probability: probability_of(log_odds) });
            }
        }
        for (cell, gain) in indices.into_iter().zip(cone.reading.gains(&cells)) {
            let value = &mut place.tile(cell.tile()).log_odds[cell.offset_in_tile()];
            let before = if value.is_nan() { self.start } else { f64::from(*value) };
            *value = (before + cone.weight * gain).max(-self.max).min(self.max) as f32;
        }
    }
}

/// ln(1 + x)/x over [−r0, 0] as a polynomial, if so few coefficients do.
fn series(detection: f64) -> Option<[f32; LOG]> {
    if detection > MOST_FOR_SERIES {
        return None;
    }
    let coefficients: [f64; LOG] = fit(|x| libm::log1p(-x) / -x, detection);
    // Of a polynomial in −x
    let mut sign = -1.0;
    Some(coefficients.map(|coefficient| {
        sign = -sign;
        (sign * coefficient) as f32
    }))
}

/// Adding a reading to a grid.
struct Weighing<'a> {
    scratch: &'a mut Scratch,
    profile: &'a Profile,
    beam: Beam,
    apex: Apex,
    place: Place<'a>,
}

impl Work for Weighing<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { scratch, profile, beam, apex, mut place } = self;
        let cone = &profile.cone;
        scratch.layout.lay_out::<L>(&beam, &apex, &profile.geometry);
        look_up::<L>(scratch, profile, place.grid);
        // Nothing in front of the echo answered
        let unanswered = product_of_rests::<L>(&scratch.front.probabilities, scratch.front.count);
        let mut total = (1.0 - cone.reading.lost) * unanswered;
        if let Some(range_m) = cone.reading.range_m {
            scratch.places.fill::<L>(&scratch.layout);
            weigh_band::<L>(scratch, profile, range_m);
            let squares = (beam.near_m.max(0.0), beam.far_m);
            let limits = (squares.0 * squares.0 - range_m * range_m, squares.1 * squares.1 - range_m * range_m);
            let probabilities = &scratch.band.probabilities[..scratch.band.count];
            total = scratch.along.sum::<L>(probabilities, unanswered, limits);
            fill_band_gains::<L>(scratch, profile);
        }
        fill_front_gains::<L>(scratch, profile, total);
        store::<L>(scratch, profile, &mut place);
    }
}

/// r and a of the cells in front of the echo, and the log-odds of those around it.
#[inline(always)]
fn look_up<L: Lanes>(scratch: &mut Scratch, profile: &Profile, grid: &Grid) {
    let Scratch { layout, front, band, .. } = scratch;
    make_room(&mut front.answers, layout.front.room::<L>());
    make_room(&mut front.probabilities, layout.front.room::<L>());
    make_room(&mut band.log_odds, layout.band.room::<L>());
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    let wide = Wide::<L>::new(&profile.geometry);
    let detection = L::splat(profile.cone.reading.detection as f32);
    for pieces in &layout.tiles {
        let tile = grid.tile(pieces.index);
        let wide = wide.on_axis(pieces.is_ray);
        for piece in layout.front.between(from.0, pieces.front) {
            let (square, across) = wide.places(pieces.column(*piece), &layout.places[pieces.place(*piece)]);
            // What is written beyond the end of the piece, the next one overwrites.
            known_of::<L>(tile, piece).store(&mut front.probabilities[at..]);
            detection.mul(wide.angular(across, square)).store(&mut front.answers[at..]);
            at += usize::from(piece.cells);
        }
        for piece in layout.band.between(from.1, pieces.band) {
            known_of::<L>(tile, piece).store(&mut band.log_odds[at_band..]);
            at_band += usize::from(piece.cells);
        }
        from = (pieces.front, pieces.band);
    }
    // What takes long one after the other in a loop of its own: many cells are under way at once there.
    for at in (0..at).step_by(L::COUNT) {
        let known = L::load(&front.probabilities[at..]);
        let r = L::load(&front.answers[at..]);
        r.mul(occupied(known, profile)).store(&mut front.probabilities[at..]);
    }
    // The last vector may reach beyond them: nothing that can't be computed, and nothing that answers.
    (front.count, band.count) = (at, at_band);
    front.answers[at..at + 16].fill(0.0);
    front.probabilities[at..at + 16].fill(0.0);
    band.log_odds[at_band..at_band + 16].fill(0.0);
}

/// The log-odds of a piece.
#[inline(always)]
fn known_of<L: Lanes>(tile: Option<&Tile>, piece: &Piece) -> L {
    let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
    match tile {
        Some(tile) => L::load_some(&tile.log_odds[first..first + cells]),
        None => L::splat(f32::NAN),
    }
}

/// p of cells of these log-odds.
#[inline(always)]
fn occupied<L: Lanes>(known: L, profile: &Profile) -> L {
    let evidence = known.or(L::splat(profile.limits.prior)).add(L::splat(profile.cone.prior_log_odds as f32));
    let against = L::splat(0.0).sub(evidence).at_most(L::splat(80.0)).at_least(L::splat(-80.0));
    reciprocal(exp(against).add(L::splat(1.0)))
}

/// Π (1 − a), as sixteen products whatever the number of lanes, multiplied one by one in the end.
#[inline(always)]
pub(super) fn product_of_rests<L: Lanes>(probabilities: &[f32], count: usize) -> f64 {
    let mut products = [1.0f32; 16];
    for (first, lanes) in products.chunks_mut(L::COUNT).enumerate() {
        let mut product = L::splat(1.0);
        for at in (0..count).step_by(16) {
            let a = L::load(&probabilities[at + first * L::COUNT..]);
            product = product.mul(L::splat(1.0).sub(a));
        }
        product.store(lanes);
    }
    products.iter().fold(1.0, |product, lane| product * f64::from(*lane))
}

/// r, a and L of the cells around the echo.
#[inline(always)]
fn weigh_band<L: Lanes>(scratch: &mut Scratch, profile: &Profile, range_m: f64) {
    let Scratch { places, band, along, .. } = scratch;
    let count = band.count;
    make_room(&mut band.answers, count);
    make_room(&mut band.probabilities, count);
    along.make_room(count);
    let wide = Wide::<L>::new(&profile.geometry);
    let likelihood = Likelihood::<L>::new(range_m, profile.cone.reading.sigma_z_m);
    for at in (0..count).step_by(L::COUNT) {
        let places = places.places(at, &profile.geometry, range_m);
        let angular = wide.angular(places.across, places.square);
        places.beyond.store(&mut along.beyond[at..]);
        let r = L::splat(profile.cone.reading.detection as f32).mul(angular);
        r.store(&mut band.answers[at..]);
        r.mul(occupied(L::load(&band.log_odds[at..]), profile)).store(&mut band.probabilities[at..]);
        likelihood.of(&places).store(&mut along.own[at..]);
    }
}

/// What the cells around the echo gain.
#[inline(always)]
fn fill_band_gains<L: Lanes>(scratch: &mut Scratch, profile: &Profile) {
    let Scratch { band, along, .. } = scratch;
    let (nobodys, one) = (L::splat(profile.cone.nobodys() as f32), L::splat(1.0));
    let weight = L::splat(profile.cone.weight as f32);
    for at in (0..band.count).step_by(L::COUNT) {
        let (r, a) = (L::load(&band.answers[at..]), L::load(&band.probabilities[at..]));
        let behind = L::load(&along.after[at..]).div(one.sub(a));
        let others = L::load(&along.before[at..]).add(nobodys).add(behind);
        let x = r.mul(L::load(&along.own[at..]).sub(behind)).div(others);
        ln_1p(x).mul(weight).store(&mut band.log_odds[at..]);
    }
}

/// What the cells in front of the echo gain.
#[inline(always)]
fn fill_front_gains<L: Lanes>(scratch: &mut Scratch, profile: &Profile, total: f64) {
    let Scratch { front, .. } = scratch;
    make_room(&mut front.log_odds, front.count);
    // x = −r T' / (c + T') with T' = T / (1 − a)
    let nobodys = profile.cone.nobodys();
    let (all, nobodys) = (L::splat((nobodys + total) as f32), L::splat(nobodys as f32));
    let (total, weight) = (L::splat(-total as f32), L::splat(profile.cone.weight as f32));
    for at in (0..front.count).step_by(L::COUNT) {
        let (r, a) = (L::load(&front.answers[at..]), L::load(&front.probabilities[at..]));
        let others = a.neg_mul_add(nobodys, all);
        let gain = match &profile.series {
            Some(series) => {
                let x = r.mul(total).mul(reciprocal(others));
                x.mul(polynomial(&splat_all(series), x))
            }
            None => ln_1p(r.mul(total).div(others)),
        };
        gain.mul(weight).store(&mut front.log_odds[at..]);
    }
}

/// Adds what the cells gain to the grid.
#[inline(always)]
fn store<L: Lanes>(scratch: &Scratch, profile: &Profile, place: &mut Place<'_>) {
    let Scratch { layout, front, band, .. } = scratch;
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    let limits = WideLimits::<L>::new(profile.limits);
    for pieces in &layout.tiles {
        let tile = place.tile(pieces.index);
        for piece in layout.front.between(from.0, pieces.front) {
            let cells = usize::from(piece.cells);
            limits.add_gain(cells_of(tile, piece), L::load(&front.log_odds[at..]));
            at += cells;
        }
        for piece in layout.band.between(from.1, pieces.band) {
            let cells = usize::from(piece.cells);
            limits.add_gain(cells_of(tile, piece), L::load(&band.log_odds[at_band..]));
            at_band += cells;
        }
        from = (pieces.front, pieces.band);
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
            let mut kernel = FirstEchoKernel { width, ..FirstEchoKernel::new(0.0, 8.0) };
            for k in 0..500u32 {
                let aperture_rad = if k % 3 == 0 { 0.003 } else { 0.02 + 0.002 * f64::from(k) };
                let reading = FirstEcho {
                    range_m: (k % 7 > 0).then(|| 0.3 + 0.008 * f64::from(k)),
                    sigma_z_m: 0.02 + 0.003 * f64::from(k % 100),
                    sigma_theta_rad: aperture_rad,
                    detection: if k % 5 == 0 { 0.6 } else { 0.2 },
                    clutter: 0.4,
                    range_cap_m: 5.0,
                    lost: 0.5,
                };
                let leaves_gaps = k % 3 == 0;
                let cone = EchoCone { reading, aperture_rad, prior_log_odds: -4.6, weight: 0.9, leaves_gaps };
                let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
                assert!(kernel.add(&mut grid, pose, &cone, 1).is_ok());
            }
            grid
        });
        assert_alike(&maps.collect::<Vec<_>>());
    }
}
