//! Walls go on: what is known along a wall says whether one can be in a cell, which the map shows.
//!
//! [`crate::oriented`] takes cells for independent. A wall of a direction that no look has met near its normal may be in any cell,
//! so what was passed once, from few sides, stays grey. But walls are longer than a cell: where those that would continue it have
//! been excluded to both sides, none is between them; and between two pieces of a wall there is rather more of it.
//!
//! Of each direction k the cells along the tangent are a chain, in which a wall that is in one cell is in the next one with
//! probability ρ = exp(−cell / L), L = `oriented_wall_m`. Let u_j be what state k of the j-th cell is worth, relative to what it was
//! before any reading. From the far end to the cell
//!
//! ```text
//! m_j = ρ x_{j+1} + 1 − ρ      x_j = min(C, min(u_j, 1) min(m_j, 1) max(u_j, m_j, 1))      f = ρ x_1 + 1 − ρ
//! ```
//!
//! and v_k counts times f of both sides. What excludes a wall multiplies, for each cell was looked through by itself. Of what supports
//! it only the greatest counts: an echo is of one of the cells of its arc, which lie along the tangent, so each of them has the same
//! witness. What is hardly excluded counts as not excluded (u < 1 is multiplied by [`DOUBTED`], up to 1): many looks that are a little
//! wrong alike must not add up.
//!
//! The states themselves stay as they were fused; only what is shown of them is another. So nothing is counted twice, in whatever order
//! tiles are shown.

use core::f64::consts::PI;

use super::functions::ln;
use super::lanes::Lanes;
use super::wide::{Width, Work};
use crate::grid::{Grid, TILE_CELLS, TILE_SIDE, TileIndex};
use crate::oriented::{DIRECTIONS, STATES};
use crate::shares::Shares;

/// Cells that are looked at to each side; fewer than a tile has along a side.
const REACH: usize = 16;
/// C: what supports a wall counts as much, at most.
const SUPPORT_MOST: f32 = 3.5;
/// What is worth 1 over this counts as 1: as if nothing had been said against it.
const DOUBTED: f32 = 2.5;
/// Cells along a side of what is looked at.
const AREA: usize = TILE_SIDE + 2 * REACH;
/// So many lanes are computed beside each other: each waits for what came before.
const BLOCK: usize = 4;

/// How walls go on.
#[derive(Debug, Clone)]
pub(crate) struct AlongWalls {
    /// ρ
    goes_on: f32,
    /// Of each state, of what is occupied, before any reading.
    priors: [f32; STATES],
    /// l_max.
    max: f32,
    /// Where the cells along a wall of each direction lie: columns and rows.
    ways: [[[isize; 2]; REACH]; DIRECTIONS],
    width: Width,
}

/// What a direction is worth in a tile and around it.
type Area = [f32; AREA * AREA];
/// A tile and those around it, row by row.
type Around<'a> = [[Option<&'a Shares>; 3]; 3];

impl AlongWalls {
    /// Of walls that are so long in the mean, in cells of `resolution_m`; of what is occupied the share `diffuse` is none. Cells stay
    /// within ± `max`.
    pub(crate) fn new(wall_m: f64, resolution_m: f64, diffuse: f64, max: f64) -> Self {
        let smooth = ((1.0 - diffuse) / DIRECTIONS as f64) as f32;
        Self {
            goes_on: libm::exp(-resolution_m / wall_m) as f32,
            priors: core::array::from_fn(|state| if state == 0 { diffuse as f32 } else { smooth }),
            max: max as f32,
            ways: core::array::from_fn(way_along),
            width: Width::of_this_processor(),
        }
    }

    /// What is shown of a tile, as log-odds; none where nothing but log-odds is known. What others have said of a cell since stays said:
    /// it moved all states alike.
    pub(crate) fn shown(&self, grid: &Grid, index: TileIndex) -> Option<Box<[f32; TILE_CELLS]>> {
        self.moved(grid, index, 1.0)
    }

    /// Of a tile whose log-odds are those that are shown, what they were as they were fused; none likewise. Where a limit cut off what
    /// is shown they are what the states come to, beyond l0 = `start`, or as near to that as is shown so.
    pub(crate) fn fused(&self, grid: &Grid, index: TileIndex, start: f32) -> Option<Box<[f32; TILE_CELLS]>> {
        let mut fused = self.moved(grid, index, -1.0)?;
        let tile = grid.tile(index)?;
        let shares = tile.shares.as_ref()?;
        for (offset, (fused, shown)) in fused.iter_mut().zip(tile.log_odds.iter()).enumerate() {
            if shown.abs() >= self.max {
                let weights = shares.of(offset).into_iter().zip(self.priors);
                let sum: f64 = weights.map(|(value, prior)| f64::from(value) * f64::from(prior)).sum();
                // As far as it is shown so.
                let (least, most) = (fused.min(*shown), fused.max(*shown));
                *fused = (start + libm::log(sum) as f32).clamp(least, most);
            }
        }
        Some(fused)
    }

