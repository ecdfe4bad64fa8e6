//! What is shown of a tile by [`super::along_walls`], many cells at once.
//!
//! Most of what lies along a wall says little: where nothing in reach was said of its direction f is 1, and where nothing in reach
//! supports it, x_j is u_j m_j. So a bit for each cell tells what is in its reach, and each vector of cells takes the shortest way, which gives
//! the same bits.

use core::ops::Range;

use super::along_walls::{AlongWalls, DOUBTED, REACH, SUPPORT_MOST, Way};
use super::functions::ln;
use super::lanes::Lanes;
use super::wide::Work;
use crate::grid::{TILE_CELLS, TILE_SIDE};
use crate::shares::Shares;

/// Cells along a side of what is looked at.
const AREA: usize = TILE_SIDE + 2 * REACH;
/// So many numbers has it, and as many as one may read beyond a vector of eight.
const NUMBERS: usize = AREA * AREA + 8;
/// So many rows are computed beside each other: each waits for what came before.
const ROWS: usize = 8;
/// From the first cell of these to the end of the last vector.
const BLOCK: usize = (ROWS - 1) * AREA + 16;

/// A tile and those around it, row by row.
pub(super) type Around<'a> = [[Option<&'a Shares>; 3]; 3];

/// Makes of the log-odds of a tile those that are shown.
pub(super) struct Showing<'a> {
    pub(super) along_walls: &'a AlongWalls,
    pub(super) around: Around<'a>,
    pub(super) own: &'a Shares,
    pub(super) times: f32,
    /// A bit for each cell that counts: vectors of others stay as they are.
    pub(super) cells: [u64; TILE_SIDE],
    pub(super) shown: &'a mut [f32; TILE_CELLS],
}

impl Work for Showing<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { along_walls, around, own, times, cells, shown } = self;
        let (mut area, mut scratch) = (Box::<Area>::default(), Box::<Scratch>::default());
        let known = known::<L>(shown, &cells);
        let rows = rows_of(&known);
        if rows.is_empty() {
            return;
        }
        for (state, prior) in along_walls.priors.into_iter().enumerate() {
            scratch.factors.0.fill(1.0);
            if let Some(direction) = state.checked_sub(1) {
                area.gather::<L>(&around, state, rows.start..rows.end + 2 * REACH);
                for side in [-1, 1] {
                    let (way, goes_on) = (&along_walls.ways[direction], along_walls.goes_on);
                    scratch.follow::<L>(&Chain { area: &area, way, side, goes_on }, &known, &rows);
                }
            }
            scratch.add::<L>(own, state, prior, &known);
        }
        scratch.show::<L>(along_walls.max, times, &known, shown);
    }
}

/// A bit for each of some cells of which something is known, row by row.
#[inline(always)]
fn known<L: Lanes>(log_odds: &[f32; TILE_CELLS], cells: &[u64; TILE_SIDE]) -> [u64; TILE_SIDE] {
    let (mut known, most) = ([0; TILE_SIDE], L::splat(f32::INFINITY));
    for ((known, row), cells) in known.iter_mut().zip(log_odds.chunks_exact(TILE_SIDE)).zip(cells) {
        if *cells == 0 {
            continue;
        }
        for column in (0..TILE_SIDE).step_by(L::COUNT) {
            let is_known = L::load(&row[column..]).no_greater(most, L::chosen(u32::MAX));
            *known |= u64::from(L::bits(is_known)) << column;
        }
        *known &= cells;
    }
    known
}

/// The rows of these cells, whole blocks of them.
fn rows_of(cells: &[u64; TILE_SIDE]) -> Range<usize> {
    let is_there = |cells: &u64| *cells != 0;
    let (first, last) = (cells.iter().position(is_there), cells.iter().rposition(is_there));
    let down = |row: usize| row - row % ROWS;
    first.zip(last).map_or(0..0, |(first, last)| down(first)..down(last) + ROWS)
}

/// The bits of so many cells.
#[inline(always)]
fn lanes<L: Lanes>(bits: u64, column: usize) -> u64 {
    bits >> column & ((1 << L::COUNT) - 1)
}

/// Numbers so placed that vectors of a row lie in lines of the cache.
#[repr(align(64))]
struct Lined<const N: usize>([f32; N]);

/// What a direction is worth in a tile and around it.
struct Area {
    /// min(u, 1)
    against: Lined<NUMBERS>,
    /// max(u, 1)
    support: Lined<NUMBERS>,
    /// Whether u is not 1.
    said: Marks,
    /// Whether u > 1.
    supported: Marks,
}

