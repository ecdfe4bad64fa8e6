//! The fast way to the numbers of [`crate::oriented`].
//!
//! As in `first_echo.rs`, of the cells in front of the echo S counts only as a product, and only those around it are sorted. What is
//! known of the states of a cell lies in its tile ([`crate::shares`]); its log-odds are what they come to. Where somebody else has
//! moved the log-odds since (a lidar, by a rule of its own; the robot, by being there), all states are moved alike first.
//!
//! **Bound.** Of the cells of the cone nearer than the end and r_cap, and only of these, each state gains what [`Oriented::gains`]
//! says, times the weight, to within [`ORIENTED_BOUND`] and what the code of a state is rounded by. Of two cells whose distances differ
//! by less than 1e-6 of them either may come first.

use super::along::Along;
use super::first_echo::{BEFORE, FINEST_SIGMA_Z_M, LEFT_OUT, peak, product_of_rests};
use super::functions::{exp, ln, ln_1p, reciprocal, reciprocal_root};
use super::geometry::{ANGLE, Band, Geometry, Wide, make_room};
use super::lanes::Lanes;
use super::layout::{Beam, Layout, Piece};
use super::oriented_answers::{Answers, Facing};
use super::wide::{Width, Work};
use super::{Apex, OffMap, Place, cells_around};
use crate::first_echo::BEHIND;
use crate::grid::{CellIndex, Grid, TILE_SIDE, Tile};
use crate::oriented::{DIRECTIONS, FacedCell, Oriented, STATES, left_by_looks};
use crate::pose::Pose2;
use crate::shares::{CUT, LEAST, MOST, SLACK, Shares};

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
    fn nobodys(&self) -> f64 {
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
struct States {
    /// l0.
    start: f32,
    /// l_max.
    max: f32,
    /// How probable each state is before any reading, if the cell is occupied: diffuse, and each direction.
    diffuse: f32,
    facing: f32,
    /// Within what each state stays.
    least: f32,
    most: f32,
}

/// Adds readings to a grid by the oriented model. Allocates nothing once it has seen a cone as large as any to come and the grid has
/// the tiles.
#[derive(Debug, Clone)]
pub struct OrientedKernel {
    states: States,
    answers: Answers,
    scratch: Scratch,
    width: Width,
}

/// What is known of the cells of the cone at hand; kept for its memory.
#[derive(Debug, Clone, Default)]
struct Scratch {
    layout: Layout,
    places: Band,
    front: FrontCells,
    band: BandCells,
    along: Along,
}

/// The cells in front of the echo, in the order of the layout.
#[derive(Debug, Clone, Default)]
struct FrontCells {
    count: usize,
    /// a
    probabilities: Vec<f32>,
    /// r of the walls that answer.
    responses: [Vec<f32>; DIRECTIONS],
}

/// The cells around the echo, in the order of the layout.
#[derive(Debug, Clone, Default)]
struct BandCells {
    log_odds: Vec<f32>,
    codes: [Vec<u16>; STATES],
    /// r of the walls that answer.
    responses: [Vec<f32>; DIRECTIONS],
    /// a
    probabilities: Vec<f32>,
}

/// What the cells of a reading have in common.
#[derive(Debug, Clone, Copy)]
struct Profile {
    geometry: Geometry,
    cone: OrientedCone,
    states: States,
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
        self.answers.turn_to(axis_rad, cone.aperture_rad, cone.detection);
        let geometry = Geometry::new(resolution_m, &apex, axis_rad, cone.aperture_rad, [0.0; ANGLE]);
        let beam = Beam {
            direction_rad: axis_rad,
            aperture_rad: cone.aperture_rad,
            near_m: cone.near_m(),
            far_m: cone.far_m(),
            leaves_gaps: cone.leaves_gaps,
        };
        let profile = Profile { geometry, cone: *cone, states: self.states };
        let (scratch, answers) = (&mut self.scratch, &self.answers);
        self.width.run(Weighing { scratch, profile: &profile, answers, beam, apex, place });
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
        core::array::from_fn(|s| libm::log(self.prior(s) * f64::from(values[s])) + moved)
    }
}

/// Adding a reading to a grid.
struct Weighing<'a> {
    scratch: &'a mut Scratch,
    profile: &'a Profile,
    answers: &'a Answers,
    beam: Beam,
    apex: Apex,
    place: Place<'a>,
}

