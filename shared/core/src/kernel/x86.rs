//! [`Lanes`] of x86-64 processors.
//!
//! Values of these types are made and used only in functions that [`super::wide`] calls, which it does where the processor has
//! the instructions: that is what makes each of them safe.

use core::arch::x86_64::*;

use super::lanes::{
    EXPONENT_BIT, EXPONENT_OF_ONE, HALF_OCTAVE, Lanes, MANTISSA, RECIPROCAL_BITS, RECIPROCAL_ROOT_BITS,
};
use super::x86_doubles::{Avx2Doubles, Avx512Doubles};
use crate::shares;

const EXPONENT: i32 = EXPONENT_BIT as i32;

/// Eight lanes: AVX2 and FMA.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(pub(super) __m256);

/// Sixteen lanes: AVX-512 (F, VL, DQ, BW).
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512(pub(super) __m512);

/// `MASK[8 − n..]` begins with n lanes that are on.
static MASK: [i32; 16] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];

impl Avx2 {
    /// The first `count` lanes, or all.
    #[inline(always)]
    fn mask(count: usize) -> __m256i {
        let from = &MASK[8 - count.min(8)..][..8];
        // SAFETY: AVX2 (see the module); eight numbers are read from an array of eight.
        unsafe { _mm256_loadu_si256(from.as_ptr().cast()) }
    }
}

/// [`Lanes::squares`] of four lanes.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn squares_avx2(xs: __m128, ys: __m128, step: f64, offset: (f64, f64), less: f64) -> __m128 {
    // SAFETY: AVX2, says who calls.
    unsafe {
        let step = _mm256_set1_pd(step);
        let x = _mm256_sub_pd(_mm256_mul_pd(_mm256_cvtps_pd(xs), step), _mm256_set1_pd(offset.0));
        let y = _mm256_sub_pd(_mm256_mul_pd(_mm256_cvtps_pd(ys), step), _mm256_set1_pd(offset.1));
        let rest = _mm256_sub_pd(_mm256_mul_pd(y, y), _mm256_set1_pd(less));
        _mm256_cvtpd_ps(_mm256_add_pd(_mm256_mul_pd(x, x), rest))
    }
}

