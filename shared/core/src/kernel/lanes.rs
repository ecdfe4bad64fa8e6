//! The sensor model for several neighbouring cells at once.
//!
//! Free space is most of a cone and smooth, so single precision does; the echo is a narrow band in which a distance
//! matters to a fraction of σ_z, so it is computed in double precision. All of it is +, −, ×, ÷ and √ on arrays, which
//! every processor rounds alike, however many lanes it has.

#![allow(clippy::needless_range_loop, reason = "loops over lanes are what the compiler turns into vectors")]

use super::fit::{evaluate, evaluate_f32};
use crate::grid::TILE_SIDE;

/// Cells that are computed together.
const LANES: usize = 8;

/// Coefficients of the angular factor.
pub(super) const ANGLE: usize = 7;
/// The same in single precision.
pub(super) const ANGLE_F32: usize = ANGLE - 1;
/// Coefficients of e^-x over [0, 2].
pub(super) const DECAY: usize = 10;
/// Coefficients of 2 artanh(y)/y as a function of y².
pub(super) const ARTANH: usize = 6;

/// All that the cells of one reading have in common. Lengths in metres from the transducer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    pub(super) resolution_m: f64,
    /// Of the transducer from the centre of its own cell, along x.
    pub(super) offset_x: f64,
    /// Sine and cosine of the axis, each divided by the sine of half the aperture: across / distance is then ±1 at
    /// the edges of the cone.
    pub(super) scaled_sin: f64,
    pub(super) scaled_cos: f64,
    /// exp(−½ (φ/σ_θ)²) as a polynomial in (sin φ / sin ½β)².
    pub(super) angle: [f64; ANGLE],
    pub(super) angle_f32: [f32; ANGLE_F32],
    /// z, metres.
    pub(super) range_m: f64,
    /// √½ / σ_z.
    pub(super) steepness: f64,
    /// 2 w (p_occ − ½).
    pub(super) echo_peak: f64,
    /// 2 w (½ − p_free).
    pub(super) free_peak: f64,
    /// 1 / (z − kσ_z)².
    pub(super) inverse_near_squared: f64,
}

/// What all readings have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Common {
    /// l0.
    pub(super) prior: f64,
    /// l_max.
    pub(super) max: f32,
    pub(super) decay: [f64; DECAY],
    /// None where the peak of region I is so close to certainty that single precision will not do.
    pub(super) artanh_f32: Option<[f32; ARTANH]>,
}

/// A row of a tile.
#[derive(Debug)]
pub(super) struct TileRow<'a> {
    pub(super) cells: &'a mut [f32; TILE_SIDE],
    /// Column of its first cell, counted from the transducer's.
    pub(super) first_column: i32,
    /// Its centres, above the transducer, metres.
    pub(super) dy: f64,
}

/// What a cell of one row gains. (A trait and not a closure: closures are not compiled for the wider processor.)
trait Gain {
    /// In the columns that begin at `first`, counted from the transducer's.
    fn from(&self, first: i32) -> [f32; LANES];
}

/// Adds region II to the columns from `low` to `high`, as far as they are in this row.
#[inline(always)]
pub(super) fn add_echo(common: &Common, profile: &Profile, row: &mut TileRow<'_>, low: i32, high: i32) {
    let gain = Echo { common, profile, dy: row.dy };
    add(common, row, low, high, &gain);
}

/// Adds region I, likewise.
#[inline(always)]
pub(super) fn add_free(common: &Common, profile: &Profile, row: &mut TileRow<'_>, low: i32, high: i32) {
    if let Some(artanh) = &common.artanh_f32 {
        let gain = Free::new(common, profile, artanh, row.dy);
        add(common, row, low, high, &gain);
    } else {
        let gain = FreeInDouble { common, profile, dy: row.dy };
        add(common, row, low, high, &gain);
    }
}

#[inline(always)]
fn add(common: &Common, row: &mut TileRow<'_>, low: i32, high: i32, gain: &impl Gain) {
    let (prior, max) = (common.prior as f32, common.max);
    let low = (low - row.first_column).max(0);
    let high = (high - row.first_column).min(TILE_SIDE as i32 - 1);
    let mut next = low;
    while next <= high {
        // Whole chunks only: the last one of a row begins early, and the lanes outside keep what they have.
        let start = next.min((TILE_SIDE - LANES) as i32);
        let (first_lane, last_lane) = (next - start, high - start);
        let gains = gain.from(row.first_column + start);
        let Some(chunk) = row.cells[start as usize..].first_chunk_mut::<LANES>() else { return };
        for lane in 0..LANES {
            let cell = chunk[lane];
            let before = if cell.is_nan() { prior } else { cell };
            let sum = before + gains[lane];
            // One instruction each, which f32::max and f32::min, careful about NaN, are not.
            let sum = if sum > -max { sum } else { -max };
            let sum = if sum < max { sum } else { max };
            let inside = lane as i32 >= first_lane && lane as i32 <= last_lane;
            chunk[lane] = if inside { sum } else { cell };
        }
        next = start + LANES as i32;
    }
}

/// Region I.
struct Free<'a> {
    profile: &'a Profile,
    artanh: &'a [f32; ARTANH],
    resolution: f32,
    offset: f32,
    dy_squared: f32,
    fading: f32,
    peak: f32,
    prior: f32,
    /// Across the axis: a difference of large numbers where the beam is narrow, so taken in double precision.
    across_at_0: f64,
    across_step: f64,
}

