//! Of which states the cells of a cone may be, and what a reading makes of them: as many cells at once as the processor can.

use super::functions::{exp, ln, ln_1p};
use super::geometry::Geometry;
use super::lanes::Lanes;
use super::oriented::{OrientedCone, States};
use super::oriented_answers::Answers;
use super::tempered::Tempered;
use crate::grid::TILE_SIDE;
use crate::oriented::{DIRECTIONS, STATES};
use crate::shares::{SLACK, Shares};

/// Does the same for each direction, one after the other: a loop would keep the states of cells in memory.
macro_rules! each_direction {
    ($direction:ident, $what:block) => {
        each_direction!($direction, $what, 0, 1, 2, 3, 4, 5, 6, 7)
    };
    ($direction:ident, $what:block, $($number:literal),*) => {
        $({
            let $direction: usize = $number;
            $what
        })*
    };
}
const _: () = assert!(DIRECTIONS == 8, "as many as `each_direction`");

pub(super) use each_direction;

/// What the cells of a reading have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile<'a> {
    pub(super) geometry: Geometry,
    pub(super) cone: OrientedCone,
    pub(super) states: States,
    /// None: its weight is 1.
    pub(super) tempered: Option<&'a Tempered>,
}
/// What y = 1 + x may be.
#[derive(Clone, Copy)]
enum Gain<'a> {
    /// No more than 1, in front of the echo; how it is tempered unless its weight is 1.
    Below1(Option<&'a Tempered>),
    Any,
}

/// What all cells of a reading need, in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Wides<'a, L> {
    answers: &'a Answers,
    /// The walls that answer: a bit for each direction.
    facing_walls: u8,
    /// r of what does not mirror.
    response: L,
    start: L,
    max: L,
    min: L,
    diffuse: L,
    facing: L,
    least: L,
    pub(super) most: L,
    /// e^−(l0 + prior): how much more probable a cell is free than occupied, before any reading.
    free: L,
    /// Likewise of a cell that is as surely occupied, and as surely free, as any, by what the states of it come to.
    free_at_ends: [L; 2],
    pub(super) nobodys: L,
    /// None: 1.
    weight: Option<L>,
    gain: Gain<'a>,
    /// None: infinitely many.
    looks: Option<L>,
    draw: u32,
}

impl<'a, L: Lanes> Wides<'a, L> {
    #[inline(always)]
    pub(super) fn new(profile: &Profile<'a>, answers: &'a Answers) -> Self {
        let Profile { cone, states, tempered, .. } = *profile;
        let free = libm::exp(-f64::from(states.start) - cone.prior_log_odds);
        // l − l0 is within ± l_max − l0.
        let at_end = |max: f32| L::splat((free * libm::exp(f64::from(states.start - max))) as f32);
        Self {
            answers,
            facing_walls: answers.in_front(),
            response: L::splat(answers.diffuse()),
            start: L::splat(states.start),
            max: L::splat(states.max),
            min: L::splat(-states.max),
            diffuse: L::splat(states.diffuse),
            facing: L::splat(states.facing),
            least: L::splat(states.least),
            most: L::splat(states.most),
            free: L::splat(free as f32),
            free_at_ends: [at_end(states.max), at_end(-states.max)],
            nobodys: L::splat(cone.nobodys() as f32),
            weight: tempered.map(|tempered| L::splat(tempered.weight())),
            gain: Gain::Below1(tempered),
            looks: cone.looks.is_finite().then(|| L::splat(cone.looks as f32)),
            draw: cone.draw & crate::shares::CUT,
        }
    }

    /// Of cells around the echo: walls that hardly answer count, and x may be far above 0.
    #[inline(always)]
    pub(super) fn around_the_echo(self) -> Self {
        Self { facing_walls: self.answers.facing(), gain: Gain::Any, ..self }
    }

