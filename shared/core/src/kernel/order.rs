//! The order of a beam's cells by distance.
//!
//! A network of comparisons (Batcher 1968) sorts whole vectors: where each of its jumps would be foreseen as often as not, a sort by
//! buckets takes ten times as long.

use super::lanes::Lanes;

/// So many numbers at most are sorted by the network: their places must leave enough bits for what they are.
const MOST: usize = 1 << 12;
/// Bits of the places of up to 1024 numbers.
const FEW_BITS: u32 = 10;
/// Added to a number from 0 to this, it leaves the number in the lowest bits.
const WHOLE: f32 = 8_388_608.0;
const WHOLE_BITS: u32 = WHOLE.to_bits();

/// Sorts numbers of known limits; kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Order {
    /// Bits: what a number is compared by, above its place.
    keys: Vec<f32>,
    /// Likewise, of more than [`MOST`].
    many: Vec<u64>,
    /// The places, from the least number on.
    places: Vec<u32>,
}

impl Order {
    /// The places of `numbers`, which lie from `low` to `high`, from the least to the greatest. Of two that differ by less than 1e-6 of
    /// the way from `low` to `high` either may come first, but the same one everywhere.
    #[inline(always)]
    pub(super) fn of<L: Lanes>(&mut self, numbers: &[f32], low: f32, high: f32) -> &[u32] {
        let Self { keys, many, places } = self;
        let count = numbers.len();
        if places.len() < count {
            places.resize(count, 0);
        }
        let places = &mut places[..count];
        if count > MOST {
            sort_many(numbers, many, places);
            return places;
        }
        let bits = FEW_BITS.max(usize::BITS - count.leading_zeros());
        let most = ((1_u32 << (u32::BITS - bits)) - 1) as f32;
        let scale = most / (high - low).max(f32::MIN_POSITIVE);
        let room = count.next_power_of_two().max(16);
        if keys.len() < room {
            keys.resize(room, 0.0);
        }
        let keys = &mut keys[..room];
        for place in 0..count {
            let step = (numbers[place] - low) * scale;
            let step = if step > 0.0 { step } else { 0.0 };
            let step = if step < most { step } else { most };
            keys[place] = f32::from_bits(((step + WHOLE).to_bits() - WHOLE_BITS) << bits | place as u32);
        }
        keys[count..].fill(f32::from_bits(u32::MAX));
        sort::<L>(keys);
        for (place, key) in places.iter_mut().zip(keys) {
            *place = key.to_bits() & ((1 << bits) - 1);
        }
        places
    }
}

/// Of numbers so many that it hardly ever happens.
fn sort_many(numbers: &[f32], keys: &mut Vec<u64>, places: &mut [u32]) {
    keys.clear();
    keys.extend(numbers.iter().enumerate().map(|(place, number)| u64::from(ordered(*number)) << 32 | place as u64));
    keys.sort_unstable();
    places.iter_mut().zip(keys).for_each(|(place, key)| *place = *key as u32);
}

