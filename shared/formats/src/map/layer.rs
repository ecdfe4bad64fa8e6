//! Quantities of each cell besides its log-odds, as an array and as a picture with a scale below.

use echogrid_core::{CellIndex, Grid, Raster};

use super::occupancy::raster_of;
use super::{MapError, npy};
use crate::canvas::{Canvas, LETTER_PX};

/// The long side of a small map, pixels.
const LONG_SIDE_PX: usize = 800;
/// A cell is at most a square of so many pixels on a side.
const SCALE_MAX: usize = 32;
/// What is left free around a scale, pixels.
pub(super) const MARGIN_PX: usize = 10;
/// How high the bar of a scale is, pixels.
pub(super) const BAR_PX: usize = 14;
/// How long its ticks are, pixels.
pub(super) const TICK_PX: usize = 4;
/// The least width: a scale and its words have room, pixels.
pub(super) const WIDTH_MIN_PX: usize = 440;

/// What `layer` holds of each cell in the rectangle of the known cells of `map`, as an NPY file's bytes; NaN where it holds nothing.
///
/// # Errors
/// The known cells lie too far apart for a rectangle.
pub(crate) fn encode_array(layer: &Grid, map: &Grid) -> Result<Vec<u8>, MapError> {
    let raster = raster_of(map)?;
    let values: Vec<f32> = cells_of(&raster, layer).collect();
    Ok(npy::encode_array(raster.width, raster.height, &values))
}

/// The cells of a raster in these colours, with room for a scale from the row on that is told.
pub(super) fn paint(raster: &Raster, colours: &[[u8; 3]]) -> (Canvas, usize) {
    let side = LONG_SIDE_PX.div_ceil(raster.width.max(raster.height).max(1)).clamp(1, SCALE_MAX);
    let (width, height) = (raster.width * side, raster.height * side);
    let mut canvas = Canvas::new(width.max(WIDTH_MIN_PX), height + MARGIN_PX + below());
    for (row, cells) in colours.chunks(raster.width.max(1)).enumerate() {
        let top = height.saturating_sub((row + 1) * side);
        for (column, colour) in cells.iter().enumerate() {
            for (x, y) in (0..side).flat_map(|x| (0..side).map(move |y| (x, y))) {
                canvas.set(column * side + x, top + y, *colour);
            }
        }
    }
    (canvas, height + MARGIN_PX)
}

/// Rows that a scale and its words take.
pub(super) fn below() -> usize {
    BAR_PX + TICK_PX + 2 * LETTER_PX + 2 * MARGIN_PX
}

/// What a grid holds of each cell of a raster, row by row.
pub(super) fn cells_of<'a>(raster: &'a Raster, grid: &'a Grid) -> impl Iterator<Item = f32> + 'a {
    let CellIndex { i, j } = raster.lower_left;
    let rows = (0..raster.height).flat_map(|row| (0..raster.width).map(move |column| (column, row)));
    rows.map(move |(column, row)| {
        let cell = CellIndex { i: i.saturating_add(column as i32), j: j.saturating_add(row as i32) };
        grid.log_odds(cell).unwrap_or(f32::NAN)
    })
}

#[cfg(test)]
pub(super) mod testing {
    use echogrid_core::{CellIndex, Grid};

    /// A grid of cells of half a metre: column, row and value of each.
    pub(in crate::map) fn grid(cells: &[(i32, i32, f32)]) -> Grid {
        let mut grid = Grid::new(0.5);
        for (i, j, value) in cells {
            let cell = CellIndex { i: *i, j: *j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = *value;
        }
        grid
    }
}
