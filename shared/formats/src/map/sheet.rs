//! A contact sheet: several maps of one place, at several moments, side by side in one frame.
//!
//! Colours are those of [`super::picture`]. The true walls are dotted red over each map; a red disc is where the robot
//! believed to be, a green ring where it was.

use std::path::Path;

use echogrid_core::{CellIndex, Grid, Pose2, World};

use super::MapError;
use super::occupancy::probability;
use super::picture::{ROBOT, UNKNOWN, grey};
use crate::canvas::{Canvas, INK, LETTER_PX};
use crate::whole_file::write_whole;

/// Colour of the true walls.
pub const TRUE_WALL: [u8; 3] = [235, 60, 60];
/// Colour of the ring where the robot was.
pub const TRUE_ROBOT: [u8; 3] = [0, 140, 60];

/// The long side of one map, pixels, about.
const LONG_SIDE_PX: usize = 480;
/// So many greys: more hardly show, and make the file much larger.
const GREYS: u16 = 16;
const GAP_PX: usize = 8;
/// A label stands so far inside of its panel.
const LABEL_PX: usize = 4;
/// The line that a letter stands on.
const LINE_PX: usize = 12;
/// One pixel of a wall in so many.
const DOT_EVERY_PX: usize = 3;
const ROBOT_RADIUS_PX: f64 = 4.0;
const RING_RADIUS_PX: f64 = 7.0;
const RING_WIDTH_PX: f64 = 1.5;
/// Most cells of a frame.
const FRAME_CELLS_MAX: f64 = 1e8;

/// One map at one moment.
#[derive(Debug, Clone)]
pub struct Panel {
    /// The map as it was known.
    pub grid: Grid,
    /// The pose at which the robot believed to be.
    pub robot: Option<Pose2>,
    /// The pose at which the robot was.
    pub true_robot: Option<Pose2>,
    /// What stands on it; may be empty.
    pub label: String,
}

/// One row: a way of mapping.
#[derive(Debug, Clone)]
pub struct Row {
    /// What stands above it.
    pub label: String,
    /// The panels, from left to right.
    pub panels: Vec<Panel>,
}

/// The whole sheet.
#[derive(Debug, Clone)]
pub struct Sheet<'a> {
    /// The world whose walls are drawn, if they are known.
    pub world: Option<&'a World>,
    /// Lowest and highest corner of what each panel shows, metres.
    pub frame_m: [[f64; 2]; 2],
    /// What stands above the columns.
    pub columns: Vec<String>,
    /// The rows, from top to bottom.
    pub rows: Vec<Row>,
}

/// The sheet as a PNG file's bytes. The same sheet gives the same bytes.
///
/// # Errors
/// The frame is empty or too large for a picture, or there is nothing to draw.
pub fn encode(sheet: &Sheet<'_>) -> Result<Vec<u8>, MapError> {
    let frame = Frame::of(sheet)?;
    let columns = sheet.columns.len().max(1);
    let width = GAP_PX + columns * (frame.width + GAP_PX);
    let left = |column: usize| GAP_PX + column * (frame.width + GAP_PX);
    let headings: Vec<Vec<String>> = sheet.columns.iter().map(|label| wrap(label, frame.width)).collect();
    let heading_px = headings.iter().map(Vec::len).max().unwrap_or(0) * LINE_PX;
    let labels: Vec<Vec<String>> = sheet.rows.iter().map(|row| wrap(&row.label, width - 2 * GAP_PX)).collect();
    let label_px: usize = labels.iter().map(|lines| lines.len() * LINE_PX).sum();
    let height = GAP_PX + heading_px + label_px + sheet.rows.len() * (frame.height + GAP_PX);
    let mut canvas = Canvas::new(width, height);
    for (column, lines) in headings.iter().enumerate() {
        canvas.lines([left(column), GAP_PX], lines, LINE_PX);
    }
    let mut top = GAP_PX + heading_px;
    for (row, lines) in sheet.rows.iter().zip(&labels) {
        canvas.lines([GAP_PX, top], lines, LINE_PX);
        top += lines.len() * LINE_PX;
        for (column, panel) in row.panels.iter().take(columns).enumerate() {
            frame.draw(&mut canvas, [left(column), top], panel, sheet.world);
        }
        top += frame.height + GAP_PX;
    }
    canvas.encode().map_err(|error| failed(&error.to_string()))
}

fn failed(what: &str) -> MapError {
    MapError::Image { path: "the contact sheet".into(), what: what.to_owned() }
}

/// Writes [`encode`] to a file, whole or not at all.
///
/// # Errors
/// When the sheet can't be encoded or written.
pub fn write(file: &Path, sheet: &Sheet<'_>) -> Result<(), MapError> {
    write_whole(file, &encode(sheet)?)?;
    Ok(())
}

