//! Bytes to a map. No size in the file is believed before the bytes for it are there.

use std::io::Read as _;

use echogrid_core::grid::UNKNOWN;
use echogrid_core::{Grid, Pose2, TILE_CELLS, TileIndex};
use flate2::read::ZlibDecoder;

use super::{
    BLOCK_TILES, DOUBT, END, FACING, GRID, MAGIC, NUMBERS_BYTES, PATH, PLAIN_VERSION, POINT_BYTES, PROVENANCE, STATES,
    TILE_BYTES, TILE_INDEX_MAX, TILES, TILES_MAX, VERSION, WHOLE_VERSION,
};
use crate::map::{MapDocument, PathPoint, Provenance};

/// What is wrong with a native map.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NativeError {
    /// The magic bytes are not there.
    #[error("not a native map, as map.echogrid: it begins with \"{begins}\"; expected \"\\x89EGM\\r\\n\\x1a\\n\"")]
    Magic {
        /// The first bytes, escaped.
        begins: String,
    },
    /// Made by a newer version.
    #[error("a native map of format version {found}; this software reads versions up to {VERSION}: use a newer one")]
    NewerVersion {
        /// The version in the file.
        found: u32,
    },
    /// The file ends too early.
    #[error("the file is cut: it ends at byte {at}, where {needed} more bytes of {what} were expected")]
    Truncated {
        /// Length of the file.
        at: u64,
        /// Bytes that are missing at least.
        needed: u64,
        /// What is missing.
        what: &'static str,
    },
    /// A section's checksum does not fit.
    #[error("damaged: the checksum of section {section} at byte {at} is {found:08x}; expected {expected:08x}")]
    Checksum {
        /// The section's tag.
        section: String,
        /// Where the section begins.
        at: u64,
        /// The checksum of the bytes in the file.
        found: u32,
        /// The checksum as it is stored in the file.
        expected: u32,
    },
    /// A section that has no place here.
    #[error("damaged: section \"{found}\" at byte {at}; expected \"{expected}\"")]
    Section {
        /// The tag found.
        found: String,
        /// Where it is.
        at: u64,
        /// The tag that should be there.
        expected: String,
    },
    /// A value that can't be.
    #[error("section {section}: {field} is {value}; expected {expected}")]
    Value {
        /// The section's tag.
        section: String,
        /// The field.
        field: &'static str,
        /// What was found.
        value: String,
        /// What would have been right.
        expected: &'static str,
    },
    /// Bytes after the end.
    #[error("damaged: {count} bytes after the end at byte {at}")]
    Trailing {
        /// Where the map ends.
        at: u64,
        /// How many bytes follow.
        count: u64,
    },
}

impl NativeError {
    pub(in crate::map) fn value(
        section: [u8; 4],
        field: &'static str,
        value: impl ToString,
        expected: &'static str,
    ) -> Self {
        Self::Value { section: escape(&section), field, value: value.to_string(), expected }
    }
}

fn escape(bytes: &[u8]) -> String {
    bytes.escape_ascii().to_string()
}

/// Reads a native map from a file's bytes. Memory stays within the cells that are really there:
/// at most [`TILES_MAX`] tiles.
///
/// # Errors
/// When the bytes are cut, damaged, of a newer version, or no native map.
pub fn decode(bytes: &[u8]) -> Result<MapDocument, NativeError> {
    let Head { mut cursor, version, resolution_m, tile_count, provenance, path } = head(bytes)?;
    let mut grid = Grid::new(resolution_m);
    if version <= WHOLE_VERSION {
        tiles(TILES, cursor.section(TILES)?, tile_count, &mut grid)?;
    }
    while version > WHOLE_VERSION && (grid.tile_count() as u64) < tile_count {
        block(TILES, cursor.section(TILES)?, &mut grid)?;
    }
    if grid.tile_count() as u64 != tile_count {
        return Err(NativeError::value(TILES, "number of tiles", grid.tile_count(), "as many as are told"));
    }
    let (mut doubt, mut facing): (Option<Grid>, Option<Grid>) = (None, None);
    while version > PLAIN_VERSION
        && let Some(tag) = cursor.optional_tag()
    {
        let content = cursor.section(tag)?;
        let layer = match tag {
            DOUBT => &mut doubt,
            FACING => &mut facing,
            STATES => {
                super::states::take(content, &mut grid)?;
                continue;
            }
            _ => continue,
        };
        if version > WHOLE_VERSION {
            block(tag, content, layer.get_or_insert_with(|| Grid::new(resolution_m)))?;
        } else if layer.is_some() {
            return Err(NativeError::value(tag, "section", "there twice", "at most one"));
        } else {
            *layer = Some(self::layer(tag, content, resolution_m)?);
        }
    }
    doubt.as_ref().map_or(Ok(()), |doubt| check_layer(DOUBT, doubt))?;
    facing.as_ref().map_or(Ok(()), |facing| check_layer(FACING, facing))?;
    if !cursor.section(END)?.is_empty() {
        return Err(NativeError::value(END, "length", "not 0", "0"));
    }
    match bytes.len() - cursor.at {
        0 => Ok(MapDocument { grid, doubt, facing, path, provenance }),
        count => Err(NativeError::Trailing { at: cursor.at as u64, count: count as u64 }),
    }
}

