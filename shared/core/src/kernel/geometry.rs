//! Where cells lie in a beam, seen from its transducer: never from the origin of the map, so that single precision does.

use super::Apex;
use super::functions::{polynomial, reciprocal, splat_all};
use super::lanes::Lanes;
use super::layout::{Layout, PlaceOfRow};

/// Coefficients of the angular factor.
pub(super) const ANGLE: usize = 5;

/// Far below what a distance can be told apart by: it keeps 0/0 out.
pub(super) const TINY: f32 = 1e-30;

/// What a beam does to all of its cells. Lengths in metres from the transducer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Geometry {
    pub(super) resolution_m: f64,
    /// Of the transducer from the centre of its own cell.
    pub(super) offset_x: f64,
    pub(super) offset_y: f64,
    /// Sine and cosine of the axis, each divided by the sine of half the aperture: across / distance is then ±1 at
    /// the edges of the cone.
    pub(super) scaled_sin: f64,
    pub(super) scaled_cos: f64,
    /// exp(−½ (φ/σ_θ)²) as a polynomial in (sin φ / sin ½β)².
    pub(super) angle: [f32; ANGLE],
}

impl Geometry {
    pub(super) fn new(resolution_m: f64, apex: &Apex, axis_rad: f64, aperture_rad: f64, angle: [f32; ANGLE]) -> Self {
        let (sin, cos) = libm::sincos(axis_rad);
        let edge = libm::sin(0.5 * aperture_rad);
        Self {
            resolution_m,
            offset_x: apex.offset_x,
            offset_y: apex.offset_y,
            scaled_sin: sin / edge,
            scaled_cos: cos / edge,
            angle,
        }
    }

    /// As if all cells lay on the axis.
    pub(super) fn on_axis(&self) -> Self {
        Self { scaled_sin: 0.0, scaled_cos: 0.0, ..*self }
    }

    pub(super) fn is_on_axis(&self) -> bool {
        self.scaled_sin == 0.0 && self.scaled_cos == 0.0
    }

    #[inline(always)]
    pub(super) fn row(&self, number: i32) -> PlaceOfRow {
        let dy = self.dy(number);
        let (dy_squared, across) = ((dy * dy) as f32 + TINY, (dy * self.scaled_cos) as f32);
        PlaceOfRow { number: number as f32, dy_squared, across }
    }

    /// How far the centres of a row lie above the transducer, metres.
    #[inline(always)]
    pub(super) fn dy(&self, row: i32) -> f64 {
        f64::from(row) * self.resolution_m - self.offset_y
    }
}

/// [`Geometry`] in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Wide<L> {
    resolution: L,
    minus_offset: L,
    scaled_sin: L,
    angle: [L; ANGLE],
}

impl<L: Lanes> Wide<L> {
    #[inline(always)]
    pub(super) fn new(geometry: &Geometry) -> Self {
        Self {
            resolution: L::splat(geometry.resolution_m as f32),
            minus_offset: L::splat(-geometry.offset_x as f32),
            scaled_sin: L::splat(geometry.scaled_sin as f32),
            angle: splat_all(&geometry.angle),
        }
    }

    /// As if all cells lay on the axis.
    #[inline(always)]
    pub(super) fn on_axis(self, is_on_axis: bool) -> Self {
        Self { scaled_sin: if is_on_axis { L::splat(0.0) } else { self.scaled_sin }, ..self }
    }

    /// exp(−½ (φ/σ_θ)²) of cells at these distances squared, so far across the axis (scaled).
    #[inline(always)]
    pub(super) fn angular(&self, across: L, square: L) -> L {
        polynomial(&self.angle, across.mul(across).mul(reciprocal(square)))
    }

    /// Distances squared, and how far across the axis (scaled), of the cells of this row from `column` on.
    #[inline(always)]
    pub(super) fn places(&self, column: f32, row: &PlaceOfRow) -> (L, L) {
        let PlaceOfRow { dy_squared, across, .. } = *row;
        let dx = L::counting().add(L::splat(column)).mul_add(self.resolution, self.minus_offset);
        (dx.mul_add(dx, L::splat(dy_squared)), dx.neg_mul_add(self.scaled_sin, L::splat(across)))
    }
}

/// The cells around the echo, one after the other, in the order of the layout: their few cells per row fill no vector.
#[derive(Debug, Clone, Default)]
pub(super) struct Band {
    pub(super) count: usize,
    /// Counted from the transducer's.
    columns: Vec<f32>,
    rows: Vec<f32>,
    /// 0 on a ray, all of whose cells count as lying on the axis; else 1.
    aside: Vec<f32>,
}

/// Where some cells around the echo lie.
pub(super) struct Places<L> {
    /// d².
    pub(super) square: L,
    /// d² − z², to all of its digits.
    pub(super) beyond: L,
    /// Across the axis, scaled.
    pub(super) across: L,
}

impl Band {
    #[inline(always)]
    pub(super) fn fill<L: Lanes>(&mut self, layout: &Layout) {
        // Room for whole vectors
        let Self { columns, rows, aside, .. } = self;
        for numbers in [&mut *columns, &mut *rows, &mut *aside] {
            make_room(numbers, layout.band.room::<L>());
        }
        let (mut from, mut at) = (0, 0);
        for tile in &layout.tiles {
            let is_aside = L::splat(if tile.is_ray { 0.0 } else { 1.0 });
            for piece in layout.band.between(from, tile.band) {
                // What is written beyond the end of the piece, the next one overwrites.
                L::counting().add(L::splat(tile.column(*piece))).store(&mut columns[at..]);
                L::splat(layout.places[tile.place(*piece)].number).store(&mut rows[at..]);
                is_aside.store(&mut aside[at..]);
                at += usize::from(piece.cells);
            }
            from = tile.band;
        }
        self.count = at;
    }

    /// Of the cells from `at` on, of a reading of `range_m`.
    #[inline(always)]
    pub(super) fn places<L: Lanes>(&self, at: usize, geometry: &Geometry, range_m: f64) -> Places<L> {
        let (column, row) = (L::load(&self.columns[at..]), L::load(&self.rows[at..]));
        let resolution = L::splat(geometry.resolution_m as f32);
        let dx = column.mul_add(resolution, L::splat(-geometry.offset_x as f32));
        let dy = row.mul_add(resolution, L::splat(-geometry.offset_y as f32));
        let across = dx.neg_mul_add(L::splat(geometry.scaled_sin as f32), dy.mul(L::splat(geometry.scaled_cos as f32)));
        let offset = (geometry.offset_x, geometry.offset_y);
        Places {
            square: dx.mul_add(dx, dy.mul_add(dy, L::splat(TINY))),
            beyond: column.squares(row, geometry.resolution_m, offset, range_m * range_m),
            across: across.mul(L::load(&self.aside[at..])),
        }
    }
}

impl<L: Lanes> Places<L> {
    /// (z − d) × `steepness`. As z² − d² = (z − d)(z + d) is known to all of its digits, so is this.
    #[inline(always)]
    pub(super) fn off(&self, range: L, steepness: L) -> L {
        let off = self.beyond.mul(steepness).div(range.add(self.square.sqrt()));
        L::splat(0.0).sub(off)
    }
}

/// Makes room for so many numbers, and for whole vectors of them.
pub(super) fn make_room(numbers: &mut Vec<f32>, count: usize) {
    let count = count + 2 * 16;
    if numbers.len() < count {
        numbers.resize(count, 0.0);
    }
}
