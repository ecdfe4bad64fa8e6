//! One reading of the oriented model, over the cells of its cone.

use super::along::{Along, Likelihood};
use super::first_echo::product_of_rests;
use super::functions::{reciprocal, reciprocal_root};
use super::geometry::{Band, Places, Wide, make_room};
use super::lanes::Lanes;
use super::layout::{Beam, Layout, Piece};
use super::oriented_answers::Answers;
use super::oriented_cells::{Profile, Wides, each_direction, states_of};
use super::oriented_settled::settle;
use super::wide::Work;
use super::{Apex, Place};
use crate::grid::{TILE_CELLS, TILE_SIDE};
use crate::oriented::{DIRECTIONS, STATES};
use crate::shares::{SLACK, Shares};

/// What is known of the cells of the cone at hand; kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
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
    responses: Responses,
    /// sin φ / sin ½β, then x.
    givens: Vec<f32>,
    /// What a is a share of, then what the states sum up to, then the log-odds.
    sums: Vec<f32>,
    /// a
    probabilities: Vec<f32>,
}

/// The cells around the echo, in the order of the layout.
#[derive(Debug, Clone, Default)]
struct BandCells {
    log_odds: Vec<f32>,
    codes: [Vec<u16>; STATES],
    responses: Responses,
    /// a
    probabilities: Vec<f32>,
}

/// r of the walls that answer, vector by vector: those of the first direction, then those of the next.
#[derive(Debug, Clone, Default)]
struct Responses {
    numbers: Vec<f32>,
}

impl Responses {
    fn make_room<L: Lanes>(&mut self, vectors: usize) {
        make_room(&mut self.numbers, vectors * DIRECTIONS * L::COUNT);
    }

    /// Of a vector.
    #[inline(always)]
    fn of<L: Lanes>(&self, vector: usize) -> &[f32] {
        &self.numbers[vector * DIRECTIONS * L::COUNT..][..DIRECTIONS * L::COUNT]
    }

    #[inline(always)]
    fn of_mut<L: Lanes>(&mut self, vector: usize) -> &mut [f32] {
        &mut self.numbers[vector * DIRECTIONS * L::COUNT..][..DIRECTIONS * L::COUNT]
    }
}
/// Adding a reading to a grid.
pub(super) struct Weighing<'a> {
    pub(super) scratch: &'a mut Scratch,
    pub(super) answers: &'a mut Answers,
    pub(super) profile: &'a Profile<'a>,
    pub(super) beam: Beam,
    pub(super) apex: Apex,
    pub(super) place: Place<'a>,
}

