//! `readings.echogrid`: the readings that made a map what it is, as they were fused; `echogrid why` asks them.
//!
//! All numbers are little-endian. The file is the magic bytes `89 45 47 52 0d 0a 1a 0a`, the format version (u32, 2) and sections
//! like those of the [native map](super::native), in this order:
//!
//! | tag | content |
//! |---|---|
//! | `CONF` | the tables `mapper` and `robot` as TOML |
//! | `SCAN` | per scan: its number, its stamp in ns (u64 each) |
//! | `READ` | older readings that there was no room for, readings (u64 each); zlib stream of, per reading in the order of fusion: number of the scan (u64), transducer (u16), code of the verdict (u8), 1 if there was an echo (u8), ns after the scan's stamp (i32), range in metres (0 without an echo), x, y in metres, heading in radians, σ_z in metres, σ_θ in radians, trust, share that was new, radius in metres that the robot's footprint cleared after it (f64 each) |
//! | `END ` | nothing |
//!
//! The same readings give the same bytes.

use std::io::{Read as _, Write as _};
use std::path::Path;

use echogrid_core::kept::KeptReading;
use echogrid_core::sensor_model::Deviations;
use echogrid_core::{Echo, MapperConfig, Pose2, Reading, Robot, Verdict};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use serde::{Deserialize, Serialize};

use super::MapError;
use super::native::{Cursor, NativeError, section};
use crate::read_at_most;
use crate::whole_file::write_whole;

/// The file's name; it lies beside `map.echogrid`.
pub const READINGS_FILE: &str = "readings.echogrid";
/// The first bytes.
pub const MAGIC: [u8; 8] = *b"\x89EGR\r\n\x1a\n";
/// The format version.
const VERSION: u32 = 2;
/// Most readings that a file may hold.
pub const READINGS_MAX: u64 = 1 << 26;

const HEAD: [u8; 4] = *b"HEAD";
const CONFIG: [u8; 4] = *b"CONF";
const SCANS: [u8; 4] = *b"SCAN";
const READINGS: [u8; 4] = *b"READ";
const END: [u8; 4] = *b"END ";
/// The largest radius that a robot clears, metres.
const CLEARED_MAX_M: f64 = 2.0;
/// Bytes of a reading before compression.
const READING_BYTES: usize = 88;
/// Fixed: another level would give other bytes.
const LEVEL: Compression = Compression::new(6);

/// Kept readings, and what they were fused by.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadingsDocument {
    /// How they were fused.
    pub mapper: MapperConfig,
    /// The robot whose readings they are.
    pub robot: Robot,
    /// Number and stamp (nanoseconds) of each scan, in order.
    pub scans: Vec<(u64, u64)>,
    /// Older readings that there was no room for.
    pub given_up: u64,
    /// The readings, in the order in which they were fused.
    pub readings: Vec<KeptReading>,
}

#[derive(Serialize, Deserialize)]
struct Config {
    mapper: MapperConfig,
    robot: Robot,
}

impl ReadingsDocument {
    /// When a reading was taken, nanoseconds on the clock of the log; none if its scan is not known.
    #[must_use]
    pub fn stamp_ns(&self, kept: &KeptReading) -> Option<u64> {
        let place = self.scans.binary_search_by_key(&kept.sequence, |(sequence, _)| *sequence).ok()?;
        let (_, stamp_ns) = self.scans.get(place)?;
        Some(stamp_ns.saturating_add_signed(i64::from(kept.reading.offset_ns)))
    }
}

/// The readings as a file's bytes.
///
/// # Errors
/// The configuration can't be written as TOML.
pub fn encode(document: &ReadingsDocument) -> Result<Vec<u8>, NativeError> {
    let ReadingsDocument { mapper, robot, scans, given_up, readings } = document;
    let mut file = [&MAGIC[..], &VERSION.to_le_bytes()].concat();
    let config = toml::to_string(&Config { mapper: mapper.clone(), robot: robot.clone() })
        .map_err(|error| NativeError::value(CONFIG, "configuration", error, "what TOML can hold"))?;
    section(&mut file, CONFIG, config.as_bytes());
    let numbers: Vec<u8> =
        scans.iter().flat_map(|(sequence, stamp)| [*sequence, *stamp]).flat_map(u64::to_le_bytes).collect();
    section(&mut file, SCANS, &numbers);
    let mut content = [given_up.to_le_bytes(), (readings.len() as u64).to_le_bytes()].concat();
    let full = |error| NativeError::value(READINGS, "readings", error, "room in memory");
    let mut stream = ZlibEncoder::new(&mut content, LEVEL);
    readings.iter().try_for_each(|kept| stream.write_all(&bytes_of(kept))).map_err(full)?;
    stream.finish().map_err(full)?;
    section(&mut file, READINGS, &content);
    section(&mut file, END, &[]);
    Ok(file)
}

