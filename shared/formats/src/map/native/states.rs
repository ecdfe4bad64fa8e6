//! `stat`: what the cells would be if they are occupied, as a mapper that goes on with the map needs it.

use std::io::{Read as _, Write as _};

use echogrid_core::grid::TILE_CELLS;
use echogrid_core::oriented::STATES;
use echogrid_core::shares::Shares;
use echogrid_core::{Grid, TileIndex};
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::write::{LEVEL, section};
use super::{Cursor, NativeError, STATES as TAG, TILES_MAX};

/// Tiles in a section: their states are larger than they are.
const BLOCK_TILES: usize = 64;
const CODES: usize = STATES * TILE_CELLS;
/// Of x and y.
const INDEX_BYTES: usize = 8;

/// A section for each so many tiles that have states.
pub(super) fn blocks(grid: &Grid) -> impl Iterator<Item = Result<Vec<u8>, NativeError>> {
    let tiles: Vec<(TileIndex, &Shares)> =
        grid.tiles().filter_map(|(index, tile)| Some((index, tile.shares.as_ref()?))).collect();
    let blocks: Vec<Vec<_>> = tiles.chunks(BLOCK_TILES).map(<[_]>::to_vec).collect();
    blocks.into_iter().map(|tiles| block(&tiles))
}

fn block(tiles: &[(TileIndex, &Shares)]) -> Result<Vec<u8>, NativeError> {
    let full = |error| NativeError::value(TAG, "states", error, "room in memory");
    let mut content = Vec::with_capacity(tiles.len() * (INDEX_BYTES + 2 * CODES));
    for (index, _) in tiles {
        content.extend_from_slice(&index.x.to_le_bytes());
        content.extend_from_slice(&index.y.to_le_bytes());
    }
    for byte in 0..2 {
        content.extend(tiles.iter().flat_map(|(_, shares)| shares.codes().iter().map(|code| code.to_le_bytes()[byte])));
    }
    let mut stream = ZlibEncoder::new((tiles.len() as u32).to_le_bytes().to_vec(), LEVEL);
    stream.write_all(&content).map_err(full)?;
    let mut file = Vec::new();
    section(&mut file, TAG, &stream.finish().map_err(full)?);
    Ok(file)
}

/// Gives tiles of `grid`, which are there, their states.
pub(super) fn take(content: &[u8], grid: &mut Grid) -> Result<(), NativeError> {
    let mut cursor = Cursor::new(content);
    let count = u32::from_le_bytes(cursor.array("number of tiles")?) as usize;
    if count == 0 || count > BLOCK_TILES || grid.tile_count() as u64 > TILES_MAX {
        return Err(NativeError::value(TAG, "number of tiles", count, "1 to 64 in a section"));
    }
    let short = |error| NativeError::value(TAG, "compressed states", error, "as many tiles as are told");
    let mut stream = ZlibDecoder::new(cursor.rest());
    let mut bytes = vec![0; count * (INDEX_BYTES + 2 * CODES)];
    stream.read_exact(&mut bytes).map_err(short)?;
    if stream.read(&mut [0]).map_err(short)? != 0 {
        return Err(NativeError::value(TAG, "compressed states", "longer", "as many tiles as are told"));
    }
    let (indices, codes) = bytes.split_at(count * INDEX_BYTES);
    let (low, high) = codes.split_at(count * CODES);
    let mut indices = Cursor::new(indices);
    for (low, high) in low.chunks_exact(CODES).zip(high.chunks_exact(CODES)) {
        let x = i32::from_le_bytes(indices.array("tile")?);
        let y = i32::from_le_bytes(indices.array("tile")?);
        let index = TileIndex { x, y };
        if grid.tile(index).is_none_or(|tile| tile.shares.is_some()) {
            return Err(NativeError::value(TAG, "tile", format!("{index:?}"), "one of the map, and each once"));
        }
        let codes: Vec<u16> = low.iter().zip(high).map(|(low, high)| u16::from_le_bytes([*low, *high])).collect();
        grid.tile_mut(index).shares = Shares::of_codes(&codes);
    }
    Ok(())
}
