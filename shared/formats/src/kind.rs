//! What a file is, told by its content: everything that echogrid reads, and what it knows and does not read.

use std::io::Read as _;
use std::path::Path;

use crate::Foreign;
use crate::foreign::foreign;
use crate::log::{self, LogError, LogFormat};
use crate::map::{native, readings};
use crate::text::BYTE_ORDER_MARK;

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A log, or a recording: odometry and range readings.
    Log(LogFormat),
    /// A map of echogrid's own.
    NativeMap,
    /// The readings that a map is made of, `readings.echogrid`.
    KeptReadings,
    /// The YAML of a map_server map.
    MapServer,
    /// A world of MobileSim (`.map`).
    MobileSimWorld,
    /// TOML: a world of our own, landmarks, a robot or a graph; its keys tell.
    Toml,
    /// What is known, and not read.
    Foreign(Foreign),
}

/// What is at `path`.
///
/// # Errors
/// When it can't be read, or is nothing that is known.
pub fn kind_of(path: &Path) -> Result<Kind, LogError> {
    if !path.is_dir() {
        let mut head = Vec::new();
        let file = log::open_file(path)?;
        file.take(64 * 1024).read_to_end(&mut head).map_err(|source| LogError::open(path, source))?;
        if let Some(kind) = of_head(&head) {
            return Ok(kind);
        }
    }
    match log::detect_format(path) {
        Ok(format) => Ok(Kind::Log(format)),
        Err(LogError::Foreign { kind, .. }) => Ok(Kind::Foreign(kind)),
        Err(LogError::UnknownFormat { .. }) if path.extension().is_some_and(|ending| ending == "toml") => {
            Ok(Kind::Toml)
        }
        Err(error) => Err(error),
    }
}

/// What is no log and begins so.
pub(crate) fn of_head(head: &[u8]) -> Option<Kind> {
    let text = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
    if head.starts_with(&native::MAGIC) {
        Some(Kind::NativeMap)
    } else if head.starts_with(&readings::MAGIC) {
        Some(Kind::KeptReadings)
    } else if text.starts_with(b"2D-Map") {
        Some(Kind::MobileSimWorld)
    } else if text.split(|byte| *byte == b'\n').any(begins_with_image_key) {
        Some(Kind::MapServer)
    } else {
        None
    }
}

/// What a file is that should be a log and begins so, if that is known.
pub(crate) fn in_place_of_a_log(head: &[u8]) -> Option<Foreign> {
    const MAP: &str = "a map is made already; name the log for another";
    let own = |name, advice| Some(Foreign { name, advice });
    match of_head(head) {
        Some(Kind::NativeMap) => own("native map of echogrid", MAP),
        Some(Kind::KeptReadings) => own("file of the readings that a map is made of", "see echogrid why"),
        Some(Kind::MapServer) => own("map_server map", MAP),
        Some(Kind::MobileSimWorld) => {
            own("world of MobileSim", "to drive through it: echogrid demo --set simulator.world=FILE")
        }
        _ => foreign(head),
    }
}

/// Whether a line of a file names the image of a map: `image:`, quoted or not, or so in a flow mapping.
fn begins_with_image_key(line: &[u8]) -> bool {
    let line = line.strip_prefix(BYTE_ORDER_MARK).unwrap_or(line);
    let is_quote = |byte: &u8| b"\"' ".contains(byte);
    let begin = line.iter().position(|byte| !is_quote(byte) && *byte != b'{').unwrap_or(line.len());
    let key = line.get(begin..).unwrap_or_default();
    key.strip_prefix(b"image").is_some_and(|rest| rest.iter().find(|byte| !is_quote(byte)) == Some(&b':'))
}