impl<'a> Free<'a> {
    #[inline(always)]
    fn new(common: &Common, profile: &'a Profile, artanh: &'a [f32; ARTANH], dy: f64) -> Self {
        // Far below what a distance can be told apart by: it keeps 0/0 out.
        const TINY: f64 = 1e-30;
        Self {
            profile,
            artanh,
            resolution: profile.resolution_m as f32,
            offset: profile.offset_x as f32,
            dy_squared: (dy * dy + TINY) as f32,
            fading: profile.inverse_near_squared as f32,
            peak: profile.free_peak as f32,
            prior: common.prior as f32,
            across_at_0: dy * profile.scaled_cos + profile.offset_x * profile.scaled_sin,
            across_step: profile.resolution_m * profile.scaled_sin,
        }
    }
}

impl Gain for Free<'_> {
    #[inline(always)]
    fn from(&self, first: i32) -> [f32; LANES] {
        let first_across = self.across_at_0 - f64::from(first) * self.across_step;
        let mut gains = [0.0; LANES];
        for lane in 0..LANES {
            let across = (first_across - f64::from(lane as i32) * self.across_step) as f32;
            let dx = (first + lane as i32) as f32 * self.resolution - self.offset;
            let d_squared = dx * dx + self.dy_squared;
            let off_axis = across * across / d_squared;
            let y = self.peak * (d_squared * self.fading - 1.0) * evaluate_f32(&self.profile.angle_f32, off_axis);
            gains[lane] = y * evaluate_f32(self.artanh, y * y) - self.prior;
        }
        gains
    }
}

/// Region I where its peak is close to certainty.
struct FreeInDouble<'a> {
    common: &'a Common,
    profile: &'a Profile,
    dy: f64,
}

impl Gain for FreeInDouble<'_> {
    #[inline(always)]
    fn from(&self, first: i32) -> [f32; LANES] {
        let mut gains = [0.0; LANES];
        for lane in 0..LANES {
            let (d_squared, angle) = distance_and_angle(self.profile, first + lane as i32, self.dy);
            let y = self.profile.free_peak * (1.0 - d_squared * self.profile.inverse_near_squared) * angle;
            gains[lane] = (-logit_above_half(y.max(0.0)) - self.common.prior) as f32;
        }
        gains
    }
}

/// Region II.
struct Echo<'a> {
    common: &'a Common,
    profile: &'a Profile,
    dy: f64,
}

impl Gain for Echo<'_> {
    #[inline(always)]
    fn from(&self, first: i32) -> [f32; LANES] {
        let mut gains = [0.0; LANES];
        for lane in 0..LANES {
            let (d_squared, angle) = distance_and_angle(self.profile, first + lane as i32, self.dy);
            let off = (self.profile.range_m - d_squared.sqrt()) * self.profile.steepness;
            let y = self.profile.echo_peak * evaluate(&self.common.decay, off * off) * angle;
            gains[lane] = (logit_above_half(y) - self.common.prior) as f32;
        }
        gains
    }
}

/// d² of a cell and its angular factor.
#[inline(always)]
fn distance_and_angle(profile: &Profile, column: i32, dy: f64) -> (f64, f64) {
    const TINY: f64 = 1e-60;
    let dx = f64::from(column) * profile.resolution_m - profile.offset_x;
    let across = dy * profile.scaled_cos - dx * profile.scaled_sin;
    let d_squared = dx * dx + (dy * dy + TINY);
    (d_squared, evaluate(&profile.angle, across * across / d_squared))
}

/// ln(p / (1 − p)) of p = ½ + y/2, for y in [0, 1): ln((1 + y) / (1 − y)).
#[inline(always)]
fn logit_above_half(y: f64) -> f64 {
    // √½, which is where the mantissa is split so that it lies within √½ … √2.
    const SPLIT: u64 = 0x3fe6_a09e_667f_3bcd;
    const EXPONENT: u64 = 0xfff0_0000_0000_0000;
    const TWO_TO_52: f64 = 4_503_599_627_370_496.0;
    let odds = (1.0 + y) / (1.0 - y);
    let above = odds.to_bits().wrapping_sub(SPLIT);
    // As a number, by putting it into the low bits of 2^52.
    let exponent = f64::from_bits((above >> 52) | TWO_TO_52.to_bits()) - TWO_TO_52;
    let mantissa = f64::from_bits(odds.to_bits().wrapping_sub(above & EXPONENT));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let q = s * s;
    let series = 1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0)))));
    exponent * core::f64::consts::LN_2 + 2.0 * s * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log_odds::log_odds_of;

    #[test]
    fn logit_from_even_odds_to_near_certainty() {
        for step in 0..100_000 {
            let y = f64::from(step) / 100_000.0;
            let expected = log_odds_of(0.5 + 0.5 * y);
            assert!((logit_above_half(y) - expected).abs() < 1e-9 * (1.0 + expected), "{y}");
        }
        let tiny = 1e-7;
        assert!((logit_above_half(tiny) / (2.0 * tiny) - 1.0).abs() < 1e-8, "a small increment keeps its digits");
    }
}
