//! Several neighbouring cells at once.
//!
//! A rule is written once, for any number of lanes; each lane does the same operations in the same order, each of which is rounded
//! once and alike everywhere (+, −, ×, ÷, √, and a × b + c fused into one). So the bits don't depend on the processor.

use super::chosen::Chosen;
use super::fused::fused;
use crate::shares;

/// Some numbers that are computed together, in single precision.
pub(super) trait Lanes: Chosen {
    /// How many: a divisor of 16.
    const COUNT: usize;
    /// What goes with it in double precision.
    type Doubles: Doubles;

    fn splat(x: f32) -> Self;
    /// 0, 1, 2 …
    fn counting() -> Self;
    /// (`self` × step − offset.0)² + ((`other` × step − offset.1)² − `less`), in double precision up to the end.
    fn squares(self, other: Self, step: f64, offset: (f64, f64), less: f64) -> Self;
    /// The first of at least so many.
    fn load(from: &[f32]) -> Self;
    /// Writes all to where there is room for at least so many.
    fn store(self, to: &mut [f32]);
    /// These, of which there are at most so many; the rest is 0.
    fn load_some(from: &[f32]) -> Self;
    /// Writes as many as there is room for, which is at most so many.
    fn store_some(self, to: &mut [f32]);

    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// self × factor + sum, rounded once.
    fn mul_add(self, factor: Self, sum: Self) -> Self;
    /// sum − self × factor, rounded once.
    fn neg_mul_add(self, factor: Self, sum: Self) -> Self;
    /// The numbers of the first of at least so many codes ([`crate::shares`]).
    fn load_codes(from: &[u16]) -> Self;
    /// Writes the codes of the first `count`, which have such, to where there is room for all.
    fn store_codes(self, count: usize, to: &mut [u16]);
    /// Numbers that have codes, or lie between such, rounded to what has one, by `draw`.
    fn coded(self, draw: u32) -> Self;
    /// The greater of two numbers.
    fn at_least(self, floor: Self) -> Self;
    /// The smaller of two numbers.
    fn at_most(self, ceiling: Self) -> Self;
    /// `other` where this is NaN.
    fn or(self, other: Self) -> Self;

    /// 1/self to within 13 %, of a normal number above 0.
    fn rough_reciprocal(self) -> Self;
    /// 1/√self to within 4 %, of a normal number above 0.
    fn rough_reciprocal_root(self) -> Self;
    /// Whether the first `count` are the same as of `other`, or NaN.
    fn are_none_or(self, other: Self, count: usize) -> bool;
    /// 2^n of what n + [`WHOLE`] is, for |n| < 126.
    fn power_of_two(self) -> Self;
    /// n and m, so that self is 2^n × m with m from 1 to 2, of a normal number above 0; the lowest bits of n are those of its exponent.
    fn split(self) -> (Self, Self);
    /// n and 2^n, so that self is `other` × 2^n × something from 0.66 to 1.5. Both above 0 and normal.
    fn octaves_above(self, other: Self) -> (Self, Self);
}

/// Eight numbers in double precision, likewise.
pub(super) trait Doubles: Copy {
    fn splat(x: f64) -> Self;
    /// `first`, `first` + 1, …
    fn counting_from(first: i32) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// The greater of two numbers.
    fn at_least(self, floor: Self) -> Self;
    /// The smaller of two numbers.
    fn at_most(self, ceiling: Self) -> Self;
    /// The whole numbers below, which must be within ± 2^31.
    fn floor(self, to: &mut [i32; 8]);
}

/// Adding it rounds to a whole number, which is then in the low bits.
pub(super) const WHOLE: f32 = 12_582_912.0;
/// A number's bits taken from it are about those of its reciprocal.
pub(super) const RECIPROCAL_BITS: i32 = 0x7EF1_27EA;
/// Half of a number's bits taken from it are about those of the reciprocal of its root.
pub(super) const RECIPROCAL_ROOT_BITS: i32 = 0x5F37_59DF;
/// Half an octave, in bits; where the exponent begins; what it is of 1.
pub(super) const HALF_OCTAVE: i32 = 0x0040_0000;
pub(super) const EXPONENT_BIT: u32 = 23;
pub(super) const EXPONENT_OF_ONE: i32 = 127;
/// The bits of a number below its exponent.
pub(super) const MANTISSA: u32 = (1 << EXPONENT_BIT) - 1;

/// For every processor. Where there are vectors of the right kind (NEON) the compiler makes use of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable(pub(super) [f32; 8]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        Self(core::array::from_fn(|n| of(self.0[n], other.0[n])))
    }
}

