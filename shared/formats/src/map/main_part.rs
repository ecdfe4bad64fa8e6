//! The part of a map that a picture can hold, where a few cells lie so far away that all of it can't be drawn.

use std::collections::{BTreeMap, BTreeSet};

use echogrid_core::{Grid, TileIndex};

use super::occupancy::{extent_of, fits, is_small_enough};
use super::{MapDocument, MapError, PathPoint};

/// Tiles that are no farther apart than so many belong together.
const TOGETHER: i32 = 4;

/// Of a map that is too large for a picture: the largest part of it that is not, with as many tiles as were left out. None if
/// all of it can be drawn.
///
/// # Errors
/// No part of it is both the main part and small enough.
pub(super) fn main_part(document: &MapDocument) -> Result<Option<(MapDocument, usize)>, MapError> {
    let Err(too_large) = fits(&document.grid) else { return Ok(None) };
    let tiles: BTreeSet<TileIndex> = known(&document.grid).map(|(index, _)| index).collect();
    let tile_of = |point: &PathPoint| document.grid.cell_at(point.pose.x, point.pose.y).tile();
    // Where the robot was for most of its way; a map without a path: where most is known.
    let main = groups(&tiles).into_iter().max_by_key(|group| {
        let way = document.path.iter().filter(|point| group.contains(&tile_of(point))).count();
        (way, cells(&document.grid, group))
    });
    let main = main.unwrap_or_default();
    // Before it is copied
    if !extent_of(main.iter()).is_some_and(is_small_enough) {
        return Err(too_large);
    }
    let only = |grid: &Grid| {
        let mut part = Grid::new(grid.resolution_m());
        for (index, tile) in grid.tiles().filter(|(index, _)| main.contains(index)) {
            *part.tile_mut(index) = tile.clone();
        }
        part
    };
    let grid = only(&document.grid);
    let (doubt, facing) = (document.doubt.as_ref().map(only), document.facing.as_ref().map(only));
    // The robot may be anywhere by now.
    let path = document.path.iter().filter(|point| main.contains(&tile_of(point))).copied().collect();
    let left_out = tiles.len() - main.len();
    Ok(Some((MapDocument { grid, doubt, facing, path, provenance: document.provenance.clone() }, left_out)))
}

fn known(grid: &Grid) -> impl Iterator<Item = (TileIndex, usize)> {
    let count = |cells: &[f32]| cells.iter().filter(|cell| !cell.is_nan()).count();
    grid.tiles().map(move |(index, tile)| (index, count(tile.log_odds.as_slice()))).filter(|(_, cells)| *cells > 0)
}

fn cells(grid: &Grid, group: &BTreeSet<TileIndex>) -> usize {
    known(grid).filter(|(index, _)| group.contains(index)).map(|(_, cells)| cells).sum()
}

/// Tiles that belong together, by blocks of so many.
fn groups(tiles: &BTreeSet<TileIndex>) -> Vec<BTreeSet<TileIndex>> {
    let block = |index: &TileIndex| (index.x.div_euclid(TOGETHER), index.y.div_euclid(TOGETHER));
    let mut blocks: BTreeMap<(i32, i32), Vec<TileIndex>> = BTreeMap::new();
    for index in tiles {
        blocks.entry(block(index)).or_default().push(*index);
    }
    let mut groups = Vec::new();
    while let Some((first, inside)) = blocks.pop_first() {
        let (mut group, mut border): (BTreeSet<TileIndex>, Vec<(i32, i32)>) =
            (inside.into_iter().collect(), vec![first]);
        while let Some((x, y)) = border.pop() {
            for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                let next = (x.saturating_add(dx), y.saturating_add(dy));
                if let Some(inside) = blocks.remove(&next) {
                    group.extend(inside);
                    border.push(next);
                }
            }
        }
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, Pose2};

    use super::*;
    use crate::map::Provenance;

    fn document(cells: &[(i32, i32)]) -> MapDocument {
        let mut grid = Grid::new(0.05);
        for (i, j) in cells {
            let cell = CellIndex { i: *i, j: *j };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 1.0;
        }
        let point = |x| PathPoint { stamp_ns: 0, pose: Pose2::new(x, 0.0, 0.0), trust: 1.0 };
        MapDocument {
            grid,
            doubt: None,
            facing: None,
            path: vec![point(0.0), point(5e5)],
            provenance: Provenance::default(),
        }
    }

    #[test]
    fn what_is_far_away_is_left_out() {
        let (part, left_out) = main_part(&document(&[(0, 0), (70, 3), (10_000_000, 9_000_000)])).unwrap().unwrap();
        assert_eq!((part.grid.tiles().count(), left_out, part.path.len()), (2, 1, 1));
    }

    #[test]
    fn all_that_can_be_drawn_is() {
        assert!(main_part(&document(&[(0, 0), (5000, 3000)])).unwrap().is_none());
        assert!(main_part(&document(&[])).unwrap().is_none());
    }

    #[test]
    fn a_trail_across_a_country_has_no_main_part() {
        let trail: Vec<(i32, i32)> = (0..2000).map(|step| (64 * step, 64 * step)).collect();
        assert!(matches!(main_part(&document(&trail)), Err(MapError::TooLarge { .. })));
    }
}
