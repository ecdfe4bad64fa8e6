//! `map.png`: a picture of the map for people.
//!
//! White is free, black occupied, grey in between: level 255·(1−p). Unknown is a bluish grey,
//! [`UNKNOWN`]: its three channels differ, so no probability looks like it. Dark blue dots, one
//! every 0.25 m, are the path; the red disc is where the robot was last. North is up: the first row
//! of the picture has the highest y. One cell is one pixel, or a square of pixels for a small map.

use std::path::Path;
use std::slice;

use echogrid_core::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, log_odds_of};
use echogrid_core::{CellIndex, Grid, Pose2, Raster};
use echogrid_judge::Wall;
use echogrid_judge::quality::{TrueCell, Truth, judged_log_odds};
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};

use super::occupancy::{CELLS_MAX, probability, raster_of};
use super::{MapDocument, MapError, legend};
use crate::whole_file::write_whole;

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
    let canvas = drawn(document, draw_path)?;
    encode_png(&canvas.pixels, canvas.width, canvas.height, ExtendedColorType::Rgb8)
}

/// The picture of [`encode`] with the heading of the robot, and below it a scale bar, the axes, and what the colours mean.
///
/// # Errors
/// As [`encode`].
pub fn encode_with_legend(document: &MapDocument, draw_path: bool) -> Result<Vec<u8>, MapError> {
    let mut canvas = drawn(document, draw_path)?;
    if let Some(Pose2 { x, y, theta }) = document.path.last().map(|last| last.pose).filter(|pose| pose.is_finite()) {
        let ahead = 2.5 * ROBOT_RADIUS_M.max(4.0 / canvas.pixels_per_m);
        canvas.line([x, y], [x + ahead * libm::cos(theta), y + ahead * libm::sin(theta)], ROBOT);
    }
    let legend = legend::below(&canvas.pixels, canvas.width, canvas.height, canvas.pixels_per_m, draw_path);
    legend.encode().map_err(|error| MapError::Image { path: "map.png".into(), what: error.to_string() })
}

fn drawn(document: &MapDocument, draw_path: bool) -> Result<Canvas, MapError> {
    let raster = raster_of(&document.grid)?;
    let path = if draw_path { document.path.as_slice() } else { document.path.last().map_or(&[][..], slice::from_ref) };
    // Where nothing was mapped any more the robot went on all the same.
    let mut canvas = Canvas::of(&raster, Margins::around(&raster, path.iter().map(|point| point.pose)));
    if draw_path {
        canvas.dots(path.iter().map(|point| point.pose));
    }
    if let Some(last) = document.path.last().filter(|last| last.pose.is_finite()) {
        canvas.disc(last.pose, ROBOT_RADIUS_M, 4.0, ROBOT);
    }
    Ok(canvas)
}

/// Colours of a judged map: red, green, blue.
pub mod judged {
    /// Free, and so the map says.
    pub const FREE: [u8; 3] = [205, 236, 205];
    /// A wall, and so the map says.
    pub const WALL: [u8; 3] = [0, 100, 40];
    /// Free, and the map says wall.
    pub const FREE_AS_WALL: [u8; 3] = [220, 30, 30];
    /// A wall, and the map says free.
    pub const WALL_AS_FREE: [u8; 3] = [245, 140, 0];
    /// Free, and the map doesn't say.
    pub const FREE_UNDECIDED: [u8; 3] = [222, 222, 222];
    /// A wall, and the map doesn't say.
    pub const WALL_UNDECIDED: [u8; 3] = [110, 110, 110];
    /// The colour of what does not count.
    pub const OPEN: [u8; 3] = [255, 255, 255];
}

/// Where a map is right and where it is wrong, as a PNG file's bytes, in the colours of [`judged`]; the true path dotted.
///
/// # Errors
/// When the picture can't be encoded.
pub fn encode_judged(grid: &Grid, truth: &Truth, path: &[Pose2]) -> Result<Vec<u8>, MapError> {
    let (low, [width, height]) = truth.rectangle();
    let resolution_m = grid.resolution_m();
    let corner_m = [f64::from(low.i) * resolution_m, f64::from(low.j) * resolution_m];
    let (occupied_above, free_below) = (log_odds_of(OCCUPIED_ABOVE), log_odds_of(FREE_BELOW));
    let colour = |column: usize, row: usize| {
        let cell = CellIndex { i: low.i + column as i32, j: low.j + row as i32 };
        let kind = truth.at(cell);
        let log_odds = judged_log_odds(grid, cell, kind).unwrap_or(0.0);
        match (kind, log_odds > occupied_above, log_odds < free_below) {
            (TrueCell::Open, ..) => judged::OPEN,
            (TrueCell::Free, true, _) => judged::FREE_AS_WALL,
            (TrueCell::Free, _, true) => judged::FREE,
            (TrueCell::Free, ..) => judged::FREE_UNDECIDED,
            (TrueCell::Wall, true, _) => judged::WALL,
            (TrueCell::Wall, _, true) => judged::WALL_AS_FREE,
            (TrueCell::Wall, ..) => judged::WALL_UNDECIDED,
        }
    };
    let mut canvas = Canvas::new(width, height, corner_m, resolution_m, colour);
    canvas.dots(path.iter().copied());
    encode_png(&canvas.pixels, canvas.width, canvas.height, ExtendedColorType::Rgb8)
}