impl Work for Weighing<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { scratch, profile, answers, beam, apex, mut place } = self;
        let cone = &profile.cone;
        scratch.layout.lay_out::<L>(&beam, &apex, &profile.geometry);
        let wide = Wides::<L>::new(profile, answers.diffuse(), answers.facing_in_front());
        look_up::<L>(scratch, profile, &wide, place.grid);
        // Nothing in front of the echo answered
        let unanswered = product_of_rests::<L>(&scratch.front.probabilities, scratch.front.count);
        let mut total = (1.0 - cone.reading.lost) * unanswered;
        if let Some(range_m) = cone.reading.range_m {
            scratch.places.fill::<L>(&scratch.layout);
            let wide = Wides::<L> { facing_walls: answers.facing(), ..wide };
            weigh_band::<L>(scratch, profile, &wide, range_m);
            let squares = (beam.near_m.max(0.0), beam.far_m);
            let limits = (squares.0 * squares.0 - range_m * range_m, squares.1 * squares.1 - range_m * range_m);
            total = scratch.along.sum(&scratch.band.probabilities[..scratch.places.count], unanswered, limits);
            move_band::<L>(scratch, &wide);
        }
        store::<L>(scratch, profile, &wide, total, &mut place);
    }
}

/// What all cells of a reading need, in all lanes.
#[derive(Clone, Copy)]
struct Wides<'a, L> {
    /// r of what does not mirror.
    response: L,
    /// The walls that answer.
    facing_walls: &'a [Facing],
    start: L,
    max: L,
    min: L,
    diffuse: L,
    facing: L,
    least: L,
    most: L,
    prior_log_odds: L,
    nobodys: L,
    /// None: 1.
    weight: Option<L>,
    /// None: infinitely many.
    looks: Option<L>,
    draw: u32,
}

impl<'a, L: Lanes> Wides<'a, L> {
    #[inline(always)]
    fn new(profile: &Profile, response: f32, facing_walls: &'a [Facing]) -> Self {
        let Profile { cone, states, .. } = profile;
        Self {
            response: L::splat(response),
            facing_walls,
            start: L::splat(states.start),
            max: L::splat(states.max),
            min: L::splat(-states.max),
            diffuse: L::splat(states.diffuse),
            facing: L::splat(states.facing),
            least: L::splat(states.least),
            most: L::splat(states.most),
            prior_log_odds: L::splat(cone.prior_log_odds as f32),
            nobodys: L::splat(cone.nobodys() as f32),
            weight: (cone.weight < 1.0).then(|| L::splat(cone.weight as f32)),
            looks: cone.looks.is_finite().then(|| L::splat(cone.looks as f32)),
            draw: cone.draw & crate::shares::CUT,
        }
    }

    /// Σ of the states, each as probable as it was before any reading.
    #[inline(always)]
    fn sum(&self, values: &[L; STATES]) -> L {
        let mut facing = values[1];
        for value in &values[2..] {
            facing = facing.add(*value);
        }
        facing.mul(self.facing).add(values[0].mul(self.diffuse))
    }

    /// a of cells with these states, at `aside` across the axis; their r go into `responses` from `at` on.
    #[inline(always)]
    fn answering(
        &self,
        values: &[L; STATES],
        known: L,
        aside: L,
        responses: &mut [Vec<f32>; DIRECTIONS],
        at: usize,
    ) -> L {
        let mut facing = L::splat(0.0);
        for (wall, responses) in self.facing_walls.iter().zip(responses) {
            let r = wall.at(aside);
            // What is written beyond the end of a piece, the next one overwrites.
            r.store(&mut responses[at..]);
            facing = values[wall.state].mul_add(r, facing);
        }
        let answered = facing.mul(self.facing).add(values[0].mul(self.diffuse).mul(self.response));
        let against = L::splat(0.0).sub(known.or(self.start).add(self.prior_log_odds));
        let against = exp(against.at_most(L::splat(80.0)).at_least(L::splat(-80.0)));
        answered.mul(reciprocal(against.add(L::splat(1.0)).mul(self.sum(values))))
    }

    /// What the states and the log-odds of the first `count` cells become, in place, that the reading says `x` of; whether all states
    /// were looked at, or only those that answer.
    #[inline(always)]
    fn moved(
        &self,
        values: &mut [L; STATES],
        known: L,
        (responses, at, count): (&[Vec<f32>; DIRECTIONS], usize, usize),
        x: L,
    ) -> (L, bool) {
        let now = self.log_odds(values);
        let is_moved = !known.are_none_or(now, count);
        if is_moved {
            // By somebody else
            let moved = exp(known.or(now).sub(now).at_most(L::splat(60.0)).at_least(L::splat(-60.0)));
            for value in values.iter_mut() {
                *value = value.mul(moved);
            }
        }
        values[0] = values[0].mul(self.gain(self.response.mul(x)));
        for (wall, responses) in self.facing_walls.iter().zip(responses) {
            let (value, r) = (values[wall.state], L::load(&responses[at..]));
            let gained = value.mul(self.gain(r.mul(x)));
            values[wall.state] = match self.looks {
                None => gained,
                Some(looks) => gained.at_least(value.at_most(left_by(looks.mul(r)))),
            };
        }
        if is_moved {
            for value in values.iter_mut() {
                *value = self.coded(*value);
            }
        } else {
            values[0] = self.coded(values[0]);
            for wall in self.facing_walls {
                values[wall.state] = self.coded(values[wall.state]);
            }
        }
        (self.log_odds(values), is_moved)
    }

