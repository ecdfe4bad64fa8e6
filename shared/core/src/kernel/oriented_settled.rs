//! What somebody else says of cells, a lidar by a rule of its own or the robot by being there, becomes part of their states.

use super::functions::exp;
use super::lanes::Lanes;
use super::layout::Piece;
use super::oriented_cells::{Wides, states_of};
use crate::grid::{TILE_CELLS, TILE_SIDE};
use crate::shares::{SLACK, Shares};

/// By no more than this the log-odds of a cell differ from what its states come to because these have codes.
const ROUNDED_BY: f32 = 1e-3;

/// Moves all states of a cell alike whose log-odds somebody else moved, in the rows of a tile that a cone touches. What is settled stays as
/// it is, so that it does not matter which rows are known to be.
#[inline(always)]
pub(super) fn settle<L: Lanes>(
    wides: &Wides<'_, L>,
    pieces: [&[Piece]; 2],
    shares: &mut Shares,
    log_odds: &mut [f32; TILE_CELLS],
) {
    let rows = |pieces: &[Piece]| match pieces {
        [] => 0,
        [first, .., last] | [first @ last] => rows_between(first.offset, last.offset),
    };
    let [front, band] = pieces;
    let mut unsettled = shares.unsettled() & (rows(front) | rows(band));
    shares.settle(unsettled);
    while unsettled != 0 {
        let first = unsettled.trailing_zeros() as usize * TILE_SIDE;
        unsettled &= unsettled - 1;
        for offset in (first..first + TILE_SIDE).step_by(L::COUNT) {
            let mut values = states_of::<L>(shares, offset);
            let known = L::load(&log_odds[offset..]);
            let off = known.sub(wides.log_odds(wides.sum(&values)));
            let off = beyond_rounding(off);
            if off.are_none_or(L::splat(0.0), L::COUNT) {
                continue;
            }
            shares.touch(Shares::blocks(offset, L::COUNT));
            let moved = exp(off.at_most(L::splat(60.0)).at_least(L::splat(-60.0)));
            let row = shares.row_mut(offset);
            for (state, value) in values.iter_mut().enumerate() {
                *value = wides.coded(value.mul(moved).at_most(wides.most));
                value.store_codes(L::COUNT, &mut row[state * TILE_SIDE..state * TILE_SIDE + SLACK]);
            }
            // Where a state could not follow, it is the states that count.
            let now = wides.log_odds(wides.sum(&values));
            known.sub(beyond_rounding(known.sub(now))).store(&mut log_odds[offset..]);
        }
    }
}

/// What is more than codes are rounded by, of cells that are known; 0 of others.
#[inline(always)]
fn beyond_rounding<L: Lanes>(off: L) -> L {
    let (all, mut beyond) = (L::chosen(u32::MAX), [0.0; 16]);
    let limit = L::splat(ROUNDED_BY);
    off.store_where(limit.less(off, all), &mut beyond);
    off.store_where(off.less(L::splat(0.0).sub(limit), all), &mut beyond);
    L::load(&beyond)
}

/// A bit for each row of a tile from that of one cell to that of another.
#[inline(always)]
fn rows_between(first: u16, last: u16) -> u64 {
    let (first, last) = (usize::from(first) / TILE_SIDE, usize::from(last) / TILE_SIDE);
    (u64::MAX << first) & (u64::MAX >> (TILE_SIDE - 1 - last))
}
