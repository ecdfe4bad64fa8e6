//! What a recording says of its run before its first message: with which settings it was made, and which run it was.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::Path;

use super::container::{Bytes, Stored};
use super::mcap::{MAGIC, op};

/// The name of the metadata that tell of the run.
pub(super) const RUN: &str = "echogrid/run";
/// More is no description of a run, bytes.
const BYTES_MAX: u64 = 4 << 20;

/// What a recording says of its run, as pairs of key and value.
pub type RunWords = BTreeMap<String, String>;

/// The key of a run's words for the settings that decide its map, as the text of a graph file.
pub const RUN_SETTINGS: &str = "settings";

/// What the recording at `path` says of its run; none where it is no recording of a run.
///
/// # Errors
/// The file can't be read.
pub fn words_of_run(path: &Path) -> io::Result<Option<RunWords>> {
    if !path.is_file() {
        return Ok(None);
    }
    read(crate::open_regular(path)?)
}

/// Only what lies before the first message is read.
pub(super) fn read(file: impl Read) -> io::Result<Option<RunWords>> {
    let mut stored = Stored::new(file)?;
    let mut data = Vec::new();
    if !stored.read(MAGIC.len() as u64, &mut data)? || data != MAGIC {
        return Ok(None);
    }
    while stored.read(9, &mut data)? {
        let mut fields = Bytes(&data);
        let (Some(kind), Some(length)) = (fields.u8(), fields.u64()) else { break };
        let may_hold = kind == op::HEADER || kind == op::METADATA;
        if !may_hold || length > BYTES_MAX || !stored.read(length, &mut data)? {
            break;
        }
        if kind == op::METADATA
            && let Some(words) = words(Bytes(&data))
        {
            return Ok(Some(words));
        }
    }
    Ok(None)
}

/// The words of a record of metadata, if they are of the run.
fn words(mut fields: Bytes<'_>) -> Option<RunWords> {
    if fields.text()? != RUN {
        return None;
    }
    let mut pairs = Bytes(fields.counted()?);
    let mut words = RunWords::new();
    while !pairs.0.is_empty() {
        words.insert(pairs.text()?, pairs.text()?);
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::super::McapWriter;
    use super::*;

    #[test]
    fn what_is_written_of_a_run_is_read_wherever_the_file_ends_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let run = RunWords::from([(RUN_SETTINGS.into(), "[mapper]\n".into()), ("epoch".into(), "7".into())]);
        let writer = McapWriter::new(File::create(&path).unwrap(), "test", &run).unwrap();
        let begun = path.metadata().unwrap().len();
        writer.finish("echogrid", &RunWords::new()).unwrap();
        assert_eq!(words_of_run(&path).unwrap(), Some(run.clone()));
        let bytes = std::fs::read(&path).unwrap();
        for end in 0..bytes.len() {
            let expected = (end as u64 >= begun).then(|| run.clone());
            assert_eq!(read(&bytes[..end]).unwrap(), expected, "cut at {end}");
        }
        assert_eq!(words_of_run(folder.path()).unwrap(), None);
    }
}
