//! Any cells of a map: whoever looks at it finds a way to. What a file can't hold is left out, for `native_map` sees to files.
#![no_main]

use echogrid_judge::Walls;
use echogrid_core::{CellIndex, Grid, GridSummary};
use echogrid_formats::map::map_server::{MapMode, Thresholds, encode_image};
use echogrid_formats::map::{OccupancyMap, npy};
use echogrid_fuzz::Numbers;
use libfuzzer_sys::fuzz_target;

/// A rectangle of more cells takes too long to look at a million times.
const CELLS_MAX: u64 = 1 << 12;

fn cell(bytes: &mut Numbers<'_>) -> Option<(CellIndex, f32)> {
    let [what] = bytes.take()?;
    let cell = if what & 1 == 0 {
        let [i, j] = bytes.take()?.map(u8::cast_signed).map(i32::from);
        CellIndex { i, j }
    } else {
        // Within 2^30, as in files.
        CellIndex { i: i32::from_le_bytes(bytes.take()?) >> 1, j: i32::from_le_bytes(bytes.take()?) >> 1 }
    };
    let log_odds = if what & 2 == 0 {
        let [tenths] = bytes.take()?;
        f32::from(tenths.cast_signed()) / 10.0
    } else {
        f32::from_le_bytes(bytes.take()?)
    };
    Some((cell, log_odds))
}

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = Numbers { bytes, any: true };
    let Some([first]) = bytes.take() else { return };
    let resolution_m = if first & 1 == 0 { Some(0.05) } else { bytes.next() };
    let Some(resolution_m) = resolution_m.filter(|metres| (1e-6..=1e6).contains(metres)) else { return };
    let mut grid = Grid::new(resolution_m);
    while let Some((cell, log_odds)) = cell(&mut bytes) {
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
    }
    let walls = Walls::of(&grid, 0.1);
    assert!(walls.near <= walls.occupied && walls.beside <= walls.occupied);
    let summary = GridSummary::of(&grid);
    assert!(summary.entropy_bits.is_finite());
    let cells = |low: i32, high: i32| u64::from(high.abs_diff(low)) + 1;
    let is_small =
        summary.bounds.is_none_or(|(low, high)| cells(low.i, high.i).saturating_mul(cells(low.j, high.j)) <= CELLS_MAX);
    if is_small && let Ok(map) = OccupancyMap::of(&grid) {
        assert_eq!(map.probability.len(), map.width * map.height);
        assert!(!npy::encode(&map).is_empty());
        for mode in [MapMode::Trinary, MapMode::Raw] {
            encode_image(&map, mode, Thresholds::default()).expect("a PGM has no limits");
        }
    }
});
