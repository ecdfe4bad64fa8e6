//! The cells of a beam on the grid, tile by tile and row by row: what all rules of fusion work on.
//!
//! A beam is a cone, and the cells whose centres lie in it belong to it. A beam that leaves gaps to its
//! neighbours would pass between the centres where it is narrower than a cell: there the cells that its axis crosses belong to it.

use super::Apex;
use super::geometry::Geometry;
use super::lanes::Lanes;
use super::spans::{Ray, Rows, Sector, Stretch, disc};
use crate::grid::{TILE_SIDE, TileIndex};

const SIDE: i32 = TILE_SIDE as i32;

/// A beam before it is laid on the grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beam {
    /// Of its axis in the map.
    pub(super) direction_rad: f64,
    pub(super) aperture_rad: f64,
    /// From where on a cell may have given the echo, metres.
    pub(super) near_m: f64,
    pub(super) far_m: f64,
    /// Whether its neighbours leave gaps.
    pub(super) leaves_gaps: bool,
}

impl Beam {
    /// To where it is a ray, metres: farther on every cell that its axis crosses has its centre in the cone.
    fn ray_m(&self, resolution_m: f64) -> f64 {
        if !self.leaves_gaps {
            return 0.0;
        }
        core::f64::consts::FRAC_1_SQRT_2 * resolution_m / libm::sin(0.5 * self.aperture_rad)
    }
}

/// Some cells of one row of a tile: at most as many as are computed at once.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Piece {
    /// Its first cell within the tile.
    pub(super) offset: u16,
    pub(super) cells: u16,
}

/// What the cells of a row have in common, seen from the transducer.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaceOfRow {
    /// Its number, counted from the transducer's.
    pub(super) number: f32,
    /// dy².
    pub(super) dy_squared: f32,
    /// Across the axis, scaled, of a cell right above or below the transducer.
    pub(super) across: f32,
}

/// The pieces of a beam that lie in a tile: from where those of the last tile end up to here.
#[derive(Debug, Clone, Copy)]
pub(super) struct TilePieces {
    pub(super) index: TileIndex,
    pub(super) front: usize,
    pub(super) band: usize,
    /// Whether they lie on the axis, as far as can be told.
    pub(super) is_ray: bool,
    /// Its first column, counted from the transducer's.
    first_column: i32,
    /// Of its first row, among [`Layout::places`] if it were there.
    first_place: i64,
}

impl TilePieces {
    /// The column of the first cell of a piece, counted from the transducer's.
    #[inline(always)]
    pub(super) fn column(&self, piece: Piece) -> f32 {
        (self.first_column + i32::from(piece.offset) % SIDE) as f32
    }

    /// Its row, among [`Layout::places`].
    #[inline(always)]
    pub(super) fn place(&self, piece: Piece) -> usize {
        (self.first_place + i64::from(piece.offset) / SIDE as i64) as usize
    }
}

/// Where the cells of a beam are; kept for its memory. A tile may come twice.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    rows: Rows,
    /// Of the rows of a tile ([`Layout::cut_rows`]).
    cut: [Vec<u32>; 4],
    /// Of each row; those of a ray, then those of a cone.
    pub(super) places: Vec<PlaceOfRow>,
    pub(super) tiles: Vec<TilePieces>,
    /// In front of the echo.
    pub(super) front: Pieces,
    /// Around it.
    pub(super) band: Pieces,
}

impl Layout {
    /// Which cells belong to `beam`.
    #[inline(always)]
    pub(super) fn lay_out<L: Lanes>(&mut self, beam: &Beam, apex: &Apex, geometry: &Geometry) {
        let resolution_m = geometry.resolution_m;
        self.places.clear();
        self.tiles.clear();
        (self.front.len, self.band.len) = (0, 0);
        let ray_m = beam.ray_m(resolution_m);
        if ray_m > 0.0 {
            let ray = Ray::new((beam.near_m, beam.far_m.min(ray_m)), beam.direction_rad, apex, resolution_m);
            let (first_row, last_row) = ray.extent();
            let count = last_row.abs_diff(first_row) as usize + 1;
            ray.fill(&mut self.rows, first_row, count);
            self.cut::<L>(apex, &geometry.on_axis(), first_row, count, None);
        }
        if beam.far_m > ray_m {
            let range_m = (beam.near_m, beam.far_m);
            let sector = Sector::new(beam.aperture_rad, range_m, beam.direction_rad, apex, resolution_m);
            let (first_row, last_row) = sector.extent();
            let count = last_row.abs_diff(first_row) as usize + 1;
            sector.fill::<L::Doubles>(&mut self.rows, first_row, count);
            self.cut::<L>(apex, geometry, first_row, count, (ray_m > 0.0).then_some(ray_m));
        }
    }

