//! What of a map a rectangle of cells can hold: all of it, its main part, or all of it with larger cells.

use echogrid_core::{CellIndex, Grid, TILE_SIDE};

use super::main_part::main_part;
use super::occupancy::{CELLS_MAX, extent, fits};
use super::{MapDocument, MapError};

/// Most cells of a map whose cells were made larger, and most along a side: what other programs read, too.
const REDUCED_CELLS_MAX: u64 = CELLS_MAX / 4;
const REDUCED_SIDE_MAX: u64 = 32_768;

/// How a map is drawn, and written for other programs.
#[derive(Debug, Clone)]
pub struct Drawable {
    /// What is drawn; none: the map as it is.
    pub document: Option<MapDocument>,
    /// Tiles that lie too far away, and are left out.
    pub left_out: usize,
    /// How many times the side of a cell is that of the map.
    pub scale: u32,
}

impl Drawable {
    /// What is drawn of a map: it as it is, if it is small enough; else without what lies far away, if that is small enough; else with cells that are
    /// twice, four times … as large, each as occupied as the most occupied of those that it covers.
    ///
    /// # Errors
    /// Its cells lie too far apart for all of these.
    pub fn of(document: &MapDocument) -> Result<Self, MapError> {
        let too_large = match main_part(document) {
            Ok(None) => return Ok(Self { document: None, left_out: 0, scale: 1 }),
            Ok(Some((part, left_out))) => return Ok(Self { document: Some(part), left_out, scale: 1 }),
            Err(too_large) => too_large,
        };
        let [width, height] = extent(&document.grid).ok_or(too_large)?;
        let is_enough = |bits: &u32| {
            let (width, height) = ((width >> bits) + 1, (height >> bits) + 1);
            width * height <= REDUCED_CELLS_MAX && width.max(height) <= REDUCED_SIDE_MAX
        };
        // A grid that can be numbered is 2^31 cells wide at most.
        let bits = (1..=31).find(is_enough).unwrap_or(31);
        let reduced = MapDocument {
            grid: reduced(&document.grid, bits),
            doubt: document.doubt.as_ref().map(|doubt| reduced(doubt, bits)),
            // Directions have no greatest.
            facing: None,
            path: document.path.clone(),
            provenance: document.provenance.clone(),
        };
        Ok(Self { document: Some(reduced), left_out: 0, scale: 1 << bits })
    }

    /// What is missing of a map in its pictures, in words; none: nothing.
    ///
    /// # Errors
    /// As [`Drawable::of`].
    pub fn missing_of(document: &MapDocument) -> Result<Option<String>, MapError> {
        // Nearly always, and without a copy
        if fits(&document.grid).is_ok() {
            return Ok(None);
        }
        Ok(Self::of(document)?.what_is_missing())
    }

    /// What is missing of the map, in words; none: nothing.
    #[must_use]
    pub fn what_is_missing(&self) -> Option<String> {
        match self {
            Self { left_out: 1.., .. } => {
                Some(format!("{} tiles, which lie too far away from the main part of the map", self.left_out))
            }
            Self { scale: 2.., .. } => Some(format!(
                "detail: the map is too large, a cell stands for {scale} × {scale} of them, as occupied as the most occupied of these",
                scale = self.scale
            )),
            _ => None,
        }
    }
}

/// With cells 2^`bits` times as large, each the greatest of what is known of those that it covers.
fn reduced(grid: &Grid, bits: u32) -> Grid {
    let mut reduced = Grid::new(grid.resolution_m() * (1_u64 << bits) as f64);
    for (index, tile) in grid.tiles() {
        let CellIndex { i, j } = index.first_cell();
        let covering = |column: i32, row: i32| CellIndex { i: (i + column) >> bits, j: (j + row) >> bits };
        // All cells of a tile lie in one of the larger ones.
        let to = &mut reduced.tile_mut(covering(0, 0).tile()).log_odds;
        for (row, values) in (0..).zip(tile.log_odds.chunks_exact(TILE_SIDE)) {
            for (column, value) in (0..).zip(values).filter(|(_, value)| !value.is_nan()) {
                let value_there = &mut to[covering(column, row).offset_in_tile()];
                *value_there = value_there.max(*value);
            }
        }
    }
    reduced
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Provenance;

    fn document(cells: &[(i32, i32, f32)]) -> MapDocument {
        let mut grid = Grid::new(0.05);
        for (i, j, log_odds) in cells {
            let cell = CellIndex { i: *i, j: *j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = *log_odds;
        }
        MapDocument { grid, doubt: None, facing: None, path: Vec::new(), provenance: Provenance::default() }
    }

    #[test]
    fn what_is_small_enough_is_drawn_as_it_is() {
        let drawable = Drawable::of(&document(&[(0, 0, 1.0), (9_000, 9_000, -1.0)])).unwrap();
        assert!(drawable.document.is_none() && drawable.scale == 1 && drawable.what_is_missing().is_none());
    }

    #[test]
    fn a_trail_across_a_country_is_drawn_with_larger_cells() {
        let trail: Vec<(i32, i32, f32)> = (-1000..1000).map(|step| (64 * step, 64 * step, -1.0)).collect();
        let drawable = Drawable::of(&document(&[&trail[..], &[(1, 2, 2.0), (3, 1, 1.0)]].concat())).unwrap();
        assert_eq!((drawable.scale, drawable.left_out), (16, 0));
        let grid = drawable.document.unwrap().grid;
        assert_eq!(grid.resolution_m(), 0.8);
        assert_eq!(grid.log_odds(CellIndex { i: 0, j: 0 }), Some(2.0), "the most occupied of them");
        assert_eq!(grid.log_odds(CellIndex { i: -4, j: -4 }), Some(-1.0));
        assert_eq!(grid.log_odds(CellIndex { i: 1, j: 0 }), None);
    }
}
