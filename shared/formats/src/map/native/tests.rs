//! Native maps there and back, damaged, and of older versions.

use std::io::Write as _;

use proptest::prelude::*;

use echogrid_core::shares::Shares;
use echogrid_core::{Grid, Pose2, TileIndex};

use super::*;
use crate::map::{PathPoint, Provenance};

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
        earlier: vec!["live".into(), "cd".into()],
        config_toml: "[mapper]\nresolution_m = 0.05 # ü\n".into(),
    };
    MapDocument { grid, doubt: None, facing: None, path: points.iter().map(point).collect(), provenance }
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
    newer[8] = 4;
    assert_eq!(decode(&newer).unwrap_err(), NativeError::NewerVersion { found: 4 });
    let mut longer = bytes;
    longer.push(0);
    assert!(matches!(decode(&longer), Err(NativeError::Trailing { count: 1, .. })));
}

#[test]
fn doubt_comes_back() {
    let plain = encode(&small()).unwrap();
    assert_eq!((plain[8], decode(&plain).unwrap().doubt.is_none()), (3, true));
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
    assert_eq!((bytes[8], encode(&back).unwrap()), (3, bytes.clone()));
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
fn states_come_back() {
    let mut map = small();
    let mut shares = Shares::default();
    shares.set_state(3, &core::array::from_fn(|offset| offset as f32));
    map.grid.tile_mut(TileIndex { x: -1, y: 2 }).shares = Some(shares.clone());
    let bytes = encode(&map).unwrap();
    let back = decode(&bytes).unwrap();
    assert_same(&small(), &back);
    let of = |x, y| back.grid.tile(TileIndex { x, y }).unwrap().shares.as_ref();
    assert!(of(-1, 2).unwrap().codes() == shares.codes() && of(0, 0).is_none());
    assert_eq!(encode(&back).unwrap(), bytes);
    assert_eq!(decode_path(&bytes).unwrap(), map.path);
    for length in 0..bytes.len() {
        assert!(decode(&bytes[..length]).is_err(), "{length}");
    }
    // Of a tile that is not there.
    let section = bytes.windows(4).position(|tag| tag == b"stat").unwrap();
    let mut twice = bytes.clone();
    let end = bytes.len() - 16;
    twice.splice(end..end, bytes[section..end].to_vec());
    assert!(matches!(decode(&twice), Err(NativeError::Value { field: "tile", .. })));
}

#[test]
fn the_last_drive_begins_where_the_clock_does() {
    let of = |stamps: &[u64]| {
        let points: Vec<_> = stamps.iter().map(|stamp_ns| (*stamp_ns, 0.0, 0.0)).collect();
        document(&[], &points).last_drive().iter().map(|point| point.stamp_ns).collect::<Vec<_>>()
    };
    assert_eq!((of(&[]), of(&[1, 2, 2]), of(&[5, 6, 1, 2])), (vec![], vec![1, 2, 2], vec![1, 2]));
    assert_eq!(of(&[5, 6, 1, 2, 0]), [0]);
    let points = [5, 6, 1, 2, 0].map(|stamp_ns| (stamp_ns, 0.0, 0.0));
    assert_eq!(document(&[], &points).drives().map(<[_]>::len).collect::<Vec<_>>(), [2, 2, 1]);
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

/// As versions 1 and 2 had it.
fn tiles_as_one_stream(grid: &Grid) -> Vec<u8> {
    let mut stream = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(6));
    for (index, tile) in grid.tiles() {
        let numbers = [&index.x.to_le_bytes()[..], &index.y.to_le_bytes(), &tile.revision.to_le_bytes()].concat();
        let cells: Vec<u8> = tile.log_odds.iter().flat_map(|cell| cell.to_le_bytes()).collect();
        stream.write_all(&[numbers, cells].concat()).unwrap();
    }
    stream.finish().unwrap()
}

#[test]
fn older_versions_are_read() {
    let map = small();
    let file = encode(&map).unwrap();
    let section_of = |tag: &[u8; 4]| {
        let at = file.windows(4).position(|bytes| bytes == tag).unwrap();
        let length = u64::from_le_bytes(file[at + 4..at + 12].try_into().unwrap()) as usize;
        file[at..at + 16 + length].to_vec()
    };
    for version in [1_u32, 2] {
        let mut old = [&MAGIC[..], &version.to_le_bytes()].concat();
        [b"GRID", b"PROV", b"PATH"].iter().for_each(|tag| old.extend(section_of(tag)));
        section(&mut old, TILES, &tiles_as_one_stream(&map.grid));
        if version == 2 {
            let tiles = map.grid.tile_count() as u64;
            let mut metres = map.grid.clone();
            metres.tile_mut(TileIndex { x: -1, y: 2 }).log_odds[4095] = 8.0;
            section(&mut old, DOUBT, &[&tiles.to_le_bytes()[..], &tiles_as_one_stream(&metres)].concat());
        }
        section(&mut old, END, &[]);
        let back = decode(&old).unwrap();
        assert_same(&map, &back);
        assert_eq!(back.doubt.is_some(), version == 2);
    }
}

#[test]
fn a_map_of_many_tiles_is_in_several_sections() {
    let tiles: Vec<TileOf> = (0..600).map(|n| (n % 30, n / 30, n as u64, vec![(n as usize, n as f32)])).collect();
    let map = document(&tiles, &[]);
    let file = encode(&map).unwrap();
    assert_eq!(file.windows(4).filter(|bytes| bytes == b"TILE").count(), 3);
    assert_same(&map, &decode(&file).unwrap());
    let without_the_last = document(&tiles[..599], &[]);
    let mut fewer = encode(&without_the_last).unwrap();
    // One more is told than there is; the checksum is that of the section.
    fewer[32..40].copy_from_slice(&600_u64.to_le_bytes());
    let checksum = crc32fast::hash(&fewer[12..48]);
    fewer[48..52].copy_from_slice(&checksum.to_le_bytes());
    assert!(matches!(decode(&fewer), Err(NativeError::Section { .. })));
}
