//! `map.echogrid`: the whole map, exactly.
//!
//! All numbers are little-endian. The file is the magic bytes `89 45 47 4d 0d 0a 1a 0a`, the format
//! version (u32: 1, or 2 if there are optional sections) and five sections in this order. A section is a tag of four characters, the
//! length of its content (u64), the content, and the CRC-32 (u32) of tag, length and content.
//!
//! | tag | content |
//! |---|---|
//! | `GRID` | resolution in metres (f64), number of tiles (u64), number of path points (u64) |
//! | `PROV` | [`Provenance`](crate::map::Provenance) as JSON |
//! | `PATH` | per point: stamp in ns (u64), x, y in metres, heading in radians, trust (f64 each) |
//! | `TILE` | zlib stream of, per tile in the order of (y, x): x, y (i32 each), revision (u64), 4096 log-odds (f32), row by row from the lowest y; unknown is NaN `00 00 c0 7f` |
//! | `END ` | nothing |
//!
//! Since version 2 there may be optional sections before `END `, each at most once. Their tags begin with a small letter, and a
//! reader that does not know one leaves it out:
//!
//! | tag | content |
//! |---|---|
//! | `doub` | number of tiles (u64), and these as in `TILE`, with metres instead of log-odds, 0 or more: how much odometry error the evidence of each cell carried |
//!
//! The same map gives the same bytes: there is no date in it, and every order is fixed. A file that
//! is cut, damaged, or made by a newer version is an error that says so.

mod read;
mod write;

use std::path::Path;

pub(super) use read::Cursor;
pub use read::{NativeError, decode};
pub use write::encode;
pub(super) use write::section;

use super::{MapDocument, MapError};
use crate::read_at_most;
use crate::whole_file::write_whole;

/// The first bytes of a native map.
pub const MAGIC: [u8; 8] = *b"\x89EGM\r\n\x1a\n";
/// The newest format version; it and all older ones can be read. A map is written in the oldest that can hold it.
pub const VERSION: u32 = 2;
/// The version without optional sections.
const PLAIN_VERSION: u32 = 1;
/// Most tiles that a file may hold: 4 GiB of cells.
pub const TILES_MAX: u64 = 1 << 18;

const GRID: [u8; 4] = *b"GRID";
const PROVENANCE: [u8; 4] = *b"PROV";
const PATH: [u8; 4] = *b"PATH";
const TILES: [u8; 4] = *b"TILE";
const DOUBT: [u8; 4] = *b"doub";
const END: [u8; 4] = *b"END ";

/// Bytes of a path point.
const POINT_BYTES: usize = 40;
/// Bytes of a tile before compression.
const TILE_BYTES: usize = 16 + 4 * echogrid_core::TILE_CELLS;
/// Tiles lie within ± this of the origin, so that cells can be numbered.
const TILE_INDEX_MAX: i32 = 1 << 24;

/// Writes a native map, whole or not at all.
///
/// # Errors
/// When the file can't be written, or the map holds what the format can't: see [`encode`].
pub fn write(path: &Path, document: &MapDocument) -> Result<(), MapError> {
    let bytes = encode(document).map_err(|source| MapError::Native { path: path.to_path_buf(), source })?;
    Ok(write_whole(path, &bytes)?)
}

/// Reads a native map.
///
/// # Errors
/// When the file can't be read, or is cut, damaged, made by a newer version, or no native map.
pub fn read(path: &Path) -> Result<MapDocument, MapError> {
    let bytes = read_at_most(path, u64::MAX - 1).map_err(|source| MapError::read(path, source))?;
    decode(&bytes).map_err(|source| MapError::Native { path: path.to_path_buf(), source })
}