    /// Cuts the rows into what lies in each tile, but for what is nearer than `hole_m`.
    #[inline(always)]
    fn cut<L: Lanes>(&mut self, apex: &Apex, geometry: &Geometry, first_row: i32, count: usize, hole_m: Option<f64>) {
        let first_place = self.places.len();
        self.places.extend((0..count).map(|n| geometry.row(first_row + n as i32)));
        let mut from = 0;
        while from < count {
            // The rows that lie in the same row of tiles
            let row = apex.cell.j + first_row + from as i32;
            let row_in_tile = row.rem_euclid(SIDE);
            let to = count.min(from + (SIDE - row_in_tile) as usize);
            let Stretch { low, high } = self.rows.columns(from, to);
            let mut x = (apex.cell.i + low).div_euclid(SIDE);
            while low <= high && x <= (apex.cell.i + high).div_euclid(SIDE) {
                let rows = RowsOfTile {
                    first_row: first_row + from as i32,
                    from,
                    to,
                    first_column: x * SIDE - apex.cell.i,
                    row_in_tile,
                    first_place: (first_place + from) as i64,
                };
                let before = self.front.len + self.band.len;
                match hole_m {
                    None => {
                        self.cut_rows(&rows, L::COUNT as i32);
                        self.cut_tile(rows, L::COUNT as u32);
                    }
                    Some(hole_m) => self.cut_tile_without(rows, L::COUNT as u32, geometry, hole_m),
                }
                if self.front.len + self.band.len > before {
                    let index = TileIndex { x, y: row.div_euclid(SIDE) };
                    let (front, band) = (self.front.len, self.band.len);
                    self.tiles.push(TilePieces {
                        index,
                        front,
                        band,
                        is_ray: geometry.is_on_axis(),
                        first_column: rows.first_column,
                        first_place: rows.first_place - i64::from(row_in_tile),
                    });
                }
                x += 1;
            }
            from = to;
        }
    }

    /// What lies in a tile of some of its rows: around the echo before and behind what is free of each, what is free, and of that
    /// what is left when one piece is cut off.
    #[inline(always)]
    fn cut_rows(&mut self, tile: &RowsOfTile, lanes: i32) {
        let Self { rows, cut, .. } = self;
        let count = tile.to - tile.from;
        for cut in cut.iter_mut().filter(|cut| cut.len() < count) {
            cut.resize(count, 0);
        }
        let [low, high, free_low, free_high] = rows.of(tile.from, tile.to);
        let [before, behind, free, more] = cut.each_mut().map(|cut| &mut cut[..count]);
        let (first_column, last_column) = (tile.first_column, tile.first_column + SIDE - 1);
        // Where in the tile column 0 would be
        let begins = tile.row_in_tile * SIDE - tile.first_column;
        for row in 0..count {
            let (low, high) = (low[row].max(first_column), high[row].min(last_column));
            let (free_low, free_high) = (free_low[row].max(low), free_high[row].min(high));
            let is_free = free_low <= free_high;
            let before_high = if is_free { free_low - 1 } else { high };
            let behind_low = if is_free { free_high + 1 } else { high + 1 };
            let free_count = (free_high - free_low + 1).max(0);
            let at = begins + row as i32 * SIDE;
            before[row] = piece(at + low, before_high - low + 1);
            behind[row] = piece(at + behind_low, high - behind_low + 1);
            free[row] = piece(at + free_low, free_count);
            more[row] = piece(at + free_low + lanes, free_count - lanes);
        }
    }

    /// A function of its own: the compiler would spread its few variables over the stack else.
    #[inline(never)]
    fn cut_tile(&mut self, tile: RowsOfTile, lanes: u32) {
        let Self { cut, front, band, .. } = self;
        let (mut front, mut band) = (front.cursor(&tile), band.cursor(&tile));
        let [before, behind, free, more] = cut.each_ref().map(|cut| &cut[..tile.to - tile.from]);
        for (((before, behind), free), more) in before.iter().zip(behind).zip(free).zip(more) {
            band.write_all(*before, lanes);
            front.write(*free, lanes);
            front.write_all(*more, lanes);
            band.write_all(*behind, lanes);
        }
        (self.front.len, self.band.len) = (front.len, band.len);
    }

