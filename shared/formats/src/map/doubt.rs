//! `doubt.png` and `doubt.npy`: how much odometry error the evidence of each cell carried.
//!
//! The array holds metres, float32 `[row, column]`, in the rectangle of `map.npy` and so with the geometry of `map.yaml`; NaN where
//! nothing moved a cell. In the picture pale yellow is none, and the darker a cell, the more error its evidence carried; a scale in
//! metres stands below. Its end is a round number that 98 % of the cells stay within: what is beyond has the last colour. Unknown is
//! the bluish grey of `map.png`. North is up.

use echogrid_core::Grid;

use super::MapError;
use super::layer::{BAR_PX, MARGIN_PX, TICK_PX, WIDTH_MIN_PX, cells_of, paint};
use super::occupancy::raster_of;
use super::picture::UNKNOWN;
use crate::canvas::{Canvas, INK, LETTER_PX};

/// The picture's name.
pub const PICTURE: &str = "doubt.png";
/// The array's name.
pub const ARRAY: &str = "doubt.npy";

/// From no error to the end of the scale: ever darker, so that it can be read without colours, too.
const COLOURS: [[u8; 3]; 6] =
    [[255, 255, 204], [254, 217, 118], [253, 141, 60], [227, 26, 28], [150, 0, 50], [60, 0, 50]];
/// Such a share of the cells lies within the scale.
const WITHIN: f64 = 0.98;
/// The least end of a scale, metres.
const END_MIN_M: f64 = 0.001;
const WORDS: &str = "odometry error of the evidence, metres";

/// The picture of the rectangle of the known cells of `map` as a PNG file's bytes. The same doubt gives the same bytes.
///
/// # Errors
/// The known cells lie too far apart for a picture.
pub fn encode_picture(doubt: &Grid, map: &Grid) -> Result<Vec<u8>, MapError> {
    let raster = raster_of(map)?;
    let metres: Vec<f32> = cells_of(&raster, doubt).collect();
    let (end_m, is_cut) = end_of_scale(&metres);
    let of = |metres: &f32| if metres.is_nan() { UNKNOWN } else { colour(f64::from(*metres) / end_m) };
    let (mut canvas, top) = paint(&raster, &metres.iter().map(of).collect::<Vec<_>>());
    draw_scale(&mut canvas, top, end_m, is_cut);
    canvas.encode().map_err(|error| MapError::Image { path: PICTURE.into(), what: error.to_string() })
}

/// The end of the scale, metres, and whether some cells are beyond it.
fn end_of_scale(metres: &[f32]) -> (f64, bool) {
    let mut known: Vec<f32> = metres.iter().copied().filter(|metres| !metres.is_nan()).collect();
    known.sort_unstable_by(f32::total_cmp);
    let most = known.last().copied().map_or(0.0, f64::from);
    let place = (WITHIN * known.len() as f64) as usize;
    let usual = known.get(place.min(known.len().saturating_sub(1))).copied().map_or(0.0, f64::from);
    let end_m = round_up(usual.max(END_MIN_M));
    (end_m, most > end_m)
}

/// The next of 1, 2, 5, 10 … metres.
fn round_up(metres: f64) -> f64 {
    let mut power = END_MIN_M;
    while power * 10.0 < metres && power < 1e30 {
        power *= 10.0;
    }
    let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * power);
    steps.into_iter().find(|step| *step >= metres * (1.0 - 1e-6)).unwrap_or(metres)
}

/// Of a share of the scale.
fn colour(share: f64) -> [u8; 3] {
    let steps = COLOURS.len() - 1;
    let at = share.clamp(0.0, 1.0) * steps as f64;
    let from = (at as usize).min(steps - 1);
    let part = at - from as f64;
    [0, 1, 2].map(|channel| {
        let (low, high) = (f64::from(COLOURS[from][channel]), f64::from(COLOURS[from + 1][channel]));
        (low + part * (high - low)).round() as u8
    })
}

/// The scale with its words, from `top` on.
fn draw_scale(canvas: &mut Canvas, top: usize, end_m: f64, is_cut: bool) {
    let (left, width) = (MARGIN_PX, WIDTH_MIN_PX - 8 * LETTER_PX);
    for x in 0..=width {
        let colour = colour(x as f64 / width as f64);
        for y in 0..BAR_PX {
            let is_edge = x == 0 || x == width || y == 0 || y + 1 == BAR_PX;
            canvas.set(left + x, top + y, if is_edge { INK } else { colour });
        }
    }
    let words = top + BAR_PX + TICK_PX + 2;
    for quarter in 0..=4_usize {
        let x = left + width * quarter / 4;
        (0..TICK_PX).for_each(|y| canvas.set(x, top + BAR_PX + y, INK));
        // Of a quarter of 0.001 there are decimals left.
        let mut label = format!("{:.5}", end_m * quarter as f64 / 4.0);
        label.truncate(label.trim_end_matches('0').trim_end_matches('.').len());
        if quarter == 4 && is_cut {
            label.push('+');
        }
        let half = label.chars().count() * LETTER_PX / 2;
        canvas.text([x.saturating_sub(half).max(2), words], &label, 1, INK);
    }
    canvas.text([left, words + LETTER_PX + 4], WORDS, 1, INK);
}

#[cfg(test)]
mod tests {
    use super::super::layer::encode_array;
    use super::super::layer::testing::grid;
    use super::*;

    #[test]
    fn the_ends_of_scales_are_round() {
        let check = |metres: f64, end: f64| assert!((round_up(metres) - end).abs() < 1e-9 * end, "{metres}");
        for (metres, end) in [(0.001, 0.001), (0.0011, 0.002), (0.2, 0.2), (0.21, 0.5), (3.0, 5.0), (99.0, 100.0)] {
            check(metres, end);
        }
        assert!(round_up(f64::from(f32::MAX)).is_finite());
        assert_eq!(end_of_scale(&[]), (0.001, false));
        let mut many = vec![0.15_f32; 99];
        many.push(7.0);
        let (end_m, is_cut) = end_of_scale(&many);
        assert!((end_m - 0.2).abs() < 1e-9 && is_cut);
    }

    #[test]
    fn cells_lie_where_those_of_the_map_do() {
        let map = grid(&[(0, 0, -8.0), (3, 1, 8.0), (0, 1, 0.0)]);
        let doubt = grid(&[(0, 0, 0.0), (3, 1, 0.2)]);
        let png = encode_picture(&doubt, &map).unwrap();
        assert_eq!(png, encode_picture(&doubt, &map).unwrap());
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (440, 64 + 10 + 14 + 4 + 16 + 20));
        let at = |x: u32, y: u32| picture.get_pixel(x, y).0;
        assert_eq!((at(0, 63), at(127, 0), at(0, 0)), (COLOURS[0], COLOURS[5], UNKNOWN));
        let npy = encode_array(&doubt, &map).unwrap();
        let cells: Vec<f32> =
            npy[npy.len() - 32..].chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
        assert_eq!((cells[0], cells[7]), (0.0, 0.2));
        assert!(cells[1..7].iter().all(|cell| cell.is_nan()));
    }
}
