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

use super::along_walls_pass::{Around, Showing};
use super::wide::Width;
use crate::grid::{Grid, TILE_CELLS, TILE_SIDE, TileIndex};
use crate::oriented::{DIRECTIONS, STATES};
use crate::shares::{BLOCK, BLOCKS_ACROSS};

/// Cells that are looked at to each side; fewer than a tile has along a side.
pub(super) const REACH: usize = 16;
/// C: what supports a wall counts as much, at most.
pub(super) const SUPPORT_MOST: f32 = 3.5;
/// What is worth 1 over this counts as 1: as if nothing had been said against it.
pub(super) const DOUBTED: f32 = 2.5;
/// Where the cells along a wall lie, to one side: columns and rows.
pub(super) type Way = [[isize; 2]; REACH];

/// How walls go on.
#[derive(Debug, Clone)]
pub(crate) struct AlongWalls {
    /// ρ
    pub(super) goes_on: f32,
    /// Of each state, of what is occupied, before any reading.
    pub(super) priors: [f32; STATES],
    /// l_max.
    pub(super) max: f32,
    /// Where the cells along a wall of each direction lie.
    pub(super) ways: [Way; DIRECTIONS],
    width: Width,
}

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

    /// Makes of what was shown of a tile what is shown of it now, where blocks of it or of those around it were written to, told row by
    /// row; false where nothing but log-odds is known.
    pub(crate) fn show_again(
        &self,
        grid: &Grid,
        index: TileIndex,
        touched: &[[u32; 3]; 3],
        shown: &mut [f32; TILE_CELLS],
    ) -> bool {
        let Some((tile, own)) = grid.tile(index).and_then(|tile| Some((tile, tile.shares.as_ref()?))) else {
            return false;
        };
        let cells = reached(touched);
        for (row, mut cells) in cells.into_iter().enumerate() {
            let (to, from) = (&mut shown[row * TILE_SIDE..], &tile.log_odds[row * TILE_SIDE..]);
            while cells != 0 {
                let column = cells.trailing_zeros() as usize;
                to[column..column + BLOCK[0]].copy_from_slice(&from[column..column + BLOCK[0]]);
                cells &= !(((1 << BLOCK[0]) - 1) << column);
            }
        }
        let around = around(grid, index);
        self.width.run(Showing { along_walls: self, around, own, times: 1.0, cells, shown });
        true
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
        self.width.run(Showing {
            along_walls: self,
            around: around(grid, index),
            own,
            times,
            cells: [u64::MAX; TILE_SIDE],
            shown: &mut shown,
        });
        Some(shown)
    }
}

/// Where the cells along a wall of a direction lie, a step of one cell along the axis that it is nearer to.
fn way_along(direction: usize) -> Way {
    let (sine, cosine) = libm::sincos(PI * direction as f64 / DIRECTIONS as f64);
    let step = sine.abs().max(cosine.abs());
    core::array::from_fn(|k| {
        let cells = (k + 1) as f64 / step;
        [-sine * cells, cosine * cells].map(|cells| libm::round(cells) as isize)
    })
}

/// The cells of a tile, a bit each, that may see one of the blocks that were touched in it or those around it, row by row: whole blocks.
fn reached(touched: &[[u32; 3]; 3]) -> [u64; TILE_SIDE] {
    const DOWN: usize = TILE_SIDE / BLOCK[1];
    const _: () = assert!(BLOCK[0] >= REACH && 2 * BLOCK[1] >= REACH, "a block to each side, and two rows of them");
    let row = |row: usize| {
        let tiles =
            touched[row / DOWN].map(|blocks| blocks >> (row % DOWN * BLOCKS_ACROSS) & ((1 << BLOCKS_ACROSS) - 1));
        let row = tiles[0] | tiles[1] << BLOCKS_ACROSS | tiles[2] << (2 * BLOCKS_ACROSS);
        (row | row << 1 | row >> 1) >> BLOCKS_ACROSS
    };
    let mut cells = [0; TILE_SIDE];
    for (n, cells) in cells.chunks_exact_mut(BLOCK[1]).enumerate() {
        let blocks = (DOWN + n - 2..=DOWN + n + 2).fold(0, |blocks, n| blocks | row(n));
        let of_block = |block: usize| (u64::from(blocks >> block & 1) * ((1 << BLOCK[0]) - 1)) << (block * BLOCK[0]);
        cells.fill((0..BLOCKS_ACROSS).fold(0, |cells, block| cells | of_block(block)));
    }
    cells
}

fn around(grid: &Grid, index: TileIndex) -> Around<'_> {
    core::array::from_fn(|row| {
        core::array::from_fn(|column| {
            let (x, y) = (index.x.checked_add(column as i32 - 1)?, index.y.checked_add(row as i32 - 1)?);
            grid.tile(TileIndex { x, y })?.shares.as_ref()
        })
    })
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

    /// Blocks are touched one by one, all over: of what is as far as REACH no cell may be left out, and of no other tile any.
    #[test]
    fn what_may_see_a_block_is_reached() {
        for (block, tile) in (0..32).flat_map(|block| (0..9).map(move |tile| (block, tile))) {
            let mut touched = [[0; 3]; 3];
            touched[tile / 3][tile % 3] = 1 << block;
            let cells = reached(&touched);
            let (left, top) =
                ((tile % 3) as isize * 64 + (block % 4) * 16 - 64, (tile / 3) as isize * 64 + (block / 4) * 8 - 64);
            let off = |at: isize, first: isize, size: isize| (first - at).max(at - (first + size - 1)).max(0);
            for (row, column) in (0..64).flat_map(|row| (0..64).map(move |column| (row, column))) {
                let (across, down) = (off(column, left, 16), off(row, top, 8));
                let is_reached = cells[row as usize] >> column & 1 == 1;
                assert!(is_reached || across.max(down) > REACH as isize, "{touched:?} {row} {column}");
                assert!(!is_reached || across < 32 && down < 24, "{touched:?} {row} {column}");
            }
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