impl Default for Area {
    #[inline(always)]
    fn default() -> Self {
        let ones = || Lined([1.0; NUMBERS]);
        Self { against: ones(), support: ones(), said: Marks::default(), supported: Marks::default() }
    }
}

impl Area {
    /// Looks up what a state is worth.
    #[inline(always)]
    fn gather<L: Lanes>(&mut self, around: &Around<'_>, state: usize, rows: Range<usize>) {
        for row in rows {
            let (tiles, of_tile) = ((row + TILE_SIDE - REACH) / TILE_SIDE, (row + TILE_SIDE - REACH) % TILE_SIDE);
            let codes = |column: usize| Some(around[tiles][column]?.codes_of(of_tile, state));
            let (against, support) = (&mut self.against.0[row * AREA..], &mut self.support.0[row * AREA..]);
            let left = codes(0).map(|codes| &codes[TILE_SIDE - REACH..]);
            let left = look_up::<L, REACH>(left, &mut against[..REACH], &mut support[..REACH]);
            let (from, to) = (REACH, REACH + TILE_SIDE);
            let own = look_up::<L, TILE_SIDE>(codes(1), &mut against[from..to], &mut support[from..to]);
            let right = look_up::<L, REACH>(codes(2), &mut against[to..AREA], &mut support[to..AREA]);
            self.said.set(row, [left.0, own.0, right.0]);
            self.supported.set(row, [left.1, own.1, right.1]);
        }
    }
}

/// What so many cells next to each other are worth: a bit for each of which u is not 1, and of which it is more.
#[inline(always)]
fn look_up<L: Lanes, const CELLS: usize>(
    codes: Option<&[u16]>,
    against: &mut [f32],
    support: &mut [f32],
) -> (u64, u64) {
    let Some(codes) = codes else {
        against.fill(1.0);
        support.fill(1.0);
        return (0, 0);
    };
    let (codes, against, support) = (&codes[..CELLS], &mut against[..CELLS], &mut support[..CELLS]);
    let (doubted, one, all) = (L::splat(DOUBTED), L::splat(1.0), L::chosen(u32::MAX));
    let (mut said, mut supported) = (0, 0);
    for column in (0..CELLS).step_by(L::COUNT) {
        let value = L::load_codes(&codes[column..]);
        let excluded = value.mul(doubted).at_most(one);
        excluded.store(&mut against[column..]);
        value.at_least(one).store(&mut support[column..]);
        let is_supported = one.less(value, all);
        supported |= u64::from(L::bits(is_supported)) << column;
        said |= u64::from(L::bits(excluded.less(one, all))) << column;
    }
    (said | supported, supported)
}

/// A bit for each cell of an area.
#[derive(Clone, Copy)]
struct Marks {
    /// The first 64 of each row, and the others.
    low: [u64; AREA],
    high: [u64; AREA],
}

impl Default for Marks {
    fn default() -> Self {
        Self { low: [0; AREA], high: [0; AREA] }
    }
}

impl Marks {
    /// Sets the bits of a row: left of the tile, in it, and right of it.
    #[inline(always)]
    fn set(&mut self, row: usize, [left, own, right]: [u64; 3]) {
        self.low[row] = left | own << REACH;
        self.high[row] = own >> (64 - REACH) | right << REACH;
    }

    /// Whether one is set along a way, of each cell of some rows of the tile.
    #[inline(always)]
    fn along(&self, way: &Way, side: isize, rows: &Range<usize>) -> [u64; TILE_SIDE] {
        let mut along = [0; TILE_SIDE];
        for offset in way {
            let [column, row] = offset.map(|cells| (REACH as isize + side * cells).unsigned_abs());
            let from = row + rows.start..row + rows.end;
            let (low, high) = (&self.low[from.clone()], &self.high[from]);
            for ((along, low), high) in along[rows.clone()].iter_mut().zip(low).zip(high) {
                *along |= low >> column | high << 1 << (63 - column);
            }
        }
        along
    }
}

/// What is known of the cells of a tile.
struct Scratch {
    /// f of both sides, multiplied
    factors: Lined<TILE_CELLS>,
    /// Σ of the states as they are, and as they are along walls
    sums: Lined<TILE_CELLS>,
    alongs: Lined<TILE_CELLS>,
}

impl Default for Scratch {
    #[inline(always)]
    fn default() -> Self {
        let zeros = || Lined([0.0; TILE_CELLS]);
        Self { factors: zeros(), sums: zeros(), alongs: zeros() }
    }
}

