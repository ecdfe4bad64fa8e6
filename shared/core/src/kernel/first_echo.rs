//! The fast way to the numbers of [`crate::first_echo`].
//!
//! In front of the echo no cell can have given it: there S counts only as a product, and no order is needed. Only the cells around
//! the echo are sorted. Everything per cell is +, −, ×, ÷ and √ on arrays in double precision, which every processor rounds alike.
//!
//! **Bound.** Of the cells of the cone nearer than z + 3 σ_z and r_cap, and only of these, each gains what
//! [`FirstEcho::gains`] says, times the weight, to within [`super::BOUND`] of log-odds and half a unit in the last place of the stored
//! single-precision sum.

use super::fit::{evaluate, fit};
use super::lanes::ANGLE;
use super::spans::{self, RowSpan, Sector};
use super::{AngleFactor, Apex, OffMap, WIDEST_HALF_APERTURE_RAD, cells_around};
use crate::first_echo::{BEHIND, FirstEcho, SeenCell};
use crate::grid::{DirtyTiles, Grid, TILE_SIDE, Tile, TileIndex};
use crate::log_odds::probability_of;
use crate::pose::Pose2;

/// Cells nearer than this many σ_z before the echo did not give it: the density of a normal distribution is 1e-11 of its peak there.
const BEFORE: f64 = 7.0;

/// Of a range known better than this the likelihood would overflow, metres.
const FINEST_SIGMA_Z_M: f64 = 1e-9;

/// Coefficients of 2^x over [0, 1].
const POWER: usize = 10;

/// A reading of which a grid learns by the first-echo model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EchoCone {
    /// What came back, and how the sensor answers.
    pub reading: FirstEcho,
    /// β: full aperture, radians.
    pub aperture_rad: f64,
    /// ln(p0/(1 − p0)): what the log-odds of the grid are relative to.
    pub prior_log_odds: f64,
    /// What is left of a gain, in [0, 1].
    pub weight: f64,
}

impl EchoCone {
    /// min(z + 3σ_z, r_cap), metres; r_cap where nothing came back.
    #[must_use]
    pub fn far_m(&self) -> f64 {
        let FirstEcho { range_m, sigma_z_m, range_cap_m, .. } = self.reading;
        range_m.map_or(range_cap_m, |range_m| (range_m + BEHIND * sigma_z_m).min(range_cap_m))
    }

    /// From where on a cell may have given the echo, metres.
    fn near_m(&self) -> f64 {
        let FirstEcho { range_m, sigma_z_m, range_cap_m, .. } = self.reading;
        // Beyond the end where no cell has.
        range_m.map_or(2.0 * range_cap_m, |range_m| range_m - BEFORE * sigma_z_m)
    }

    /// Whether its numbers are such that every gain is finite.
    fn is_sound(&self) -> bool {
        let FirstEcho { range_m, sigma_z_m, sigma_theta_rad, detection, clutter, range_cap_m, lost } = self.reading;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let probability = |x: f64| x > 0.0 && x < 1.0;
        range_m.is_none_or(positive)
            && sigma_z_m >= FINEST_SIGMA_Z_M
            && sigma_z_m.is_finite()
            && positive(range_cap_m)
            && positive(self.aperture_rad)
            && sigma_theta_rad >= 0.5 * self.aperture_rad
            && sigma_theta_rad.is_finite()
            && probability(detection)
            && probability(clutter)
            && probability(lost)
            && self.prior_log_odds.abs() <= 100.0
            && (0.0..=1.0).contains(&self.weight)
    }
}

/// Adds readings to a grid by the first-echo model. Allocates nothing once it has seen a cone as large as any to come and the grid
/// has the tiles.
#[derive(Debug, Clone)]
pub struct FirstEchoKernel {
    /// l0.
    start: f64,
    /// l_max.
    max: f64,
    power: [f64; POWER],
    angle: AngleFactor,
    work: Work,
    /// Whether the processor computes several cells at once (AVX2).
    #[cfg(target_arch = "x86_64")]
    wide: bool,
}

