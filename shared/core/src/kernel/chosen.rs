//! Lanes of which some are chosen, and numbers of a table that each lane looks up.

use super::lanes::{Lanes, Portable};

/// How many numbers a table has: a power of two.
pub(super) const PLACES: usize = 32;

/// Numbers that lanes look up, so placed that no vector of them lies across two lines of the cache.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Table(pub(super) [f32; PLACES]);

/// What [`Lanes`] can do to some lanes.
pub(super) trait Chosen: Copy {
    /// Lanes that are chosen.
    type Mask: Copy;

    /// Those whose bit is set, the lowest for the first.
    fn chosen(bits: u32) -> Self::Mask;
    /// Those that are less than `other`, of some.
    fn less(self, other: Self, of: Self::Mask) -> Self::Mask;
    /// Those that are no greater than `other`, of some.
    fn no_greater(self, other: Self, of: Self::Mask) -> Self::Mask;
    /// Those of one that the other has not.
    fn without(mask: Self::Mask, other: Self::Mask) -> Self::Mask;
    /// A bit for each lane, the lowest for the first.
    fn bits(mask: Self::Mask) -> u32;
    /// Writes those that are chosen to where there is room for all.
    fn store_where(self, mask: Self::Mask, to: &mut [f32]);
    /// Writes those that are chosen one after the other; there must be room for all, and what comes after them is lost.
    fn store_together(self, mask: Self::Mask, to: &mut [f32]);
    /// Of each lane the number at the place that its lowest bits tell ([`super::lanes::WHOLE`]).
    fn pick(self, table: &Table) -> Self;
    /// The bits of each lane and of that `J` places off (1, 2, 4 or 8, less than there are lanes: its number with that bit turned), as whole
    /// numbers: the greater of both for those that are told, the lesser for others.
    fn exchanged<const J: usize>(self, greater: Self::Mask) -> Self;
    /// Of the bits of both, as whole numbers, the lesser and the greater.
    fn lesser_and_greater(self, other: Self) -> (Self, Self);
    /// (`self` × step − offset.0)² + ((`other` × step − offset.1)² − (`less` + `rest`)), in double precision up to the end.
    fn squares_less(self, other: Self, step: f64, offset: (f64, f64), less: Self, rest: Self) -> Self;
}

impl Chosen for Portable {
    type Mask = u32;

    #[inline(always)]
    fn chosen(bits: u32) -> u32 {
        bits
    }

    #[inline(always)]
    fn less(self, other: Self, of: u32) -> u32 {
        self.bits_where(other, |a, b| a < b) & of
    }

    #[inline(always)]
    fn no_greater(self, other: Self, of: u32) -> u32 {
        self.bits_where(other, |a, b| a <= b) & of
    }

    #[inline(always)]
    fn without(mask: u32, other: u32) -> u32 {
        mask & !other
    }

    #[inline(always)]
    fn bits(mask: u32) -> u32 {
        mask
    }

    #[inline(always)]
    fn store_where(self, mask: u32, to: &mut [f32]) {
        for (n, (x, lane)) in to[..8].iter_mut().zip(self.0).enumerate() {
            if mask >> n & 1 == 1 {
                *x = lane;
            }
        }
    }

    #[inline(always)]
    fn store_together(self, mask: u32, to: &mut [f32]) {
        let chosen = self.0.into_iter().enumerate().filter(|(n, _)| mask >> n & 1 == 1);
        to.iter_mut().zip(chosen).for_each(|(x, (_, lane))| *x = lane);
    }

    #[inline(always)]
    fn pick(self, table: &Table) -> Self {
        Self(self.0.map(|x| table.0[x.to_bits() as usize % PLACES]))
    }

    #[inline(always)]
    fn exchanged<const J: usize>(self, greater: u32) -> Self {
        Self(core::array::from_fn(|n| {
            let (own, other) = (self.0[n].to_bits(), self.0[(n ^ J) % 8].to_bits());
            f32::from_bits(if greater >> n & 1 == 1 { own.max(other) } else { own.min(other) })
        }))
    }

    #[inline(always)]
    fn lesser_and_greater(self, other: Self) -> (Self, Self) {
        let of = |which: fn(u32, u32) -> u32| {
            core::array::from_fn(|n| f32::from_bits(which(self.0[n].to_bits(), other.0[n].to_bits())))
        };
        (Self(of(u32::min)), Self(of(u32::max)))
    }

    #[inline(always)]
    fn squares_less(self, other: Self, step: f64, offset: (f64, f64), less: Self, rest: Self) -> Self {
        Self(core::array::from_fn(|n| {
            let x = f64::from(self.0[n]) * step - offset.0;
            let y = f64::from(other.0[n]) * step - offset.1;
            let less = f64::from(less.0[n]) + f64::from(rest.0[n]);
            (x * x + (y * y - less)) as f32
        }))
    }
}

impl Portable {
    #[inline(always)]
    fn bits_where(self, other: Self, is: impl Fn(f32, f32) -> bool) -> u32 {
        (0..Self::COUNT).fold(0, |bits, n| bits | u32::from(is(self.0[n], other.0[n])) << n)
    }
}