impl Lanes for Portable {
    const COUNT: usize = 8;
    type Doubles = PortableDoubles;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 8])
    }

    #[inline(always)]
    fn counting() -> Self {
        Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    }

    #[inline(always)]
    fn squares(self, other: Self, step: f64, offset: (f64, f64), less: f64) -> Self {
        Self(core::array::from_fn(|n| {
            let x = f64::from(self.0[n]) * step - offset.0;
            let y = f64::from(other.0[n]) * step - offset.1;
            (x * x + (y * y - less)) as f32
        }))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self::load_some(&from[..8])
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn load_some(from: &[f32]) -> Self {
        let mut lanes = [0.0; 8];
        for (lane, x) in lanes.iter_mut().zip(from) {
            *lane = *x;
        }
        Self(lanes)
    }

    #[inline(always)]
    fn store_some(self, to: &mut [f32]) {
        for (x, lane) in to.iter_mut().zip(self.0) {
            *x = lane;
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, sum: Self) -> Self {
        Self(core::array::from_fn(|n| fused(self.0[n], factor.0[n], sum.0[n])))
    }

    #[inline(always)]
    fn neg_mul_add(self, factor: Self, sum: Self) -> Self {
        Self(core::array::from_fn(|n| fused(-self.0[n], factor.0[n], sum.0[n])))
    }

    #[inline(always)]
    fn load_codes(from: &[u16]) -> Self {
        let from = &from[..8];
        Self(core::array::from_fn(|n| shares::decoded(from[n])))
    }

    #[inline(always)]
    fn store_codes(self, count: usize, to: &mut [u16]) {
        for (x, code) in self.0.iter().zip(&mut to[..count]) {
            *code = ((x.to_bits() - shares::LEAST_BITS) >> shares::CUT_BITS) as u16;
        }
    }

    #[inline(always)]
    fn coded(self, draw: u32) -> Self {
        let coded = |x: f32| f32::from_bits((x.to_bits() + draw) & !shares::CUT);
        Self(self.0.map(coded))
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        self.zip(floor, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        self.zip(ceiling, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self.zip(other, |a, b| if a.is_nan() { b } else { a })
    }

    #[inline(always)]
    fn rough_reciprocal(self) -> Self {
        Self(self.0.map(|x| f32::from_bits(RECIPROCAL_BITS.wrapping_sub(x.to_bits() as i32) as u32)))
    }

    #[inline(always)]
    fn rough_reciprocal_root(self) -> Self {
        Self(self.0.map(|x| f32::from_bits((RECIPROCAL_ROOT_BITS - (x.to_bits() >> 1) as i32) as u32)))
    }

    #[inline(always)]
    fn are_none_or(self, other: Self, count: usize) -> bool {
        self.0.iter().zip(&other.0).take(count).all(|(a, b)| a.is_nan() || a == b)
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(self.0.map(|x| f32::from_bits(x.to_bits().wrapping_add(EXPONENT_OF_ONE as u32) << EXPONENT_BIT)))
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let exponent = self.0.map(|x| f32::from_bits(x.to_bits() >> EXPONENT_BIT));
        (Self(exponent), Self(self.0.map(|x| f32::from_bits(x.to_bits() & MANTISSA | 1.0_f32.to_bits()))))
    }

    #[inline(always)]
    fn octaves_above(self, other: Self) -> (Self, Self) {
        let octaves = |n: usize| {
            let above = (self.0[n].to_bits() as i32).wrapping_sub(other.0[n].to_bits() as i32);
            above.wrapping_add(HALF_OCTAVE) >> EXPONENT_BIT
        };
        let power = |n: i32| f32::from_bits(((n + EXPONENT_OF_ONE) as u32) << EXPONENT_BIT);
        (Self(core::array::from_fn(|n| octaves(n) as f32)), Self(core::array::from_fn(|n| power(octaves(n)))))
    }
}

/// [`Portable`] in double precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct PortableDoubles([f64; 8]);

impl PortableDoubles {
    #[inline(always)]
    fn zip(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self(core::array::from_fn(|n| of(self.0[n], other.0[n])))
    }
}

impl Doubles for PortableDoubles {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; 8])
    }

    #[inline(always)]
    fn counting_from(first: i32) -> Self {
        Self(core::array::from_fn(|n| f64::from(first + n as i32)))
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        self.zip(floor, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        self.zip(ceiling, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn floor(self, to: &mut [i32; 8]) {
        *to = self.0.map(|x| x.floor() as i32);
    }
}