// SAFETY of each block: AVX2 and FMA (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Lanes for Avx2 {
    const COUNT: usize = 8;
    type Doubles = Avx2Doubles;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(unsafe { _mm256_set1_ps(x) })
    }

    #[inline(always)]
    fn counting() -> Self {
        Self(unsafe { _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0) })
    }

    #[inline(always)]
    fn squares(self, other: Self, step: f64, offset: (f64, f64), less: f64) -> Self {
        Self(unsafe {
            let (xs, ys) = (self.0, other.0);
            let low = squares_avx2(_mm256_castps256_ps128(xs), _mm256_castps256_ps128(ys), step, offset, less);
            let (xs, ys) = (_mm256_extractf128_ps::<1>(xs), _mm256_extractf128_ps::<1>(ys));
            _mm256_set_m128(squares_avx2(xs, ys, step, offset, less), low)
        })
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..8];
        // SAFETY: the eight that are read are there.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..8];
        // SAFETY: there is room for the eight that are written.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn load_some(from: &[f32]) -> Self {
        // SAFETY: lanes beyond the end are masked out.
        Self(unsafe { _mm256_maskload_ps(from.as_ptr(), Self::mask(from.len())) })
    }

    #[inline(always)]
    fn store_some(self, to: &mut [f32]) {
        // SAFETY: lanes beyond the end are masked out.
        unsafe { _mm256_maskstore_ps(to.as_mut_ptr(), Self::mask(to.len()), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm256_add_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(unsafe { _mm256_sub_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm256_mul_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(unsafe { _mm256_div_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, sum: Self) -> Self {
        Self(unsafe { _mm256_fmadd_ps(self.0, factor.0, sum.0) })
    }

    #[inline(always)]
    fn neg_mul_add(self, factor: Self, sum: Self) -> Self {
        Self(unsafe { _mm256_fnmadd_ps(self.0, factor.0, sum.0) })
    }

    #[inline(always)]
    fn load_codes(from: &[u16]) -> Self {
        let from = &from[..8];
        // SAFETY: the eight that are read are there.
        Self(unsafe {
            let codes = _mm256_cvtepu16_epi32(_mm_loadu_si128(from.as_ptr().cast()));
            let bits = _mm256_add_epi32(
                _mm256_slli_epi32::<{ shares::CUT_BITS as i32 }>(codes),
                _mm256_set1_epi32(shares::LEAST_BITS as i32),
            );
            _mm256_castsi256_ps(bits)
        })
    }

    #[inline(always)]
    fn store_codes(self, count: usize, to: &mut [u16]) {
        let to = &mut to[..8];
        // SAFETY: there is room for the eight that are written; those beyond `count` are written as they were.
        unsafe {
            let bits = _mm256_sub_epi32(_mm256_castps_si256(self.0), _mm256_set1_epi32(shares::LEAST_BITS as i32));
            let codes = _mm256_srli_epi32::<{ shares::CUT_BITS as i32 }>(bits);
            let codes = _mm_packus_epi32(_mm256_castsi256_si128(codes), _mm256_extracti128_si256::<1>(codes));
            let mask = Self::mask(count);
            let mask = _mm_packs_epi32(_mm256_castsi256_si128(mask), _mm256_extracti128_si256::<1>(mask));
            let were = _mm_loadu_si128(to.as_ptr().cast());
            _mm_storeu_si128(to.as_mut_ptr().cast(), _mm_blendv_epi8(were, codes, mask));
        }
    }

    #[inline(always)]
    fn coded(self, draw: u32) -> Self {
        Self(unsafe {
            let bits = _mm256_add_epi32(_mm256_castps_si256(self.0), _mm256_set1_epi32(draw as i32));
            _mm256_castsi256_ps(_mm256_and_si256(bits, _mm256_set1_epi32(!shares::CUT as i32)))
        })
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        Self(unsafe { _mm256_max_ps(self.0, floor.0) })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        Self(unsafe { _mm256_min_ps(self.0, ceiling.0) })
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(unsafe { _mm256_blendv_ps(self.0, other.0, _mm256_cmp_ps::<_CMP_UNORD_Q>(self.0, self.0)) })
    }

    #[inline(always)]
    fn rough_reciprocal(self) -> Self {
        Self(unsafe {
            _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_set1_epi32(RECIPROCAL_BITS), _mm256_castps_si256(self.0)))
        })
    }

    #[inline(always)]
    fn rough_reciprocal_root(self) -> Self {
        Self(unsafe {
            let half = _mm256_srli_epi32::<1>(_mm256_castps_si256(self.0));
            _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_set1_epi32(RECIPROCAL_ROOT_BITS), half))
        })
    }

    #[inline(always)]
    fn are_none_or(self, other: Self, count: usize) -> bool {
        unsafe {
            let differ = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_OQ>(self.0, other.0));
            _bzhi_u32(differ as u32, count as u32) == 0
        }
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(unsafe {
            let exponent = _mm256_add_epi32(_mm256_castps_si256(self.0), _mm256_set1_epi32(EXPONENT_OF_ONE));
            _mm256_castsi256_ps(_mm256_slli_epi32::<EXPONENT>(exponent))
        })
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        unsafe {
            let bits = _mm256_castps_si256(self.0);
            let below = _mm256_and_si256(bits, _mm256_set1_epi32(MANTISSA as i32));
            let mantissa = _mm256_or_si256(below, _mm256_castps_si256(_mm256_set1_ps(1.0)));
            let exponent = _mm256_srli_epi32::<EXPONENT>(bits);
            (Self(_mm256_castsi256_ps(exponent)), Self(_mm256_castsi256_ps(mantissa)))
        }
    }

    #[inline(always)]
    fn octaves_above(self, other: Self) -> (Self, Self) {
        unsafe {
            let above = _mm256_sub_epi32(_mm256_castps_si256(self.0), _mm256_castps_si256(other.0));
            let octaves = _mm256_srai_epi32::<EXPONENT>(_mm256_add_epi32(above, _mm256_set1_epi32(HALF_OCTAVE)));
            let exponent = _mm256_add_epi32(octaves, _mm256_set1_epi32(EXPONENT_OF_ONE));
            let power = _mm256_castsi256_ps(_mm256_slli_epi32::<EXPONENT>(exponent));
            (Self(_mm256_cvtepi32_ps(octaves)), Self(power))
        }
    }
}