impl Work for Weighing<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { scratch, answers, profile, beam, apex, mut place } = self;
        let cone = &profile.cone;
        answers.turn_to(beam.direction_rad, beam.aperture_rad, cone.detection);
        let answers = &*answers;
        scratch.layout.lay_out::<L>(&beam, &apex, &profile.geometry);
        let wide = Wides::<L>::new(profile, answers);
        look_up::<L>(scratch, profile, &wide, &mut place);
        // Nothing in front of the echo answered
        let unanswered = product_of_rests::<L>(&scratch.front.probabilities, scratch.front.count);
        let mut total = (1.0 - cone.reading.lost) * unanswered;
        if let Some(range_m) = cone.reading.range_m {
            scratch.places.fill::<L>(&scratch.layout);
            let wide = wide.around_the_echo();
            weigh_band::<L>(scratch, profile, &wide, range_m);
            let squares = (beam.near_m.max(0.0), beam.far_m);
            let limits = (squares.0 * squares.0 - range_m * range_m, squares.1 * squares.1 - range_m * range_m);
            total = scratch.along.sum::<L>(&scratch.band.probabilities[..scratch.places.count], unanswered, limits);
            move_band::<L>(scratch, &wide);
        }
        store::<L>(scratch, profile, &wide, total, &mut place);
    }
}
/// sin φ / sin ½β of cells at these distances squared, so far across the axis (scaled).
#[inline(always)]
fn aside<L: Lanes>(square: L, across: L) -> L {
    across.mul(reciprocal_root(square))
}
/// a of the cells in front of the echo, and what is known of those around it.
#[inline(always)]
fn look_up<L: Lanes>(scratch: &mut Scratch, profile: &Profile<'_>, wides: &Wides<'_, L>, place: &mut Place<'_>) {
    let Scratch { layout, front, band, .. } = scratch;
    let FrontCells { responses, givens, sums, probabilities, .. } = front;
    let room_in_front = layout.front.room::<L>();
    for numbers in [&mut *givens, &mut *sums, &mut *probabilities] {
        make_room(numbers, room_in_front);
    }
    responses.make_room::<L>(room_in_front / L::COUNT);
    lay_aside::<L>(layout, profile, givens);
    let room = layout.band.room::<L>();
    for codes in &mut band.codes {
        if codes.len() < room + 32 {
            codes.resize(room + 32, 0);
        }
    }
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    for pieces in &layout.tiles {
        let [of_front, of_band] =
            [layout.front.between(from.0, pieces.front), layout.band.between(from.1, pieces.band)];
        let (shares, log_odds) = place.states(pieces.index);
        settle::<L>(wides, [of_front, of_band], shares, log_odds);
        for (vector, piece) in (from.0..).zip(of_front) {
            let values = states_of::<L>(shares, usize::from(piece.offset));
            let (answered, of) = wides.answering(&values, L::load(&givens[at..]), responses.of_mut::<L>(vector));
            answered.store(&mut probabilities[at..]);
            of.store(&mut sums[at..]);
            at += usize::from(piece.cells);
        }
        for piece in of_band {
            let row = shares.row(usize::from(piece.offset));
            for (state, to) in band.codes.iter_mut().enumerate() {
                to[at_band..at_band + SLACK].copy_from_slice(&row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
            }
            at_band += usize::from(piece.cells);
        }
        from = (pieces.front, pieces.band);
    }
    for at in (0..at).step_by(L::COUNT) {
        L::load(&probabilities[at..]).mul(reciprocal(L::load(&sums[at..]))).store(&mut probabilities[at..]);
    }
    // The last vector may reach beyond them: nothing that answers.
    probabilities[at..at + 16].fill(0.0);
    front.count = at;
    for codes in &mut band.codes {
        codes[at_band..at_band + 16].copy_from_slice(&Shares::ones());
    }
}

/// How far the cells in front of the echo lie from the axis. Where little is computed of a cell at a time the processor works at
/// many cells at once; so what takes long one after the other stands in loops of its own.
#[inline(always)]
fn lay_aside<L: Lanes>(layout: &Layout, profile: &Profile<'_>, asides: &mut [f32]) {
    let wide = Wide::<L>::new(&profile.geometry);
    let (mut from, mut at) = (0, 0);
    for pieces in &layout.tiles {
        let wide = wide.on_axis(pieces.is_ray);
        for piece in layout.front.between(from, pieces.front) {
            let (square, across) = wide.places(pieces.column(*piece), &layout.places[pieces.place(*piece)]);
            // What is written beyond the end of a piece, the next one overwrites.
            aside(square, across).store(&mut asides[at..]);
            at += usize::from(piece.cells);
        }
        from = pieces.front;
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
fn weigh_band<L: Lanes>(scratch: &mut Scratch, profile: &Profile<'_>, wides: &Wides<'_, L>, range_m: f64) {
    let Scratch { places, band, along, .. } = scratch;
    let count = places.count;
    band.responses.make_room::<L>(count.div_ceil(L::COUNT));
    make_room(&mut band.probabilities, count);
    make_room(&mut band.log_odds, count);
    along.make_room(count);
    let likelihood = Likelihood::<L>::new(range_m, profile.cone.reading.sigma_z_m);
    for at in (0..count).step_by(L::COUNT) {
        let places: Places<L> = places.places(at, &profile.geometry, range_m);
        let aside = aside(places.square, places.across);
        places.beyond.store(&mut along.beyond[at..]);
        let values = band.states::<L>(at);
        let (answered, of) = wides.answering(&values, aside, band.responses.of_mut::<L>(at / L::COUNT));
        answered.mul(reciprocal(of)).store(&mut band.probabilities[at..]);
        likelihood.of(&places).store(&mut along.own[at..]);
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
        wides.move_states(&mut values, band.responses.of::<L>(at / L::COUNT), x);
        wides.log_odds(wides.sum(&values)).store(&mut band.log_odds[at..]);
        for (value, codes) in values.into_iter().zip(&mut band.codes) {
            value.store_codes(L::COUNT, &mut codes[at..]);
        }
    }
}

/// Writes to the grid what the cells become.
#[inline(always)]
fn store<L: Lanes>(
    scratch: &mut Scratch,
    profile: &Profile<'_>,
    wides: &Wides<'_, L>,
    total: f64,
    place: &mut Place<'_>,
) {
    let Scratch { layout, front, band, .. } = scratch;
    let FrontCells { count, responses, givens, sums, probabilities } = front;
    // x = −T' / (c + T') with T' = T / (1 − a)
    let all = L::splat((profile.cone.nobodys() + total) as f32);
    let minus_total = L::splat(-total as f32);
    for at in (0..*count).step_by(L::COUNT) {
        let others = L::load(&probabilities[at..]).neg_mul_add(wides.nobodys, all);
        minus_total.mul(reciprocal(others)).store(&mut givens[at..]);
    }
    let (mut from, mut at, mut at_band) = ((0, 0), 0, 0);
    for pieces in &layout.tiles {
        let [of_front, of_band] =
            [layout.front.between(from.0, pieces.front), layout.band.between(from.1, pieces.band)];
        let (shares, log_odds) = place.states(pieces.index);
        let (begun, mut touched) = (at, 0);
        for (vector, piece) in (from.0..).zip(of_front) {
            let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
            touched |= Shares::blocks(first, cells);
            let mut values = states_of::<L>(shares, first);
            wides.move_states(&mut values, responses.of::<L>(vector), L::load(&givens[at..]));
            wides.sum(&values).store(&mut sums[at..]);
            let row = shares.row_mut(first);
            values[0].store_codes(cells, &mut row[..SLACK]);
            each_direction!(direction, {
                if wides.answers(direction) {
                    let state = 1 + direction;
                    values[state].store_codes(cells, &mut row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
                }
            });
            at += cells;
        }
        for at in (begun..at).step_by(L::COUNT) {
            wides.log_odds(L::load(&sums[at..])).store(&mut sums[at..]);
        }
        store_log_odds::<L>(of_front, &sums[begun..], log_odds);
        store_log_odds::<L>(of_band, &band.log_odds[at_band..], log_odds);
        for piece in of_band {
            let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
            touched |= Shares::blocks(first, cells);
            let row = shares.row_mut(first);
            for (codes, to) in band.codes.iter().zip(row.chunks_mut(TILE_SIDE)) {
                L::load_codes(&codes[at_band..]).store_codes(cells, &mut to[..SLACK]);
            }
            at_band += cells;
        }
        shares.touch(touched);
        from = (pieces.front, pieces.band);
    }
}

/// Writes the log-odds of some pieces of a tile, one after the other.
#[inline(always)]
fn store_log_odds<L: Lanes>(pieces: &[Piece], mut from: &[f32], log_odds: &mut [f32; TILE_CELLS]) {
    for piece in pieces {
        let (first, cells) = (usize::from(piece.offset), usize::from(piece.cells));
        L::load(from).store_some(&mut log_odds[first..first + cells]);
        from = &from[cells..];
    }
}
