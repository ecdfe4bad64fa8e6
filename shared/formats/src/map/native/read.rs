//! Bytes to a map. No size in the file is believed before the bytes for it are there.

use std::io::Read as _;

use echogrid_core::grid::UNKNOWN;
use echogrid_core::{Grid, Pose2, TileIndex};
use flate2::read::ZlibDecoder;

use super::{
    DOUBT, END, GRID, MAGIC, PATH, PLAIN_VERSION, POINT_BYTES, PROVENANCE, TILE_BYTES, TILE_INDEX_MAX, TILES,
    TILES_MAX, VERSION,
};
use crate::map::{MapDocument, PathPoint};

/// What is wrong with a native map.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NativeError {
    /// The magic bytes are not there.
    #[error("not a native map: it begins with \"{begins}\"; expected \"\\x89EGM\\r\\n\\x1a\\n\"")]
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
        /// Of the bytes in the file.
        found: u32,
        /// As stored in the file.
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
    let mut grid = Grid::new(resolution_m);
    tiles(TILES, cursor.section(TILES)?, tile_count, &mut grid)?;
    let mut doubt = None;
    while version > PLAIN_VERSION
        && let Some(tag) = cursor.optional_tag()
    {
        let content = cursor.section(tag)?;
        if tag == DOUBT {
            if doubt.is_some() {
                return Err(NativeError::value(DOUBT, "section", "there twice", "at most one"));
            }
            doubt = Some(self::doubt(content, resolution_m)?);
        }
    }
    if !cursor.section(END)?.is_empty() {
        return Err(NativeError::value(END, "length", "not 0", "0"));
    }
    match bytes.len() - cursor.at {
        0 => Ok(MapDocument { grid, doubt, path, provenance }),
        count => Err(NativeError::Trailing { at: cursor.at as u64, count: count as u64 }),
    }
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

/// Metres in the cells.
fn doubt(content: &[u8], resolution_m: f64) -> Result<Grid, NativeError> {
    let mut cursor = Cursor::new(content);
    let tile_count = u64::from_le_bytes(cursor.array("number of tiles")?);
    if tile_count > TILES_MAX {
        return Err(NativeError::value(DOUBT, "number of tiles", tile_count, "at most 262144"));
    }
    let mut grid = Grid::new(resolution_m);
    tiles(DOUBT, content.get(cursor.at..).unwrap_or_default(), tile_count, &mut grid)?;
    check_doubt(&grid)?;
    Ok(grid)
}

/// Every cell is no negative number of metres, or unknown.
pub(super) fn check_doubt(grid: &Grid) -> Result<(), NativeError> {
    let wrong = |value: &&f32| !(value.is_nan() || (value.is_finite() && **value >= 0.0));
    let wrong = grid.tiles().find_map(|(_, tile)| tile.log_odds.iter().find(wrong));
    let refuse = |wrong| Err(NativeError::value(DOUBT, "doubt", wrong, "metres, 0 or more, or NaN for unknown"));
    wrong.map_or(Ok(()), refuse)
}