    /// Likewise, of a cone the first part of which is a ray.
    #[inline(never)]
    fn cut_tile_without(&mut self, tile: RowsOfTile, lanes: u32, geometry: &Geometry, hole_m: f64) {
        let Self { rows, front, band, .. } = self;
        let columns = Stretch { low: tile.first_column, high: tile.first_column + SIDE - 1 };
        let (mut front, mut band) = (front.cursor(&tile), band.cursor(&tile));
        let mut at = tile.row_in_tile * SIDE - tile.first_column;
        for (row, (cells, free)) in (tile.first_row..).zip(rows.between(tile.from, tile.to)) {
            let cells = cells.and(columns);
            let free = free.and(cells);
            if !cells.is_empty() {
                let hole = disc(hole_m, geometry.dy(row), geometry.offset_x, geometry.resolution_m);
                let [before, behind] = around(cells, free);
                for part in without(before, hole).into_iter().chain(without(behind, hole)) {
                    band.write_all(piece(at + part.low, part.high - part.low + 1), lanes);
                }
                for part in without(free, hole) {
                    front.write_all(piece(at + part.low, part.high - part.low + 1), lanes);
                }
            }
            at += SIDE;
        }
        (self.front.len, self.band.len) = (front.len, band.len);
    }
}

/// Some rows of a tile.
#[derive(Debug, Clone, Copy)]
struct RowsOfTile {
    /// Counted from the transducer's.
    first_row: i32,
    /// Among all rows.
    from: usize,
    to: usize,
    /// Of the tile, counted from the transducer's.
    first_column: i32,
    row_in_tile: i32,
    /// Of the first of them.
    first_place: i64,
}

/// What is left of some cells on both sides of those that are free; all of it on one side where none is.
#[inline(always)]
fn around(cells: Stretch, free: Stretch) -> [Stretch; 2] {
    let is_free = !free.is_empty();
    let before = if is_free { free.low - 1 } else { cells.high };
    let behind = if is_free { free.high + 1 } else { cells.high + 1 };
    [Stretch { low: cells.low, high: before }, Stretch { low: behind, high: cells.high }]
}

/// Cells that are not in the hole.
fn without(cells: Stretch, hole: Stretch) -> [Stretch; 2] {
    if hole.and(cells).is_empty() {
        [cells, Stretch::EMPTY]
    } else {
        [Stretch { low: cells.low, high: hole.low - 1 }, Stretch { low: hole.high + 1, high: cells.high }]
    }
}

/// Pieces, tile by tile.
#[derive(Debug, Clone, Default)]
pub(super) struct Pieces {
    /// More than there are.
    pieces: Vec<Piece>,
    len: usize,
}

impl Pieces {
    /// At least as many as there are cells.
    pub(super) fn room<L: Lanes>(&self) -> usize {
        self.len * L::COUNT
    }

    /// Those of a tile.
    #[inline(always)]
    pub(super) fn between(&self, from: usize, to: usize) -> &[Piece] {
        &self.pieces[from..to]
    }

    /// Where more are added, of some rows of a tile.
    fn cursor(&mut self, tile: &RowsOfTile) -> Cursor<'_> {
        // Of eight lanes or more, in up to four parts, and some that are written in vain.
        const MOST_PER_ROW: usize = TILE_SIDE / 8 + 5;
        let most = self.len + (tile.to - tile.from + 1) * MOST_PER_ROW;
        if self.pieces.len() < most {
            self.pieces.resize(most, Piece::default());
        }
        Cursor { pieces: &mut self.pieces, len: self.len }
    }
}

struct Cursor<'a> {
    pieces: &'a mut [Piece],
    len: usize,
}

impl Cursor<'_> {
    /// Writes as much of a piece as is computed at once, which counts if it has cells. (A jump here would be as good as never foreseen.)
    #[inline(always)]
    fn write(&mut self, piece: u32, lanes: u32) {
        let cells = (piece >> 16).min(lanes);
        self.pieces[self.len] = Piece { offset: piece as u16, cells: cells as u16 };
        self.len += usize::from(cells > 0);
    }

    /// Writes a piece.
    #[inline(always)]
    fn write_all(&mut self, piece: u32, lanes: u32) {
        self.write(piece, lanes);
        self.write_rest(piece, lanes);
    }

    /// What is left of it then; hardly ever is anything.
    #[inline(always)]
    fn write_rest(&mut self, mut piece: u32, lanes: u32) {
        while piece >> 16 > lanes {
            piece = piece + lanes - (lanes << 16);
            self.write(piece, lanes);
        }
    }
}

/// Cells of a tile: the first of them, and above that how many they are, none if that is below 0.
#[inline(always)]
fn piece(first: i32, count: i32) -> u32 {
    first as u32 & 0xffff | (count.max(0) as u32) << 16
}