/// The path of a native map, from the bytes of its file: what comes after it is not looked at.
///
/// # Errors
/// As [`decode`], as far as the path.
pub fn decode_path(bytes: &[u8]) -> Result<Vec<PathPoint>, NativeError> {
    Ok(head(bytes)?.path)
}

/// What comes before the tiles.
struct Head<'a> {
    cursor: Cursor<'a>,
    version: u32,
    resolution_m: f64,
    tile_count: u64,
    provenance: Provenance,
    path: Vec<PathPoint>,
}

fn head(bytes: &[u8]) -> Result<Head<'_>, NativeError> {
    let mut cursor = Cursor::new(bytes);
    if bytes.len() < MAGIC.len() && MAGIC.starts_with(bytes) {
        return Err(cursor.cut(MAGIC.len() - bytes.len(), "magic"));
    }
    if !bytes.starts_with(&MAGIC) {
        return Err(NativeError::Magic { begins: escape(bytes.get(..16).unwrap_or(bytes)) });
    }
    cursor.at = MAGIC.len();
    let version = u32::from_le_bytes(cursor.array("version")?);
    if version == 0 || version > VERSION {
        return Err(NativeError::NewerVersion { found: version });
    }
    let (resolution_m, tile_count, point_count) = grid_header(cursor.section(GRID)?)?;
    let provenance = serde_json::from_slice(cursor.section(PROVENANCE)?)
        .map_err(|error| NativeError::value(PROVENANCE, "provenance", error, "JSON"))?;
    let path = path(cursor.section(PATH)?, point_count)?;
    Ok(Head { cursor, version, resolution_m, tile_count, provenance, path })
}

fn grid_header(content: &[u8]) -> Result<(f64, u64, u64), NativeError> {
    let mut cursor = Cursor::new(content);
    let resolution_m = f64::from_le_bytes(cursor.array("resolution")?);
    check_resolution(resolution_m)?;
    let tile_count = u64::from_le_bytes(cursor.array("number of tiles")?);
    if tile_count > TILES_MAX {
        return Err(NativeError::value(GRID, "number of tiles", tile_count, "at most 262144"));
    }
    let point_count = u64::from_le_bytes(cursor.array("number of path points")?);
    if cursor.at != content.len() {
        return Err(NativeError::value(GRID, "length", content.len(), "24"));
    }
    Ok((resolution_m, tile_count, point_count))
}

/// Of cells that are larger or smaller nobody could number the places.
pub(super) fn check_resolution(resolution_m: f64) -> Result<(), NativeError> {
    if (1e-6..=1e6).contains(&resolution_m) {
        return Ok(());
    }
    Err(NativeError::value(GRID, "resolution", resolution_m, "metres from 1e-6 to 1e6"))
}

