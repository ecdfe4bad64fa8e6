//! How far a calibration can be trusted: bootstrap intervals of its coefficients.
//!
//! The trials of each phase are drawn anew, with replacement, and fitted again, some thousand times. The intervals are the
//! *bias-corrected and accelerated* ones (BCa; B. Efron, "Better bootstrap confidence intervals", JASA 82, 1987): variances have
//! skewed estimates, of which plain percentiles would promise too much.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::fit::check;
use super::phase::{Phase, Shares};
use super::{Calibration, CalibrationError, Trial};

/// How often trials are drawn anew, unless told otherwise.
pub const RESAMPLES: usize = 4000;
/// The least number of trials of a phase for an interval: of fewer it would mean nothing.
pub const TRIALS_MIN: usize = 8;

/// 1.96: between ± this lie 95 % of a normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// 95 % confidence intervals of a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// The lower ends of the intervals.
    pub low: Calibration,
    /// The upper ends of the intervals.
    pub high: Calibration,
}

impl Bootstrap {
    /// The intervals of [`Calibration::fit`] to the same trials. The same trials, seed and number of resamples give the same
    /// intervals on every machine.
    ///
    /// # Errors
    /// As the fit; or fewer than [`TRIALS_MIN`] trials of a phase.
    pub fn of(
        translations: &[Trial],
        rotations: &[Trial],
        resamples: usize,
        seed: u64,
    ) -> Result<Self, CalibrationError> {
        check("translation", translations, |trial| trial.measured_m)?;
        check("rotation", rotations, |trial| trial.measured_rad)?;
        for (phase, count) in [("translation", translations.len()), ("rotation", rotations.len())] {
            if count < TRIALS_MIN {
                return Err(CalibrationError::TooFewForIntervals { phase, count });
            }
        }
        let translation = intervals(&Phase::translation(translations), resamples, &mut stream(seed, b"forward"));
        let rotation = intervals(&Phase::rotation(rotations), resamples, &mut stream(seed, b"turning"));
        let end = |end: fn(&(Shares, Shares)) -> Shares| Calibration::from_shares(end(&translation), end(&rotation));
        Ok(Self { low: end(|interval| interval.0), high: end(|interval| interval.1) })
    }
}

/// Draws of a phase: more trials of one phase change nothing about the other.
fn stream(seed: u64, purpose: &[u8; 7]) -> ChaCha8Rng {
    let mut key = [0u8; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..15].copy_from_slice(purpose);
    key[23..].copy_from_slice(b"bootstrap");
    ChaCha8Rng::from_seed(key)
}

/// Lower and upper ends of what a phase tells.
fn intervals(phase: &Phase, resamples: usize, stream: &mut ChaCha8Rng) -> (Shares, Shares) {
    let estimate = phase.shares().as_array();
    let mut drawn: [Vec<f64>; Shares::COUNT] = Default::default();
    let mut again = Phase { trials: phase.trials.clone() };
    for _ in 0..resamples {
        for place in &mut again.trials {
            *place = phase.trials[below(stream, phase.trials.len())];
        }
        let shares = again.shares().as_array();
        // All of them may be the one trial that measured nothing.
        if shares.iter().all(|share| share.is_finite()) {
            drawn.iter_mut().zip(shares).for_each(|(drawn, share)| drawn.push(share));
        }
    }
    let mut ends = [[0.0; Shares::COUNT]; 2];
    for (share, drawn) in drawn.iter_mut().enumerate() {
        let acceleration = acceleration(phase.influences().map(|influences| influences[share]));
        let [low, high] = bca(estimate[share], drawn, acceleration);
        (ends[0][share], ends[1][share]) = (low, high);
    }
    (Shares::from_array(ends[0]), Shares::from_array(ends[1]))
}

/// A uniform index below `count`; the bias of 2⁻⁶⁴ per index is nothing.
pub(super) fn below(stream: &mut ChaCha8Rng, count: usize) -> usize {
    ((u128::from(stream.next_u64()) * count as u128) >> 64) as usize
}

/// A sixth of the skewness of the influences.
fn acceleration(influences: impl Iterator<Item = f64>) -> f64 {
    let (squares, cubes) = influences.fold((0.0, 0.0), |(squares, cubes), u| (squares + u * u, cubes + u * u * u));
    let acceleration = cubes / (6.0 * squares * squares.sqrt());
    if acceleration.is_finite() { acceleration } else { 0.0 }
}

/// Both ends of the interval, from estimates of trials drawn anew; sorts them.
fn bca(estimate: f64, drawn: &mut [f64], acceleration: f64) -> [f64; 2] {
    if drawn.is_empty() {
        return [estimate; 2];
    }
    drawn.sort_unstable_by(f64::total_cmp);
    let count = drawn.len() as f64;
    // Of equal ones half count as less.
    let less = drawn.partition_point(|value| *value < estimate) as f64;
    let not_more = drawn.partition_point(|value| *value <= estimate) as f64;
    let share = (0.5 * (less + not_more) / count).clamp(0.5 / count, 1.0 - 0.5 / count);
    let bias = quantile_of_normal(share);
    [-Z_95, Z_95].map(|z| {
        let z = bias + z;
        let stretch = 1.0 - acceleration * z;
        // A skewness beyond all measure would turn the interval inside out.
        let corrected = if stretch > 0.05 { bias + z / stretch } else { bias + z / 0.05 };
        quantile(drawn, share_below(corrected))
    })
}

/// The value that a share of sorted values is below, interpolated.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = libm::floor(place);
    let (a, b) = (sorted[below as usize], sorted[(below as usize + 1).min(sorted.len() - 1)]);
    a + (place - below) * (b - a)
}

