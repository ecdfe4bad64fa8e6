//! One pass over the cells of a wedge of beams ([`super::fan`]).

use super::fan::{Curves, Wedge};
use super::functions::{exp, log_odds, polynomial, splat_all};
use super::geometry::{TINY, make_room};
use super::lanes::{Lanes, WHOLE};
use super::paper::{Limits, WideLimits};
use super::spans::{Rows, Sector, Stretch};
use super::wide::Work;
use super::{Apex, Place};
use crate::grid::{TILE_CELLS, TILE_SIDE, Tile, TileIndex};

const SIDE: i32 = TILE_SIDE as i32;
/// In a row of a tile, of eight lanes.
const MOST_BLOCKS: usize = TILE_SIDE / 8;

/// Kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct FanScratch {
    rows: Rows,
    /// Of a part of the wedge.
    some: Rows,
    /// Of each row.
    places: Vec<PlaceOfRow>,
    pieces: Vec<Piece>,
    band: Band,
}

/// What the cells of a row have in common.
#[derive(Debug, Clone, Copy, Default)]
struct PlaceOfRow {
    dy_squared: f32,
    /// Of a cell right above or below the transducer: along the axis, and across it.
    along: f32,
    across: f32,
}

/// Cells of one row of a tile that are computed at once: which of these blocks it is, counted row by row, and a bit for each cell.
#[derive(Debug, Clone, Copy, Default)]
struct Piece {
    block: u16,
    cells: u16,
}

/// The cells of a tile that lie around an echo.
#[derive(Debug, Clone, Default)]
struct Band {
    count: usize,
    /// Within the tile.
    offsets: Vec<f32>,
    /// Of each its beam's place, and how far from the beam's axis it is, steps.
    places: Vec<f32>,
    gains: Vec<f32>,
}

/// Adding a wedge to a grid.
pub(super) struct AddingWedge<'a, 'g> {
    pub(super) scratch: &'a mut FanScratch,
    pub(super) wedge: &'a Wedge,
    pub(super) curves: &'a Curves,
    pub(super) apex: Apex,
    pub(super) limits: Limits,
    pub(super) resolution_m: f64,
    pub(super) place: &'a mut Place<'g>,
}

/// What all cells of a wedge have in common.
#[derive(Clone, Copy)]
struct Fixed<'a, L> {
    wedge: &'a Wedge,
    curves: &'a Curves,
    resolution: L,
    minus_offset: L,
    sin: L,
    cos: L,
    middle: L,
    /// Of atan(t)/t, in steps.
    atan: [L; super::fan::ATAN],
    limits: WideLimits<L>,
    each: Limits,
}

/// Rows of a tile.
#[derive(Debug, Clone, Copy)]
struct Part {
    index: TileIndex,
    /// The first column of the tile, and the first row of the part, counted from the transducer's.
    first_column: i32,
    first_row: i32,
    /// Where in the tile that row begins.
    offset: i32,
    /// Among all rows.
    from: usize,
    to: usize,
}

impl Work for AddingWedge<'_, '_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { scratch, wedge, curves, apex, limits, resolution_m, place } = self;
        let FanScratch { rows, some, places, pieces, band } = scratch;
        let (first_row, count) = wedge.lay_out::<L>(rows, some, &apex, resolution_m);
        places.clear();
        places.extend((0..count).map(|n| wedge.row(first_row + n as i32, &apex, resolution_m)));
        let fixed = Fixed::<L>::new(wedge, curves, &apex, limits, resolution_m);
        let mut from = 0;
        while from < count {
            // The rows that lie in the same row of tiles
            let row = apex.cell.j + first_row + from as i32;
            let row_in_tile = row.rem_euclid(SIDE);
            let to = count.min(from + (SIDE - row_in_tile) as usize);
            let Stretch { low, high } = rows.columns(from, to);
            let mut x = (apex.cell.i + low).div_euclid(SIDE);
            while low <= high && x <= (apex.cell.i + high).div_euclid(SIDE) {
                let part = Part {
                    index: TileIndex { x, y: row.div_euclid(SIDE) },
                    first_column: x * SIDE - apex.cell.i,
                    first_row: first_row + from as i32,
                    offset: row_in_tile * SIDE,
                    from,
                    to,
                };
                let pieces = part.cut::<L>(rows, pieces);
                fixed.add(place, (pieces, &places[from..to]), band, &part, (&apex, resolution_m));
                x += 1;
            }
            from = to;
        }
    }
}

impl<'a, L: Lanes> Fixed<'a, L> {
    #[inline(always)]
    fn new(wedge: &'a Wedge, curves: &'a Curves, apex: &Apex, limits: Limits, resolution_m: f64) -> Self {
        let mut atan = curves.atan;
        for coefficient in &mut atan {
            *coefficient = (f64::from(*coefficient) / wedge.step_rad) as f32;
        }
        Self {
            wedge,
            curves,
            resolution: L::splat(resolution_m as f32),
            minus_offset: L::splat(-apex.offset_x as f32),
            sin: L::splat(wedge.sin as f32),
            cos: L::splat(wedge.cos as f32),
            middle: L::splat(wedge.middle as f32),
            atan: splat_all(&atan),
            limits: WideLimits::new(limits),
            each: limits,
        }
    }