/// What is known of the cells of the cone at hand; kept for its memory.
#[derive(Debug, Clone, Default)]
struct Work {
    rows: Vec<RowSpan>,
    tiles: Vec<TilePieces>,
    pieces: Vec<Piece>,
    /// In front of the echo.
    front: Cells,
    /// Around it.
    band: Cells,
    /// Distances of the latter, metres squared.
    squares: Vec<f64>,
    /// Of each, L, S and B.
    likelihood: Vec<f64>,
    unanswered: Vec<f64>,
    before: Vec<f64>,
    order: Vec<u64>,
}

/// Cells, in the order of the grid.
#[derive(Debug, Clone, Default)]
struct Cells {
    /// r: how probably each answers if it is there.
    answers: Vec<f64>,
    /// a = p r. In the end: what each gains.
    gains: Vec<f64>,
}

impl Cells {
    fn clear(&mut self) {
        self.answers.clear();
        self.gains.clear();
    }
}

/// The pieces of a cone that lie in a tile: up to this many, from where those of the last tile end.
#[derive(Debug, Clone, Copy)]
struct TilePieces {
    index: TileIndex,
    end: usize,
}

/// Some cells of one row of a tile.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Its first cell within the tile.
    offset: u16,
    cells: u16,
    /// Whether they lie in front of the echo.
    front: bool,
    /// Column of the first, counted from the transducer's.
    column: i32,
    /// Its centres, above the transducer, metres.
    dy: f64,
}

/// What the cells of a reading have in common.
#[derive(Debug, Clone, Copy)]
struct Common {
    resolution_m: f64,
    offset_x: f64,
    scaled_sin: f64,
    scaled_cos: f64,
    angle: [f64; ANGLE],
    power: [f64; POWER],
    detection: f64,
    /// Of cells that nobody spoke of yet.
    start: f64,
    prior: f64,
}

impl FirstEchoKernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64) -> Self {
        Self {
            start: log_odds_prior,
            max: log_odds_max,
            power: fit(libm::exp2, 1.0),
            angle: AngleFactor::new(),
            work: Work::default(),
            #[cfg(target_arch = "x86_64")]
            wide: std::arch::is_x86_feature_detected!("avx2"),
        }
    }

    /// Lets every cell of the cone of a transducer at `map_from_transducer` gain what the reading says of it. The tiles that
    /// changed get `revision` and are noted in `dirty`.
    ///
    /// # Errors
    /// When the cone or the pose is not finite or no reading at all, or the cone leaves the grid; nothing is changed then.
    pub fn add(
        &mut self,
        grid: &mut Grid,
        dirty: &mut DirtyTiles,
        map_from_transducer: Pose2,
        cone: &EchoCone,
        revision: u64,
    ) -> Result<(), OffMap> {
        if !cone.is_sound() {
            return Err(OffMap);
        }
        let apex = Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, grid.resolution_m())?;
        if 0.5 * cone.aperture_rad > WIDEST_HALF_APERTURE_RAD {
            self.add_by_reference(grid, dirty, map_from_transducer, cone, revision, apex);
            return Ok(());
        }
        let common = self.common(map_from_transducer, cone, grid.resolution_m(), apex);
        self.work.lay_out(map_from_transducer, cone, grid.resolution_m(), apex);
        #[cfg(target_arch = "x86_64")]
        if self.wide {
            // SAFETY: `wide` says that this processor has AVX2.
            unsafe { weigh_avx2(&mut self.work, grid, &common, cone) };
            self.work.store(grid, dirty, self.start, self.max, revision);
            return Ok(());
        }
        weigh(&mut self.work, grid, &common, cone);
        self.work.store(grid, dirty, self.start, self.max, revision);
        Ok(())
    }

    fn common(&mut self, map_from_transducer: Pose2, cone: &EchoCone, resolution_m: f64, apex: Apex) -> Common {
        let (sin, cos) = libm::sincos(map_from_transducer.theta);
        let edge = libm::sin(0.5 * cone.aperture_rad);
        Common {
            resolution_m,
            offset_x: apex.offset_x,
            scaled_sin: sin / edge,
            scaled_cos: cos / edge,
            angle: self.angle.of(cone.aperture_rad, cone.reading.sigma_theta_rad),
            power: self.power,
            detection: cone.reading.detection,
            start: self.start,
            prior: cone.prior_log_odds,
        }
    }

    /// For apertures wider than any sensor's.
    fn add_by_reference(
        &self,
        grid: &mut Grid,
        dirty: &mut DirtyTiles,
        map_from_transducer: Pose2,
        cone: &EchoCone,
        revision: u64,
        apex: Apex,
    ) {
        let far_m = cone.far_m();
        let (mut indices, mut cells) = (Vec::new(), Vec::new());
        for (cell, distance_m, bearing_rad) in cells_around(grid, map_from_transducer, apex, far_m) {
            if distance_m > 0.0 && distance_m <= far_m && bearing_rad.abs() <= 0.5 * cone.aperture_rad {
                let log_odds = grid.log_odds(cell).map_or(self.start, f64::from) + cone.prior_log_odds;
                indices.push(cell);
                cells.push(SeenCell { distance_m, bearing_rad, probability: probability_of(log_odds) });
            }
        }
        for (cell, gain) in indices.into_iter().zip(cone.reading.gains(&cells)) {
            let tile = grid.tile_mut(cell.tile());
            tile.revision = revision;
            dirty.insert(cell.tile());
            gain_of(&mut tile.log_odds[cell.offset_in_tile()], cone.weight * gain, self.start, self.max);
        }
    }
}

