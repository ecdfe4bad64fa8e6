//! Any cells and poses as a native map: what is written is read again, and whoever looks at it finds a way to.
#![no_main]

use echogrid_core::walls::Walls;
use echogrid_core::{CellIndex, Grid, GridSummary, Pose2};
use echogrid_formats::map::map_server::{MapMode, Thresholds, encode_image};
use echogrid_formats::map::native::{decode, encode};
use echogrid_formats::map::{MapDocument, OccupancyMap, PathPoint, Provenance, npy};
use libfuzzer_sys::fuzz_target;

/// A rectangle of more cells takes too long to look at a million times.
const CELLS_MAX: u64 = 1 << 16;

struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn small(&mut self) -> Option<i16> {
        self.take().map(i16::from_le_bytes)
    }

    fn any(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    fn cell(&mut self, is_near: bool) -> Option<(CellIndex, f32)> {
        let cell = if is_near {
            CellIndex { i: self.small()?.into(), j: self.small()?.into() }
        } else {
            CellIndex { i: i32::from_le_bytes(self.take()?), j: i32::from_le_bytes(self.take()?) }
        };
        Some((cell, f32::from_le_bytes(self.take()?)))
    }

    fn point(&mut self) -> Option<PathPoint> {
        let pose = Pose2 { x: self.any()?, y: self.any()?, theta: self.any()? };
        Some(PathPoint { stamp_ns: u64::from_le_bytes(self.take()?), pose, trust: self.any()? })
    }
}

fn document(mut bytes: Bytes<'_>) -> Option<MapDocument> {
    let [first] = bytes.take()?;
    let resolution_m = if first & 1 == 0 { 0.05 } else { bytes.any()? };
    let mut document = MapDocument {
        grid: Grid::new(resolution_m),
        doubt: (first & 2 != 0).then(|| Grid::new(resolution_m)),
        path: Vec::new(),
        provenance: Provenance::default(),
    };
    while let Some([what]) = bytes.take() {
        match what % 8 {
            0..=5 => {
                let (cell, value) = bytes.cell(what % 8 < 4)?;
                let grid = document.doubt.as_mut().filter(|_| what & 8 != 0).unwrap_or(&mut document.grid);
                grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = value;
            }
            _ => document.path.push(bytes.point()?),
        }
    }
    Some(document)
}

fuzz_target!(|bytes: &[u8]| {
    let Some(document) = document(Bytes(bytes)) else { return };
    let Ok(file) = encode(&document) else { return };
    // What can't be is refused on one of both sides.
    let Ok(document) = decode(&file) else { return };
    assert_eq!(encode(&document).as_ref(), Ok(&file));
    let grid = &document.grid;
    let walls = Walls::of(grid, 0.1);
    assert!(walls.near <= walls.occupied && walls.beside <= walls.occupied);
    let summary = GridSummary::of(grid);
    assert!(summary.entropy_bits.is_finite());
    let cells = |low: i32, high: i32| u64::from(high.abs_diff(low)) + 1;
    let is_small =
        summary.bounds.is_none_or(|(low, high)| cells(low.i, high.i).saturating_mul(cells(low.j, high.j)) <= CELLS_MAX);
    if is_small && let Ok(map) = OccupancyMap::of(grid) {
        assert_eq!(map.probability.len(), map.width * map.height);
        assert!(!npy::encode(&map).is_empty());
        for mode in [MapMode::Trinary, MapMode::Raw] {
            encode_image(&map, mode, Thresholds::default()).expect("a PGM has no limits");
        }
    }
});
