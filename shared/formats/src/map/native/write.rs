//! A map to bytes.

use std::io::Write as _;

use echogrid_core::{Grid, TILE_CELLS, Tile, TileIndex};
use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::{
    BLOCK_TILES, DOUBT, END, FACING, GRID, MAGIC, NUMBERS_BYTES, NativeError, PATH, POINT_BYTES, PROVENANCE,
    TILE_INDEX_MAX, TILES, TILES_MAX, VERSION,
};
use crate::map::MapDocument;

/// Fixed: another level would give other bytes. Of planes of bytes more would hardly be less.
pub(super) const LEVEL: Compression = Compression::new(1);

/// The map as a native file's bytes. The same map gives the same bytes.
///
/// # Errors
/// When the map holds what could not be read back: a resolution beyond 1e-6 and 1e6 m, a path
/// point that is not finite, a tile beyond 2²⁴, or more than [`TILES_MAX`] tiles.
pub fn encode(document: &MapDocument) -> Result<Vec<u8>, NativeError> {
    let mut file = Vec::new();
    for part in parts(document) {
        file.extend(part?);
    }
    Ok(file)
}

/// The same in parts of a few megabytes at most, so that a large map is never in memory twice.
pub(super) fn parts(document: &MapDocument) -> impl Iterator<Item = Result<Vec<u8>, NativeError>> {
    let head = core::iter::once_with(|| head(document));
    let doubt = document.doubt.iter().flat_map(|doubt| Blocks::of(DOUBT, doubt));
    let facing = document.facing.iter().flat_map(|facing| Blocks::of(FACING, facing));
    let end = core::iter::once_with(|| {
        let mut end = Vec::new();
        section(&mut end, END, &[]);
        Ok(end)
    });
    head.chain(Blocks::of(TILES, &document.grid))
        .chain(doubt)
        .chain(facing)
        .chain(super::states::blocks(&document.grid))
        .chain(end)
}

/// What comes before the tiles; nothing of the map is written where this fails.
fn head(document: &MapDocument) -> Result<Vec<u8>, NativeError> {
    let MapDocument { grid, doubt, facing, path, provenance } = document;
    let resolution_m = grid.resolution_m();
    super::read::check_resolution(resolution_m)?;
    for (tag, layer) in [(DOUBT, doubt), (FACING, facing)] {
        let Some(layer) = layer else { continue };
        super::read::check_layer(tag, layer)?;
        tile_count(tag, layer)?;
    }
    let mut file = [&MAGIC[..], &VERSION.to_le_bytes()].concat();
    let numbers = [tile_count(GRID, grid)?, path.len() as u64].map(u64::to_le_bytes).concat();
    section(&mut file, GRID, &[&resolution_m.to_le_bytes()[..], &numbers].concat());
    let content = serde_json::to_vec(provenance)
        .map_err(|error| NativeError::value(PROVENANCE, "provenance", error, "text that JSON can hold"))?;
    section(&mut file, PROVENANCE, &content);
    let mut content = Vec::with_capacity(path.len() * POINT_BYTES);
    for point in path {
        if !(point.pose.is_finite() && point.trust.is_finite()) {
            return Err(NativeError::value(PATH, "path point", format!("{point:?}"), "finite numbers"));
        }
        content.extend_from_slice(&point.stamp_ns.to_le_bytes());
        for number in [point.pose.x, point.pose.y, point.pose.theta, point.trust] {
            content.extend_from_slice(&number.to_le_bytes());
        }
    }
    section(&mut file, PATH, &content);
    Ok(file)
}

fn tile_count(tag: [u8; 4], grid: &Grid) -> Result<u64, NativeError> {
    let count = grid.tile_count() as u64;
    if count > TILES_MAX {
        return Err(NativeError::value(tag, "number of tiles", count, "at most 262144"));
    }
    Ok(count)
}

/// The tiles of a grid, section by section.
struct Blocks<'a> {
    tag: [u8; 4],
    tiles: Vec<(TileIndex, &'a Tile)>,
    /// Tiles that are written.
    written: usize,
    /// A doubt of no tile is one nevertheless.
    is_begun: bool,
}

impl<'a> Blocks<'a> {
    fn of(tag: [u8; 4], grid: &'a Grid) -> Self {
        Self { tag, tiles: grid.tiles().collect(), written: 0, is_begun: tag == TILES }
    }
}

impl Iterator for Blocks<'_> {
    type Item = Result<Vec<u8>, NativeError>;

    fn next(&mut self) -> Option<Self::Item> {
        let tiles = self.tiles.get(self.written..).unwrap_or_default();
        let tiles = tiles.get(..BLOCK_TILES).unwrap_or(tiles);
        if std::mem::replace(&mut self.is_begun, true) && tiles.is_empty() {
            return None;
        }
        self.written += tiles.len();
        Some(block(self.tag, tiles))
    }
}

/// Some tiles as a section.
fn block(tag: [u8; 4], tiles: &[(TileIndex, &Tile)]) -> Result<Vec<u8>, NativeError> {
    let mut numbers = Vec::with_capacity(tiles.len() * NUMBERS_BYTES);
    let mut planes = vec![0; 4 * tiles.len() * TILE_CELLS];
    for (at, (index, tile)) in tiles.iter().enumerate() {
        if index.x.unsigned_abs().max(index.y.unsigned_abs()) > TILE_INDEX_MAX.unsigned_abs() {
            return Err(NativeError::value(tag, "tile", format!("{index:?}"), "within 2^24 of the origin"));
        }
        numbers.extend_from_slice(&index.x.to_le_bytes());
        numbers.extend_from_slice(&index.y.to_le_bytes());
        numbers.extend_from_slice(&tile.revision.to_le_bytes());
        // One NaN for all: its payload says nothing.
        let bits = |cell: &f32| if cell.is_nan() { 0x7fc0_0000 } else { cell.to_bits() };
        for (byte, plane) in planes.chunks_exact_mut(tiles.len() * TILE_CELLS).enumerate() {
            let bytes = plane.iter_mut().skip(at * TILE_CELLS);
            for (to, cell) in bytes.zip(tile.log_odds.iter()) {
                *to = (bits(cell) >> (8 * byte)) as u8;
            }
        }
    }
    let full = |error| NativeError::value(tag, "tiles", error, "room in memory");
    let mut stream = ZlibEncoder::new((tiles.len() as u32).to_le_bytes().to_vec(), LEVEL);
    stream.write_all(&numbers).and_then(|()| stream.write_all(&planes)).map_err(full)?;
    let mut file = Vec::new();
    section(&mut file, tag, &stream.finish().map_err(full)?);
    Ok(file)
}

/// Adds a section to a file.
pub(in crate::map) fn section(file: &mut Vec<u8>, tag: [u8; 4], content: &[u8]) {
    let start = file.len();
    file.extend_from_slice(&tag);
    file.extend_from_slice(&(content.len() as u64).to_le_bytes());
    file.extend_from_slice(content);
    let sum = crc32fast::hash(file.get(start..).unwrap_or_default());
    file.extend_from_slice(&sum.to_le_bytes());
}