fn bytes_of(kept: &KeptReading) -> Vec<u8> {
    let KeptReading { sequence, reading, pose, deviations, news, verdict, cleared_m } = kept;
    let range_m = if let Echo::Hit { range_m } = reading.echo { range_m } else { 0.0 };
    let mut bytes = Vec::with_capacity(READING_BYTES);
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(reading.transducer.to_le_bytes());
    bytes.extend([verdict.code(), u8::from(range_m > 0.0)]);
    bytes.extend(reading.offset_ns.to_le_bytes());
    let Deviations { sigma_z_m, sigma_theta_rad, trust } = *deviations;
    let numbers = [range_m, pose.x, pose.y, pose.theta, sigma_z_m, sigma_theta_rad, trust, *news, *cleared_m];
    bytes.extend(numbers.into_iter().flat_map(f64::to_le_bytes));
    bytes
}

/// Reads them from a file's bytes. No size in the file is believed before the bytes for it are there.
///
/// # Errors
/// The bytes are cut, damaged, of a newer version, or no kept readings.
pub fn decode(bytes: &[u8]) -> Result<ReadingsDocument, NativeError> {
    let mut cursor = Cursor::new(bytes);
    let magic: [u8; 8] = cursor.array("magic")?;
    if magic != MAGIC {
        let begins = magic.escape_ascii();
        return Err(NativeError::value(HEAD, "magic", begins, "\\x89EGR\\r\\n\\x1a\\n: a file of kept readings"));
    }
    let version = u32::from_le_bytes(cursor.array("version")?);
    if version != VERSION {
        return Err(NativeError::value(HEAD, "format version", version, "2 (kept by another version: keep them anew)"));
    }
    let wrong = |error: &dyn ToString| {
        NativeError::value(CONFIG, "configuration", error.to_string(), "mapper and robot as TOML")
    };
    let text = core::str::from_utf8(cursor.section(CONFIG)?).map_err(|error| wrong(&error))?;
    let Config { mapper, robot } = toml::from_str(text).map_err(|error| wrong(&error))?;
    let scans = scans(cursor.section(SCANS)?)?;
    let (given_up, readings) = readings(cursor.section(READINGS)?)?;
    if !cursor.section(END)?.is_empty() || !cursor.is_at_end() {
        return Err(NativeError::value(END, "length", "not 0", "0, and nothing after it"));
    }
    Ok(ReadingsDocument { mapper, robot, scans, given_up, readings })
}

fn scans(content: &[u8]) -> Result<Vec<(u64, u64)>, NativeError> {
    let mut cursor = Cursor::new(content);
    let mut scans: Vec<(u64, u64)> = Vec::new();
    while !cursor.is_at_end() {
        let mut number = || cursor.array("scan").map(u64::from_le_bytes);
        let scan = (number()?, number()?);
        if scans.last().is_some_and(|last| last.0 >= scan.0) {
            return Err(NativeError::value(SCANS, "scan", scan.0, "numbers in ascending order"));
        }
        scans.push(scan);
    }
    Ok(scans)
}

fn readings(content: &[u8]) -> Result<(u64, Vec<KeptReading>), NativeError> {
    let mut cursor = Cursor::new(content);
    let given_up = u64::from_le_bytes(cursor.array("readings given up")?);
    let count = u64::from_le_bytes(cursor.array("number of readings")?);
    if count > READINGS_MAX {
        return Err(NativeError::value(READINGS, "number of readings", count, "at most 67108864"));
    }
    let mut stream = ZlibDecoder::new(cursor.rest());
    let mut bytes = [0; READING_BYTES];
    let mut readings = Vec::new();
    for _ in 0..count {
        stream
            .read_exact(&mut bytes)
            .map_err(|error| NativeError::value(READINGS, "compressed readings", error, "as many as are told"))?;
        readings.push(reading(&bytes)?);
    }
    match stream.read(&mut [0]) {
        Ok(0) => Ok((given_up, readings)),
        _ => Err(NativeError::value(READINGS, "compressed readings", "longer", "as many as are told")),
    }
}

