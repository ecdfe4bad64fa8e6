//! Functions of the models on [`Lanes`].

use super::lanes::{Lanes, WHOLE};

/// The polynomial of these coefficients of 1, x, x² … at x.
#[inline(always)]
pub(super) fn polynomial<L: Lanes, const N: usize>(coefficients: &[L; N], x: L) -> L {
    let mut sum = coefficients[N - 1];
    for n in (0..N - 1).rev() {
        sum = x.mul_add(sum, coefficients[n]);
    }
    sum
}

/// Likewise, of an even number of coefficients, too many to keep them in all lanes; in half the time where little else is to be
/// done meanwhile. `square` is x².
#[inline(always)]
pub(super) fn polynomial_in_halves<L: Lanes, const N: usize>(coefficients: &[f32; N], x: L, square: L) -> L {
    let (mut even, mut odd) = (L::splat(coefficients[N - 2]), L::splat(coefficients[N - 1]));
    for n in (0..N / 2 - 1).rev() {
        even = square.mul_add(even, L::splat(coefficients[2 * n]));
        odd = square.mul_add(odd, L::splat(coefficients[2 * n + 1]));
    }
    x.mul_add(odd, even)
}

/// All coefficients in all lanes.
#[inline(always)]
pub(super) fn splat_all<L: Lanes, const N: usize>(coefficients: &[f32; N]) -> [L; N] {
    let mut all = [L::splat(0.0); N];
    for n in 0..N {
        all[n] = L::splat(coefficients[n]);
    }
    all
}

/// 1/x to within 1e-6 of it, for normal x above 0.
#[inline(always)]
pub(super) fn reciprocal<L: Lanes>(x: L) -> L {
    let rough = x.rough_reciprocal();
    let off = x.neg_mul_add(rough, L::splat(1.0));
    // 1 / (1 − off) = 1 + off + off² + off³ …
    let more = off.mul_add(off, off);
    let rough = rough.mul_add(more, rough);
    let off = x.neg_mul_add(rough, L::splat(1.0));
    rough.mul_add(off, rough)
}

/// 1/√x to within 5e-6 of it, for normal x above 0.
#[inline(always)]
pub(super) fn reciprocal_root<L: Lanes>(x: L) -> L {
    let minus_half = x.mul(L::splat(-0.5));
    let mut root = x.rough_reciprocal_root();
    for _ in 0..2 {
        // Newton's step
        root = root.mul(minus_half.mul(root).mul_add(root, L::splat(1.5)));
    }
    root
}

/// e^x for |x| < 85.
#[inline(always)]
pub(super) fn exp<L: Lanes>(x: L) -> L {
    // 2^x over [−½, ½]
    const POWER: [f32; 7] =
        [1.0, core::f32::consts::LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_13, 0.001_333_355_8, 0.000_154_035_3];
    let octaves = x.mul(L::splat(core::f32::consts::LOG2_E));
    let shifted = octaves.add(L::splat(WHOLE));
    let whole = shifted.sub(L::splat(WHOLE));
    // Of the octaves, the fraction, with what rounding their product lost
    let rest = x.mul_add(L::splat(core::f32::consts::LOG2_E), L::splat(0.0).sub(whole));
    polynomial(&splat_all(&POWER), rest).mul(shifted.power_of_two())
}

/// ln((1 + y)/(1 − y)) of y within (−1, 1): the log-odds of p = ½ + y/2. What is small keeps its digits.
#[inline(always)]
pub(super) fn log_odds<L: Lanes>(y: L) -> L {
    // One unit in the last place off certainty
    let (one, most) = (L::splat(1.0), L::splat(1.0 - f32::EPSILON));
    let y = y.at_most(most).at_least(L::splat(0.0).sub(most));
    let (octaves, power) = one.add(y).octaves_above(one.sub(y));
    // (1 + y) − 2^n (1 − y) and (1 + y) + 2^n (1 − y)
    let (less, more) = (one.sub(power), one.add(power));
    artanh_twice(y.mul_add(more, less).div(y.mul_add(less, more)), octaves)
}

/// ln(1 + x) for x above −1. What is small keeps its digits.
#[inline(always)]
pub(super) fn ln_1p<L: Lanes>(x: L) -> L {
    let one = L::splat(1.0);
    let (octaves, power) = one.add(x).octaves_above(one);
    artanh_twice(x.add(one.sub(power)).div(x.add(one.add(power))), octaves)
}

/// ln x of a normal number above 0.
#[inline(always)]
pub(super) fn ln<L: Lanes>(x: L) -> L {
    let (octaves, power) = x.octaves_above(L::splat(1.0));
    artanh_twice(x.sub(power).div(x.add(power)), octaves)
}

/// n ln 2 + ln((1 + s)/(1 − s)) for |s| up to 0.21.
#[inline(always)]
fn artanh_twice<L: Lanes>(s: L, octaves: L) -> L {
    const SERIES: [f32; 5] = [2.0, 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0];
    let series = polynomial(&splat_all(&SERIES), s.mul(s));
    octaves.mul_add(L::splat(core::f32::consts::LN_2), s.mul(series))
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Portable;
    use super::*;
    use crate::log_odds::log_odds_of;

    fn of(function: impl Fn(Portable) -> Portable, x: f32) -> f64 {
        let mut out = [0.0; 8];
        function(Portable::splat(x)).store(&mut out);
        f64::from(out[0])
    }

    #[test]
    fn reciprocals_and_powers_hold_their_digits() {
        for step in -8000..8000i32 {
            let x = step as f32 * 0.01;
            assert!((of(exp, x) / libm::exp(f64::from(x)) - 1.0).abs() < 3e-6, "{x}");
            let x = libm::exp2f(step as f32 * 0.01);
            assert!((of(reciprocal, x) * f64::from(x) - 1.0).abs() < 1e-6, "{x}");
            assert!((of(reciprocal_root, x) * f64::from(x).sqrt() - 1.0).abs() < 5e-6, "{x}");
        }
    }

    #[test]
    fn logarithms_from_nearly_nothing_to_near_certainty() {
        for step in -99_999..100_000i32 {
            let y = step as f32 / 100_000.0;
            let expected = log_odds_of(0.5 + 0.5 * f64::from(y));
            assert!((of(log_odds, y) - expected).abs() < 4e-7 * (1.0 + expected.abs()), "{y}");
            let expected = libm::log1p(f64::from(y));
            assert!((of(ln_1p, y) - expected).abs() < 4e-7 * (1.0 + expected.abs()), "{y}");
        }
        for tiny in [1e-4f32, -1e-6, 1e-9, 3e-20] {
            assert!((of(log_odds, tiny) / (2.0 * f64::from(tiny)) - 1.0).abs() < 1e-6, "{tiny}");
            assert!((of(ln_1p, tiny) / libm::log1p(f64::from(tiny)) - 1.0).abs() < 1e-6, "{tiny}");
        }
        for large in [1e3f32, 1e9, 1e20] {
            assert!((of(ln_1p, large) / libm::log1p(f64::from(large)) - 1.0).abs() < 1e-6, "{large}");
        }
    }
}