/// Adds to the log-odds of a cell.
#[inline(always)]
fn gain_of(cell: &mut f32, gain: f64, start: f64, max: f64) {
    let before = if cell.is_nan() { start } else { f64::from(*cell) };
    *cell = (before + gain).max(-max).min(max) as f32;
}

impl Work {
    /// Which cells belong to the cone, tile by tile and row by row.
    fn lay_out(&mut self, map_from_transducer: Pose2, cone: &EchoCone, resolution_m: f64, apex: Apex) {
        const SIDE: i32 = TILE_SIDE as i32;
        let extent = (cone.near_m(), cone.far_m());
        let sector = Sector::new(cone.aperture_rad, extent, map_from_transducer, apex.offset_x, resolution_m);
        let (low_y, high_y) = sector.extent_y();
        let first_row = ((low_y + apex.offset_y) / resolution_m).floor() as i32;
        let last_row = ((high_y + apex.offset_y) / resolution_m).ceil() as i32;
        let dy_of = |row: i32| f64::from(row) * resolution_m - apex.offset_y;
        self.rows.clear();
        self.rows.extend((first_row..=last_row).map(|row| sector.row(dy_of(row))));

        self.tiles.clear();
        self.pieces.clear();
        let mut from = 0;
        while from < self.rows.len() {
            // The rows that lie in the same row of tiles
            let row = apex.cell.j + first_row + from as i32;
            let row_in_tile = row.rem_euclid(SIDE) as usize;
            let to = self.rows.len().min(from + TILE_SIDE - row_in_tile);
            let spans = &self.rows[from..to];
            let first_dy_row = first_row + from as i32;
            from = to;
            let Some((low, high)) = spans::columns(spans) else { continue };
            for tile_x in (apex.cell.i + low).div_euclid(SIDE)..=(apex.cell.i + high).div_euclid(SIDE) {
                let first_column = tile_x * SIDE - apex.cell.i;
                let begun = self.pieces.len();
                for (n, span) in spans.iter().enumerate() {
                    let parts = [
                        (span.low, span.free_low - 1, false),
                        (span.free_low, span.free_high, true),
                        (span.free_high + 1, span.high, false),
                    ];
                    for (low, high, front) in parts {
                        let low = low.max(first_column).max(span.low);
                        let high = high.min(first_column + SIDE - 1).min(span.high);
                        if low <= high {
                            self.pieces.push(Piece {
                                offset: ((row_in_tile + n) * TILE_SIDE) as u16 + (low - first_column) as u16,
                                cells: (high - low + 1) as u16,
                                front,
                                column: low,
                                dy: dy_of(first_dy_row + n as i32),
                            });
                        }
                    }
                }
                if self.pieces.len() > begun {
                    let index = TileIndex { x: tile_x, y: row.div_euclid(SIDE) };
                    self.tiles.push(TilePieces { index, end: self.pieces.len() });
                }
            }
        }
    }

