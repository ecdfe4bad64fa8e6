//! What the cells of a tile would be if they are occupied: the evidence by state of [`crate::oriented`], 18 bytes a cell.
//!
//! Of each state it is kept what e^v is, relative to what it was before any reading: a number of 5 bits of exponent and 11 of
//! mantissa, from 2^-15 up to 2^17. Steps of a reading that are less than the last bit are not lost but for chance: what is cut off is
//! rounded up as often as it is great, by a draw of the reading (`draw`).

use crate::grid::{TILE_CELLS, TILE_SIDE};
use crate::oriented::STATES;
use crate::parts::SavedError;

/// Bits of single precision that a code has none of.
pub(crate) const CUT_BITS: u32 = 12;
/// What is cut off.
pub(crate) const CUT: u32 = (1 << CUT_BITS) - 1;
/// Of the number whose code is 0, 2^-15, in single precision.
pub(crate) const LEAST_BITS: u32 = (127 - 15) << 23;
/// The least number that has a code.
pub(crate) const LEAST: f32 = f32::from_bits(LEAST_BITS);
/// The greatest.
pub(crate) const MOST: f32 = f32::from_bits(LEAST_BITS + ((u16::MAX as u32) << CUT_BITS));
/// The code of 1: what a cell begins with.
const ONE: u16 = ((1.0_f32.to_bits() - LEAST_BITS) >> CUT_BITS) as u16;

/// So much more than there is may be read, and written as it was.
pub(crate) const SLACK: usize = 16;
/// From a state of a cell to the end of what may be read of its last one.
const ROW: usize = (STATES - 1) * TILE_SIDE + SLACK;
const CODES: usize = TILE_CELLS * STATES;
const BYTES: usize = CODES * size_of::<u16>();

/// Columns and rows of a block of cells, and blocks of a tile side by side.
pub(crate) const BLOCK: [usize; 2] = [16, 8];
pub(crate) const BLOCKS_ACROSS: usize = TILE_SIDE / BLOCK[0];

/// The states of the cells of a tile: row by row, in a row state by state.
pub struct Shares {
    codes: Box<[u16; CODES + SLACK]>,
    /// Rows, a bit each, in which log-odds may have been moved by somebody who did not move these.
    unsettled: u64,
    /// Blocks, a bit each, row by row, that may have been written to since that was asked last.
    touched: u32,
}

/// All of what is copied counts as written to.
impl Clone for Shares {
    fn clone(&self) -> Self {
        Self { codes: self.codes.clone(), unsettled: self.unsettled, touched: u32::MAX }
    }
}

impl core::fmt::Debug for Shares {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Shares").finish_non_exhaustive()
    }
}

impl Default for Shares {
    fn default() -> Self {
        Self { codes: Box::new([ONE; CODES + SLACK]), unsettled: u64::MAX, touched: u32::MAX }
    }
}

impl Shares {
    /// Codes of cells that no reading touched.
    pub(crate) fn ones() -> [u16; SLACK] {
        [ONE; SLACK]
    }

    /// The rows, a bit each, in which the log-odds may not be what these come to.
    pub(crate) fn unsettled(&self) -> u64 {
        self.unsettled
    }

    /// In some rows somebody may move log-odds, and not these.
    pub(crate) fn unsettle(&mut self, rows: u64) {
        self.unsettled |= rows;
    }

    /// In some rows the log-odds are what these come to.
    pub(crate) fn settle(&mut self, rows: u64) {
        self.unsettled &= !rows;
    }

    /// Some blocks may be written to.
    pub(crate) fn touch(&mut self, blocks: u32) {
        self.touched |= blocks;
    }

    /// The blocks that may have been written to since this was asked last.
    pub(crate) fn take_touched(&mut self) -> u32 {
        core::mem::take(&mut self.touched)
    }

    /// The blocks of so many cells of a row, 16 at most, from `offset` on.
    #[inline(always)]
    pub(crate) fn blocks(offset: usize, cells: usize) -> u32 {
        let (row, column) = (offset / TILE_SIDE / BLOCK[1] * BLOCKS_ACROSS, offset % TILE_SIDE);
        1 << (row + column / BLOCK[0]) | 1 << (row + (column + cells - 1) / BLOCK[0])
    }

    /// Where a state of a cell of the tile lies.
    #[inline(always)]
    pub(crate) fn place(offset: usize, state: usize) -> usize {
        offset / TILE_SIDE * (TILE_SIDE * STATES) + state * TILE_SIDE + offset % TILE_SIDE
    }

    /// Codes of the cells from `offset` on, as far as they lie in one row: those of each state [`TILE_SIDE`] after those of the last.
    #[inline(always)]
    pub(crate) fn row(&self, offset: usize) -> &[u16; ROW] {
        let at = Self::place(offset, 0);
        let (row, _) = self.codes[at..].split_first_chunk().unwrap_or_else(|| unreachable!("{at}"));
        row
    }

    #[inline(always)]
    pub(crate) fn row_mut(&mut self, offset: usize) -> &mut [u16; ROW] {
        let at = Self::place(offset, 0);
        let (row, _) = self.codes[at..].split_first_chunk_mut().unwrap_or_else(|| unreachable!("{at}"));
        row
    }

