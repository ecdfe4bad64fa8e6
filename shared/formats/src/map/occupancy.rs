//! Occupancy as a rectangle of probabilities: what other programs' map files hold.

use echogrid_core::{Grid, Pose2, Raster, TILE_SIDE, Tile, TileIndex};

use super::MapError;

/// Most cells of a rectangle.
pub(crate) const CELLS_MAX: u64 = 1 << 28;

/// A rectangle of occupancy probabilities.
#[derive(Debug, Clone)]
pub struct OccupancyMap {
    /// The number of cells along x.
    pub width: usize,
    /// The number of cells along y.
    pub height: usize,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// The outer corner of the cell of lowest x and y, in the map frame; its heading turns the
    /// whole rectangle.
    pub map_from_corner: Pose2,
    /// Probability that a cell is occupied, `[row * width + column]`, row 0 at the lowest y; NaN is
    /// unknown.
    pub probability: Vec<f32>,
}

impl OccupancyMap {
    /// The smallest rectangle that holds every known cell; a single unknown cell if none is known.
    ///
    /// # Errors
    /// When the known cells span more than some 268 million cells.
    pub fn of(grid: &Grid) -> Result<Self, MapError> {
        let raster = raster_of(grid)?;
        let [x, y] = raster.origin_m();
        Ok(Self {
            width: raster.width,
            height: raster.height,
            resolution_m: raster.resolution_m,
            map_from_corner: Pose2::new(x, y, 0.0),
            probability: raster.log_odds.iter().map(|log_odds| probability(*log_odds)).collect(),
        })
    }

    /// Probability of a cell; none if it is unknown or outside.
    #[must_use]
    pub fn probability_at(&self, column: usize, row: usize) -> Option<f32> {
        if column >= self.width {
            return None;
        }
        self.probability.get(row.checked_mul(self.width)? + column).copied().filter(|p| !p.is_nan())
    }
}

/// Probability of log-odds; NaN stays NaN. The same on every machine.
pub(crate) fn probability(log_odds: f32) -> f32 {
    (1.0 / (1.0 + libm::exp(-f64::from(log_odds)))) as f32
}

/// The rectangle of all tiles with known cells: cells along x and y; none where nothing is known, or no cell of it could be numbered.
pub(crate) fn extent(grid: &Grid) -> Option<[u64; 2]> {
    let indices: Vec<TileIndex> = known(grid).collect();
    extent_of(indices.iter())
}

/// The same of these tiles.
pub(crate) fn extent_of<'a>(tiles: impl Iterator<Item = &'a TileIndex>) -> Option<[u64; 2]> {
    let [x0, x1, y0, y1] = bounds(tiles.copied())?;
    let numbered = |tile: i64| (tile * TILE_SIDE as i64).unsigned_abs() < (1 << 30);
    [x0, x1, y0, y1].into_iter().all(numbered).then(|| cells([x0, x1, y0, y1]))
}

/// Whether a rectangle of so many cells along x and y is drawn as it is.
pub(crate) fn is_small_enough([width, height]: [u64; 2]) -> bool {
    width.saturating_mul(height) <= CELLS_MAX
}

fn known(grid: &Grid) -> impl Iterator<Item = TileIndex> {
    let has_known = |tile: &Tile| tile.log_odds.iter().any(|cell| !cell.is_nan());
    grid.tiles().filter(move |(_, tile)| has_known(tile)).map(|(index, _)| index)
}

/// Lowest and highest tile along x, then along y.
fn bounds(tiles: impl Iterator<Item = TileIndex>) -> Option<[i64; 4]> {
    tiles.fold(None, |bounds, index| {
        let (x, y) = (i64::from(index.x), i64::from(index.y));
        let [x0, x1, y0, y1] = bounds.unwrap_or([x, x, y, y]);
        Some([x0.min(x), x1.max(x), y0.min(y), y1.max(y)])
    })
}

/// Cells along x and y.
fn cells([x0, x1, y0, y1]: [i64; 4]) -> [u64; 2] {
    [x0.abs_diff(x1), y0.abs_diff(y1)].map(|tiles| tiles.saturating_add(1).saturating_mul(TILE_SIDE as u64))
}

/// Whether the rectangle of all known cells is not too large.
pub(crate) fn fits(grid: &Grid) -> Result<(), MapError> {
    let Some(bounds) = bounds(known(grid)) else { return Ok(()) };
    if extent(grid).is_some_and(is_small_enough) {
        return Ok(());
    }
    let (resolution_m, [width_m, height_m]) = (grid.resolution_m(), cells(bounds).map(|cells| cells as f64));
    Err(MapError::TooLarge { width_m: width_m * resolution_m, height_m: height_m * resolution_m, resolution_m })
}

/// The dense rectangle of all known cells, at least one cell.
pub(crate) fn raster_of(grid: &Grid) -> Result<Raster, MapError> {
    fits(grid)?;
    let mut raster = Raster::of(grid);
    if raster.log_odds.is_empty() {
        raster.width = 1;
        raster.height = 1;
        raster.log_odds = vec![f32::NAN];
    }
    Ok(raster)
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, TileIndex};

    use super::*;

    #[test]
    fn an_empty_grid_is_one_unknown_cell() {
        let map = OccupancyMap::of(&Grid::new(0.05)).unwrap();
        assert_eq!((map.width, map.height), (1, 1));
        assert_eq!(map.probability_at(0, 0), None);
    }

    #[test]
    fn far_apart_is_an_error_not_an_allocation() {
        let mut grid = Grid::new(0.05);
        for x in [i32::MIN, i32::MAX] {
            grid.tile_mut(TileIndex { x, y: 0 }).log_odds[0] = 1.0;
        }
        assert!(matches!(OccupancyMap::of(&grid), Err(MapError::TooLarge { .. })));
    }

    #[test]
    fn log_odds_become_probabilities() {
        let mut grid = Grid::new(0.5);
        let cell = CellIndex { i: -3, j: 4 };
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 0.0;
        let map = OccupancyMap::of(&grid).unwrap();
        assert_eq!(map.probability_at(0, 0), Some(0.5));
        assert_eq!((map.map_from_corner.x, map.map_from_corner.y), (-1.5, 2.0));
        assert!(probability(8.0) > 0.999 && probability(f32::NAN).is_nan());
    }
}