/// Writes [`encode_judged`] to a file, whole or not at all.
///
/// # Errors
/// When the picture can't be encoded or written.
pub fn write_judged(file: &Path, grid: &Grid, truth: &Truth, path: &[Pose2]) -> Result<(), MapError> {
    write_whole(file, &encode_judged(grid, truth, path)?)?;
    Ok(())
}

/// Colour of a straight wall: red, green, blue.
pub const WALL: [u8; 3] = [230, 0, 120];

/// The map as a PNG file's bytes, with straight walls drawn over it.
///
/// # Errors
/// When the known cells lie too far apart for a picture.
pub fn encode_walls(grid: &Grid, walls: &[Wall]) -> Result<Vec<u8>, MapError> {
    let mut canvas = Canvas::of(&raster_of(grid)?, Margins::default());
    for wall in walls {
        canvas.line(wall.from, wall.to, WALL);
    }
    encode_png(&canvas.pixels, canvas.width, canvas.height, ExtendedColorType::Rgb8)
}

/// Writes [`encode_walls`] to a file, whole or not at all.
///
/// # Errors
/// When the picture can't be encoded or written.
pub fn write_walls(file: &Path, grid: &Grid, walls: &[Wall]) -> Result<(), MapError> {
    write_whole(file, &encode_walls(grid, walls)?)?;
    Ok(())
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

/// Cells around a raster, in which the path still is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Margins {
    left: usize,
    right: usize,
    below: usize,
    above: usize,
}

impl Margins {
    /// None at all if the picture would get too large with them.
    fn around(raster: &Raster, path: impl IntoIterator<Item = Pose2>) -> Self {
        let [x0, y0] = raster.origin_m();
        let side = raster.resolution_m;
        let (x1, y1) = (x0 + raster.width as f64 * side, y0 + raster.height as f64 * side);
        // Saturates where a pose is absurd, and is too large then.
        let cells = |beyond_m: f64| if beyond_m > 0.0 { (beyond_m / side).ceil() as usize } else { 0 };
        let margins =
            path.into_iter().filter(|pose| pose.is_finite()).fold(Self::default(), |margins, Pose2 { x, y, .. }| {
                Self {
                    left: margins.left.max(cells(x0 - (x - ROBOT_RADIUS_M))),
                    right: margins.right.max(cells(x + ROBOT_RADIUS_M - x1)),
                    below: margins.below.max(cells(y0 - (y - ROBOT_RADIUS_M))),
                    above: margins.above.max(cells(y + ROBOT_RADIUS_M - y1)),
                }
            });
        let across = raster.width.saturating_add(margins.left).saturating_add(margins.right) as u64;
        let along = raster.height.saturating_add(margins.below).saturating_add(margins.above) as u64;
        let known = (raster.width as u64).saturating_mul(raster.height as u64);
        let limit = CELLS_MAX.min(known.saturating_mul(4).max(1 << 24));
        if across.saturating_mul(along) <= limit { margins } else { Self::default() }
    }
}

impl Canvas {
    fn of(raster: &Raster, Margins { left, right, below, above }: Margins) -> Self {
        let [x, y] = raster.origin_m();
        let corner_m = [x - left as f64 * raster.resolution_m, y - below as f64 * raster.resolution_m];
        let (columns, rows) = (left + raster.width + right, below + raster.height + above);
        Self::new(columns, rows, corner_m, raster.resolution_m, |column, row| {
            let (Some(column), Some(row)) = (column.checked_sub(left), row.checked_sub(below)) else { return UNKNOWN };
            match raster.log_odds.get(row * raster.width + column).filter(|_| column < raster.width) {
                Some(log_odds) if !log_odds.is_nan() => [grey(probability(*log_odds)); 3],
                _ => UNKNOWN,
            }
        })
    }

    /// Cells of the colours that `colour(column, row)` gives, row 0 at the bottom.
    fn new(
        columns: usize,
        rows: usize,
        corner_m: [f64; 2],
        resolution_m: f64,
        colour: impl Fn(usize, usize) -> [u8; 3],
    ) -> Self {
        let scale = LONG_SIDE.div_ceil(columns.max(rows).max(1)).clamp(1, SCALE_MAX);
        let (width, height) = (columns * scale, rows * scale);
        let mut pixels = Vec::with_capacity(width * height * 3);
        let mut line = Vec::with_capacity(width * 3);
        for row in (0..rows).rev() {
            line.clear();
            for column in 0..columns {
                let colour = colour(column, row);
                for _ in 0..scale {
                    line.extend_from_slice(&colour);
                }
            }
            for _ in 0..scale {
                pixels.extend_from_slice(&line);
            }
        }
        Self { width, height, pixels, corner_m, pixels_per_m: scale as f64 / resolution_m }
    }