    /// The log-odds and so many times what is known along walls.
    fn moved(&self, grid: &Grid, index: TileIndex, times: f32) -> Option<Box<[f32; TILE_CELLS]>> {
        let tile = grid.tile(index)?;
        let own = tile.shares.as_ref()?;
        let mut shown = tile.log_odds.clone();
        self.width.run(Showing { along_walls: self, around: around(grid, index), own, times, shown: &mut shown });
        Some(shown)
    }

    /// f of both sides, multiplied, of the cells from the one at `first` of the area on.
    #[inline(always)]
    fn factors<L: Lanes>(&self, area: &Area, direction: usize, first: usize) -> [L; BLOCK] {
        let (goes_on, ends, one) = (L::splat(self.goes_on), L::splat(1.0 - self.goes_on), L::splat(1.0));
        let most = L::splat(SUPPORT_MOST);
        let mut factors = [one; BLOCK];
        for side in [-1, 1] {
            let mut along = [one; BLOCK];
            for [columns, rows] in self.ways[direction].iter().rev() {
                let from = first as isize + side * (rows * AREA as isize + columns);
                let from = &area[from.unsigned_abs()..];
                for (n, m) in along.iter_mut().enumerate() {
                    let u = L::load(&from[n * L::COUNT..]);
                    let excluded = u.at_most(one).mul(m.at_most(one));
                    let x = excluded.mul(u.at_least(*m).at_least(one)).at_most(most);
                    *m = x.mul_add(goes_on, ends);
                }
            }
            for (factor, m) in factors.iter_mut().zip(along) {
                *factor = factor.mul(m);
            }
        }
        factors
    }
}

/// Makes of the log-odds of a tile those that are shown.
struct Showing<'a> {
    along_walls: &'a AlongWalls,
    around: Around<'a>,
    own: &'a Shares,
    times: f32,
    shown: &'a mut [f32; TILE_CELLS],
}

impl Work for Showing<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { along_walls, around, own, times, shown } = self;
        let mut area = Box::new([1.0; AREA * AREA]);
        // Σ of the states as they are, and as they are along walls
        let (mut sums, mut alongs) = (Box::new([0.0; TILE_CELLS]), Box::new([0.0; TILE_CELLS]));
        let mut known = [false; TILE_SIDE];
        for (known, row) in known.iter_mut().zip(shown.chunks_exact(TILE_SIDE)) {
            *known = row.iter().any(|cell| !cell.is_nan());
        }
        for state in 0..STATES {
            if state > 0 {
                gather::<L>(&around, state, &mut area);
            }
            let prior = L::splat(along_walls.priors[state]);
            for first in (0..TILE_CELLS).step_by(BLOCK * L::COUNT) {
                let (row, column) = (first / TILE_SIDE, first % TILE_SIDE);
                if !known[row] {
                    continue;
                }
                let factors = match state {
                    0 => [L::splat(1.0); BLOCK],
                    _ => along_walls.factors::<L>(&area, state - 1, (row + REACH) * AREA + REACH + column),
                };
                for (n, factor) in factors.into_iter().enumerate() {
                    let lanes = n * L::COUNT;
                    let weight = L::load_codes(&own.codes_of(row, state)[column + lanes..]).mul(prior);
                    let (sum, along) = (&mut sums[first + lanes..], &mut alongs[first + lanes..]);
                    L::load(sum).add(weight).store(sum);
                    weight.mul_add(factor, L::load(along)).store(along);
                }
            }
        }
        let (least, most, times) = (L::splat(-along_walls.max), L::splat(along_walls.max), L::splat(times));
        for at in (0..TILE_CELLS).step_by(L::COUNT) {
            let added = ln(L::load(&alongs[at..])).sub(ln(L::load(&sums[at..])));
            // What is unknown stays so.
            most.at_most(least.at_least(added.mul_add(times, L::load(&shown[at..])))).store(&mut shown[at..]);
        }
    }
}

/// Where the cells along a wall of a direction lie, a step of one cell along the axis that it is nearer to.
fn way_along(direction: usize) -> [[isize; 2]; REACH] {
    let (sine, cosine) = libm::sincos(PI * direction as f64 / DIRECTIONS as f64);
    let step = sine.abs().max(cosine.abs());
    core::array::from_fn(|k| {
        let cells = (k + 1) as f64 / step;
        [-sine * cells, cosine * cells].map(|cells| libm::round(cells) as isize)
    })
}