/// Bits that are ordered as the numbers are.
fn ordered(number: f32) -> u32 {
    let bits = number.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// Lanes whose number has a bit: that of the neighbour 1, 2, 4 or 8 places away.
const EVERY_1: u32 = 0xaaaa;
const EVERY_2: u32 = 0xcccc;
const EVERY_4: u32 = 0xf0f0;
const EVERY_8: u32 = 0xff00;

/// Sorts keys by their bits; as many as a power of two of at least 16.
#[inline(always)]
fn sort<L: Lanes>(keys: &mut [f32]) {
    // No closure: it would not be compiled for the same processor.
    let two = L::chosen(EVERY_1 ^ EVERY_2);
    let (four_2, four_1) = (L::chosen(EVERY_2 ^ EVERY_4), L::chosen(EVERY_1 ^ EVERY_4));
    let (eight_4, eight_2, eight_1) =
        (L::chosen(EVERY_4 ^ EVERY_8), L::chosen(EVERY_2 ^ EVERY_8), L::chosen(EVERY_1 ^ EVERY_8));
    for at in (0..keys.len()).step_by(L::COUNT) {
        let mut some = L::load(&keys[at..]).exchanged::<1>(two);
        some = some.exchanged::<2>(four_2).exchanged::<1>(four_1);
        if L::COUNT == 16 {
            some = some.exchanged::<4>(eight_4).exchanged::<2>(eight_2).exchanged::<1>(eight_1);
        }
        some.store(&mut keys[at..]);
    }
    // Of runs of this length every other one falls.
    let mut run = L::COUNT;
    while run <= keys.len() {
        for (number, keys) in keys.chunks_exact_mut(run).enumerate() {
            merge::<L>(keys, number % 2 == 1);
        }
        run *= 2;
    }
}

/// Sorts keys that rise and then fall.
#[inline(always)]
fn merge<L: Lanes>(keys: &mut [f32], falls: bool) {
    let mut distance = keys.len() / 2;
    while distance >= L::COUNT {
        for begun in (0..keys.len()).step_by(2 * distance) {
            for at in (begun..begun + distance).step_by(L::COUNT) {
                let (lesser, greater) = L::load(&keys[at..]).lesser_and_greater(L::load(&keys[at + distance..]));
                let (first, second) = if falls { (greater, lesser) } else { (lesser, greater) };
                first.store(&mut keys[at..]);
                second.store(&mut keys[at + distance..]);
            }
        }
        distance /= 2;
    }
    let all = if falls { 0xffff } else { 0 };
    let (one, two) = (L::chosen(EVERY_1 ^ all), L::chosen(EVERY_2 ^ all));
    let (four, eight) = (L::chosen(EVERY_4 ^ all), L::chosen(EVERY_8 ^ all));
    for at in (0..keys.len()).step_by(L::COUNT) {
        let mut some = L::load(&keys[at..]);
        if L::COUNT == 16 {
            some = some.exchanged::<8>(eight);
        }
        some.exchanged::<4>(four).exchanged::<2>(two).exchanged::<1>(one).store(&mut keys[at..]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::wide::{Width, Work};
    use super::*;

    /// The places as each processor finds them.
    fn orders(numbers: &[f32], low: f32, high: f32) -> Vec<Vec<u32>> {
        struct Sorting<'a>(&'a [f32], f32, f32, &'a mut Vec<u32>);
        impl Work for Sorting<'_> {
            #[inline(always)]
            fn run<L: Lanes>(self) {
                let mut order = Order::default();
                // The second time it has its memory.
                order.of::<L>(&[self.1; 40], self.1, self.2);
                self.3.extend(order.of::<L>(self.0, self.1, self.2));
            }
        }
        let sorted = |width: Width| {
            let mut places = Vec::new();
            width.run(Sorting(numbers, low, high, &mut places));
            places
        };
        Width::all().into_iter().map(sorted).collect()
    }

    proptest! {
        #[test]
        fn is_sorted_and_everywhere_alike(
            numbers in prop::collection::vec((-400..400i32).prop_map(|n| n as f32 * 0.01), 0..700),
        ) {
            let orders = orders(&numbers, -4.0, 4.0);
            let mut expected: Vec<u32> = (0..numbers.len() as u32).collect();
            expected.sort_by(|a, b| numbers[*a as usize].total_cmp(&numbers[*b as usize]));
            for order in orders {
                prop_assert_eq!(&order, &expected);
            }
        }

        /// None is lost, and those within them are in order.
        #[test]
        fn limits_that_are_none_do_no_harm(
            numbers in prop::collection::vec(prop_oneof![prop::num::f32::ANY, -9.0..9.0f32], 0..100),
            low in -5.0..0.0f32, width in prop_oneof![Just(0.0f32), 0.0..5.0f32],
        ) {
            let all = orders(&numbers, low, low + width);
            prop_assert!(all.windows(2).all(|pair| pair[0] == pair[1]));
            let mut places = all[0].clone();
            places.sort_unstable();
            prop_assert_eq!(places, (0..numbers.len() as u32).collect::<Vec<_>>());
        }
    }

    #[test]
    fn many_are_sorted_too() {
        for count in [1000, 1024, 1025, 4095, 4096, 5000] {
            let numbers: Vec<f32> = (0..count).map(|n: i32| (n * 7919 % count) as f32).collect();
            let order = &orders(&numbers, 0.0, count as f32)[0];
            assert!(order.is_sorted_by(|a, b| numbers[*a as usize] <= numbers[*b as usize]), "{count}");
        }
    }
}
