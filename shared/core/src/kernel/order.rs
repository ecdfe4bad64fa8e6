//! The order of a beam's cells by distance, in linear time.

/// Buckets to a beam: about as many as it has cells.
const BUCKETS: usize = 256;
/// How many of a bucket are held back while it is sorted.
const HELD: usize = 2;

/// Sorts numbers of known limits; kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Order {
    bucket: Vec<u8>,
    /// Of each number, by rank: what it is compared by, and its place.
    keys: Vec<u64>,
}

impl Order {
    /// The places of `numbers` from the least to the greatest, the first one first where they are the same. They are spread about
    /// evenly from `low` to `high`, or it takes longer.
    #[inline(always)]
    pub(super) fn of(&mut self, numbers: &[f32], low: f32, high: f32) -> impl Iterator<Item = usize> {
        let scale = (BUCKETS - 1) as f32 / (high - low).max(f32::MIN_POSITIVE);
        let mut ends = [0u32; BUCKETS + 1];
        self.bucket.clear();
        self.bucket.extend(numbers.iter().map(|number| ((number - low) * scale) as u8));
        for bucket in &self.bucket {
            ends[usize::from(*bucket) + 1] += 1;
        }
        for bucket in 1..BUCKETS {
            ends[bucket + 1] += ends[bucket];
        }
        if self.keys.len() < numbers.len() {
            self.keys.resize(numbers.len(), 0);
        }
        let keys = &mut self.keys[..numbers.len()];
        for (place, (number, bucket)) in numbers.iter().zip(&self.bucket).enumerate() {
            let end = &mut ends[usize::from(*bucket)];
            keys[*end as usize] = u64::from(ordered(*number)) << 32 | place as u64;
            *end += 1;
        }
        // Within the buckets: hardly any holds more than three, of which two are held back till a greater one has come. (Jumps here
        // would be foreseen as often as not.)
        let (mut low, mut high) = (0, 0);
        for place in 0..keys.len() + HELD {
            let key = keys.get(place).copied().unwrap_or(u64::MAX);
            let (least, other) = (key.min(low), key.max(low));
            (low, high) = (high.min(other), high.max(other));
            if let Some(to) = place.checked_sub(HELD) {
                keys[to] = least;
            }
        }
        for rank in 1..keys.len() {
            let key = keys[rank];
            let mut to = rank;
            while to > 0 && keys[to - 1] > key {
                keys[to] = keys[to - 1];
                to -= 1;
            }
            keys[to] = key;
        }
        keys.iter().map(|key| *key as u32 as usize)
    }
}

/// Bits that are ordered as the numbers are.
#[inline(always)]
fn ordered(number: f32) -> u32 {
    let bits = number.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn is_sorted_whatever_the_limits(
            numbers in prop::collection::vec((-40..40i32).prop_map(|n| n as f32 * 0.37), 0..300),
            low in -20.0..0.0f32, width in 0.0..40.0f32,
        ) {
            let mut expected: Vec<usize> = (0..numbers.len()).collect();
            expected.sort_by(|a, b| numbers[*a].total_cmp(&numbers[*b]));
            let mut order = Order::default();
            for _ in 0..2 {
                prop_assert_eq!(order.of(&numbers, low, low + width).collect::<Vec<_>>(), expected.clone());
            }
        }
    }
}
