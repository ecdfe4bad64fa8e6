//! The rules that add up (`paper`, `covariance`): what each cell of a beam gains.

use super::fit::fit;
use super::functions::{exp, log_odds, polynomial, reciprocal, splat_all};
use super::geometry::{ANGLE, Band, Geometry, Wide, make_room};
use super::lanes::Lanes;
use super::layout::{Layout, Piece, PlaceOfRow};
use super::wide::Work;
use super::{Apex, Place};
use crate::grid::Tile;
use crate::sensor_model::Cone;

/// Coefficients of 2 artanh(y)/y as a function of y².
pub(super) const ARTANH: usize = 3;
/// Peaks of region I that are at least this far from certain are near enough to even odds for so few.
const LOWEST_P_FREE: f64 = 0.28;

/// What the cells of a reading have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    pub(super) geometry: Geometry,
    /// z, metres.
    range_m: f64,
    /// √½ / σ_z.
    steepness: f32,
    /// 2 w (p_occ − ½).
    echo_peak: f32,
    /// 2 w (½ − p_free).
    free_peak: f32,
    /// 1 / (z − kσ_z)².
    inverse_near_squared: f32,
    /// None where the peak of region I is too close to certainty.
    artanh: Option<[f32; ARTANH]>,
}

impl Profile {
    pub(super) fn new(cone: &Cone, geometry: Geometry, artanh: Option<[f32; ARTANH]>) -> Self {
        let near_m = cone.near_m();
        Self {
            geometry,
            range_m: cone.range_m,
            steepness: (core::f64::consts::FRAC_1_SQRT_2 / cone.deviations.sigma_z_m) as f32,
            echo_peak: (2.0 * cone.deviations.trust * (cone.p_occupied - 0.5)) as f32,
            free_peak: (2.0 * cone.deviations.trust * (0.5 - cone.p_free)) as f32,
            inverse_near_squared: (1.0 / (near_m * near_m)) as f32,
            artanh,
        }
    }
}

/// 2 artanh(y)/y = ln((1 + y)/(1 − y))/y as a polynomial in y², for all y that region I can have.
pub(super) fn artanh(p_free: f64) -> Option<[f32; ARTANH]> {
    if !(LOWEST_P_FREE..0.5).contains(&p_free) {
        return None;
    }
    let most = 1.0 - 2.0 * p_free;
    let coefficients: [f64; ARTANH] = fit(
        |square| {
            let y = square.sqrt();
            (libm::log1p(y) - libm::log1p(-y)) / y
        },
        most * most,
    );
    Some(coefficients.map(|c| c as f32))
}

/// The polynomial of one degree less that differs least from this one over [0, 1]: x⁴ is replaced by what Chebyshev's polynomial of
/// degree 4 leaves of it. Where p is near even odds that is enough.
pub(super) fn shortened(angle: &[f32; ANGLE]) -> [f32; ANGLE - 1] {
    const LEFT: [f32; ANGLE - 1] = [1.0, -32.0, 160.0, -256.0];
    core::array::from_fn(|power| angle[power] - angle[ANGLE - 1] * LEFT[power] / 128.0)
}

/// What is known of the cells of the beam at hand; kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    pub(super) layout: Layout,
    band: Band,
    /// Of the cells around the echo.
    gains: Vec<f32>,
}

/// Adding a reading to a grid.
pub(super) struct Adding<'a> {
    pub(super) scratch: &'a mut Scratch,
    pub(super) profile: &'a Profile,
    pub(super) beam: super::layout::Beam,
    pub(super) apex: Apex,
    pub(super) limits: Limits,
    pub(super) place: Place<'a>,
}

/// Where cells start, and how far they may get.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// l0.
    pub(super) prior: f32,
    /// l_max.
    pub(super) max: f32,
}

impl Work for Adding<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { scratch, profile, beam, apex, limits, mut place } = self;
        scratch.layout.lay_out::<L>(&beam, &apex, &profile.geometry);
        scratch.band.fill::<L>(&scratch.layout);
        echo_gains::<L>(scratch, profile);
        let Scratch { layout, gains, .. } = scratch;
        let (mut from, mut at) = ((0, 0), 0);
        let free = Free::<L>::new(profile);
        let limits = WideLimits::new(limits);
        for pieces in &layout.tiles {
            let tile = place.tile(pieces.index);
            let free = Free { wide: free.wide.on_axis(pieces.is_ray), ..free };
            let free_pieces = layout.front.between(from.0, pieces.front);
            if let Some(artanh) = &profile.artanh {
                let artanh = splat_all(artanh);
                let angle = splat_all(&shortened(&profile.geometry.angle));
                for piece in free_pieces {
                    let y = free.y(&angle, pieces.column(*piece), &layout.places[pieces.place(*piece)]);
                    limits.add_product(cells_of(tile, piece), y, polynomial(&artanh, y.mul(y)));
                }
            } else {
                let angle = splat_all(&profile.geometry.angle);
                for piece in free_pieces {
                    limits.add(
                        cells_of(tile, piece),
                        log_odds(free.y(&angle, pieces.column(*piece), &layout.places[pieces.place(*piece)])),
                    );
                }
            }
            for piece in layout.band.between(from.1, pieces.band) {
                limits.add(cells_of(tile, piece), L::load(&gains[at..]));
                at += usize::from(piece.cells);
            }
            from = (pieces.front, pieces.band);
        }
    }
}