    /// Adds what the cells gain to the grid.
    fn store(&self, grid: &mut Grid, dirty: &mut DirtyTiles, start: f64, max: f64, revision: u64) {
        let (mut front, mut band) = (self.front.gains.iter(), self.band.gains.iter());
        let mut from = 0;
        for TilePieces { index, end } in &self.tiles {
            dirty.insert(*index);
            let tile = grid.tile_mut(*index);
            tile.revision = revision;
            for piece in &self.pieces[from..*end] {
                let gains = if piece.front { &mut front } else { &mut band };
                let first = usize::from(piece.offset);
                let cells = &mut tile.log_odds[first..first + usize::from(piece.cells)];
                for (cell, gain) in cells.iter_mut().zip(gains) {
                    gain_of(cell, *gain, start, max);
                }
            }
            from = *end;
        }
    }
}

/// [`weigh`] in the instructions of a processor that computes several cells at once. They are the same operations in the same
/// order (a product and a sum are never fused), so the bytes are the same.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn weigh_avx2(work: &mut Work, grid: &Grid, common: &Common, cone: &EchoCone) {
    weigh(work, grid, common, cone);
}

/// What the cells gain.
#[inline(always)]
fn weigh(work: &mut Work, grid: &Grid, common: &Common, cone: &EchoCone) {
    look_up(work, grid, common);
    let FirstEcho { range_m, clutter, range_cap_m, lost, .. } = cone.reading;
    // Nothing in front of the echo answered
    let mut unanswered = work.front.gains.iter().fold(1.0, |unanswered, a| unanswered * (1.0 - a));
    let (mut nobodys, mut total) = (lost, (1.0 - lost) * unanswered);
    if let Some(range_m) = range_m {
        (nobodys, total) = (clutter / range_cap_m, 0.0);
        fill_likelihood(work, common, range_m, cone.reading.sigma_z_m);
        sort_by_distance(work);
        // S and B along the cone
        let cells = work.band.gains.len();
        work.unanswered.resize(cells, 0.0);
        work.before.resize(cells, 0.0);
        for key in &work.order {
            let index = *key as u32 as usize;
            let a = work.band.gains[index];
            work.unanswered[index] = unanswered;
            work.before[index] = total;
            total += a * unanswered * work.likelihood[index];
            unanswered *= 1.0 - a;
        }
        fill_band_gains(work, nobodys, total, cone.weight);
    }
    let Cells { answers, gains } = &mut work.front;
    for (r, gain) in answers.iter().zip(gains) {
        let behind = total / (1.0 - *gain);
        *gain = cone.weight * ln_1p(-r * behind / (nobodys + behind));
    }
}

/// r and a of every cell, and the distances of those around the echo.
#[inline(always)]
fn look_up(work: &mut Work, grid: &Grid, common: &Common) {
    work.front.clear();
    work.band.clear();
    work.squares.clear();
    let mut from = 0;
    for TilePieces { index, end } in &work.tiles {
        let tile = grid.tile(*index);
        for piece in &work.pieces[from..*end] {
            if piece.front {
                look_up_piece(tile, piece, common, &mut work.front, None);
            } else {
                look_up_piece(tile, piece, common, &mut work.band, Some(&mut work.squares));
            }
        }
        from = *end;
    }
}

