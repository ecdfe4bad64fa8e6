//! Probability and log-odds (eqs 13, 14).

/// A cell whose probability is above this is called occupied.
pub const OCCUPIED_ABOVE: f64 = 0.65;
/// A cell whose probability is below this is called free.
pub const FREE_BELOW: f64 = 0.35;

/// l = ln(p / (1 − p)) (eq 13). `probability` in (0, 1) gives a finite number; 0 and 1 give ∓∞, anything outside NaN.
#[must_use]
pub fn log_odds_of(probability: f64) -> f64 {
    libm::log(probability / (1.0 - probability))
}

/// p = 1 − 1/(1 + e^l), in [0, 1]: the inverse of eq 13. (Eq 14 as printed, 1 − 1/e^l, is not, and leaves [0, 1].)
///
/// Written so that neither a large positive nor a large negative l loses digits or overflows.
#[must_use]
pub fn probability_of(log_odds: f64) -> f64 {
    if log_odds >= 0.0 {
        1.0 / (1.0 + libm::exp(-log_odds))
    } else {
        let odds = libm::exp(log_odds);
        odds / (1.0 + odds)
    }
}

/// Shannon entropy of a cell, bits in [0, 1]: 1 where nothing is known, 0 where all is.
#[must_use]
pub fn entropy_bits(log_odds: f64) -> f64 {
    // With p the smaller of the two probabilities, H = (ln(1 + e^-|l|) + |l| p) / ln 2: no 0 · ln 0.
    let magnitude = log_odds.abs();
    if magnitude.is_infinite() {
        return 0.0;
    }
    let odds = libm::exp(-magnitude);
    (libm::log1p(odds) + magnitude * odds / (1.0 + odds)) / core::f64::consts::LN_2
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn known_values() {
        assert_eq!(probability_of(0.0), 0.5);
        assert!((log_odds_of(0.85) - 1.734_601_055_388_106_3).abs() < 1e-15);
        assert_eq!(probability_of(1e4), 1.0);
        assert_eq!(probability_of(-1e4), 0.0);
        assert_eq!(probability_of(f64::NEG_INFINITY), 0.0);
        assert!(
            (probability_of(-700.0) / libm::exp(-700.0) - 1.0).abs() < 1e-12,
            "small probabilities keep their digits"
        );
        assert!(probability_of(f64::NAN).is_nan());
        assert!(log_odds_of(1.5).is_nan());
    }

    #[test]
    fn entropy_of_known_cells() {
        assert!((entropy_bits(0.0) - 1.0).abs() < 1e-15);
        assert_eq!(entropy_bits(f64::INFINITY), 0.0);
        let p: f64 = 0.2;
        let expected = -(p * libm::log2(p) + (1.0 - p) * libm::log2(1.0 - p));
        assert!((entropy_bits(log_odds_of(p)) - expected).abs() < 1e-14);
        assert!((entropy_bits(log_odds_of(1.0 - p)) - expected).abs() < 1e-14);
    }

    proptest! {
        #[test]
        fn eq_14_undoes_eq_13(l in -30.0..30.0f64) {
            prop_assert!((log_odds_of(probability_of(l)) - l).abs() < 1e-13 + libm::exp(l) * 1e-15);
        }

        #[test]
        fn probability_grows_with_log_odds(a in -30.0..30.0f64, step in 1e-3..10.0f64) {
            prop_assert!(probability_of(a) < probability_of(a + step));
        }

        #[test]
        fn entropy_is_symmetric_and_within_a_bit(l in -800.0..800.0f64) {
            let h = entropy_bits(l);
            prop_assert!((0.0..=1.0 + 1e-15).contains(&h));
            prop_assert_eq!(h, entropy_bits(-l));
        }
    }
}
