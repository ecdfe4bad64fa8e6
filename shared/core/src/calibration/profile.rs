//! Where a parameter is best, and how surely: log-likelihoods at some of its values, block by block of the data.
//!
//! The blocks are drawn anew, with replacement, and the best value is sought again: what neighbours in time have in common does not
//! count twice (block bootstrap; H. R. Künsch, "The jackknife and the bootstrap for general stationary observations", 1989).

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::bootstrap::below;

/// The log-likelihoods of the blocks of the data at each value of a parameter, in rising order of the values.
#[derive(Debug, Clone)]
pub struct Profile<'a> {
    /// The values, in their order, each above 0.
    pub values: &'a [f64],
    /// The log-likelihood of each block at each of the values, nat; the blocks are the same at all of them.
    pub blocks: &'a [&'a [f64]],
}

/// What a profile says of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// Where it is best.
    pub estimate: f64,
    /// Ends of the 95 % interval.
    pub low: f64,
    /// Ends of the 95 % interval.
    pub high: f64,
    /// Whether the interval leaves more than half of the values out.
    pub is_told: bool,
    /// Whether the best is the first of the values, or the last: what is still less or more was not tried.
    pub is_at_end: [bool; 2],
}

impl Profile<'_> {
    /// Where the parameter is best, and the interval of that in so many draws. The same profile, seed and number of draws tell the same
    /// on every machine. None where there is no value or no block, or they are not of each other.
    #[must_use]
    pub fn tell(&self, draws: usize, seed: u64) -> Option<Told> {
        let count = self.blocks.first()?.len();
        if self.values.len() != self.blocks.len()
            || self.blocks.iter().any(|blocks| blocks.len() != count)
            || count == 0
        {
            return None;
        }
        let sums: Vec<f64> = self.blocks.iter().map(|blocks| blocks.iter().sum()).collect();
        let best = peak(&sums);
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        let mut peaks: Vec<f64> = (0..draws.max(1))
            .map(|_| {
                let mut sums = vec![0.0; self.blocks.len()];
                for _ in 0..count {
                    let block = below(&mut stream, count);
                    sums.iter_mut().zip(self.blocks).for_each(|(sum, blocks)| *sum += blocks[block]);
                }
                peak(&sums)
            })
            .collect();
        peaks.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| peaks[(share * (peaks.len() - 1) as f64).round() as usize];
        let (low, high) = (at(0.025).min(best), at(0.975).max(best));
        let end = (self.values.len() - 1) as f64;
        Some(Told {
            estimate: self.value(best),
            low: self.value(low),
            high: self.value(high),
            is_told: high - low <= 0.5 * end,
            is_at_end: [best <= 0.0, best >= end],
        })
    }

    /// Between the values, in proportion.
    fn value(&self, place: f64) -> f64 {
        let below = self.values[(place.floor() as usize).min(self.values.len() - 1)];
        let above = self.values[(place.ceil() as usize).min(self.values.len() - 1)];
        below * libm::pow(above / below, place - place.floor())
    }
}

/// The place of the highest, between its neighbours as a parabola through them has it.
fn peak(sums: &[f64]) -> f64 {
    let best = (0..sums.len()).max_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0);
    if best == 0 || best + 1 >= sums.len() {
        return best as f64;
    }
    let (before, after) = (sums[best] - sums[best - 1], sums[best] - sums[best + 1]);
    let off = if before + after > 0.0 { 0.5 * (before - after) / (before + after) } else { 0.0 };
    best as f64 + off
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];

    /// Blocks whose best place is where `of` says.
    fn told(of: impl Fn(usize) -> f64, curvature: f64) -> Told {
        let square = |off: f64| -curvature * off * off;
        let rows: Vec<Vec<f64>> =
            (0..VALUES.len()).map(|place| (0..200).map(|block| square(place as f64 - of(block))).collect()).collect();
        let blocks: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
        Profile { values: &VALUES, blocks: &blocks }.tell(400, 7).unwrap()
    }

    #[test]
    fn blocks_that_agree_tell_a_value_between_those_tried() {
        let sure = told(|_| 2.25, 1.0);
        assert!((sure.estimate - 4.0 * libm::pow(2.0, 0.25)).abs() < 1e-9, "{sure:?}");
        assert!((sure.low - sure.high).abs() < 1e-9 && sure.is_told);
        let spread = told(|block| 2.0 + if block % 2 == 0 { 1.0 } else { -1.0 }, 1.0);
        assert!((spread.estimate - 4.0).abs() < 1e-9 && spread.low < 3.9 && spread.high > 4.1 && spread.is_told);
        // 1.96 σ/√n of places that are 1 off: 0.14 of a place
        assert!((libm::log2(spread.high / spread.low) - 0.28).abs() < 0.08, "{spread:?}");
    }

    #[test]
    fn what_cannot_be_told_is_said() {
        assert_eq!(told(|_| -3.0, 1.0).is_at_end, [true, false]);
        assert_eq!(told(|_| 9.0, 1.0).is_at_end, [false, true]);
        let torn = told(|block| if block % 2 == 0 { 40.0 } else { -36.0 }, 1.0);
        assert!(!torn.is_told && torn.low <= 1.5 && torn.high >= 8.0, "{torn:?}");
        assert_eq!(Profile { values: &[], blocks: &[] }.tell(10, 1), None);
        assert_eq!(Profile { values: &VALUES, blocks: &[&[1.0]] }.tell(10, 1), None);
    }
}