fn path(content: &[u8], point_count: u64) -> Result<Vec<PathPoint>, NativeError> {
    if Some(content.len() as u64) != point_count.checked_mul(POINT_BYTES as u64) {
        return Err(NativeError::value(PATH, "length", content.len(), "40 bytes for each path point"));
    }
    let mut cursor = Cursor::new(content);
    let mut path = Vec::with_capacity(content.len() / POINT_BYTES);
    while cursor.at < content.len() {
        let stamp_ns = u64::from_le_bytes(cursor.array("stamp")?);
        let mut number = || cursor.array("path point").map(f64::from_le_bytes);
        // Not `Pose2::new`: the heading comes back as it was.
        let point =
            PathPoint { stamp_ns, pose: Pose2 { x: number()?, y: number()?, theta: number()? }, trust: number()? };
        if !(point.pose.is_finite() && point.trust.is_finite()) {
            return Err(NativeError::value(PATH, "path point", format!("{point:?}"), "finite numbers"));
        }
        path.push(point);
    }
    Ok(path)
}

/// A quantity of each cell besides its log-odds.
fn layer(tag: [u8; 4], content: &[u8], resolution_m: f64) -> Result<Grid, NativeError> {
    let mut cursor = Cursor::new(content);
    let tile_count = u64::from_le_bytes(cursor.array("number of tiles")?);
    if tile_count > TILES_MAX {
        return Err(NativeError::value(tag, "number of tiles", tile_count, "at most 262144"));
    }
    let mut grid = Grid::new(resolution_m);
    tiles(tag, content.get(cursor.at..).unwrap_or_default(), tile_count, &mut grid)?;
    check_layer(tag, &grid)?;
    Ok(grid)
}

/// Every cell is unknown, or no negative number of metres where the layer is doubt, and the angle of a normal where it is facing.
pub(super) fn check_layer(tag: [u8; 4], grid: &Grid) -> Result<(), NativeError> {
    let (name, below, expected) = match tag {
        FACING => ("facing", core::f32::consts::PI, "radians from 0 to below π, or NaN for unknown"),
        _ => ("doubt", f32::INFINITY, "metres, 0 or more, or NaN for unknown"),
    };
    let wrong = |value: &&f32| !(value.is_nan() || (0.0..below).contains(*value));
    let wrong = grid.tiles().find_map(|(_, tile)| tile.log_odds.iter().find(wrong));
    let refuse = |wrong| Err(NativeError::value(tag, name, wrong, expected));
    wrong.map_or(Ok(()), refuse)
}

/// All tiles of a file of version 1 or 2.
fn tiles(tag: [u8; 4], content: &[u8], tile_count: u64, grid: &mut Grid) -> Result<(), NativeError> {
    let mut stream = Stream::new(tag, content);
    let mut bytes = vec![0; TILE_BYTES];
    let mut previous = None;
    for _ in 0..tile_count {
        stream.fill(&mut bytes)?;
        let mut cursor = Cursor::new(&bytes);
        let index = index(tag, &mut cursor, &mut previous)?;
        let tile = grid.tile_mut(index);
        tile.revision = u64::from_le_bytes(cursor.array("revision")?);
        for cell in tile.log_odds.iter_mut() {
            *cell = any_nan_as_one(cursor.array("cell")?);
        }
    }
    stream.end()
}

/// Some tiles, which come after those that are there.
fn block(tag: [u8; 4], content: &[u8], grid: &mut Grid) -> Result<(), NativeError> {
    let mut cursor = Cursor::new(content);
    let count = u32::from_le_bytes(cursor.array("number of tiles")?) as usize;
    // Nothing but an empty map has none.
    if count > BLOCK_TILES || (count == 0 && tag == TILES) {
        return Err(NativeError::value(tag, "number of tiles", count, "1 to 256 in a section"));
    }
    let mut stream = Stream::new(tag, cursor.rest());
    let mut numbers = vec![0; count * NUMBERS_BYTES];
    stream.fill(&mut numbers)?;
    let mut planes = vec![0; 4 * count * TILE_CELLS];
    stream.fill(&mut planes)?;
    stream.end()?;
    let mut numbers = Cursor::new(&numbers);
    let mut previous = grid.tiles().next_back().map(|(index, _)| index);
    let plane = |n: usize| planes.chunks_exact(TILE_CELLS).skip(n * count);
    let cells = plane(0).zip(plane(1)).zip(plane(2).zip(plane(3)));
    for ((low, second), (third, high)) in cells.take(count) {
        let index = index(tag, &mut numbers, &mut previous)?;
        let tile = grid.tile_mut(index);
        tile.revision = u64::from_le_bytes(numbers.array("revision")?);
        let bytes = low.iter().zip(second).zip(third.iter().zip(high));
        for (cell, ((low, second), (third, high))) in tile.log_odds.iter_mut().zip(bytes) {
            *cell = any_nan_as_one([*low, *second, *third, *high]);
        }
    }
    Ok(())
}