/// Share of a standard normal distribution below z.
fn share_below(z: f64) -> f64 {
    0.5 * libm::erfc(-z * core::f64::consts::FRAC_1_SQRT_2)
}

/// Its inverse, by halving: it is asked for a handful of times.
fn quantile_of_normal(share: f64) -> f64 {
    let (mut low, mut high) = (-9.0, 9.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if share_below(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Draws;

    const TRUE: Calibration = Calibration {
        lin_scale: 0.05,
        lin_offset_m: 0.004,
        ang_scale: 0.08,
        ang_offset_rad: 0.01,
        k_ll: 1e-4,
        k_lt: 2e-5,
        k_tt: 3e-4,
        k_tl: 5e-5,
    };

    /// Trials of a robot with the error model above: ways of 1 to 5, in metres and in radians.
    fn data(seed: u64, count: usize) -> [Vec<Trial>; 2] {
        let mut draws = Draws::new(seed, "trials");
        let mut trial = |x: f64, scale: f64, offset: f64, k_own: f64, k_other: f64| {
            let own = scale * x + (k_own * x).sqrt() * draws.normal();
            (own, offset + (k_other * x).sqrt() * draws.normal())
        };
        let x = |index: usize| 1.0 + 4.0 * index as f64 / (count - 1) as f64;
        let straight = |index| {
            let (own, other) = trial(x(index), TRUE.lin_scale, TRUE.ang_offset_rad, TRUE.k_ll, TRUE.k_tl);
            Trial { measured_m: x(index), measured_rad: other, true_m: x(index) - own, true_rad: 0.0 }
        };
        let straight = (0..count).map(straight).collect();
        let turn = |index| {
            let (own, other) = trial(x(index), TRUE.ang_scale, TRUE.lin_offset_m, TRUE.k_tt, TRUE.k_lt);
            Trial { measured_rad: x(index), measured_m: other, true_rad: x(index) - own, true_m: 0.0 }
        };
        [straight, (0..count).map(turn).collect()]
    }

    fn all(calibration: &Calibration) -> [f64; 8] {
        let Calibration { lin_scale, lin_offset_m, ang_scale, ang_offset_rad, k_ll, k_lt, k_tt, k_tl } = *calibration;
        [lin_scale, lin_offset_m, ang_scale, ang_offset_rad, k_ll, k_lt, k_tt, k_tl]
    }

    /// In how many of 400 calibrations each coefficient is in its interval.
    fn covered(count: usize) -> [u32; 8] {
        let mut covered = [0; 8];
        for seed in 0..400 {
            let [straight, turns] = data(seed, count);
            let interval = Bootstrap::of(&straight, &turns, 1000, seed).unwrap();
            let (low, high) = (all(&interval.low), all(&interval.high));
            for (place, truth) in all(&TRUE).into_iter().enumerate() {
                covered[place] += u32::from((low[place]..=high[place]).contains(&truth));
            }
        }
        covered
    }

    #[test]
    fn intervals_hold_the_truth_as_often_as_they_promise() {
        let covered = covered(60);
        // Slopes and means: 90 to 98 %. Variances, whose estimates have heavy tails, are promised a little too much of.
        for (place, covered) in covered.into_iter().enumerate() {
            let least = if place < 4 { 360 } else { 348 };
            assert!((least..=392).contains(&covered), "{place}: {covered} of 400");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_and_the_estimate_is_inside() {
        let [straight, turns] = data(7, 20);
        let fit = Calibration::fit(&straight, &turns).unwrap();
        let interval = Bootstrap::of(&straight, &turns, RESAMPLES, 1).unwrap();
        assert_eq!(interval, Bootstrap::of(&straight, &turns, RESAMPLES, 1).unwrap());
        assert_ne!(interval, Bootstrap::of(&straight, &turns, RESAMPLES, 2).unwrap());
        for ((low, value), high) in all(&interval.low).into_iter().zip(all(&fit)).zip(all(&interval.high)) {
            assert!(low < value && value < high, "{low} {value} {high}");
        }
        // The other phase's trials do not matter to it.
        let fewer = Bootstrap::of(&straight, &turns[..10], RESAMPLES, 1).unwrap();
        assert_eq!((fewer.low.lin_scale, fewer.high.k_tl), (interval.low.lin_scale, interval.high.k_tl));
    }

    #[test]
    fn without_spread_the_interval_is_a_point() {
        let exact = Trial { measured_m: 1.0, measured_rad: 1.0, true_m: 0.75, true_rad: 0.75 };
        let interval = Bootstrap::of(&[exact; 8], &[exact; 8], 100, 1).unwrap();
        assert_eq!(interval.low, interval.high);
        assert_eq!((interval.low.lin_scale, interval.low.k_ll), (0.25, 0.0));
        let mut one_moves = [Trial::default(); 8];
        one_moves[0] = exact;
        let interval = Bootstrap::of(&one_moves, &one_moves, 100, 1).unwrap();
        assert!(all(&interval.low).into_iter().chain(all(&interval.high)).all(f64::is_finite), "{interval:?}");
    }

    #[test]
    fn too_few_are_told() {
        let trials = [Trial { measured_m: 1.0, measured_rad: 1.0, ..Trial::default() }; 8];
        let told = Bootstrap::of(&trials, &trials[..7], 100, 1).unwrap_err().to_string();
        assert_eq!(told, "7 trials of rotation; expected 8 or more, of which a confidence interval can be told");
    }

    #[test]
    fn the_normal_distribution_and_back() {
        for (z, share) in [(-Z_95, 0.025), (0.0, 0.5), (Z_95, 0.975)] {
            assert!((share_below(z) - share).abs() < 1e-12 && (quantile_of_normal(share) - z).abs() < 1e-9);
        }
    }
}