fn tiles(tag: [u8; 4], content: &[u8], tile_count: u64, grid: &mut Grid) -> Result<(), NativeError> {
    let mut decoder = ZlibDecoder::new(content);
    let mut bytes = vec![0; TILE_BYTES];
    let mut previous: Option<TileIndex> = None;
    for _ in 0..tile_count {
        decoder
            .read_exact(&mut bytes)
            .map_err(|error| NativeError::value(tag, "compressed tiles", error, "as many tiles as are told"))?;
        let mut cursor = Cursor::new(&bytes);
        let x = i32::from_le_bytes(cursor.array("tile")?);
        let y = i32::from_le_bytes(cursor.array("tile")?);
        let index = TileIndex { x, y };
        if x.unsigned_abs().max(y.unsigned_abs()) > TILE_INDEX_MAX.unsigned_abs() {
            return Err(NativeError::value(tag, "tile", format!("{index:?}"), "within 2^24 of the origin"));
        }
        if previous.is_some_and(|previous| previous >= index) {
            return Err(NativeError::value(tag, "tile", format!("{index:?}"), "tiles in ascending order"));
        }
        previous = Some(index);
        let tile = grid.tile_mut(index);
        tile.revision = u64::from_le_bytes(cursor.array("revision")?);
        for cell in tile.log_odds.iter_mut() {
            let log_odds = f32::from_le_bytes(cursor.array("cell")?);
            *cell = if log_odds.is_nan() { UNKNOWN } else { log_odds };
        }
    }
    match decoder.read(&mut [0]) {
        Ok(0) => Ok(()),
        Ok(_) => Err(NativeError::value(tag, "compressed tiles", "longer", "as many tiles as are told")),
        Err(error) => Err(NativeError::value(tag, "compressed tiles", error, "a whole zlib stream")),
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::encode;
    use super::*;
    use crate::map::Provenance;

    /// Tile x, y, revision, and cells by their offset.
    type TileOf = (i32, i32, u64, Vec<(usize, f32)>);

    fn document(tiles: &[TileOf], points: &[(u64, f64, f64)]) -> MapDocument {
        let mut grid = Grid::new(0.05);
        for (x, y, revision, cells) in tiles {
            let tile = grid.tile_mut(TileIndex { x: *x, y: *y });
            tile.revision = *revision;
            for (offset, log_odds) in cells {
                tile.log_odds[*offset] = *log_odds;
            }
        }
        let point = |(stamp_ns, x, theta): &(u64, f64, f64)| PathPoint {
            stamp_ns: *stamp_ns,
            pose: Pose2 { x: *x, y: -*x, theta: *theta },
            trust: 0.5,
        };
        let provenance = Provenance {
            software: "echogrid 0".into(),
            log_sha256: Some("ab".into()),
            config_toml: "[mapper]\nresolution_m = 0.05 # ü\n".into(),
        };
        MapDocument { grid, doubt: None, path: points.iter().map(point).collect(), provenance }
    }

    fn small() -> MapDocument {
        document(&[(-1, 2, 7, vec![(0, 1.5), (4095, -8.0)]), (0, 0, 0, vec![])], &[(5, 1.0, 9.0)])
    }

    fn assert_same(a: &MapDocument, b: &MapDocument) {
        assert_eq!(a.path, b.path);
        assert_eq!(a.provenance, b.provenance);
        assert_eq!(a.grid.resolution_m().to_bits(), b.grid.resolution_m().to_bits());
        assert_eq!(a.grid.tile_count(), b.grid.tile_count());
        for ((index_a, tile_a), (index_b, tile_b)) in a.grid.tiles().zip(b.grid.tiles()) {
            assert_eq!((index_a, tile_a.revision), (index_b, tile_b.revision));
            for (cell_a, cell_b) in tile_a.log_odds.iter().zip(tile_b.log_odds.iter()) {
                assert!(cell_a.to_bits() == cell_b.to_bits() || (cell_a.is_nan() && cell_b.is_nan()));
            }
        }
    }

    #[test]
    fn every_truncation_is_an_error() {
        let bytes = encode(&small()).unwrap();
        for length in 0..bytes.len() {
            assert!(matches!(decode(&bytes[..length]), Err(NativeError::Truncated { at, .. }) if at == length as u64));
        }
        assert!(decode(&bytes).is_ok());
    }

    #[test]
    fn every_flipped_bit_is_an_error() {
        let bytes = encode(&small()).unwrap();
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(decode(&damaged).is_err(), "byte {at}");
        }
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let bytes = encode(&small()).unwrap();
        assert!(matches!(decode(b"P5\n2 2\n255\n"), Err(NativeError::Magic { .. })));
        let mut newer = bytes.clone();
        newer[8] = 3;
        assert_eq!(decode(&newer).unwrap_err(), NativeError::NewerVersion { found: 3 });
        let mut longer = bytes;
        longer.push(0);
        assert!(matches!(decode(&longer), Err(NativeError::Trailing { count: 1, .. })));
    }

    #[test]
    fn doubt_comes_back_and_who_has_none_writes_what_old_readers_read() {
        let plain = encode(&small()).unwrap();
        assert_eq!((plain[8], decode(&plain).unwrap().doubt.is_none()), (1, true));
        let with = |metres: f32| {
            let mut map = small();
            let mut doubt = Grid::new(0.05);
            doubt.tile_mut(TileIndex { x: -1, y: 2 }).log_odds[9] = metres;
            map.doubt = Some(doubt);
            encode(&map)
        };
        let bytes = with(0.25).unwrap();
        let back = decode(&bytes).unwrap();
        assert_same(&small(), &back);
        assert_eq!(back.doubt.as_ref().unwrap().tile(TileIndex { x: -1, y: 2 }).unwrap().log_odds[9], 0.25);
        assert_eq!((bytes[8], encode(&back).unwrap()), (2, bytes.clone()));
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_err(), "{length}");
        }
        assert!(with(-0.1).is_err() && with(f32::INFINITY).is_err());
        // A later version's optional section is left out; one with a capital letter is none of these.
        let add = |tag: &[u8; 4]| {
            let mut section = [&tag[..], &3_u64.to_le_bytes(), b"abc"].concat();
            section.extend(crc32fast::hash(&section).to_le_bytes());
            let mut more = bytes.clone();
            let end = more.len() - 16;
            more.splice(end..end, section);
            decode(&more)
        };
        assert!(add(b"what").unwrap().doubt.is_some());
        assert!(matches!(add(b"What"), Err(NativeError::Section { .. })));
    }

    #[test]
    fn any_nan_is_written_as_one() {
        let mut odd = small();
        odd.grid.tile_mut(TileIndex { x: 0, y: 0 }).log_odds[3] = f32::from_bits(0xffc1_2345);
        assert_eq!(encode(&odd).unwrap(), encode(&small()).unwrap());
    }

    #[test]
    fn what_could_not_be_read_back_is_not_written() {
        assert!(encode(&document(&[], &[(0, f64::NAN, 0.0)])).is_err());
        assert!(encode(&document(&[(i32::MAX, 0, 0, vec![])], &[])).is_err());
        for resolution_m in [0.0, 1e-7, 1e7, f64::NAN, f64::INFINITY] {
            let flat = MapDocument { grid: Grid::new(resolution_m), ..small() };
            assert!(encode(&flat).is_err(), "{resolution_m}");
        }
    }

    /// Cells so large that whoever looked for walls could not number its steps (found by fuzzing).
    #[test]
    fn a_map_of_absurd_resolution_is_refused() {
        let mut file = encode(&small()).unwrap();
        // After magic, version, tag and length; the checksum is that of the section.
        file[24..32].copy_from_slice(&1e300_f64.to_le_bytes());
        let checksum = crc32fast::hash(&file[12..48]);
        file[48..52].copy_from_slice(&checksum.to_le_bytes());
        let error = decode(&file).unwrap_err().to_string();
        assert!(error.contains("resolution is 1000") && error.contains("metres from 1e-6 to 1e6"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn there_and_back(
            tiles in prop::collection::vec(
                (-3..3, -3..3, any::<u64>(), prop::collection::vec((0..4096_usize, -9.0_f32..9.0), 0..20)), 0..5),
            points in prop::collection::vec((any::<u64>(), -1e6..1e6, -10.0..10.0), 0..20),
        ) {
            let document = document(&tiles, &points);
            let bytes = encode(&document).unwrap();
            let back = decode(&bytes).unwrap();
            assert_same(&document, &back);
            prop_assert_eq!(encode(&back).unwrap(), bytes);
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..300), with_magic: bool) {
            let mut file = if with_magic { MAGIC.to_vec() } else { Vec::new() };
            file.extend(bytes);
            prop_assert!(decode(&file).is_err());
        }
    }
}