fn around(grid: &Grid, index: TileIndex) -> Around<'_> {
    core::array::from_fn(|row| {
        core::array::from_fn(|column| {
            let (x, y) = (index.x.checked_add(column as i32 - 1)?, index.y.checked_add(row as i32 - 1)?);
            grid.tile(TileIndex { x, y })?.shares.as_ref()
        })
    })
}

/// What a state is worth in the cells of a tile and around it.
#[inline(always)]
fn gather<L: Lanes>(around: &Around<'_>, state: usize, area: &mut Area) {
    let (doubted, one) = (L::splat(DOUBTED), L::splat(1.0));
    for (row, to) in area.chunks_exact_mut(AREA).enumerate() {
        let row = row + TILE_SIDE - REACH;
        let (tiles, row) = (&around[row / TILE_SIDE], row % TILE_SIDE);
        let (left, rest) = to.split_at_mut(REACH);
        let (own, right) = rest.split_at_mut(TILE_SIDE);
        for ((to, tile), first) in [left, own, right].into_iter().zip(tiles).zip([TILE_SIDE - REACH, 0, 0]) {
            let Some(shares) = tile else {
                to.fill(1.0);
                continue;
            };
            let codes = &shares.codes_of(row, state)[first..];
            for at in (0..to.len()).step_by(L::COUNT) {
                let value = L::load_codes(&codes[at..]);
                value.at_least(value.mul(doubted).at_most(one)).store(&mut to[at..]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::CellIndex;

    const DIFFUSE: f64 = 0.15;

    fn along_walls() -> AlongWalls {
        AlongWalls::new(2.5, 0.05, DIFFUSE, 8.0)
    }

    /// A cell of which the walls of one direction are worth `wall`, the other states `rest`.
    fn set(grid: &mut Grid, cell: (i32, i32), direction: usize, wall: f32, rest: f32) {
        let cell = CellIndex { i: cell.0, j: cell.1 };
        let mut values = [rest; STATES];
        values[1 + direction] = wall;
        let tile = grid.tile_mut(cell.tile());
        let shares = tile.shares.get_or_insert_default();
        shares.set(cell.offset_in_tile(), &values, 0);
        let values = shares.of(cell.offset_in_tile());
        let priors = along_walls().priors;
        let sum: f32 = values.iter().zip(priors).map(|(value, prior)| value * prior).sum();
        tile.log_odds[cell.offset_in_tile()] = libm::logf(sum);
    }

    fn shown(grid: &Grid, cell: (i32, i32)) -> f32 {
        let cell = CellIndex { i: cell.0, j: cell.1 };
        along_walls().shown(grid, cell.tile()).unwrap()[cell.offset_in_tile()]
    }

    /// Of every cell, by the equations, one by one.
    fn by_equations(grid: &Grid, cell: (i32, i32)) -> f64 {
        let state = |at: (i32, i32), state: usize| {
            let cell = CellIndex { i: at.0, j: at.1 };
            let shares = grid.tile(cell.tile()).and_then(|tile| tile.shares.as_ref());
            shares.map_or(1.0, |shares| f64::from(shares.of(cell.offset_in_tile())[state]))
        };
        let rho = libm::exp(-0.02);
        let mut sum = DIFFUSE * state(cell, 0);
        for k in 0..DIRECTIONS {
            let mut weight = (1.0 - DIFFUSE) / 8.0 * state(cell, 1 + k);
            for side in [-1, 1] {
                let x = (0..REACH).rev().fold(1.0, |x, j| {
                    let [columns, rows] = way_along(k)[j].map(|cells| side * cells as i32);
                    let u = state((cell.0 + columns, cell.1 + rows), 1 + k);
                    let u = if u < 1.0 { (2.5 * u).min(1.0) } else { u };
                    let m = rho * x + 1.0 - rho;
                    (u.min(1.0) * m.min(1.0) * u.max(m).max(1.0)).min(3.5)
                });
                weight *= rho * x + 1.0 - rho;
            }
            sum += weight;
        }
        libm::log(sum)
    }

    /// Cells of all sorts, on four tiles.
    fn any_grid() -> Grid {
        let mut grid = Grid::new(0.05);
        let mut number = 1u32;
        for i in -30..40 {
            for j in -30..40 {
                number = number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let worth = |bits: u32| libm::expf((bits % 64) as f32 / 8.0 - 5.0);
                set(&mut grid, (i, j), (number >> 8) as usize % 8, worth(number >> 16), worth(number >> 24));
            }
        }
        grid
    }

    #[test]
    fn it_is_what_the_equations_say_across_tiles_too() {
        let grid = any_grid();
        for cell in (-30..40).flat_map(|i| (-30..40).map(move |j| (i, j))) {
            let (found, expected) = (f64::from(shown(&grid, cell)), by_equations(&grid, cell));
            assert!((found - expected).abs() < 1e-4, "{cell:?}: {found} {expected}");
        }
    }

    #[test]
    fn a_wall_between_cells_without_any_is_none() {
        let mut grid = Grid::new(0.05);
        // Walls that run along y were excluded along a column, but for one cell that no look met so.
        (-20..20).for_each(|j| set(&mut grid, (5, j), 0, 0.05, 0.2));
        set(&mut grid, (5, 3), 0, 1.0, 0.2);
        let raw = grid.log_odds(CellIndex { i: 5, j: 3 }).unwrap();
        assert!(shown(&grid, (5, 3)) < raw - 0.3, "{raw} {}", shown(&grid, (5, 3)));
    }

    #[test]
    fn a_wall_stays_one_to_its_end_and_gaps_in_it_are_closed() {
        let mut grid = Grid::new(0.05);
        for j in -20..20 {
            let wall = if (0..10).contains(&j) { 3000.0 } else { 0.05 };
            set(&mut grid, (5, j), 0, wall, 0.1);
        }
        set(&mut grid, (5, 4), 0, 1.0, 0.1);
        assert!((0..10).filter(|j| *j != 4).all(|j| shown(&grid, (5, j)) > 1.0), "from end to end");
        assert!(shown(&grid, (5, 4)) > grid.log_odds(CellIndex { i: 5, j: 4 }).unwrap() + 0.2);
    }

    #[test]
    fn an_arc_is_one_witness_however_many_cells_it_has() {
        let shown_of = |cells: i32| {
            let mut grid = Grid::new(0.05);
            (-cells..=cells).for_each(|j| set(&mut grid, (5, j), 0, 1.5, 0.8));
            shown(&grid, (5, 0))
        };
        // 1.5 of itself, and at most as much of either side
        assert!(shown_of(15) < shown_of(0) + libm::logf(1.5 * 1.5));
        assert!(shown_of(15) > shown_of(0) + 0.1);
    }

    #[test]
    fn what_others_said_and_what_is_unknown_stays() {
        let mut grid = Grid::new(0.05);
        (-20..20).for_each(|j| set(&mut grid, (5, j), 0, 0.05, 0.05));
        let (told, before) = (CellIndex { i: 5, j: 3 }, shown(&grid, (5, 3)));
        grid.tile_mut(told.tile()).log_odds[told.offset_in_tile()] += 2.5;
        assert!((shown(&grid, (5, 3)) - before - 2.5).abs() < 1e-5);
        assert!(shown(&grid, (6, 3)).is_nan());
        grid.tile_mut(TileIndex { x: 9, y: 9 });
        assert!(along_walls().shown(&grid, TileIndex { x: 9, y: 9 }).is_none(), "no states, nothing to say");
        assert!(along_walls().shown(&grid, TileIndex { x: 50, y: 9 }).is_none());
    }

    #[test]
    fn what_is_shown_tells_what_was_fused() {
        let mut grid = any_grid();
        let fused: Vec<_> = grid.tiles().map(|(index, tile)| (index, tile.log_odds.clone())).collect();
        let shown: Vec<_> = fused.iter().map(|(index, _)| along_walls().shown(&grid, *index).unwrap()).collect();
        for ((index, _), shown) in fused.iter().zip(shown) {
            grid.tile_mut(*index).log_odds = shown;
        }
        for (index, fused) in &fused {
            let again = along_walls().fused(&grid, *index, 0.0).unwrap();
            let is_same = |(a, b): (&f32, &f32)| a.is_nan() && b.is_nan() || (a - b).abs() < 1e-5;
            assert!(again.iter().zip(fused.iter()).all(is_same), "{index:?}");
        }
    }

    #[test]
    fn every_processor_shows_the_same_bits() {
        let grid = any_grid();
        let bits = |width| {
            let along_walls = AlongWalls { width, ..along_walls() };
            let tiles = grid.tiles().flat_map(|(index, _)| along_walls.shown(&grid, index));
            tiles.flat_map(|shown| shown.map(f32::to_bits)).collect::<Vec<_>>()
        };
        let portable = bits(Width::Portable);
        assert!(Width::all().into_iter().all(|width| bits(width) == portable));
    }
}
