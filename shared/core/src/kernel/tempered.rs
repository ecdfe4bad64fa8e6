//! What a reading that counts only in part says: y = 1 + r x to the power of its weight.
//!
//! y^w = (2^n)^w m^w with m from 1 to 2: one number of a table, times a polynomial.

use super::chosen::{PLACES, Table};
use super::fit::Fitter;
use super::functions::polynomial_in_halves;
use super::lanes::Lanes;

/// Coefficients of m^w.
const WITHIN: usize = 6;
/// The place of the octave that begins with 1.
const ONE: usize = PLACES - 1;

/// y^w of a weight, for y from 2^-31 to 1.
#[derive(Debug, Clone)]
pub(super) struct Tempered {
    weight: f64,
    /// (2^n)^w, at the place that the lowest bits of the exponent tell.
    octaves: Table,
    /// m^w, in powers of m − 1.
    within: [f32; WITHIN],
    fitter: Fitter<WITHIN>,
    /// ln m of the nodes.
    logarithms: [f64; WITHIN],
}

impl Default for Tempered {
    fn default() -> Self {
        // With both ends among them, so that nothing jumps from octave to octave and 1 stays 1.
        let nodes = core::array::from_fn(|k| {
            let angle = core::f64::consts::PI * k as f64 / (WITHIN - 1) as f64;
            0.5 * (1.0 - libm::cos(angle))
        });
        Self {
            weight: f64::NAN,
            octaves: Table::default(),
            within: [0.0; WITHIN],
            fitter: Fitter::over(&nodes),
            logarithms: nodes.map(libm::log1p),
        }
    }
}

impl Tempered {
    /// To a weight in [0, 1]; the same as before costs nothing.
    pub(super) fn turn_to(&mut self, weight: f64) {
        if self.weight.to_bits() == weight.to_bits() {
            return;
        }
        self.weight = weight;
        let values = self.logarithms.map(|ln| libm::exp(weight * ln));
        self.within = self.fitter.through(&values).map(|coefficient| coefficient as f32);
        let octave = libm::exp(-weight * core::f64::consts::LN_2);
        let mut power = 1.0;
        for place in (0..=ONE).rev() {
            self.octaves.0[place] = power as f32;
            power *= octave;
        }
    }

    /// w.
    pub(super) fn weight(&self) -> f32 {
        self.weight as f32
    }

    /// y^w, to within 1e-5 of it; y no less than 2^-31 and no greater than 1.
    #[inline(always)]
    pub(super) fn of<L: Lanes>(&self, y: L) -> L {
        let (exponent, mantissa) = y.split();
        let above = mantissa.sub(L::splat(1.0));
        let within = polynomial_in_halves(&self.within, above, above.mul(above));
        exponent.pick(&self.octaves).mul(within)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Portable;
    use super::*;

    #[test]
    fn is_the_power_and_leaves_one_as_it_is() {
        let mut tempered = Tempered::default();
        let of = |tempered: &Tempered, y: f32| {
            let mut out = [0.0; 8];
            tempered.of(Portable::splat(y)).store(&mut out);
            f64::from(out[0])
        };
        for weight in [0.0, 1e-6, 0.05, 0.3, 0.5, 0.77, 0.999] {
            tempered.turn_to(weight);
            assert_eq!(of(&tempered, 1.0), 1.0);
            for step in 0..=30_000 {
                let y = libm::exp2f(-f32::from(step as u16) / 1000.0);
                let expected = libm::pow(f64::from(y), weight);
                assert!((of(&tempered, y) / expected - 1.0).abs() < 1e-5, "{y}^{weight}");
            }
        }
    }
}