/// What the cells around the echo gain.
#[inline(always)]
fn echo_gains<L: Lanes>(scratch: &mut Scratch, profile: &Profile) {
    let Scratch { band, gains, .. } = scratch;
    make_room(gains, band.count);
    let wide = Wide::<L>::new(&profile.geometry);
    let (range, steepness) = (L::splat(profile.range_m as f32), L::splat(profile.steepness));
    for at in (0..band.count).step_by(L::COUNT) {
        let places = band.places(at, &profile.geometry, profile.range_m);
        let off = places.off(range, steepness);
        let angular = wide.angular(places.across, places.square);
        let y = L::splat(profile.echo_peak).mul(exp(L::splat(0.0).sub(off.mul(off)))).mul(angular);
        log_odds(y).store(&mut gains[at..]);
    }
}

/// What region I takes.
#[derive(Clone, Copy)]
struct Free<L> {
    wide: Wide<L>,
    /// Minus the peak, and what of it a distance squared takes away.
    minus_peak: L,
    fading: L,
}

impl<L: Lanes> Free<L> {
    #[inline(always)]
    fn new(profile: &Profile) -> Self {
        Self {
            wide: Wide::new(&profile.geometry),
            minus_peak: L::splat(-profile.free_peak),
            fading: L::splat(profile.free_peak * profile.inverse_near_squared),
        }
    }

    /// 2p − 1 of the cells of a row from `column` on, negative.
    #[inline(always)]
    fn y<const N: usize>(&self, angle: &[L; N], column: f32, row: &PlaceOfRow) -> L {
        let (square, across) = self.wide.places(column, row);
        let angular = polynomial(angle, across.mul(across).mul(reciprocal(square)));
        square.mul_add(self.fading, self.minus_peak).mul(angular)
    }
}

/// [`Limits`] in all lanes.
#[derive(Clone, Copy)]
pub(super) struct WideLimits<L> {
    prior: L,
    max: L,
    min: L,
}

impl<L: Lanes> WideLimits<L> {
    #[inline(always)]
    pub(super) fn new(limits: Limits) -> Self {
        Self { prior: L::splat(limits.prior), max: L::splat(limits.max), min: L::splat(-limits.max) }
    }

    /// Lets cells gain a × b, less l0.
    #[inline(always)]
    fn add_product(&self, cells: &mut [f32], a: L, b: L) {
        // What is unknown has gained nothing so far.
        let gained = L::load_some(cells).sub(self.prior).or(L::splat(0.0));
        self.store(cells, a.mul_add(b, gained));
    }

    /// Lets those of as many cells as there are lanes that are chosen gain a × b, less l0.
    #[inline(always)]
    pub(super) fn add_product_where(&self, chosen: L::Mask, cells: &mut [f32], a: L, b: L) {
        let gained = L::load(cells).sub(self.prior).or(L::splat(0.0));
        a.mul_add(b, gained).at_least(self.min).at_most(self.max).store_where(chosen, cells);
    }

    /// Lets cells gain log-odds, less l0.
    #[inline(always)]
    fn add(&self, cells: &mut [f32], log_odds: L) {
        let gained = L::load_some(cells).sub(self.prior).or(L::splat(0.0));
        self.store(cells, log_odds.add(gained));
    }

    /// Lets cells gain.
    #[inline(always)]
    pub(super) fn add_gain(&self, cells: &mut [f32], gain: L) {
        self.store(cells, L::load_some(cells).or(self.prior).add(gain));
    }

    #[inline(always)]
    fn store(&self, cells: &mut [f32], log_odds: L) {
        log_odds.at_least(self.min).at_most(self.max).store_some(cells);
    }
}

impl Limits {
    /// Lets a cell gain log-odds, less l0.
    #[inline(always)]
    pub(super) fn add(&self, cell: &mut f32, log_odds: f32) {
        let gained = if cell.is_nan() { 0.0 } else { *cell - self.prior };
        let sum = log_odds + gained;
        let sum = if sum > -self.max { sum } else { -self.max };
        *cell = if sum < self.max { sum } else { self.max };
    }
}

/// The cells of a piece.
#[inline(always)]
pub(super) fn cells_of<'a>(tile: &'a mut Tile, piece: &Piece) -> &'a mut [f32] {
    let first = usize::from(piece.offset);
    &mut tile.log_odds[first..first + usize::from(piece.cells)]
}