#[inline(always)]
fn look_up_piece(
    tile: Option<&Tile>,
    piece: &Piece,
    common: &Common,
    into: &mut Cells,
    squares: Option<&mut Vec<f64>>,
) {
    const TINY: f64 = 1e-60;
    let cells = usize::from(piece.cells);
    let begun = into.answers.len();
    into.answers.resize(begun + cells, 0.0);
    into.gains.resize(begun + cells, 0.0);
    let known = tile.map(|tile| &tile.log_odds[usize::from(piece.offset)..usize::from(piece.offset) + cells]);
    let log_odds = |n: usize| known.map_or(f32::NAN, |cells| cells[n]);
    let (answers, gains) = (&mut into.answers[begun..begun + cells], &mut into.gains[begun..begun + cells]);
    let across_at_0 = piece.dy * common.scaled_cos + common.offset_x * common.scaled_sin;
    let dy_squared = piece.dy * piece.dy + TINY;
    for n in 0..cells {
        let column = f64::from(piece.column + n as i32);
        let dx = column * common.resolution_m - common.offset_x;
        let across = across_at_0 - column * common.resolution_m * common.scaled_sin;
        let square = dx * dx + dy_squared;
        answers[n] = common.detection * evaluate(&common.angle, across * across / square);
        let cell = log_odds(n);
        let evidence = if cell.is_nan() { common.start } else { f64::from(cell) };
        gains[n] = answers[n] * sigmoid(&common.power, evidence + common.prior);
    }
    if let Some(squares) = squares {
        squares.extend((0..cells).map(|n| {
            let dx = f64::from(piece.column + n as i32) * common.resolution_m - common.offset_x;
            dx * dx + dy_squared
        }));
    }
}

/// L of the cells around the echo.
#[inline(always)]
fn fill_likelihood(work: &mut Work, common: &Common, range_m: f64, sigma_z_m: f64) {
    const FRAC_1_SQRT_TAU: f64 = 0.398_942_280_401_432_7;
    let (peak, steepness) = (FRAC_1_SQRT_TAU / sigma_z_m, core::f64::consts::FRAC_1_SQRT_2 / sigma_z_m);
    work.likelihood.resize(work.squares.len(), 0.0);
    for (likelihood, square) in work.likelihood.iter_mut().zip(&work.squares) {
        let off = (range_m - square.sqrt()) * steepness;
        *likelihood = peak * exp(&common.power, -off * off);
    }
}

/// Distance first, then place in the grid: all orders are alike on all machines.
#[inline(always)]
fn sort_by_distance(work: &mut Work) {
    work.order.clear();
    // The bits of positive numbers are ordered as the numbers are.
    let keys =
        work.squares.iter().enumerate().map(|(n, square)| u64::from((*square as f32).to_bits()) << 32 | n as u64);
    work.order.extend(keys);
    work.order.sort_unstable();
}

#[inline(always)]
fn fill_band_gains(work: &mut Work, nobodys: f64, total: f64, weight: f64) {
    let Work { band, likelihood, unanswered, before, .. } = work;
    let cells = band.gains.len();
    let (answers, gains) = (&band.answers[..cells], &mut band.gains[..cells]);
    let (likelihood, unanswered, before) = (&likelihood[..cells], &unanswered[..cells], &before[..cells]);
    for n in 0..cells {
        let (r, a) = (answers[n], gains[n]);
        let own = unanswered[n] * likelihood[n];
        let after = total - before[n] - a * own;
        let behind = if after > 0.0 { after } else { 0.0 } / (1.0 - a);
        gains[n] = weight * ln_1p(r * (own - behind) / (before[n] + nobodys + behind));
    }
}

/// 1/(1 + e^-x).
#[inline(always)]
fn sigmoid(power: &[f64; POWER], x: f64) -> f64 {
    1.0 / (1.0 + exp(power, -x))
}

