//! `map.echogrid`: the whole map, exactly.
//!
//! All numbers are little-endian. The file is the magic bytes `89 45 47 4d 0d 0a 1a 0a`, the format
//! version (u32: 3) and sections in this order. A section is a tag of four characters, the
//! length of its content (u64), the content, and the CRC-32 (u32) of tag, length and content.
//!
//! | tag | content |
//! |---|---|
//! | `GRID` | resolution in metres (f64), number of tiles (u64), number of path points (u64) |
//! | `PROV` | [`Provenance`](crate::map::Provenance) as JSON |
//! | `PATH` | per point: stamp in ns (u64), x, y in metres, heading in radians, trust (f64 each) |
//! | `TILE` | up to 256 tiles, in the order of (y, x): how many (u32), then a zlib stream of x, y (i32 each) and revision (u64) of each, then of the 4096 log-odds (f32) of each, row by row from the lowest y, the lowest byte, of all of them the second byte, the third, the highest; unknown is NaN `00 00 c0 7f`. As many sections as it takes |
//! | `doub` | optional: as `TILE`, with metres instead of log-odds, 0 or more: how much odometry error the evidence of each cell carried |
//! | `face` | optional: as `TILE`, with the normal of the wall in each cell instead, radians in [0, π): which way it faces |
//! | `stat` | optional: up to 64 tiles of the map, in the same order: how many (u32), then a zlib stream of x, y (i32 each) of each, then of the 4096 × 9 states (u16) of each the lower byte, and of all of them the higher: what a mapper knows of each cell besides its log-odds, row by row, in a row state by state (diffuse, then a wall of each of eight directions): how much likelier it is than before any reading, relative to free, its number in single precision with 5 bits of exponent, from 2^-15 on, and 11 of mantissa. As many sections as it takes |
//! | `END ` | nothing |
//!
//! A section whose tag begins with a small letter is optional, and a reader that does not know one leaves it out. So a map is written
//! and read in pieces of some megabytes, however large it is.
//!
//! Versions 1 (no optional sections) and 2 are read, too: there `TILE` is one section, a zlib stream of, per tile, x, y, revision and
//! the log-odds as they are, and `doub` likewise after the number of its tiles (u64).
//!
//! The same map gives the same bytes: there is no date in it, and every order is fixed. A file that
//! is cut, damaged, or made by a newer version is an error that says so.

mod read;
mod states;
#[cfg(test)]
mod tests;
mod write;

use std::io::Write as _;
use std::path::Path;

pub(super) use read::Cursor;
pub use read::{NativeError, decode, decode_path};
pub use write::encode;
pub(super) use write::section;

use super::{MapDocument, MapError, PathPoint};
use crate::read_at_most;
use crate::whole_file::WholeFile;

/// The first bytes of a native map.
pub const MAGIC: [u8; 8] = *b"\x89EGM\r\n\x1a\n";
/// The newest format version, which is written; it and all older ones can be read.
pub const VERSION: u32 = 3;
/// The last version with all tiles in one stream.
const WHOLE_VERSION: u32 = 2;
/// The version without optional sections.
const PLAIN_VERSION: u32 = 1;
/// Most tiles that a file may hold: 4 GiB of cells.
pub const TILES_MAX: u64 = 1 << 18;

const GRID: [u8; 4] = *b"GRID";
const PROVENANCE: [u8; 4] = *b"PROV";
const PATH: [u8; 4] = *b"PATH";
const TILES: [u8; 4] = *b"TILE";
const DOUBT: [u8; 4] = *b"doub";
const FACING: [u8; 4] = *b"face";
const STATES: [u8; 4] = *b"stat";
const END: [u8; 4] = *b"END ";

/// Bytes of a path point.
const POINT_BYTES: usize = 40;
/// Tiles in a section.
const BLOCK_TILES: usize = 256;
/// Bytes of what is said of a tile besides its cells.
const NUMBERS_BYTES: usize = 16;
/// Bytes of a tile before compression, up to version 2.
const TILE_BYTES: usize = 16 + 4 * echogrid_core::TILE_CELLS;
/// Tiles lie within ± this of the origin, so that cells can be numbered.
const TILE_INDEX_MAX: i32 = 1 << 24;

/// Writes a native map, whole or not at all.
///
/// # Errors
/// When the file can't be written, or the map holds what the format can't: see [`encode`].
pub fn write(path: &Path, document: &MapDocument) -> Result<(), MapError> {
    let mut file = WholeFile::create(path)?;
    for part in write::parts(document) {
        let part = part.map_err(|source| MapError::Native { path: path.to_path_buf(), source })?;
        file.write_all(&part).map_err(|source| file.failed(source))?;
    }
    Ok(file.commit()?)
}

/// Reads a native map.
///
/// # Errors
/// When the file can't be read, or is cut, damaged, made by a newer version, or no native map.
pub fn read(path: &Path) -> Result<MapDocument, MapError> {
    let bytes = read_at_most(path, u64::MAX - 1).map_err(|source| MapError::read(path, source))?;
    decode(&bytes).map_err(|source| MapError::Native { path: path.to_path_buf(), source })
}

/// Reads the path of a native map alone.
///
/// # Errors
/// As [`read`], as far as the path.
pub fn read_path(path: &Path) -> Result<Vec<PathPoint>, MapError> {
    let bytes = read_at_most(path, u64::MAX - 1).map_err(|source| MapError::read(path, source))?;
    decode_path(&bytes).map_err(|source| MapError::Native { path: path.to_path_buf(), source })
}