    /// Within its limits, and such that it has a code. What has one stays as it is.
    #[inline(always)]
    fn coded(&self, value: L) -> L {
        value.at_least(self.least).at_most(self.most).coded(self.draw)
    }

    /// (1 + x) to the power of the weight.
    #[inline(always)]
    fn gain(&self, x: L) -> L {
        match self.weight {
            None => x.add(L::splat(1.0)),
            Some(weight) => exp(ln_1p(x).mul(weight)),
        }
    }

    #[inline(always)]
    fn log_odds(&self, values: &[L; STATES]) -> L {
        ln(self.sum(values)).add(self.start).at_least(self.min).at_most(self.max)
    }
}

/// What looks leave of a wall, of n r: as [`left_by_looks`], or a number below 0.
#[inline(always)]
fn left_by<L: Lanes>(answers: L) -> L {
    answers.neg_mul_add(answers, L::splat(1.0))
}

/// The states of cells of a tile from `offset` on.
#[inline(always)]
fn states_of<L: Lanes>(shares: Option<&Shares>, offset: usize) -> [L; STATES] {
    let mut values = [L::splat(1.0); STATES];
    if let Some(shares) = shares {
        let row = shares.row(offset);
        for (state, value) in values.iter_mut().enumerate() {
            *value = L::load_codes(&row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
        }
    }
    values
}

/// sin φ / sin ½β of cells at these distances squared, so far across the axis (scaled).
#[inline(always)]
fn aside<L: Lanes>(square: L, across: L) -> L {
    across.mul(reciprocal_root(square))
}

/// a of the cells in front of the echo, and what is known of those around it.
#[inline(always)]
fn look_up<L: Lanes>(scratch: &mut Scratch, profile: &Profile, wides: &Wides<'_, L>, grid: &Grid) {
    let Scratch { layout, front, band, .. } = scratch;
    make_room(&mut front.probabilities, layout.front.room::<L>());
    make_room_for_responses(&mut front.responses, wides, layout.front.room::<L>());
    let room = layout.band.room::<L>();
    make_room(&mut band.log_odds, room);
    for codes in &mut band.codes {
        if codes.len() < room + 32 {
            codes.resize(room + 32, 0);
        }
    }
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    let wide = Wide::<L>::new(&profile.geometry);
    let ones = Shares::ones();
    for pieces in &layout.tiles {
        let tile = grid.tile(pieces.index);
        let shares = tile.and_then(|tile| tile.shares.as_ref());
        let wide = wide.on_axis(pieces.is_ray);
        for piece in layout.front.between(from.0, pieces.front) {
            let (square, across) = wide.places(pieces.column(*piece), &layout.places[pieces.place(*piece)]);
            let first = usize::from(piece.offset);
            let known = known_of::<L>(tile, piece);
            let values = states_of::<L>(shares, first);
            let a = wides.answering(&values, known, aside(square, across), &mut front.responses, at);
            a.store(&mut front.probabilities[at..]);
            at += usize::from(piece.cells);
        }
        for piece in layout.band.between(from.1, pieces.band) {
            let first = usize::from(piece.offset);
            known_of::<L>(tile, piece).store(&mut band.log_odds[at_band..]);
            for (state, to) in band.codes.iter_mut().enumerate() {
                let codes = shares.map_or(&ones[..], |shares| &shares.row(first)[state * TILE_SIDE..]);
                to[at_band..at_band + SLACK].copy_from_slice(&codes[..SLACK]);
            }
            at_band += usize::from(piece.cells);
        }
        from = (pieces.front, pieces.band);
    }
    // The last vector may reach beyond them: nothing that answers.
    front.count = at;
    front.probabilities[at..at + 16].fill(0.0);
    band.log_odds[at_band..at_band + 16].fill(0.0);
    for codes in &mut band.codes {
        codes[at_band..at_band + 16].copy_from_slice(&ones);
    }
}

#[inline(always)]
fn known_of<L: Lanes>(tile: Option<&Tile>, piece: &Piece) -> L {
    let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
    // No closure: it would not be compiled for the same processor.
    match tile {
        Some(tile) => L::load_some(&tile.log_odds[first..first + cells]),
        None => L::splat(f32::NAN),
    }
}

#[inline(always)]
fn make_room_for_responses<L: Lanes>(responses: &mut [Vec<f32>; DIRECTIONS], wides: &Wides<'_, L>, count: usize) {
    for responses in &mut responses[..wides.facing_walls.len()] {
        make_room(responses, count);
    }
}

impl BandCells {
    #[inline(always)]
    fn states<L: Lanes>(&self, at: usize) -> [L; STATES] {
        let mut values = [L::splat(1.0); STATES];
        for (value, codes) in values.iter_mut().zip(&self.codes) {
            *value = L::load_codes(&codes[at..]);
        }
        values
    }
}

/// a and L of the cells around the echo.
#[inline(always)]
fn weigh_band<L: Lanes>(scratch: &mut Scratch, profile: &Profile, wides: &Wides<'_, L>, range_m: f64) {
    let Scratch { places, band, along, .. } = scratch;
    let count = places.count;
    make_room_for_responses(&mut band.responses, wides, count);
    make_room(&mut band.probabilities, count);
    along.make_room(count);
    let sigma_z_m = profile.cone.reading.sigma_z_m;
    let peak = L::splat(peak(sigma_z_m) as f32);
    let steepness = L::splat((core::f64::consts::FRAC_1_SQRT_2 / sigma_z_m) as f32);
    for at in (0..count).step_by(L::COUNT) {
        let places = places.places(at, &profile.geometry, range_m);
        let off = places.off(L::splat(range_m as f32), steepness);
        let aside = aside(places.square, places.across);
        places.beyond.store(&mut along.beyond[at..]);
        let values = band.states::<L>(at);
        let known = L::load(&band.log_odds[at..]);
        wides.answering(&values, known, aside, &mut band.responses, at).store(&mut band.probabilities[at..]);
        let exponent = L::splat(0.0).sub(off.mul(off)).at_least(L::splat(-80.0));
        peak.mul(exp(exponent)).store(&mut along.own[at..]);
    }
}

/// What the cells around the echo become.
#[inline(always)]
fn move_band<L: Lanes>(scratch: &mut Scratch, wides: &Wides<'_, L>) {
    let Scratch { places, band, along, .. } = scratch;
    let one = L::splat(1.0);
    for at in (0..places.count).step_by(L::COUNT) {
        let a = L::load(&band.probabilities[at..]);
        let behind = L::load(&along.after[at..]).div(one.sub(a));
        let others = L::load(&along.before[at..]).add(wides.nobodys).add(behind);
        let x = L::load(&along.own[at..]).sub(behind).div(others);
        let mut values = band.states::<L>(at);
        let known = L::load(&band.log_odds[at..]);
        let (log_odds, _) = wides.moved(&mut values, known, (&band.responses, at, L::COUNT), x);
        log_odds.store(&mut band.log_odds[at..]);
        for (value, codes) in values.into_iter().zip(&mut band.codes) {
            value.store_codes(L::COUNT, &mut codes[at..]);
        }
    }
}

/// Writes to the grid what the cells become.
#[inline(always)]
fn store<L: Lanes>(scratch: &Scratch, profile: &Profile, wides: &Wides<'_, L>, total: f64, place: &mut Place<'_>) {
    let Scratch { layout, front, band, .. } = scratch;
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    // x = −T' / (c + T') with T' = T / (1 − a)
    let all = L::splat((profile.cone.nobodys() + total) as f32);
    let minus_total = L::splat(-total as f32);
    for pieces in &layout.tiles {
        let tile = place.tile(pieces.index);
        let (shares, log_odds) = (tile.shares.get_or_insert_default(), &mut tile.log_odds);
        for piece in layout.front.between(from.0, pieces.front) {
            let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
            let others = L::load(&front.probabilities[at..]).neg_mul_add(wides.nobodys, all);
            let x = minus_total.mul(reciprocal(others));
            let mut values = states_of::<L>(Some(shares), first);
            let known = &mut log_odds[first..first + cells];
            let (now, are_all) = wides.moved(&mut values, L::load_some(known), (&front.responses, at, cells), x);
            now.store_some(known);
            let row = shares.row_mut(first);
            if are_all {
                for (state, value) in values.into_iter().enumerate() {
                    value.store_codes(cells, &mut row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
                }
            } else {
                values[0].store_codes(cells, &mut row[..SLACK]);
                for Facing { state, .. } in wides.facing_walls {
                    values[*state].store_codes(cells, &mut row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
                }
            }
            at += cells;
        }
        for piece in layout.band.between(from.1, pieces.band) {
            let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
            L::load(&band.log_odds[at_band..]).store_some(&mut log_odds[first..first + cells]);
            let row = shares.row_mut(first);
            for (codes, to) in band.codes.iter().zip(row.chunks_mut(TILE_SIDE)) {
                L::load_codes(&codes[at_band..]).store_codes(cells, &mut to[..SLACK]);
            }
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
