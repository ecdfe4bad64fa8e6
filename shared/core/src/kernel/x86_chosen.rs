//! [`Chosen`] of x86-64 processors. What makes them safe is said in [`super::x86`].

use core::arch::x86_64::*;

use super::chosen::{Chosen, PLACES, Table};
use super::lanes::Lanes;
use super::x86::{Avx2, Avx512};

/// [`Chosen::squares_less`] of four lanes: x, y, less, rest.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn squares_avx2([x, y, less, rest]: [__m128; 4], step: f64, offset: (f64, f64)) -> __m128 {
    // SAFETY: AVX2, says who calls.
    unsafe {
        let step = _mm256_set1_pd(step);
        let x = _mm256_sub_pd(_mm256_mul_pd(_mm256_cvtps_pd(x), step), _mm256_set1_pd(offset.0));
        let y = _mm256_sub_pd(_mm256_mul_pd(_mm256_cvtps_pd(y), step), _mm256_set1_pd(offset.1));
        let less = _mm256_add_pd(_mm256_cvtps_pd(less), _mm256_cvtps_pd(rest));
        _mm256_cvtpd_ps(_mm256_add_pd(_mm256_mul_pd(x, x), _mm256_sub_pd(_mm256_mul_pd(y, y), less)))
    }
}

/// [`Chosen::squares_less`] of eight lanes: x, y, less, rest.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn squares_avx512([x, y, less, rest]: [__m256; 4], step: f64, offset: (f64, f64)) -> __m256 {
    // SAFETY: AVX-512, says who calls.
    unsafe {
        let step = _mm512_set1_pd(step);
        let x = _mm512_sub_pd(_mm512_mul_pd(_mm512_cvtps_pd(x), step), _mm512_set1_pd(offset.0));
        let y = _mm512_sub_pd(_mm512_mul_pd(_mm512_cvtps_pd(y), step), _mm512_set1_pd(offset.1));
        let less = _mm512_add_pd(_mm512_cvtps_pd(less), _mm512_cvtps_pd(rest));
        _mm512_cvtpd_ps(_mm512_add_pd(_mm512_mul_pd(x, x), _mm512_sub_pd(_mm512_mul_pd(y, y), less)))
    }
}

// SAFETY of each block: AVX2 and FMA (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Chosen for Avx2 {
    type Mask = __m256;

    #[inline(always)]
    fn chosen(bits: u32) -> __m256 {
        unsafe {
            let each = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let of_lane = _mm256_and_si256(_mm256_set1_epi32(bits as i32), each);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(of_lane, each))
        }
    }

    #[inline(always)]
    fn less(self, other: Self, of: __m256) -> __m256 {
        unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0), of) }
    }

    #[inline(always)]
    fn no_greater(self, other: Self, of: __m256) -> __m256 {
        unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0), of) }
    }

    #[inline(always)]
    fn without(mask: __m256, other: __m256) -> __m256 {
        unsafe { _mm256_andnot_ps(other, mask) }
    }

    #[inline(always)]
    fn bits(mask: __m256) -> u32 {
        unsafe { _mm256_movemask_ps(mask) as u32 }
    }

    #[inline(always)]
    fn store_where(self, mask: __m256, to: &mut [f32]) {
        let to = &mut to[..8];
        // SAFETY: there is room for all.
        unsafe { _mm256_maskstore_ps(to.as_mut_ptr(), _mm256_castps_si256(mask), self.0) }
    }

    #[inline(always)]
    fn store_together(self, mask: __m256, to: &mut [f32]) {
        let mut all = [0.0; 8];
        self.store(&mut all);
        let mut bits = Self::bits(mask);
        for x in to {
            if bits == 0 {
                break;
            }
            *x = all[bits.trailing_zeros() as usize % 8];
            bits &= bits - 1;
        }
    }

    #[inline(always)]
    fn pick(self, table: &Table) -> Self {
        // SAFETY: each place lies within the table.
        Self(unsafe {
            let place = _mm256_and_si256(_mm256_castps_si256(self.0), _mm256_set1_epi32(PLACES as i32 - 1));
            _mm256_i32gather_ps::<4>(table.0.as_ptr(), place)
        })
    }

    #[inline(always)]
    fn exchanged<const J: usize>(self, greater: __m256) -> Self {
        unsafe {
            let other = match J {
                1 => _mm256_permute_ps::<0b10_11_00_01>(self.0),
                2 => _mm256_permute_ps::<0b01_00_11_10>(self.0),
                _ => _mm256_permute2f128_ps::<1>(self.0, self.0),
            };
            let (lesser, more) = self.lesser_and_greater(Self(other));
            Self(_mm256_blendv_ps(lesser.0, more.0, greater))
        }
    }

    #[inline(always)]
    fn lesser_and_greater(self, other: Self) -> (Self, Self) {
        unsafe {
            let (a, b) = (_mm256_castps_si256(self.0), _mm256_castps_si256(other.0));
            let (lesser, greater) = (_mm256_min_epu32(a, b), _mm256_max_epu32(a, b));
            (Self(_mm256_castsi256_ps(lesser)), Self(_mm256_castsi256_ps(greater)))
        }
    }

    #[inline(always)]
    fn squares_less(self, other: Self, step: f64, offset: (f64, f64), less: Self, rest: Self) -> Self {
        Self(unsafe {
            let low = [
                _mm256_castps256_ps128(self.0),
                _mm256_castps256_ps128(other.0),
                _mm256_castps256_ps128(less.0),
                _mm256_castps256_ps128(rest.0),
            ];
            let high = [
                _mm256_extractf128_ps::<1>(self.0),
                _mm256_extractf128_ps::<1>(other.0),
                _mm256_extractf128_ps::<1>(less.0),
                _mm256_extractf128_ps::<1>(rest.0),
            ];
            _mm256_set_m128(squares_avx2(high, step, offset), squares_avx2(low, step, offset))
        })
    }
}