/// What every panel shows.
struct Frame {
    /// Metres.
    low: [f64; 2],
    metres_per_px: f64,
    /// Pixels.
    width: usize,
    height: usize,
}

impl Frame {
    fn of(sheet: &Sheet<'_>) -> Result<Self, MapError> {
        let first = sheet.rows.iter().flat_map(|row| &row.panels).next().ok_or_else(|| failed("no panel to draw"))?;
        let cell_m = first.grid.resolution_m();
        let [low, high] = sheet.frame_m;
        let cells = [0, 1].map(|axis| ((high[axis] - low[axis]) / cell_m).ceil());
        if cells.iter().any(|cells| !(1.0..=FRAME_CELLS_MAX).contains(cells)) || cells[0] * cells[1] > FRAME_CELLS_MAX {
            return Err(failed("the frame is empty or too large"));
        }
        // Whole pixels for a cell, or whole cells for a pixel.
        let long_side = cells[0].max(cells[1]) as usize;
        let metres_per_px = match LONG_SIDE_PX / long_side {
            0 => cell_m * long_side.div_ceil(LONG_SIDE_PX) as f64,
            pixels => cell_m / pixels.min(8) as f64,
        };
        let pixels = |axis: usize| ((high[axis] - low[axis]) / metres_per_px).ceil() as usize;
        Ok(Self { low, metres_per_px, width: pixels(0), height: pixels(1) })
    }

    /// Pixels right of and below the panel's upper left corner.
    fn pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.low[0]) / self.metres_per_px, self.height as f64 - (y - self.low[1]) / self.metres_per_px]
    }

    fn draw(&self, canvas: &mut Canvas, at: [usize; 2], panel: &Panel, world: Option<&World>) {
        for row in 0..self.height {
            for column in 0..self.width {
                canvas.set(at[0] + column, at[1] + row, self.colour(&panel.grid, column, row));
            }
        }
        if let Some(world) = world {
            self.draw_walls(canvas, at, world);
        }
        if let Some(pose) = panel.true_robot.filter(|pose| pose.is_finite()) {
            self.disc(canvas, at, pose, RING_RADIUS_PX - RING_WIDTH_PX..=RING_RADIUS_PX, TRUE_ROBOT);
        }
        if let Some(pose) = panel.robot.filter(|pose| pose.is_finite()) {
            self.disc(canvas, at, pose, 0.0..=ROBOT_RADIUS_PX, ROBOT);
        }
        canvas.text(at.map(|edge| edge + LABEL_PX), &panel.label, 1, INK);
    }

    /// The mean over the known cells of a pixel.
    fn colour(&self, grid: &Grid, column: usize, row: usize) -> [u8; 3] {
        let edge = |pixels: usize, axis: usize| self.low[axis] + pixels as f64 * self.metres_per_px;
        // A little inside, so that rounding finds no neighbour.
        let inset = 1e-6 * self.metres_per_px;
        let low = grid.cell_at(edge(column, 0) + inset, edge(self.height - 1 - row, 1) + inset);
        let high = grid.cell_at(edge(column + 1, 0) - inset, edge(self.height - row, 1) - inset);
        let cells = (low.j..=high.j).flat_map(|j| (low.i..=high.i).map(move |i| CellIndex { i, j }));
        let (sum, count) = cells
            .filter_map(|cell| grid.log_odds(cell))
            .fold((0.0_f32, 0_u16), |(sum, count), log_odds| (sum + probability(log_odds), count.saturating_add(1)));
        if count == 0 { UNKNOWN } else { [one_of_greys(grey(sum / f32::from(count))); 3] }
    }

    fn draw_walls(&self, canvas: &mut Canvas, at: [usize; 2], world: &World) {
        for wall in world.lines() {
            let (from, to) = (self.pixel(wall.from), self.pixel(wall.to));
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            let dots = (length / DOT_EVERY_PX as f64).ceil().clamp(1.0, 1e5) as usize;
            for dot in 0..=dots {
                let share = dot as f64 / dots as f64;
                self.set(
                    canvas,
                    at,
                    [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])],
                    TRUE_WALL,
                );
            }
        }
    }

    fn disc(
        &self,
        canvas: &mut Canvas,
        at: [usize; 2],
        pose: Pose2,
        radii: std::ops::RangeInclusive<f64>,
        colour: [u8; 3],
    ) {
        let [x, y] = self.pixel([pose.x, pose.y]);
        let reach = radii.end().ceil() as i32;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if radii.contains(&f64::from(dx).hypot(f64::from(dy))) {
                    self.set(canvas, at, [x + f64::from(dx), y + f64::from(dy)], colour);
                }
            }
        }
    }

    /// A pixel of the panel; what lies outside of it is cut off.
    fn set(&self, canvas: &mut Canvas, at: [usize; 2], [x, y]: [f64; 2], colour: [u8; 3]) {
        if (0.0..self.width as f64).contains(&x) && (0.0..self.height as f64).contains(&y) {
            canvas.set(at[0] + x as usize, at[1] + y as usize, colour);
        }
    }
}

