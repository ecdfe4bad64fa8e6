//! A tile of the grid: the log-odds of its cells, and planes of whatever else is known of them.

use super::plane::Plane;
use super::{Bounds, CellIndex, TILE_CELLS, TILE_SIDE, TileIndex, UNKNOWN};
use crate::parts::SavedError;
use crate::shares::Shares;

/// 64 × 64 cells.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Changes whenever a cell changes: the number of the scan that changed it last.
    pub revision: u64,
    /// Log-odds, row by row, row 0 at the lowest y; NaN is unknown.
    pub log_odds: Box<[f32; TILE_CELLS]>,
    /// What its cells would be if they are occupied; none: nothing but the log-odds is known.
    pub shares: Option<Shares>,
    /// In the order of [`Plane::ALL`], each if there is one.
    planes: [Option<Box<[f32]>>; Plane::ALL.len()],
}

impl Default for Tile {
    fn default() -> Self {
        Self::new(0, Box::new([UNKNOWN; TILE_CELLS]))
    }
}

impl Tile {
    /// A tile of these log-odds, without planes.
    #[must_use]
    pub fn new(revision: u64, log_odds: Box<[f32; TILE_CELLS]>) -> Self {
        Self { revision, log_odds, shares: None, planes: Default::default() }
    }

    /// A plane, cell by cell as the log-odds; none where nothing was put into it.
    #[must_use]
    pub fn plane(&self, plane: Plane) -> Option<&[f32]> {
        self.planes[plane.index()].as_deref()
    }

    /// All planes that there are, in the order of [`Plane::ALL`].
    pub fn planes(&self) -> impl Iterator<Item = (Plane, &[f32])> {
        Plane::ALL.into_iter().filter_map(|plane| Some((plane, self.plane(plane)?)))
    }

    /// The log-odds and some planes, each another, to write to; a plane is unknown at first.
    pub fn with_planes_mut<const N: usize>(&mut self, planes: [Plane; N]) -> (&mut [f32; TILE_CELLS], [&mut [f32]; N]) {
        for plane in planes {
            self.planes[plane.index()]
                .get_or_insert_with(|| vec![UNKNOWN; TILE_CELLS * plane.numbers_per_cell()].into_boxed_slice());
        }
        let slots = self.planes.get_disjoint_mut(planes.map(Plane::index));
        let all = slots.unwrap_or_else(|_| unreachable!("the same plane twice: {planes:?}"));
        (&mut self.log_odds, all.map(|slot| slot.as_deref_mut().unwrap_or_default()))
    }

    /// Makes all cells unknown, in the planes that there are, too.
    pub(crate) fn forget(&mut self) {
        self.log_odds.fill(UNKNOWN);
        self.shares = None;
        self.planes.iter_mut().flatten().for_each(|plane| plane.fill(UNKNOWN));
    }

    /// Bounds of the known cells of this tile, which is the one at `index`.
    pub(crate) fn bounds(&self, index: TileIndex) -> Bounds {
        let first = index.first_cell();
        let known = |cells: &[f32]| cells.iter().any(|value| !value.is_nan());
        let rows = || self.log_odds.chunks_exact(TILE_SIDE);
        let low_row = rows().position(known)?;
        let high_row = rows().rposition(known)?;
        let columns = |row: &[f32]| {
            let low = row.iter().position(|value| !value.is_nan())?;
            Some((low, row.iter().rposition(|value| !value.is_nan())?))
        };
        let (low_column, high_column) = rows().filter_map(columns).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let cell = |column: usize, row: usize| CellIndex {
            i: first.i.saturating_add(column as i32),
            j: first.j.saturating_add(row as i32),
        };
        Some((cell(low_column, low_row), cell(high_column, high_row)))
    }
}

/// The bit of a saved tile that says that shares follow.
const SHARES: u8 = 0x80;

