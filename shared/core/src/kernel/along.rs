//! The cells around an echo in the order of their distance, and what the sums along the cone make of them.

use super::first_echo::peak;
use super::functions::exp;
use super::geometry::{Places, make_room};
use super::lanes::Lanes;
use super::order::Order;

/// L of the cells around an echo.
#[derive(Clone, Copy)]
pub(super) struct Likelihood<L> {
    range: L,
    /// √½ / σ_z.
    steepness: L,
    peak: L,
}

impl<L: Lanes> Likelihood<L> {
    #[inline(always)]
    pub(super) fn new(range_m: f64, sigma_z_m: f64) -> Self {
        Self {
            range: L::splat(range_m as f32),
            steepness: L::splat((core::f64::consts::FRAC_1_SQRT_2 / sigma_z_m) as f32),
            peak: L::splat(peak(sigma_z_m) as f32),
        }
    }

    #[inline(always)]
    pub(super) fn of(&self, places: &Places<L>) -> L {
        let off = places.off(self.range, self.steepness);
        let exponent = L::splat(0.0).sub(off.mul(off)).at_least(L::splat(-80.0));
        self.peak.mul(exp(exponent))
    }
}

/// Sums along a cone; kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Along {
    order: Order,
    /// Of each cell L, then S L.
    pub(super) own: Vec<f32>,
    /// d² − z².
    pub(super) beyond: Vec<f32>,
    /// B.
    pub(super) before: Vec<f32>,
    /// A.
    pub(super) after: Vec<f32>,
    /// B and what the cell adds to it.
    until: Vec<[f64; 2]>,
}

impl Along {
    /// For so many cells, of which L and d² − z² are to be written.
    pub(super) fn make_room(&mut self, count: usize) {
        make_room(&mut self.own, count);
        make_room(&mut self.beyond, count);
    }

    /// S and B along the cone, then A, of cells with `probabilities` a, before which nothing has answered with probability
    /// `unanswered`; what the echo comes from in all. `limits`: of d² − z².
    #[inline(always)]
    pub(super) fn sum<L: Lanes>(&mut self, probabilities: &[f32], unanswered: f64, limits: (f64, f64)) -> f64 {
        let Self { order, own, beyond, before, after, until } = self;
        let count = probabilities.len();
        make_room(before, count);
        make_room(after, count);
        if until.len() < count {
            until.resize(count, [0.0; 2]);
        }
        let (mut unanswered, mut total) = (unanswered, 0.0);
        let (own, until) = (&mut own[..count], &mut until[..count]);
        for place in order.of::<L>(&beyond[..count], limits.0 as f32, limits.1 as f32) {
            let index = *place as usize;
            let a = f64::from(probabilities[index]);
            let likely = unanswered * f64::from(own[index]);
            own[index] = likely as f32;
            until[index] = [total, a * likely];
            total += a * likely;
            unanswered *= 1.0 - a;
        }
        for ((before, after), [until, own]) in before.iter_mut().zip(after.iter_mut()).zip(&*until) {
            let behind = (total - until) - own;
            *before = *until as f32;
            *after = if behind > 0.0 { behind as f32 } else { 0.0 };
        }
        total
    }
}
