//! Folders of rosbag2: a recording in several files, one after the other, with a `metadata.yaml`.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};

use saphyr_parser::{Event, Parser};
use sha2::Digest as _;

use super::container::{Channel, Container, Entry, RECORD_BYTES_MAX, Take};
use crate::log::fault::{FaultKind, Refusal};
use crate::log::source::Stamp;
use crate::log::zstandard::Zstandard;
use crate::read_at_most;

/// What tells of a folder's files.
const METADATA: &str = "metadata.yaml";
/// Longest such text, bytes: it lists topics, and files.
const METADATA_BYTES_MAX: u64 = 16 << 20;

/// The files of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Files {
    pub(crate) paths: Vec<PathBuf>,
    /// Each message is packed by Zstandard.
    pub(crate) packs_messages: bool,
}

/// The recording in a folder; none: there is none. Who was killed left no `metadata.yaml`: then it is all files of its kind.
pub(crate) fn files_of(folder: &Path) -> Option<Files> {
    if let Ok(text) = read_at_most(&folder.join(METADATA), METADATA_BYTES_MAX) {
        let (names, packs_messages) = listed(&String::from_utf8_lossy(&text));
        let paths: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
        // Older ones name the files from the folder around theirs.
        let paths = paths.into_iter().map(|path| match path.file_name() {
            Some(name) if !path.exists() => folder.join(name),
            _ => path,
        });
        return Some(Files { paths: paths.collect(), packs_messages }).filter(|files| !files.paths.is_empty());
    }
    let entries = std::fs::read_dir(folder).ok()?;
    let is_recording = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"].iter().any(|ending| name.ends_with(ending))
    };
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_recording).collect();
    paths.sort_by_key(|path| (last_number(path), path.clone()));
    (!paths.is_empty()).then_some(Files { paths, packs_messages: false })
}

/// `drive_10.mcap` is the tenth.
fn last_number(path: &Path) -> u64 {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.split('.').next().unwrap_or_default();
    stem.rsplit('_').next().and_then(|digits| digits.parse().ok()).unwrap_or(0)
}

/// The files that a metadata text lists, and whether messages are packed one by one.
fn listed(text: &str) -> (Vec<String>, bool) {
    let (mut names, mut mode, mut format) = (Vec::new(), String::new(), String::new());
    let (mut before, mut in_list) = (String::new(), false);
    for event in Parser::new_from_str(text) {
        match event {
            Ok((Event::Scalar(value, ..), _)) if in_list => names.push(value.to_string()),
            Ok((Event::Scalar(value, ..), _)) => {
                match before.as_str() {
                    "compression_mode" => mode = value.to_string(),
                    "compression_format" => format = value.to_string(),
                    _ => {}
                }
                before = value.to_string();
            }
            Ok((Event::SequenceStart(..), _)) => in_list = before == "relative_file_paths",
            Ok((Event::SequenceEnd, _)) => in_list = false,
            Ok(_) => {}
            Err(_) => break,
        }
    }
    (names, mode.eq_ignore_ascii_case("message") && format == "zstd")
}

/// Opens a file of a recording.
pub(crate) type Open = dyn FnMut(&Path) -> io::Result<Box<dyn Container>> + Send;

/// Files one after the other, as one.
pub(crate) struct Chain {
    left: VecDeque<PathBuf>,
    packs_messages: bool,
    open: Box<Open>,
    current: Option<Box<dyn Container>>,
    stamps: Vec<Stamp>,
    unpacked: Vec<u8>,
}

impl Chain {
    pub(crate) fn new(files: Files, open: Box<Open>) -> Self {
        Self {
            left: files.paths.into(),
            packs_messages: files.packs_messages,
            open,
            current: None,
            stamps: Vec::new(),
            unpacked: Vec::new(),
        }
    }
}

impl Container for Chain {
    fn advance(&mut self, take: &mut Take<'_>) -> io::Result<bool> {
        let Some(current) = &mut self.current else {
            let Some(path) = self.left.pop_front() else { return Ok(false) };
            match (self.open)(&path) {
                Ok(container) => self.current = Some(container),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    let what = format!("{} is missing", path.display());
                    take(Entry::Damage(Refusal::new(FaultKind::RecordingCut, what)));
                }
                Err(error) => return Err(error),
            }
            return Ok(true);
        };
        let goes_on = if self.packs_messages {
            let unpacked = &mut self.unpacked;
            current.advance(&mut |entry| match entry {
                Entry::Message { channel, log_ns, data } => unpack(unpacked, channel, log_ns, data, take),
                damage @ Entry::Damage(_) => take(damage),
            })?
        } else {
            current.advance(take)?
        };
        if !goes_on && let Some(ended) = self.current.take() {
            self.stamps.push(ended.finish()?);
        }
        Ok(true)
    }

    fn finish(mut self: Box<Self>) -> io::Result<Stamp> {
        if let Some(current) = self.current.take() {
            self.stamps.push(current.finish()?);
        }
        let mut hasher = sha2::Sha256::new();
        let bytes = self.stamps.iter().map(|stamp| stamp.bytes).sum();
        self.stamps.into_iter().for_each(|stamp| hasher.update(stamp.hasher.finalize()));
        Ok(Stamp { hasher, bytes })
    }
}

fn unpack(unpacked: &mut Vec<u8>, channel: &Channel, log_ns: u64, data: &[u8], take: &mut Take<'_>) {
    use io::Read as _;
    unpacked.clear();
    match Zstandard::new(data).take(RECORD_BYTES_MAX).read_to_end(unpacked) {
        Ok(_) => take(Entry::Message { channel, log_ns, data: unpacked }),
        Err(error) => {
            let what = format!("{}: {error}", channel.topic);
            take(Entry::Damage(Refusal::new(FaultKind::MessageDamaged, what)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_those_that_the_metadata_lists() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n    - a_0.db3\n    - \
                    a_1.db3\n  duration:\n    nanoseconds: 7\n  topics_with_message_count:\n    - topic_metadata:\n        name: /scan\n  \
                    compression_format: zstd\n  compression_mode: MESSAGE\n";
        assert_eq!(listed(text), (vec!["a_0.db3".to_owned(), "a_1.db3".to_owned()], true));
        assert_eq!(
            listed("compression_format: \"\"\ncompression_mode: \"\"\nrelative_file_paths: [x.mcap]"),
            (vec!["x.mcap".to_owned()], false)
        );
        assert_eq!(listed(": : :\n\t"), (Vec::new(), false));
    }

    #[test]
    fn without_metadata_files_come_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["drive_10.mcap", "drive_9.mcap", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let names: Vec<PathBuf> = files_of(folder.path()).unwrap().paths;
        assert_eq!(names, ["drive_9.mcap", "drive_10.mcap"].map(|name| folder.path().join(name)));
    }
}
