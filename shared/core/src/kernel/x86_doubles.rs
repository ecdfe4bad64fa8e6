//! [`Doubles`] of x86-64 processors. What makes them safe is said in [`super::x86`].

use core::arch::x86_64::*;

use super::lanes::Doubles;

/// Eight numbers in double precision: AVX2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2Doubles(__m256d, __m256d);

/// Eight numbers in double precision: AVX-512.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512Doubles(__m512d);

// SAFETY of each block: AVX2 (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Doubles for Avx2Doubles {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        let all = unsafe { _mm256_set1_pd(x) };
        Self(all, all)
    }

    #[inline(always)]
    fn counting_from(first: i32) -> Self {
        unsafe {
            let low = _mm_add_epi32(_mm_set1_epi32(first), _mm_setr_epi32(0, 1, 2, 3));
            let high = _mm_add_epi32(_mm_set1_epi32(first), _mm_setr_epi32(4, 5, 6, 7));
            Self(_mm256_cvtepi32_pd(low), _mm256_cvtepi32_pd(high))
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { Self(_mm256_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1)) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { Self(_mm256_sub_pd(self.0, other.0), _mm256_sub_pd(self.1, other.1)) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm256_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1)) }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { Self(_mm256_sqrt_pd(self.0), _mm256_sqrt_pd(self.1)) }
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        unsafe { Self(_mm256_max_pd(self.0, floor.0), _mm256_max_pd(self.1, floor.1)) }
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        unsafe { Self(_mm256_min_pd(self.0, ceiling.0), _mm256_min_pd(self.1, ceiling.1)) }
    }

    #[inline(always)]
    fn floor(self, to: &mut [i32; 8]) {
        // SAFETY: there is room for the eight that are written.
        unsafe {
            let low = _mm256_cvttpd_epi32(_mm256_floor_pd(self.0));
            let high = _mm256_cvttpd_epi32(_mm256_floor_pd(self.1));
            _mm256_storeu_si256(to.as_mut_ptr().cast(), _mm256_set_m128i(high, low));
        }
    }
}

// SAFETY of each block: AVX-512 (see the module), and where memory is touched what is said there.
#[allow(clippy::undocumented_unsafe_blocks, reason = "see above")]
impl Doubles for Avx512Doubles {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self(unsafe { _mm512_set1_pd(x) })
    }

    #[inline(always)]
    fn counting_from(first: i32) -> Self {
        Self(unsafe {
            let steps = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            _mm512_cvtepi32_pd(_mm256_add_epi32(_mm256_set1_epi32(first), steps))
        })
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm512_add_pd(self.0, other.0) })
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(unsafe { _mm512_sub_pd(self.0, other.0) })
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm512_mul_pd(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm512_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        Self(unsafe { _mm512_max_pd(self.0, floor.0) })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        Self(unsafe { _mm512_min_pd(self.0, ceiling.0) })
    }

    #[inline(always)]
    fn floor(self, to: &mut [i32; 8]) {
        // SAFETY: there is room for the eight that are written.
        unsafe {
            let below = _mm512_cvt_roundpd_epi32::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0);
            _mm256_storeu_si256(to.as_mut_ptr().cast(), below);
        }
    }
}