/// The first `count` lanes, or all.
#[inline(always)]
fn first_lanes(count: usize) -> __mmask16 {
    // SAFETY: BMI2 (see the module). It is a shift that does not go round.
    unsafe { _bzhi_u32(0xffff, count.min(16) as u32) as u16 }
}

/// [`Lanes::squares`] of eight lanes.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn squares_avx512(xs: __m256, ys: __m256, step: f64, offset: (f64, f64), less: f64) -> __m256 {
    // SAFETY: AVX-512, says who calls.
    unsafe {
        let step = _mm512_set1_pd(step);
        let x = _mm512_sub_pd(_mm512_mul_pd(_mm512_cvtps_pd(xs), step), _mm512_set1_pd(offset.0));
        let y = _mm512_sub_pd(_mm512_mul_pd(_mm512_cvtps_pd(ys), step), _mm512_set1_pd(offset.1));
        let rest = _mm512_sub_pd(_mm512_mul_pd(y, y), _mm512_set1_pd(less));
        _mm512_cvtpd_ps(_mm512_add_pd(_mm512_mul_pd(x, x), rest))
    }
}

// SAFETY of each block: AVX-512 (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Lanes for Avx512 {
    const COUNT: usize = 16;
    type Doubles = Avx512Doubles;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(unsafe { _mm512_set1_ps(x) })
    }

    #[inline(always)]
    fn counting() -> Self {
        let steps = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
        // SAFETY: the sixteen that are read are there.
        Self(unsafe { _mm512_loadu_ps(steps.as_ptr()) })
    }

    #[inline(always)]
    fn squares(self, other: Self, step: f64, offset: (f64, f64), less: f64) -> Self {
        Self(unsafe {
            let (xs, ys) = (self.0, other.0);
            let low = squares_avx512(_mm512_castps512_ps256(xs), _mm512_castps512_ps256(ys), step, offset, less);
            let (xs, ys) = (_mm512_extractf32x8_ps::<1>(xs), _mm512_extractf32x8_ps::<1>(ys));
            let high = squares_avx512(xs, ys, step, offset, less);
            _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
        })
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..16];
        // SAFETY: the sixteen that are read are there.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..16];
        // SAFETY: there is room for the sixteen that are written.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn load_some(from: &[f32]) -> Self {
        // SAFETY: lanes beyond the end are masked out.
        Self(unsafe { _mm512_maskz_loadu_ps(first_lanes(from.len()), from.as_ptr()) })
    }

    #[inline(always)]
    fn store_some(self, to: &mut [f32]) {
        // SAFETY: lanes beyond the end are masked out.
        unsafe { _mm512_mask_storeu_ps(to.as_mut_ptr(), first_lanes(to.len()), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm512_add_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(unsafe { _mm512_sub_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm512_mul_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(unsafe { _mm512_div_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, sum: Self) -> Self {
        Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, sum.0) })
    }

    #[inline(always)]
    fn neg_mul_add(self, factor: Self, sum: Self) -> Self {
        Self(unsafe { _mm512_fnmadd_ps(self.0, factor.0, sum.0) })
    }

    #[inline(always)]
    fn load_codes(from: &[u16]) -> Self {
        let from = &from[..16];
        // SAFETY: the sixteen that are read are there.
        Self(unsafe {
            let codes = _mm512_cvtepu16_epi32(_mm256_loadu_si256(from.as_ptr().cast()));
            let bits = _mm512_add_epi32(
                _mm512_slli_epi32::<{ shares::CUT_BITS }>(codes),
                _mm512_set1_epi32(shares::LEAST_BITS as i32),
            );
            _mm512_castsi512_ps(bits)
        })
    }

    #[inline(always)]
    fn store_codes(self, count: usize, to: &mut [u16]) {
        let to = &mut to[..16];
        // SAFETY: there is room for the sixteen; those beyond `count` are masked out.
        unsafe {
            let bits = _mm512_sub_epi32(_mm512_castps_si512(self.0), _mm512_set1_epi32(shares::LEAST_BITS as i32));
            let codes = _mm512_cvtepi32_epi16(_mm512_srli_epi32::<{ shares::CUT_BITS }>(bits));
            _mm256_mask_storeu_epi16(to.as_mut_ptr().cast(), first_lanes(count), codes);
        }
    }

    #[inline(always)]
    fn coded(self, draw: u32) -> Self {
        Self(unsafe {
            let bits = _mm512_add_epi32(_mm512_castps_si512(self.0), _mm512_set1_epi32(draw as i32));
            _mm512_castsi512_ps(_mm512_and_si512(bits, _mm512_set1_epi32(!shares::CUT as i32)))
        })
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        Self(unsafe { _mm512_max_ps(self.0, floor.0) })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        Self(unsafe { _mm512_min_ps(self.0, ceiling.0) })
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(unsafe { _mm512_mask_mov_ps(self.0, _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(self.0, self.0), other.0) })
    }

    #[inline(always)]
    fn rough_reciprocal(self) -> Self {
        Self(unsafe {
            _mm512_castsi512_ps(_mm512_sub_epi32(_mm512_set1_epi32(RECIPROCAL_BITS), _mm512_castps_si512(self.0)))
        })
    }

    #[inline(always)]
    fn rough_reciprocal_root(self) -> Self {
        Self(unsafe {
            let half = _mm512_srli_epi32::<1>(_mm512_castps_si512(self.0));
            _mm512_castsi512_ps(_mm512_sub_epi32(_mm512_set1_epi32(RECIPROCAL_ROOT_BITS), half))
        })
    }

    #[inline(always)]
    fn are_none_or(self, other: Self, count: usize) -> bool {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_NEQ_OQ>(first_lanes(count), self.0, other.0) == 0 }
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(unsafe {
            let exponent = _mm512_add_epi32(_mm512_castps_si512(self.0), _mm512_set1_epi32(EXPONENT_OF_ONE));
            _mm512_castsi512_ps(_mm512_slli_epi32::<EXPONENT_BIT>(exponent))
        })
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        unsafe {
            let bits = _mm512_castps_si512(self.0);
            let below = _mm512_and_si512(bits, _mm512_set1_epi32(MANTISSA as i32));
            let mantissa = _mm512_or_si512(below, _mm512_castps_si512(_mm512_set1_ps(1.0)));
            let exponent = _mm512_srli_epi32::<EXPONENT_BIT>(bits);
            (Self(_mm512_castsi512_ps(exponent)), Self(_mm512_castsi512_ps(mantissa)))
        }
    }

    #[inline(always)]
    fn octaves_above(self, other: Self) -> (Self, Self) {
        unsafe {
            let above = _mm512_sub_epi32(_mm512_castps_si512(self.0), _mm512_castps_si512(other.0));
            let octaves = _mm512_srai_epi32::<EXPONENT_BIT>(_mm512_add_epi32(above, _mm512_set1_epi32(HALF_OCTAVE)));
            let exponent = _mm512_add_epi32(octaves, _mm512_set1_epi32(EXPONENT_OF_ONE));
            let power = _mm512_castsi512_ps(_mm512_slli_epi32::<EXPONENT_BIT>(exponent));
            (Self(_mm512_cvtepi32_ps(octaves)), Self(power))
        }
    }
}