/// e^x for |x| up to 700; beyond that as there.
#[inline(always)]
fn exp(power: &[f64; POWER], x: f64) -> f64 {
    // Adding it rounds to a whole number, which is then in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let x = if x > -700.0 { x } else { -700.0 };
    let x = if x < 700.0 { x } else { 700.0 };
    let octaves = x * core::f64::consts::LOG2_E;
    // Rounded down, but for rounding errors that leave the rest within [0, 1] all the same.
    let shifted = (octaves - 0.5) + ROUND;
    let rest = octaves - (shifted - ROUND);
    let scale = f64::from_bits((shifted.to_bits().wrapping_add(1023)) << 52);
    scale * evaluate(power, rest)
}

/// ln(1 + x) for x above −1.
#[inline(always)]
fn ln_1p(x: f64) -> f64 {
    // √½, which is where the mantissa is split so that it lies within √½ … √2.
    const SPLIT: u64 = 0x3fe6_a09e_667f_3bcd;
    const EXPONENT: u64 = 0xfff0_0000_0000_0000;
    const TWO_TO_52: f64 = 4_503_599_627_370_496.0;
    const BIAS: u64 = 1024;
    let sum = 1.0 + x;
    let above = sum.to_bits().wrapping_sub(SPLIT);
    let biased = above.wrapping_add(BIAS << 52) >> 52;
    let exponent = f64::from_bits(biased | TWO_TO_52.to_bits()) - (TWO_TO_52 + BIAS as f64);
    let mantissa = f64::from_bits(sum.to_bits().wrapping_sub(above & EXPONENT));
    // What adding 1 lost of a small x.
    let lost = x - (sum - 1.0);
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let q = s * s;
    let series = 1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0)))));
    exponent * core::f64::consts::LN_2 + 2.0 * s * series + lost / sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_and_ln_hold_their_digits() {
        let power = fit(libm::exp2, 1.0);
        for step in -20_000..20_000 {
            let x = f64::from(step) * 0.002;
            assert!((exp(&power, x) / libm::exp(x) - 1.0).abs() < 1e-9, "{x}");
        }
        for step in 1..100_000 {
            for x in [-1.0 + 1e-5 * f64::from(step), 1e-3 * f64::from(step) * f64::from(step), 1e-12 * f64::from(step)]
            {
                assert!((ln_1p(x) - libm::log1p(x)).abs() < 1e-9 * libm::log1p(x).abs().max(1e-3), "{x}");
            }
        }
        assert!(ln_1p(1e-15) > 0.9e-15);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn wide_and_narrow_processors_give_the_same_bytes() {
        let (mut narrow_grid, mut wide_grid) = (Grid::new(0.05), Grid::new(0.05));
        let mut dirty = DirtyTiles::default();
        let mut wide = FirstEchoKernel::new(0.0, 8.0);
        let mut narrow = FirstEchoKernel { wide: false, ..wide.clone() };
        for k in 0..500u32 {
            let aperture_rad = 0.02 + 0.002 * f64::from(k);
            let reading = FirstEcho {
                range_m: (k % 7 > 0).then(|| 0.3 + 0.008 * f64::from(k)),
                sigma_z_m: 0.02 + 0.003 * f64::from(k % 100),
                sigma_theta_rad: aperture_rad,
                detection: 0.2,
                clutter: 0.4,
                range_cap_m: 5.0,
                lost: 0.5,
            };
            let cone = EchoCone { reading, aperture_rad, prior_log_odds: -4.6, weight: 0.9 };
            let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
            assert!(narrow.add(&mut narrow_grid, &mut dirty, pose, &cone, 1).is_ok());
            assert!(wide.add(&mut wide_grid, &mut dirty, pose, &cone, 1).is_ok());
        }
        assert_eq!(narrow_grid.tile_count(), wide_grid.tile_count());
        for ((index, a), (_, b)) in narrow_grid.tiles().zip(wide_grid.tiles()) {
            let bits = |tile: &Tile| tile.log_odds.map(f32::to_bits);
            assert!(bits(a) == bits(b), "{index:?}");
        }
    }
}