    /// Adds what lies in a tile, which is one only if anything does. (A jump for what none of its cells needs would hardly ever be
    /// foreseen, and it is long until it is known.)
    #[inline(always)]
    fn add(
        self,
        place: &mut Place<'_>,
        (pieces, places): (&[Piece], &[PlaceOfRow]),
        band: &mut Band,
        part: &Part,
        at: (&Apex, f64),
    ) {
        let (mut place, mut tile) = (Some(place), None);
        let mut dx = [L::splat(0.0); MOST_BLOCKS];
        for (block, dx) in dx.iter_mut().enumerate().take(SIDE as usize / L::COUNT) {
            let column = (part.first_column + (block * L::COUNT) as i32) as f32;
            *dx = L::counting().add(L::splat(column)).mul_add(self.resolution, self.minus_offset);
        }
        band.begin();
        for Piece { block, cells } in pieces.iter().copied() {
            let (row, column) = Piece::place::<L>(block);
            let (square, turn, seen) = self.seen(&places[row], dx[column], L::chosen(u32::from(cells)));
            if let Some(unmade) = place.take() {
                if L::bits(seen) == 0 {
                    place = Some(unmade);
                    continue;
                }
                tile = Some(unmade.tile(part.index));
            }
            let Some(tile) = &mut tile else { continue };
            let offset = part.offset as usize + usize::from(block) * L::COUNT;
            let free = self.add_free(&mut tile.log_odds[offset..offset + L::COUNT], square, turn, seen);
            band.put(L::without(seen, free), L::counting().add(L::splat(offset as f32)), turn);
        }
        if let Some(tile) = tile
            && band.count > 0
        {
            self.add_band(tile, band, part, at);
        }
    }

    /// d² of some cells of a row, their places in steps, and which of them a beam reaches.
    #[inline(always)]
    fn seen(&self, row: &PlaceOfRow, dx: L, cells: L::Mask) -> (L, L, L::Mask) {
        let square = dx.mul_add(dx, L::splat(row.dy_squared));
        let along = dx.mul_add(self.cos, L::splat(row.along));
        let across = dx.neg_mul_add(self.sin, L::splat(row.across));
        let tangent = across.div(along);
        let turn = tangent.mul_add(polynomial(&self.atan, tangent.mul(tangent)), self.middle);
        let seen = square.no_greater(whole(turn).pick(&self.wedge.far_squared), cells);
        (square, turn, seen)
    }

    /// Adds what the beams say of cells in front of their echoes; which are that.
    #[inline(always)]
    fn add_free(&self, cells: &mut [f32], square: L, turn: L, seen: L::Mask) -> L::Mask {
        let place = whole(turn);
        let height = square.mul_add(place.pick(&self.wedge.fading), place.pick(&self.wedge.minus_peak));
        let free = height.less(L::splat(0.0), seen);
        let off = self.off(turn, place);
        if let Some(artanh) = &self.curves.artanh {
            let y = height.mul(polynomial(&splat_all(&self.curves.short_angle), off));
            self.limits.add_product_where(free, cells, y, polynomial(&splat_all(artanh), y.mul(y)));
        } else {
            let y = height.mul(polynomial(&splat_all(&self.curves.angle), off));
            self.limits.add_product_where(free, cells, log_odds(y), L::splat(1.0));
        }
        free
    }

    /// (φ/σ_θ)².
    #[inline(always)]
    fn off(&self, turn: L, place: L) -> L {
        let off = turn.sub(place.sub(L::splat(WHOLE)));
        off.mul(off).mul(place.pick(&self.wedge.narrowness))
    }

