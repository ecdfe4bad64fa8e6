//! A map to bytes.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use echogrid_core::Grid;

use super::{
    DOUBT, END, GRID, MAGIC, NativeError, PATH, PLAIN_VERSION, POINT_BYTES, PROVENANCE, TILE_INDEX_MAX, TILES,
    TILES_MAX, VERSION,
};
use crate::map::MapDocument;

/// Fixed: another level would give other bytes.
const LEVEL: Compression = Compression::new(6);

/// The map as a native file's bytes. The same map gives the same bytes.
///
/// # Errors
/// When the map holds what could not be read back: a resolution beyond 1e-6 and 1e6 m, a path
/// point that is not finite, a tile beyond 2²⁴, or more than [`TILES_MAX`] tiles.
pub fn encode(document: &MapDocument) -> Result<Vec<u8>, NativeError> {
    let MapDocument { grid, doubt, path, provenance } = document;
    let resolution_m = grid.resolution_m();
    super::read::check_resolution(resolution_m)?;
    let tile_count = tile_count(GRID, grid)?;
    let mut file = MAGIC.to_vec();
    let version = if doubt.is_some() { VERSION } else { PLAIN_VERSION };
    file.extend_from_slice(&version.to_le_bytes());

    let mut content = Vec::new();
    content.extend_from_slice(&resolution_m.to_le_bytes());
    content.extend_from_slice(&tile_count.to_le_bytes());
    content.extend_from_slice(&(path.len() as u64).to_le_bytes());
    section(&mut file, GRID, &content);

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

    section(&mut file, TILES, &tiles(TILES, grid)?);
    if let Some(doubt) = doubt {
        super::read::check_doubt(doubt)?;
        let mut content = self::tile_count(DOUBT, doubt)?.to_le_bytes().to_vec();
        content.extend(tiles(DOUBT, doubt)?);
        section(&mut file, DOUBT, &content);
    }
    section(&mut file, END, &[]);
    Ok(file)
}

fn tile_count(tag: [u8; 4], grid: &Grid) -> Result<u64, NativeError> {
    let count = grid.tile_count() as u64;
    if count > TILES_MAX {
        return Err(NativeError::value(tag, "number of tiles", count, "at most 262144"));
    }
    Ok(count)
}

/// All tiles as a zlib stream.
fn tiles(tag: [u8; 4], grid: &Grid) -> Result<Vec<u8>, NativeError> {
    let mut tiles = ZlibEncoder::new(Vec::new(), LEVEL);
    let mut bytes = Vec::new();
    for (index, tile) in grid.tiles() {
        if index.x.unsigned_abs().max(index.y.unsigned_abs()) > TILE_INDEX_MAX.unsigned_abs() {
            return Err(NativeError::value(tag, "tile", format!("{index:?}"), "within 2^24 of the origin"));
        }
        bytes.clear();
        bytes.extend_from_slice(&index.x.to_le_bytes());
        bytes.extend_from_slice(&index.y.to_le_bytes());
        bytes.extend_from_slice(&tile.revision.to_le_bytes());
        for log_odds in tile.log_odds.iter() {
            // One NaN for all: its payload says nothing.
            let bits = if log_odds.is_nan() { 0x7fc0_0000 } else { log_odds.to_bits() };
            bytes.extend_from_slice(&bits.to_le_bytes());
        }
        tiles.write_all(&bytes).map_err(|error| NativeError::value(tag, "tile", error, "room in memory"))?;
    }
    tiles.finish().map_err(|error| NativeError::value(tag, "tiles", error, "room in memory"))
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