impl Scratch {
    /// Multiplies by f of a side.
    #[inline(always)]
    fn follow<L: Lanes>(&mut self, chain: &Chain<'_>, known: &[u64; TILE_SIDE], rows: &Range<usize>) {
        let Chain { area, way, side, .. } = *chain;
        let (said, supported) = (area.said.along(way, side, rows), area.supported.along(way, side, rows));
        for first in rows.clone().step_by(ROWS) {
            let (mut is_said, mut is_supported) = (0, 0);
            for row in first..first + ROWS {
                is_said |= said[row] & known[row];
                is_supported |= supported[row] & known[row];
            }
            for column in (0..TILE_SIDE).step_by(L::COUNT) {
                if lanes::<L>(is_said, column) == 0 {
                    continue;
                }
                let place = (first + REACH) * AREA + REACH + column;
                let m = match lanes::<L>(is_supported, column) {
                    0 => chain.follow::<L, false>(place),
                    _ => chain.follow::<L, true>(place),
                };
                for (row, m) in (first..).zip(m) {
                    let factors = &mut self.factors.0[row * TILE_SIDE + column..];
                    L::load(factors).mul(m).store(factors);
                }
            }
        }
    }

    /// Adds a state, as it is and as it is along walls.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, own: &Shares, state: usize, prior: f32, known: &[u64; TILE_SIDE]) {
        let prior = L::splat(prior);
        for (row, known) in known.iter().enumerate() {
            if *known == 0 {
                continue;
            }
            let codes = own.codes_of(row, state);
            for column in (0..TILE_SIDE).step_by(L::COUNT) {
                let at = row * TILE_SIDE + column;
                let weight = L::load_codes(&codes[column..]).mul(prior);
                let (sum, along) = (&mut self.sums.0[at..], &mut self.alongs.0[at..]);
                L::load(sum).add(weight).store(sum);
                weight.mul_add(L::load(&self.factors.0[at..]), L::load(along)).store(along);
            }
        }
    }

    /// Adds what is known along walls to log-odds, so many times. What is unknown stays so.
    #[inline(always)]
    fn show<L: Lanes>(&self, max: f32, times: f32, known: &[u64; TILE_SIDE], shown: &mut [f32; TILE_CELLS]) {
        let (least, most, times) = (L::splat(-max), L::splat(max), L::splat(times));
        for (row, known) in known.iter().enumerate() {
            for column in (0..TILE_SIDE).step_by(L::COUNT) {
                if lanes::<L>(*known, column) == 0 {
                    continue;
                }
                let at = row * TILE_SIDE + column;
                let added = ln(L::load(&self.alongs.0[at..])).sub(ln(L::load(&self.sums.0[at..])));
                most.at_most(least.at_least(added.mul_add(times, L::load(&shown[at..])))).store(&mut shown[at..]);
            }
        }
    }
}

/// The cells along walls of a direction, to one side.
struct Chain<'a> {
    area: &'a Area,
    way: &'a Way,
    side: isize,
    /// ρ
    goes_on: f32,
}

impl Chain<'_> {
    /// f of the vectors of some rows of the area, which something SUPPORTS, or nothing.
    #[inline(always)]
    fn follow<L: Lanes, const SUPPORTED: bool>(&self, first: usize) -> [L; ROWS] {
        let (goes_on, ends, one) = (L::splat(self.goes_on), L::splat(1.0 - self.goes_on), L::splat(1.0));
        let support_most = L::splat(SUPPORT_MOST);
        let mut along = [one; ROWS];
        for [columns, rows] in self.way.iter().rev() {
            let from = first.wrapping_add_signed(self.side * (rows * AREA as isize + columns));
            let (against, support) = (block(&self.area.against, from), block(&self.area.support, from));
            for n in 0..ROWS {
                let (m, against) = (along[n], L::load(&against[n * AREA..]));
                let x = if SUPPORTED {
                    let u = against.mul(m.at_most(one));
                    u.mul(L::load(&support[n * AREA..]).at_least(m)).at_most(support_most)
                } else {
                    against.mul(m)
                };
                along[n] = x.mul_add(goes_on, ends);
            }
        }
        along
    }
}

/// The numbers of some rows, from the first one on.
#[inline(always)]
fn block(numbers: &Lined<NUMBERS>, from: usize) -> &[f32; BLOCK] {
    numbers.0[from..].first_chunk().unwrap_or_else(|| unreachable!("{from}"))
}