/// Black and white stay what they are.
fn one_of_greys(level: u8) -> u8 {
    let step = (u16::from(level) * (GREYS - 1) + 127) / 255;
    (step * 255 / (GREYS - 1)) as u8
}

/// Lines of whole words no wider than `width` pixels; a word that is wider is cut off.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let letters = (width / LETTER_PX).max(1);
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let word: String = word.chars().take(letters).collect();
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= letters => {
                line.push(' ');
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Segment, WorldParts};

    use super::*;
    use crate::canvas::INK;

    fn world() -> World {
        let walls = vec![Segment { from: [0.0, 1.75], to: [40.0, 1.75] }];
        World::new(WorldParts { walls, ..WorldParts::default() }).unwrap()
    }

    fn panel() -> Panel {
        let mut grid = Grid::new(0.5);
        for (i, log_odds) in [(0, -8.0), (1, 8.0)] {
            let cell = CellIndex { i, j: 0 };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        }
        let at = |x| Some(Pose2::new(x, 1.0, 0.0));
        Panel { grid, robot: at(2.0), true_robot: at(1e300), label: String::new() }
    }

    fn sheet(world: &World) -> Sheet<'_> {
        let rows = ["1st", "second"].map(|label| Row { label: label.into(), panels: vec![panel(), panel()] }).into();
        let columns = vec!["before".into(), "after it and interminable".into()];
        Sheet { world: Some(world), frame_m: [[0.0, 0.0], [4.0, 2.0]], columns, rows }
    }

    #[test]
    fn cells_walls_robots_and_words_are_where_they_belong() {
        let world = world();
        let png = encode(&sheet(&world)).unwrap();
        assert_eq!(png, encode(&sheet(&world)).unwrap());
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        // Eight pixels a cell: panels of 64 x 32, below headings of three lines.
        assert_eq!(picture.dimensions(), (8 + 2 * 72, 8 + 3 * 12 + 2 * (12 + 32 + 8)));
        for [left, top] in [[8, 56], [80, 56], [8, 108], [80, 108]] {
            let at = |x: u32, y: u32| picture.get_pixel(left + x, top + y).0;
            assert_eq!((at(1, 30), at(12, 30)), ([255; 3], [0; 3]), "{left} {top}");
            assert_eq!((at(32, 16), at(1, 12), at(0, 4)), (ROBOT, UNKNOWN, TRUE_WALL), "{left} {top}");
        }
        let inked = |x: std::ops::Range<u32>, y: std::ops::Range<u32>| {
            x.into_iter().flat_map(|x| y.clone().map(move |y| (x, y))).any(|(x, y)| picture.get_pixel(x, y).0 == INK)
        };
        assert!(inked(8..56, 8..16) && inked(8..32, 44..52) && inked(80..144, 20..28) && !inked(144..152, 8..44));
    }

    #[test]
    fn words_stay_whole_where_they_fit() {
        assert_eq!(wrap("after it and interminable", 64), ["after it", "and", "intermin"]);
        assert!(wrap("  ", 64).is_empty() && wrap("a b", 0) == ["a", "b"]);
    }

    #[test]
    fn a_large_place_has_several_cells_to_a_pixel() {
        let world = world();
        let mut large = Sheet { frame_m: [[0.0, 0.0], [400.0, 2.0]], ..sheet(&world) };
        large.rows[0].panels[0].robot = None;
        let picture = image::load_from_memory(&encode(&large).unwrap()).unwrap().to_rgb8();
        // Two cells to a pixel: one free, one occupied.
        assert_eq!(picture.get_pixel(8, 8 + 2 * 12 + 1).0, [136; 3]);
    }

    #[test]
    fn what_is_no_frame_is_refused() {
        let world = world();
        for frame_m in [[[0.0, 0.0], [0.0, 2.0]], [[0.0, 0.0], [1e9, 2.0]], [[0.0, 0.0], [f64::NAN, 2.0]]] {
            assert!(encode(&Sheet { frame_m, ..sheet(&world) }).is_err(), "{frame_m:?}");
        }
        assert!(encode(&Sheet { rows: vec![], ..sheet(&world) }).is_err());
    }
}