/// Where the next tile lies.
fn index(tag: [u8; 4], cursor: &mut Cursor<'_>, previous: &mut Option<TileIndex>) -> Result<TileIndex, NativeError> {
    let x = i32::from_le_bytes(cursor.array("tile")?);
    let y = i32::from_le_bytes(cursor.array("tile")?);
    let index = TileIndex { x, y };
    if x.unsigned_abs().max(y.unsigned_abs()) > TILE_INDEX_MAX.unsigned_abs() {
        return Err(NativeError::value(tag, "tile", format!("{index:?}"), "within 2^24 of the origin"));
    }
    if previous.is_some_and(|previous| previous >= index) {
        return Err(NativeError::value(tag, "tile", format!("{index:?}"), "tiles in ascending order"));
    }
    *previous = Some(index);
    Ok(index)
}

fn any_nan_as_one(bytes: [u8; 4]) -> f32 {
    let value = f32::from_le_bytes(bytes);
    if value.is_nan() { UNKNOWN } else { value }
}

/// A zlib stream of tiles.
struct Stream<'a> {
    tag: [u8; 4],
    decoder: ZlibDecoder<&'a [u8]>,
}

impl<'a> Stream<'a> {
    fn new(tag: [u8; 4], content: &'a [u8]) -> Self {
        Self { tag, decoder: ZlibDecoder::new(content) }
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), NativeError> {
        let short = |error| NativeError::value(self.tag, "compressed tiles", error, "as many tiles as are told");
        self.decoder.read_exact(bytes).map_err(short)
    }

    fn end(mut self) -> Result<(), NativeError> {
        match self.decoder.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(NativeError::value(self.tag, "compressed tiles", "longer", "as many tiles as are told")),
            Err(error) => Err(NativeError::value(self.tag, "compressed tiles", error, "a whole zlib stream")),
        }
    }
}

/// Takes bytes from the front.
pub(in crate::map) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(in crate::map) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(in crate::map) fn is_at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// What was not taken yet.
    pub(in crate::map) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    fn cut(&self, needed: usize, what: &'static str) -> NativeError {
        NativeError::Truncated { at: self.bytes.len() as u64, needed: needed as u64, what }
    }

    fn take(&mut self, length: usize, what: &'static str) -> Result<&'a [u8], NativeError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let taken = rest.get(..length).ok_or_else(|| self.cut(length - rest.len(), what))?;
        self.at += length;
        Ok(taken)
    }

    pub(in crate::map) fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], NativeError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    /// The tag of the section that comes next, if it is an optional one.
    fn optional_tag(&self) -> Option<[u8; 4]> {
        let tag: [u8; 4] = self.bytes.get(self.at..)?.get(..4)?.try_into().ok()?;
        tag[0].is_ascii_lowercase().then_some(tag)
    }

    /// The content of the section that must come next.
    pub(in crate::map) fn section(&mut self, expected_tag: [u8; 4]) -> Result<&'a [u8], NativeError> {
        let start = self.at;
        let tag: [u8; 4] = self.array("section tag")?;
        if tag != expected_tag {
            let (found, expected) = (escape(&tag), escape(&expected_tag));
            return Err(NativeError::Section { found, at: start as u64, expected });
        }
        let length = u64::from_le_bytes(self.array("section length")?);
        let content = self.take(usize::try_from(length).unwrap_or(usize::MAX), "section content")?;
        let found = crc32fast::hash(self.bytes.get(start..self.at).unwrap_or_default());
        let expected = u32::from_le_bytes(self.array("section checksum")?);
        if found != expected {
            return Err(NativeError::Checksum { section: escape(&tag), at: start as u64, found, expected });
        }
        Ok(content)
    }
}
