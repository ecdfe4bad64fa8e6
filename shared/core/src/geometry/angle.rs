//! Angles.

use core::f64::consts::{PI, TAU};

/// Wraps an angle to (-π, π]. Non-finite input stays non-finite.
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    // The remainder is exact, so no angle, however large, is rounded out of the range.
    let turned = angle_rad % TAU;
    if turned > PI {
        turned - TAU
    } else if turned <= -PI {
        turned + TAU
    } else {
        turned
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn ends_of_the_range() {
        assert_eq!(wrap_angle(PI), PI);
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(3.0 * PI), PI);
        assert_eq!(wrap_angle(-3.0 * PI), PI);
        assert_eq!(wrap_angle(PI.next_up()), -PI.next_down());
        assert!(wrap_angle(f64::NAN).is_nan());
        assert!(!wrap_angle(f64::INFINITY).is_finite());
    }

    proptest! {
        #[test]
        fn always_in_range(angle in prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI, "{angle} -> {wrapped}");
        }

        #[test]
        fn same_direction(angle in -100.0..100.0f64) {
            let (s, c) = libm::sincos(angle);
            let (ws, wc) = libm::sincos(wrap_angle(angle));
            prop_assert!((s - ws).abs() < 1e-13 && (c - wc).abs() < 1e-13);
        }
    }
}
