//! `facing.png` and `facing.npy`: which way each wall faces.
//!
//! The array holds the normal of the wall in each cell, radians in [0, π) from the x axis of the map, float32 `[row, column]`, in the
//! rectangle of `map.npy`; NaN where no wall faces one way. The picture is the map in grey with its walls in colours, one for each
//! direction, all round: opposite directions are the same. What is occupied and faces no way (a post, a corner) stays dark. A scale
//! stands below; north is up.

use core::f64::consts::PI;

use echogrid_core::Grid;

use super::MapError;
use super::layer::{BAR_PX, MARGIN_PX, below, cells_of, paint};
use super::occupancy::raster_of;
use super::picture::{UNKNOWN, level};
use crate::canvas::{Canvas, INK, LETTER_PX};

/// The picture's name.
pub const PICTURE: &str = "facing.png";
/// The array's name.
pub const ARRAY: &str = "facing.npy";

const BAR_WIDTH_PX: usize = 376;
const WORDS: &str = "direction of the wall's normal, degrees";

/// The picture of the rectangle of the known cells of `map` as a PNG file's bytes. The same map gives the same bytes.
///
/// # Errors
/// The known cells lie too far apart for a picture.
pub fn encode_picture(facing: &Grid, map: &Grid) -> Result<Vec<u8>, MapError> {
    let raster = raster_of(map)?;
    let cells = cells_of(&raster, map).zip(cells_of(&raster, facing));
    let colours: Vec<[u8; 3]> = cells.map(|(log_odds, radians)| cell_colour(log_odds, radians)).collect();
    let (mut canvas, top) = paint(&raster, &colours);
    draw_scale(&mut canvas, top);
    canvas.encode().map_err(|error| MapError::Image { path: PICTURE.into(), what: error.to_string() })
}

/// Of a cell of these log-odds whose wall has its normal so far from the x axis.
fn cell_colour(log_odds: f32, radians: f32) -> [u8; 3] {
    match level(log_odds) {
        None => UNKNOWN,
        // Pale enough that colours stand out.
        Some(grey) if radians.is_nan() => [64 + grey / 4 * 3; 3],
        Some(_) => colour(f64::from(radians)),
    }
}

/// Round the circle of colours once in half a turn.
fn colour(radians: f64) -> [u8; 3] {
    let sixth = (radians / PI).clamp(0.0, 1.0) * 6.0;
    let channel = |shift: f64| {
        let place = (sixth + shift) % 6.0;
        let share = (place.min(4.0 - place)).clamp(0.0, 1.0);
        (235.0 * share).round() as u8
    };
    [channel(2.0), channel(0.0), channel(4.0)]
}

fn draw_scale(canvas: &mut Canvas, top: usize) {
    for x in 0..=BAR_WIDTH_PX {
        let colour = colour(PI * x as f64 / BAR_WIDTH_PX as f64);
        (0..BAR_PX).for_each(|y| canvas.set(MARGIN_PX + x, top + y, colour));
    }
    for quarter in 0..=4_usize {
        let label = (45 * quarter).to_string();
        let half = label.len() * LETTER_PX / 2;
        let x = MARGIN_PX + BAR_WIDTH_PX * quarter / 4;
        canvas.text([x.saturating_sub(half).max(2), top + BAR_PX + 6], &label, 1, INK);
    }
    canvas.text([MARGIN_PX, top + below() - LETTER_PX - MARGIN_PX], WORDS, 1, INK);
}

#[cfg(test)]
mod tests {
    use super::super::layer::encode_array;
    use super::super::layer::testing::grid;
    use super::*;

    #[test]
    fn walls_are_coloured_by_direction_where_the_map_has_them() {
        let map = grid(&[(0, 0, -8.0), (3, 1, 8.0), (0, 1, 8.0), (1, 1, 8.0)]);
        let facing = grid(&[(3, 1, 0.0), (0, 1, 1.6)]);
        let png = encode_picture(&facing, &map).unwrap();
        assert_eq!(png, encode_picture(&facing, &map).unwrap());
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        let at = |x: u32, y: u32| picture.get_pixel(x, y).0;
        assert_eq!((at(127, 0), at(0, 0)), (colour(0.0), colour(1.6)));
        assert_eq!(at(127, 63), UNKNOWN);
        let (free, post) = (at(0, 63), at(40, 0));
        assert!(free[0] > 240 && post[0] < 80 && post[0] == post[2], "{free:?} {post:?}");
        let npy = encode_array(&facing, &map).unwrap();
        let cells: Vec<f32> =
            npy[npy.len() - 32..].chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
        assert_eq!((cells[4], cells[7]), (1.6, 0.0));
        assert_eq!(cells.iter().filter(|cell| cell.is_nan()).count(), 6);
    }

    #[test]
    fn opposite_normals_are_the_same_colour_and_right_angles_are_not() {
        assert_eq!(colour(0.0), colour(PI));
        assert_eq!(colour(0.0), [235, 0, 0]);
        assert_eq!(colour(0.5 * PI), [0, 235, 235]);
    }
}