/// A saved tile: its revision, which planes there are (a bit each), the log-odds as they are, the planes that are no copies, and the
/// shares if there are any.
impl Tile {
    /// `bytes` with this tile after them, every bit of it.
    pub(crate) fn append_to(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        let shares = if self.shares.is_some() { SHARES } else { 0 };
        let there = self.planes().fold(shares, |there, (plane, _)| there | 1 << plane.index());
        bytes.extend_from_slice(&self.revision.to_le_bytes());
        bytes.push(there);
        let saved = self.planes().filter(|(plane, _)| !plane.is_copy()).map(|(_, numbers)| numbers);
        for numbers in core::iter::once(self.log_odds.as_slice()).chain(saved) {
            bytes.extend(numbers.iter().flat_map(|value| value.to_le_bytes()));
        }
        if let Some(shares) = &self.shares {
            shares.append_to(&mut bytes);
        }
        bytes
    }

    /// The tile that `bytes`, of this part, begin with, and what comes after it.
    ///
    /// # Errors
    /// They are too short for one, or of a plane that does not exist.
    pub(crate) fn take_from<'a>(part: &str, bytes: &'a [u8]) -> Result<(Self, &'a [u8]), SavedError> {
        let short = || SavedError::new(part, "shorter than a tile");
        let (revision, bytes) = bytes.split_first_chunk().ok_or_else(short)?;
        let (there, mut bytes) = bytes.split_first().ok_or_else(short)?;
        if usize::from(*there & !SHARES) >> Plane::ALL.len() != 0 {
            return Err(SavedError::new(part, "a tile with planes that are not known"));
        }
        let mut take = |to: &mut [f32]| {
            let (numbers, rest) = bytes.split_at_checked(size_of_val(to)).ok_or_else(short)?;
            for (value, bytes) in to.iter_mut().zip(numbers.as_chunks().0) {
                *value = f32::from_le_bytes(*bytes);
            }
            bytes = rest;
            Ok(())
        };
        let mut tile = Self { revision: u64::from_le_bytes(*revision), ..Self::default() };
        take(tile.log_odds.as_mut_slice())?;
        for plane in Plane::ALL.into_iter().filter(|plane| there >> plane.index() & 1 == 1) {
            let (log_odds, [numbers]) = tile.with_planes_mut([plane]);
            if plane.is_copy() { numbers.copy_from_slice(log_odds) } else { take(numbers)? }
        }
        if there & SHARES != 0 {
            let (shares, rest) = Shares::take_from(part, bytes)?;
            (tile.shares, bytes) = (Some(shares), rest);
        }
        Ok((tile, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_tile_is_the_tile() {
        let mut tile = Tile { revision: 7, ..Tile::default() };
        tile.log_odds[3] = 0.5;
        let (_, [weights, before]) = tile.with_planes_mut([Plane::DoubtWeight, Plane::LogOddsBefore]);
        weights[4] = 2.0;
        before[3] = 0.5;
        tile.shares = Some(Shares::default());
        let bytes = tile.append_to(vec![9]);
        let (back, rest) = Tile::take_from("part", &bytes[1..]).unwrap();
        let bits = |numbers: &[f32]| numbers.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let all = |tile: &Tile| tile.planes().map(|(plane, numbers)| (plane, bits(numbers))).collect::<Vec<_>>();
        assert!(rest.is_empty() && back.shares.is_some() && back.revision == 7 && all(&back) == all(&tile));
        assert!(bits(back.log_odds.as_slice()) == bits(tile.log_odds.as_slice()) && back.plane(Plane::Doubt).is_none());
        for length in 0..bytes.len() - 1 {
            assert!(Tile::take_from("part", &bytes[1..1 + length]).is_err());
        }
        assert!(Tile::take_from("part", &[&bytes[1..9], &[0x40], &bytes[10..]].concat()).is_err());
    }

    #[test]
    fn a_tile_that_forgets_keeps_its_planes() {
        let mut tile = Tile::default();
        tile.log_odds[0] = 1.0;
        let (_, [doubt]) = tile.with_planes_mut([Plane::Doubt]);
        doubt[0] = 1.0;
        tile.forget();
        assert!(tile.log_odds.iter().chain(tile.plane(Plane::Doubt).unwrap()).all(|value| value.is_nan()));
    }
}