// SAFETY of each block: AVX-512 (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Chosen for Avx512 {
    type Mask = __mmask16;

    #[inline(always)]
    fn chosen(bits: u32) -> __mmask16 {
        bits as __mmask16
    }

    #[inline(always)]
    fn less(self, other: Self, of: __mmask16) -> __mmask16 {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(of, self.0, other.0) }
    }

    #[inline(always)]
    fn no_greater(self, other: Self, of: __mmask16) -> __mmask16 {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(of, self.0, other.0) }
    }

    #[inline(always)]
    fn without(mask: __mmask16, other: __mmask16) -> __mmask16 {
        mask & !other
    }

    #[inline(always)]
    fn bits(mask: __mmask16) -> u32 {
        u32::from(mask)
    }

    #[inline(always)]
    fn store_where(self, mask: __mmask16, to: &mut [f32]) {
        let to = &mut to[..16];
        // SAFETY: there is room for all.
        unsafe { _mm512_mask_storeu_ps(to.as_mut_ptr(), mask, self.0) }
    }

    #[inline(always)]
    fn store_together(self, mask: __mmask16, to: &mut [f32]) {
        Self(unsafe { _mm512_maskz_compress_ps(mask, self.0) }).store(to);
    }

    #[inline(always)]
    fn pick(self, table: &Table) -> Self {
        let (low, high) = table.0.split_at(16);
        // SAFETY: both halves have sixteen numbers; of a place the lowest five bits count.
        Self(unsafe {
            let (low, high) = (_mm512_loadu_ps(low.as_ptr()), _mm512_loadu_ps(high.as_ptr()));
            _mm512_permutex2var_ps(low, _mm512_castps_si512(self.0), high)
        })
    }

    #[inline(always)]
    fn exchanged<const J: usize>(self, greater: __mmask16) -> Self {
        unsafe {
            let other = match J {
                1 => _mm512_permute_ps::<0b10_11_00_01>(self.0),
                2 => _mm512_permute_ps::<0b01_00_11_10>(self.0),
                4 => _mm512_shuffle_f32x4::<0b10_11_00_01>(self.0, self.0),
                _ => _mm512_shuffle_f32x4::<0b01_00_11_10>(self.0, self.0),
            };
            let (own, other) = (_mm512_castps_si512(self.0), _mm512_castps_si512(other));
            let lesser = _mm512_min_epu32(own, other);
            Self(_mm512_castsi512_ps(_mm512_mask_max_epu32(lesser, greater, own, other)))
        }
    }

    #[inline(always)]
    fn lesser_and_greater(self, other: Self) -> (Self, Self) {
        unsafe {
            let (a, b) = (_mm512_castps_si512(self.0), _mm512_castps_si512(other.0));
            let (lesser, greater) = (_mm512_min_epu32(a, b), _mm512_max_epu32(a, b));
            (Self(_mm512_castsi512_ps(lesser)), Self(_mm512_castsi512_ps(greater)))
        }
    }

    #[inline(always)]
    fn squares_less(self, other: Self, step: f64, offset: (f64, f64), less: Self, rest: Self) -> Self {
        Self(unsafe {
            let low = [
                _mm512_castps512_ps256(self.0),
                _mm512_castps512_ps256(other.0),
                _mm512_castps512_ps256(less.0),
                _mm512_castps512_ps256(rest.0),
            ];
            let high = [
                _mm512_extractf32x8_ps::<1>(self.0),
                _mm512_extractf32x8_ps::<1>(other.0),
                _mm512_extractf32x8_ps::<1>(less.0),
                _mm512_extractf32x8_ps::<1>(rest.0),
            ];
            let (low, high) = (squares_avx512(low, step, offset), squares_avx512(high, step, offset));
            _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
        })
    }
}
