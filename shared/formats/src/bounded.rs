//! Files that are read whole, if they are not too long for it.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

/// All bytes of a file. One that is longer than `most` is refused before it is read; one that grows meanwhile, as soon as
/// it is too long.
pub(crate) fn read_at_most(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let too_long =
        |bytes: u64| io::Error::new(io::ErrorKind::FileTooLarge, format!("{bytes} bytes; expected at most {most}"));
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    if length > most {
        return Err(too_long(length));
    }
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(too_long(bytes.len() as u64)) } else { Ok(bytes) }
}
