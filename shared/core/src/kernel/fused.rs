//! a × b + c rounded once, on processors that have no instruction for it too.

/// a × b + c, rounded once, for results that are finite.
#[cfg(target_arch = "aarch64")]
#[inline(always)]
#[allow(clippy::disallowed_methods, reason = "every such processor has the instruction: the system is not asked")]
pub(super) fn fused(a: f32, b: f32, c: f32) -> f32 {
    a.mul_add(b, c)
}

/// a × b + c, rounded once, for results that are finite.
///
/// The product is exact in double precision. Their sum is rounded to odd there (what is lost sets the last bit), which leaves the
/// second rounding, to single precision, as if it were the first.
#[cfg(not(target_arch = "aarch64"))]
#[inline(always)]
pub(super) fn fused(a: f32, b: f32, c: f32) -> f32 {
    let (product, c) = (f64::from(a) * f64::from(b), f64::from(c));
    let sum = product + c;
    // What rounding took from the sum, exactly
    let part = sum - product;
    let lost = (product - (sum - part)) + (c - part);
    let bits = sum.to_bits();
    // Towards the exact sum, if the last bit is 0: one more or one less in magnitude is the neighbour whose last bit is 1.
    let grows = (lost > 0.0) == (sum > 0.0);
    let odd = if grows { bits | 1 } else { bits.wrapping_sub(1) };
    let is_exact = lost == 0.0 || bits & 1 == 1;
    f64::from_bits(if is_exact { bits } else { odd }) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn check(a: f32, b: f32, c: f32) {
        let expected = libm::fmaf(a, b, c);
        if expected.is_finite() {
            assert_eq!(fused(a, b, c).to_bits(), expected.to_bits(), "{a:e} * {b:e} + {c:e}");
        }
    }

    #[test]
    fn hard_cases() {
        let next = |x: f32, by: i32| f32::from_bits((x.to_bits() as i32 + by) as u32);
        for a in [1.0, next(1.0, 1), next(1.0, -1), 3.0, next(2.0, -1), 1e-20, 4097.0, 1.0 + f32::EPSILON * 2048.0] {
            for b in [1.0, next(1.0, 1), next(1.0, -3), 1e-20, 4097.0, 1.0 + f32::EPSILON * 2048.0] {
                for c in [0.0, -0.0, 1.0, 1e-30, 1e-45, 16_777_216.0, 1e8, 3e-8, f32::EPSILON * 0.5, f32::EPSILON] {
                    for (a, c) in [(a, c), (-a, c), (a, -c), (-a, -c)] {
                        check(a, b, c);
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]

        #[test]
        fn of_any_bits(a in any::<u32>(), b in any::<u32>(), c in any::<u32>()) {
            let of = f32::from_bits;
            check(of(a), of(b), of(c));
        }

        /// Where the sum is nearly halfway between two numbers.
        #[test]
        fn nearly_halfway(a in 1u32..1 << 24, b in 1u32..1 << 24, shift in -60..60i32, sign in any::<bool>()) {
            let c = libm::ldexpf(if sign { 1.0 } else { -1.0 }, shift);
            check(a as f32, b as f32, c);
            check(a as f32, b as f32 * c, (a as f32).floor());
            check(a as f32, b as f32, -(a as f32) * (b as f32));
        }
    }
}