    /// Adds what the beams say of cells around their echoes.
    #[inline(always)]
    fn add_band(&self, tile: &mut Tile, band: &mut Band, part: &Part, (apex, resolution_m): (&Apex, f64)) {
        let wedge = self.wedge;
        let side = L::splat(SIDE as f32);
        let first_column = L::splat(part.first_column as f32);
        // The row of the tile's first cell
        let first_row = L::splat((part.first_row - part.offset / SIDE) as f32);
        let angle = splat_all(&self.curves.angle);
        for at in (0..band.count).step_by(L::COUNT) {
            let (offset, turn) = (L::load(&band.offsets[at..]), L::load(&band.places[at..]));
            let place = whole(turn);
            // Half a row less, rounded to the nearest, is the whole row below.
            let half = L::splat(0.5 - 0.5 / SIDE as f32);
            let row = whole(offset.mul(L::splat(1.0 / SIDE as f32)).sub(half)).sub(L::splat(WHOLE));
            let (column, row) = (row.neg_mul_add(side, offset).add(first_column), row.add(first_row));
            let dx = column.mul_add(self.resolution, self.minus_offset);
            let dy = row.mul_add(self.resolution, L::splat(-apex.offset_y as f32));
            let square = dx.mul_add(dx, dy.mul_add(dy, L::splat(TINY)));
            let (range_squared, rest) = (place.pick(&wedge.range_squared), place.pick(&wedge.range_squared_rest));
            let beyond = column.squares_less(row, resolution_m, (apex.offset_x, apex.offset_y), range_squared, rest);
            // (d − z) = (d² − z²)/(d + z), to all of its digits
            let off = beyond.mul(place.pick(&wedge.steepness)).div(place.pick(&wedge.range).add(square.sqrt()));
            let height = place.pick(&wedge.echo_peak).mul(exp(L::splat(0.0).sub(off.mul(off))));
            log_odds(height.mul(polynomial(&angle, self.off(turn, place)))).store(&mut band.gains[at..]);
        }
        let cells = band.offsets.iter().zip(&band.gains).take(band.count);
        for (offset, gain) in cells {
            self.each.add(&mut tile.log_odds[*offset as usize % TILE_CELLS], *gain);
        }
    }
}

impl Wedge {
    /// From where to where the wedge reaches in each row, as far as the farthest of every few beams does; the first row, and how many.
    #[inline(always)]
    fn lay_out<L: Lanes>(&self, rows: &mut Rows, some: &mut Rows, apex: &Apex, resolution_m: f64) -> (i32, usize) {
        let sectors = self.parts.iter().map(|part| {
            let sector = Sector::between(part.left_rad, part.right_rad, (0.0, part.far_m), apex, resolution_m);
            let (first, last) = sector.extent();
            (sector, first, last)
        });
        let (first, last) = sectors.clone().fold((i32::MAX, i32::MIN), |all, (_, a, b)| (all.0.min(a), all.1.max(b)));
        let count = last.abs_diff(first) as usize + 1;
        rows.clear(count);
        for (sector, a, b) in sectors {
            let count = b.abs_diff(a) as usize + 1;
            sector.fill::<L::Doubles>(some, a, count);
            rows.widen(a.abs_diff(first) as usize, some, count);
        }
        (first, count)
    }

    #[inline(always)]
    fn row(&self, row: i32, apex: &Apex, resolution_m: f64) -> PlaceOfRow {
        let dy = f64::from(row) * resolution_m - apex.offset_y;
        let (along, across) = ((dy * self.sin) as f32, (dy * self.cos) as f32);
        PlaceOfRow { dy_squared: (dy * dy) as f32 + TINY, along, across }
    }
}

impl Part {
    /// What lies in the tile, cut into as many cells as are computed at once. (Likewise without jumps.)
    #[inline(always)]
    fn cut<'a, L: Lanes>(&self, rows: &Rows, pieces: &'a mut Vec<Piece>) -> &'a [Piece] {
        let blocks = SIDE as usize / L::COUNT;
        if pieces.len() < TILE_CELLS {
            pieces.resize(TILE_CELLS, Piece::default());
        }
        let (mut len, mut block) = (0, 0);
        for (cells, _) in rows.between(self.from, self.to) {
            let low = cells.low.saturating_sub(self.first_column).clamp(0, SIDE);
            let count = cells.high.saturating_sub(self.first_column).clamp(-1, SIDE - 1) - low + 1;
            // A bit for each cell of the row
            let all = if count > 0 { u64::MAX >> (SIDE - count) << low } else { 0 };
            for at in 0..blocks {
                let cells = (all >> (at * L::COUNT)) as u16 & (u16::MAX >> (16 - L::COUNT));
                pieces[len % TILE_CELLS] = Piece { block, cells };
                len += usize::from(cells != 0);
                block += 1;
            }
        }
        &pieces[..len]
    }
}

impl Piece {
    /// Row and block within the row.
    #[inline(always)]
    fn place<L: Lanes>(block: u16) -> (usize, usize) {
        let blocks = SIDE as usize / L::COUNT;
        (usize::from(block) / blocks, usize::from(block) % blocks)
    }
}

/// The place nearest to this, in the low bits.
#[inline(always)]
fn whole<L: Lanes>(turn: L) -> L {
    turn.add(L::splat(WHOLE))
}

impl Band {
    fn begin(&mut self) {
        self.count = 0;
        for numbers in [&mut self.offsets, &mut self.places, &mut self.gains] {
            make_room(numbers, TILE_CELLS);
        }
    }

    #[inline(always)]
    fn put<L: Lanes>(&mut self, chosen: L::Mask, offsets: L, places: L) {
        offsets.store_together(chosen, &mut self.offsets[self.count..]);
        places.store_together(chosen, &mut self.places[self.count..]);
        self.count += L::bits(chosen).count_ones() as usize;
    }
}
