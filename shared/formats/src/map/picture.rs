//! `map.png`: a picture of the map for people.
//!
//! White is free, black occupied, grey in between: level 255·(1−p). Unknown is a bluish grey,
//! [`UNKNOWN`]: its three channels differ, so no probability looks like it. Dark blue dots, one
//! every 0.25 m, are the path; the red disc is where the robot was last. North is up: the first row
//! of the picture has the highest y. One cell is one pixel, or a square of pixels for a small map.

use echogrid_core::{Pose2, Raster};
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};

use super::occupancy::{probability, raster_of};
use super::{MapDocument, MapError};

/// Colour of unknown cells: red, green, blue.
pub const UNKNOWN: [u8; 3] = [188, 198, 210];
/// Colour of the path.
pub const PATH: [u8; 3] = [20, 40, 150];
/// Colour of the robot's last position.
pub const ROBOT: [u8; 3] = [220, 30, 30];

/// The long side of a small map's picture, pixels.
const LONG_SIDE: usize = 800;
/// A cell is at most a square of so many pixels on a side.
const SCALE_MAX: usize = 32;
const DOT_EVERY_M: f64 = 0.25;
const DOT_RADIUS_M: f64 = 0.03;
const ROBOT_RADIUS_M: f64 = 0.2;

/// The map as a PNG file's bytes, with or without the path; the robot's last position is always
/// there. The same map gives the same bytes.
///
/// # Errors
/// When the known cells lie too far apart for a picture.
pub fn encode(document: &MapDocument, draw_path: bool) -> Result<Vec<u8>, MapError> {
    let mut canvas = Canvas::of(&raster_of(&document.grid)?);
    let mut last_dot: Option<Pose2> = None;
    let path = if draw_path { document.path.as_slice() } else { &[] };
    for point in path.iter().map(|point| point.pose).filter(|pose| pose.is_finite()) {
        if last_dot.is_none_or(|dot| dot.distance_m(point) >= DOT_EVERY_M) {
            canvas.disc(point, DOT_RADIUS_M, 1.3, PATH);
            last_dot = Some(point);
        }
    }
    if let Some(last) = document.path.last().filter(|last| last.pose.is_finite()) {
        canvas.disc(last.pose, ROBOT_RADIUS_M, 4.0, ROBOT);
    }
    encode_png(&canvas.pixels, canvas.width, canvas.height, ExtendedColorType::Rgb8)
}

/// Pixels as a PNG file's bytes.
pub(crate) fn encode_png(
    pixels: &[u8],
    width: usize,
    height: usize,
    colour: ExtendedColorType,
) -> Result<Vec<u8>, MapError> {
    let mut png = Vec::new();
    let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
    PngEncoder::new(&mut png)
        .write_image(pixels, side(width), side(height), colour)
        .map_err(|error| MapError::Image { path: "map.png".into(), what: error.to_string() })?;
    Ok(png)
}

struct Canvas {
    width: usize,
    height: usize,
    /// Three bytes a pixel, first row on top.
    pixels: Vec<u8>,
    /// Map coordinates of the lower left corner, metres.
    corner_m: [f64; 2],
    pixels_per_m: f64,
}

impl Canvas {
    fn of(raster: &Raster) -> Self {
        let scale = LONG_SIDE.div_ceil(raster.width.max(raster.height).max(1)).clamp(1, SCALE_MAX);
        let (width, height) = (raster.width * scale, raster.height * scale);
        let mut pixels = Vec::with_capacity(width * height * 3);
        let mut line = Vec::with_capacity(width * 3);
        for row in raster.log_odds.chunks_exact(raster.width.max(1)).rev() {
            line.clear();
            for log_odds in row {
                let colour = if log_odds.is_nan() { UNKNOWN } else { [grey(probability(*log_odds)); 3] };
                for _ in 0..scale {
                    line.extend_from_slice(&colour);
                }
            }
            for _ in 0..scale {
                pixels.extend_from_slice(&line);
            }
        }
        let pixels_per_m = scale as f64 / raster.resolution_m;
        Self { width, height, pixels, corner_m: raster.origin_m(), pixels_per_m }
    }

    /// A disc around a place of the map; what lies outside is cut off.
    fn disc(&mut self, at: Pose2, radius_m: f64, least_radius_px: f64, colour: [u8; 3]) {
        let radius = (radius_m * self.pixels_per_m).max(least_radius_px);
        let x = (at.x - self.corner_m[0]) * self.pixels_per_m;
        let y = self.height as f64 - (at.y - self.corner_m[1]) * self.pixels_per_m;
        let span = |centre: f64, end: usize| {
            let from = (centre - radius).floor().clamp(0.0, end as f64) as usize;
            let to = (centre + radius).ceil().clamp(0.0, end as f64) as usize;
            from..to
        };
        for row in span(y, self.height) {
            for column in span(x, self.width) {
                let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                if dx * dx + dy * dy <= radius * radius {
                    let start = (row * self.width + column) * 3;
                    if let Some(pixel) = self.pixels.get_mut(start..start + 3) {
                        pixel.copy_from_slice(&colour);
                    }
                }
            }
        }
    }
}

/// Level of a probability: 255 is certainly free.
fn grey(p: f32) -> u8 {
    ((1.0 - p) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, Grid};

    use super::*;
    use crate::map::{PathPoint, Provenance};

    fn document() -> MapDocument {
        let mut grid = Grid::new(0.5);
        for (i, j, log_odds) in [(0, 0, -8.0), (3, 1, 8.0), (0, 1, 0.0)] {
            let cell = CellIndex { i, j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        }
        let at = |x| PathPoint { stamp_ns: 0, pose: Pose2::new(x, 0.25, 0.0), trust: 1.0 };
        MapDocument { grid, path: vec![at(0.25), at(1.75), at(1e300)], provenance: Provenance::default() }
    }

    #[test]
    fn top_left_is_highest_y_and_lowest_x() {
        let png = encode(&document(), true).unwrap();
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (128, 64));
        assert_eq!(picture.get_pixel(0, 0).0, [128; 3]);
        assert_eq!(picture.get_pixel(127, 0).0, [0; 3]);
        assert_eq!(picture.get_pixel(1, 62).0, [255; 3]);
        assert_eq!(picture.get_pixel(40, 5).0, UNKNOWN);
        assert_eq!(picture.get_pixel(16, 47).0, PATH);
    }

    #[test]
    fn the_same_map_gives_the_same_bytes() {
        assert_eq!(encode(&document(), true).unwrap(), encode(&document(), true).unwrap());
    }

    #[test]
    fn the_path_may_be_left_out_but_not_the_robot() {
        let mut document = document();
        document.path.truncate(2);
        let has = |draw_path: bool, colour: [u8; 3]| {
            let picture = image::load_from_memory(&encode(&document, draw_path).unwrap()).unwrap().to_rgb8();
            picture.pixels().any(|pixel| pixel.0 == colour)
        };
        assert!(has(true, PATH) && has(true, ROBOT));
        assert!(!has(false, PATH) && has(false, ROBOT));
    }

    #[test]
    fn no_probability_looks_unknown() {
        assert!(UNKNOWN[0] != UNKNOWN[1] || UNKNOWN[1] != UNKNOWN[2]);
    }
}