    /// A path.
    fn dots(&mut self, path: impl IntoIterator<Item = Pose2>) {
        let mut last_dot: Option<Pose2> = None;
        for pose in path.into_iter().filter(|pose| pose.is_finite()) {
            if last_dot.is_none_or(|dot| dot.distance_m(pose) >= DOT_EVERY_M) {
                self.disc(pose, DOT_RADIUS_M, 1.3, PATH);
                last_dot = Some(pose);
            }
        }
    }

    /// A straight line between two places of the map.
    fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: [u8; 3]) {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let dots = (dx.hypot(dy) * self.pixels_per_m).ceil().clamp(1.0, 1e5) as u32;
        for dot in 0..=dots {
            let share = f64::from(dot) / f64::from(dots);
            self.disc(Pose2::new(from[0] + share * dx, from[1] + share * dy, 0.0), 0.0, 1.3, colour);
        }
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
/// The level of a cell in the picture, 255·(1−p): 255 is free, 0 occupied; none where it is unknown.
#[must_use]
pub fn level(log_odds: f32) -> Option<u8> {
    (!log_odds.is_nan()).then(|| grey(probability(log_odds)))
}

pub(super) fn grey(p: f32) -> u8 {
    ((1.0 - p) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Segment, World, WorldParts};

    use super::*;
    use crate::map::{PathPoint, Provenance};

    fn document() -> MapDocument {
        let mut grid = Grid::new(0.5);
        for (i, j, log_odds) in [(0, 0, -8.0), (3, 1, 8.0), (0, 1, 0.0)] {
            let cell = CellIndex { i, j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        }
        let at = |x| PathPoint { stamp_ns: 0, pose: Pose2::new(x, 0.25, 0.0), trust: 1.0 };
        MapDocument {
            grid,
            doubt: None,
            facing: None,
            path: vec![at(0.25), at(1.75), at(1e300)],
            provenance: Provenance::default(),
        }
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
    fn right_wrong_and_undecided_have_their_colours() {
        let walls = vec![Segment { from: [-9.0, 1.75], to: [9.0, 1.75] }];
        let world = World::new(WorldParts { walls, ..WorldParts::default() }).unwrap();
        let mut grid = Grid::new(0.5);
        for (i, j, log_odds) in [(0, 0, -8.0), (1, 0, 8.0), (0, 3, 8.0), (4, 3, -8.0)] {
            let cell = CellIndex { i, j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        }
        let path = [Pose2::new(-1.75, -0.75, 0.0)];
        let truth = Truth::of(&world, &path, &grid).unwrap();
        let picture = image::load_from_memory(&encode_judged(&grid, &truth, &path).unwrap()).unwrap().to_rgb8();
        let (low, [width, height]) = truth.rectangle();
        let side = picture.width() / width as u32;
        let check = |i: i32, j: i32, expected: [u8; 3]| {
            let (column, row) = ((i - low.i) as u32, (low.j + height as i32 - 1 - j) as u32);
            assert_eq!(picture.get_pixel(column * side + side / 2, row * side + side / 2).0, expected, "{i} {j}");
        };
        check(0, 0, judged::FREE);
        check(1, 0, judged::FREE_AS_WALL);
        check(-2, 0, judged::FREE_UNDECIDED);
        check(0, 3, judged::WALL);
        check(1, 3, judged::WALL);
        check(-5, 3, judged::WALL_UNDECIDED);
        check(0, 2, judged::OPEN);
        check(0, 4, judged::OPEN);
        check(3, 3, judged::WALL_AS_FREE);
    }

    #[test]
    fn walls_are_drawn_over_the_map() {
        let wall = Wall { from: [0.25, 0.25], to: [1.75, 0.25], covered_m: 1.5, cells: 4, rms_m: 0.0 };
        let picture = |walls: &[Wall]| {
            image::load_from_memory(&encode_walls(&document().grid, walls).unwrap()).unwrap().to_rgb8()
        };
        assert!(picture(&[]).pixels().all(|pixel| pixel.0 != WALL));
        let drawn = picture(&[wall]);
        assert!((20..100).all(|x| drawn.get_pixel(x, 47).0 == WALL));
        assert_eq!(drawn.get_pixel(0, 0).0, [128; 3]);
    }

    #[test]
    fn the_picture_is_as_large_as_the_way() {
        let mut document = document();
        document.path.truncate(2);
        let size = |document: &MapDocument| {
            let picture = image::load_from_memory(&encode(document, true).unwrap()).unwrap();
            (f64::from(picture.width()), f64::from(picture.height()))
        };
        let (width, height) = size(&document);
        let pose = document.path[0].pose;
        let far = |x: f64| PathPoint { pose: Pose2::new(x, pose.y, 0.0), ..document.path[0] };
        let (wide, absurd) = (far(pose.x + 40.0), far(1e300));
        document.path.push(wide);
        let (wider, lower) = size(&document);
        assert!(wider / lower > 2.0 * width / height, "{wider} {lower} {width} {height}");
        document.path.push(absurd);
        assert_eq!(size(&document), (width, height), "a jump to nowhere is no reason to fail");
    }

    #[test]
    fn no_probability_looks_unknown() {
        assert!(UNKNOWN[0] != UNKNOWN[1] || UNKNOWN[1] != UNKNOWN[2]);
    }
}