    /// Whether walls of this direction answer.
    #[inline(always)]
    pub(super) fn answers(&self, direction: usize) -> bool {
        self.facing_walls >> direction & 1 == 1
    }

    /// Σ of the states, each as probable as it was before any reading.
    #[inline(always)]
    pub(super) fn sum(&self, values: &[L; STATES]) -> L {
        let [diffuse, a, b, c, d, e, f, g, h] = *values;
        let facing = a.add(b).add(c.add(d)).add(e.add(f).add(g.add(h)));
        facing.mul(self.facing).add(diffuse.mul(self.diffuse))
    }

    /// What answers of cells with these states, at `aside` across the axis, and what a is when it is divided by; their r go into
    /// `responses`.
    #[inline(always)]
    pub(super) fn answering(&self, values: &[L; STATES], aside: L, responses: &mut [f32]) -> (L, L) {
        let square = aside.mul(aside);
        let mut facing = L::splat(0.0);
        each_direction!(direction, {
            if self.answers(direction) {
                let r = self.answers.at(direction, aside, square);
                r.store(&mut responses[direction * L::COUNT..(direction + 1) * L::COUNT]);
                facing = values[1 + direction].mul_add(r, facing);
            }
        });
        let answered = facing.mul(self.facing).add(values[0].mul(self.diffuse).mul(self.response));
        // The log-odds are ln of the sum, within their limits.
        let sum = self.sum(values);
        let [occupied, free] = self.free_at_ends;
        let against = self.free.at_least(sum.mul(occupied)).at_most(sum.mul(free));
        (answered, sum.add(against))
    }

    /// What the states of cells become, in place, that the reading says `x` of.
    #[inline(always)]
    pub(super) fn move_states(&self, values: &mut [L; STATES], responses: &[f32], x: L) {
        values[0] = self.coded(self.gained(values[0], self.response.mul(x)));
        each_direction!(direction, {
            if self.answers(direction) {
                let (value, r) =
                    (values[1 + direction], L::load(&responses[direction * L::COUNT..(direction + 1) * L::COUNT]));
                let gained = self.gained(value, r.mul(x));
                values[1 + direction] = self.coded(match self.looks {
                    None => gained,
                    Some(looks) => gained.at_least(value.at_most(left_by(looks.mul(r)))),
                });
            }
        });
    }

    /// Such that it has a code. What has one stays as it is.
    #[inline(always)]
    pub(super) fn coded(&self, value: L) -> L {
        value.at_least(self.least).coded(self.draw)
    }

    /// The value times (1 + x) to the power of the weight; no more than may be.
    #[inline(always)]
    pub(super) fn gained(&self, value: L, x: L) -> L {
        let y = x.add(L::splat(1.0));
        match (self.gain, self.weight) {
            (Gain::Below1(None), _) => value.mul(y),
            (Gain::Below1(Some(tempered)), _) => value.mul(tempered.of(y)),
            (Gain::Any, None) => value.mul(y).at_most(self.most),
            (Gain::Any, Some(weight)) => value.mul(exp(ln_1p(x).mul(weight))).at_most(self.most),
        }
    }

    /// Of what the states sum up to.
    #[inline(always)]
    pub(super) fn log_odds(&self, sum: L) -> L {
        ln(sum).add(self.start).at_least(self.min).at_most(self.max)
    }
}

/// What looks leave of a wall, of n r: as [`crate::oriented::left_by_looks`], or a number below 0.
#[inline(always)]
pub(super) fn left_by<L: Lanes>(answers: L) -> L {
    answers.neg_mul_add(answers, L::splat(1.0))
}

/// The states of cells of a tile from `offset` on.
#[inline(always)]
pub(super) fn states_of<L: Lanes>(shares: &Shares, offset: usize) -> [L; STATES] {
    let mut values = [L::splat(1.0); STATES];
    let row = shares.row(offset);
    for (state, value) in values.iter_mut().enumerate() {
        *value = L::load_codes(&row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
    }
    values
}