fn reading(bytes: &[u8; READING_BYTES]) -> Result<KeptReading, NativeError> {
    let mut cursor = Cursor::new(bytes);
    let sequence = u64::from_le_bytes(cursor.array("reading")?);
    let transducer = u16::from_le_bytes(cursor.array("reading")?);
    let [code, has_echo] = cursor.array("reading")?;
    let offset_ns = i32::from_le_bytes(cursor.array("reading")?);
    let mut number = || cursor.array("reading").map(f64::from_le_bytes);
    let range_m = number()?;
    // Not `Pose2::new`: the heading comes back as it was.
    let pose = Pose2 { x: number()?, y: number()?, theta: number()? };
    let deviations = Deviations { sigma_z_m: number()?, sigma_theta_rad: number()?, trust: number()? };
    let news = number()?;
    let cleared_m = number()?;
    let verdict = Verdict::from_code(code);
    let verdict = verdict.ok_or_else(|| NativeError::value(READINGS, "verdict", code, "the code of a verdict"))?;
    if !pose.is_finite() {
        return Err(NativeError::value(READINGS, "pose", format!("{pose:?}"), "finite numbers"));
    }
    if !(0.0..=CLEARED_MAX_M).contains(&cleared_m) {
        return Err(NativeError::value(READINGS, "radius that was cleared", cleared_m, "metres from 0 to 2"));
    }
    if !(0.0..=1.0).contains(&news) {
        return Err(NativeError::value(READINGS, "share that was new", news, "a number from 0 to 1"));
    }
    if has_echo == 1 && !(range_m > 0.0 && range_m.is_finite()) {
        return Err(NativeError::value(READINGS, "range", range_m, "metres above 0 where there was an echo"));
    }
    let echo = if has_echo == 1 { Echo::Hit { range_m } } else { Echo::NoEcho };
    Ok(KeptReading {
        sequence,
        reading: Reading { transducer, echo, offset_ns },
        pose,
        deviations,
        news,
        verdict,
        cleared_m,
    })
}

/// Writes the file, whole or not at all.
///
/// # Errors
/// It can't be written.
pub fn write(path: &Path, document: &ReadingsDocument) -> Result<(), MapError> {
    let bytes = encode(document).map_err(|source| MapError::Native { path: path.to_path_buf(), source })?;
    Ok(write_whole(path, &bytes)?)
}

/// Reads a file of kept readings.
///
/// # Errors
/// It can't be read, or is cut, damaged, or something else.
pub fn read(path: &Path) -> Result<ReadingsDocument, MapError> {
    let bytes = read_at_most(path, u64::MAX - 1).map_err(|source| MapError::read(path, source))?;
    decode(&bytes).map_err(|source| MapError::Native { path: path.to_path_buf(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> ReadingsDocument {
        let reading = |sequence, echo, verdict| KeptReading {
            sequence,
            reading: Reading { transducer: 3, echo, offset_ns: -7 },
            pose: Pose2 { x: 0.1, y: -2.0 / 3.0, theta: 9.0 },
            deviations: Deviations { sigma_z_m: 0.1 + 0.2, sigma_theta_rad: 0.3, trust: 1.0 / 3.0 },
            news: 0.9,
            verdict,
            cleared_m: 0.25,
        };
        ReadingsDocument {
            mapper: MapperConfig { p_free: 0.1 + 0.2, ..MapperConfig::default() },
            robot: Robot { name: "r".into(), ..Robot::default() },
            scans: vec![(4, 1_000), (9, 2_000)],
            given_up: 5,
            readings: vec![
                reading(4, Echo::Hit { range_m: 1.1 }, Verdict::Accepted),
                reading(9, Echo::NoEcho, Verdict::Accepted),
                reading(10, Echo::Hit { range_m: 2.0 }, Verdict::Lone),
            ],
        }
    }

    #[test]
    fn there_and_back_exactly() {
        let document = document();
        let bytes = encode(&document).unwrap();
        assert_eq!(decode(&bytes).unwrap(), document);
        let stamps: Vec<_> = document.readings.iter().map(|kept| document.stamp_ns(kept)).collect();
        assert_eq!(stamps, [Some(993), Some(1_993), None]);
    }

    #[test]
    fn every_cut_and_every_flipped_bit_is_an_error() {
        let bytes = encode(&document()).unwrap();
        for at in 0..bytes.len() {
            assert!(decode(&bytes[..at]).is_err(), "{at}");
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(decode(&damaged).is_err(), "{at}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert!(decode(&longer).is_err());
    }

    /// It came back as a reading without an echo (found by fuzzing).
    #[test]
    fn an_echo_from_nowhere_is_refused() {
        for range_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let mut bytes = bytes_of(&document().readings[0]);
            bytes[16..24].copy_from_slice(&f64::to_le_bytes(range_m));
            let error = reading(bytes.as_slice().try_into().unwrap()).unwrap_err().to_string();
            assert!(error.contains("range is") && error.contains("metres above 0"), "{error}");
        }
    }
}