    /// The codes of a state in a row of the tile.
    pub(crate) fn codes_of(&self, row: usize, state: usize) -> &[u16] {
        &self.codes[Self::place(row * TILE_SIDE, state)..][..TILE_SIDE]
    }

    /// How much more or less probable each state of a cell is than before any reading, relative to free.
    #[must_use]
    pub fn of(&self, offset: usize) -> [f32; STATES] {
        core::array::from_fn(|state| decoded(self.codes[Self::place(offset, state)]))
    }

    pub(crate) fn set(&mut self, offset: usize, values: &[f32; STATES], draw: u32) {
        for (state, value) in values.iter().enumerate() {
            self.codes[Self::place(offset, state)] = coded(*value, draw);
        }
    }

    /// All codes, row by row, in a row state by state: what [`Shares::of_codes`] takes.
    #[must_use]
    pub fn codes(&self) -> &[u16] {
        &self.codes[..CODES]
    }

    /// The states of a tile from as many codes as [`Shares::codes`] has; none if they are more or fewer.
    #[must_use]
    pub fn of_codes(codes: &[u16]) -> Option<Self> {
        let mut shares = Self::default();
        (codes.len() == CODES).then(|| shares.codes[..CODES].copy_from_slice(codes))?;
        Some(shares)
    }

    /// How much more or less probable this state of each cell is than before any reading, relative to free, row by row.
    #[must_use]
    pub fn state(&self, state: usize) -> Box<[f32; TILE_CELLS]> {
        let mut values = Box::new([0.0; TILE_CELLS]);
        for (offset, value) in values.iter_mut().enumerate() {
            *value = decoded(self.codes[Self::place(offset, state)]);
        }
        values
    }

    /// Sets this state of each cell to what [`Shares::state`] told: every such number has a code.
    pub fn set_state(&mut self, state: usize, values: &[f32; TILE_CELLS]) {
        for (offset, value) in values.iter().enumerate() {
            self.codes[Self::place(offset, state)] = coded(*value, 0);
        }
    }

    /// `bytes` with this after them.
    pub(crate) fn append_to(&self, bytes: &mut Vec<u8>) {
        bytes.extend(self.codes[..CODES].iter().flat_map(|code| code.to_le_bytes()));
    }

    /// What `bytes`, of this part, begin with, and what comes after it.
    pub(crate) fn take_from<'a>(part: &str, bytes: &'a [u8]) -> Result<(Self, &'a [u8]), SavedError> {
        let (taken, rest) =
            bytes.split_at_checked(BYTES).ok_or_else(|| SavedError::new(part, "shorter than the states of a tile"))?;
        let mut shares = Self::default();
        for (code, bytes) in shares.codes.iter_mut().zip(taken.as_chunks().0) {
            *code = u16::from_le_bytes(*bytes);
        }
        Ok((shares, rest))
    }
}

/// The number of a code.
#[inline(always)]
pub(crate) fn decoded(code: u16) -> f32 {
    f32::from_bits((u32::from(code) << CUT_BITS) + LEAST_BITS)
}

/// The code of a number, rounded by `draw`.
pub(crate) fn coded(value: f32, draw: u32) -> u16 {
    let value = if value > LEAST { value.min(MOST) } else { LEAST };
    let bits = value.to_bits() - LEAST_BITS;
    ((bits + (draw & CUT)) >> CUT_BITS) as u16
}

/// By what a reading rounds: of many readings evenly spread, whichever of them speak of a cell.
#[must_use]
pub(crate) fn draw(sequence: u64, transducer: u16) -> u32 {
    // Multiples of the golden ratio, of their fractions the first bits
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let number = sequence.wrapping_mul(64).wrapping_add(u64::from(transducer));
    (number.wrapping_mul(GOLDEN) >> (64 - CUT_BITS)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_a_number_and_back() {
        for code in 0..=u16::MAX {
            let value = decoded(code);
            assert!((LEAST..=MOST).contains(&value));
            assert_eq!(coded(value, 0), code);
            assert_eq!(coded(value, CUT), code, "what has a code is not rounded");
        }
        assert_eq!((coded(0.0, 5), coded(f32::INFINITY, CUT)), (0, u16::MAX));
        assert_eq!(Shares::default().of(77), [1.0; STATES]);
    }

    #[test]
    fn states_and_codes_come_back() {
        let mut shares = Shares::default();
        shares.set(77, &core::array::from_fn(|state| 0.01 * (state * state) as f32), 9);
        shares.set(4095, &[1e6; STATES], 0);
        let mut back = Shares::default();
        (0..STATES).for_each(|state| back.set_state(state, &shares.state(state)));
        assert_eq!(back.codes(), shares.codes());
        assert_eq!(Shares::of_codes(shares.codes()).unwrap().codes(), shares.codes());
        assert!(Shares::of_codes(&shares.codes()[1..]).is_none());
    }

    #[test]
    fn steps_less_than_the_last_bit_are_kept_in_the_mean() {
        let step = 1.000_02_f32;
        let mut value = 1.0;
        for sequence in 0..10_000 {
            value = decoded(coded(value * step, draw(16 * sequence, 3)));
        }
        let expected = 10_000.0 * libm::logf(step);
        assert!((libm::logf(value) / expected - 1.0).abs() < 0.05, "{} of {expected}", libm::logf(value));
    }
}
