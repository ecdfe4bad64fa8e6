//! Files that are opened only if they are files, and read whole only if they are not too long for it.

use std::fs::{File, FileType};
use std::io::{self, Read as _};
use std::path::Path;

/// Opens a file for reading. A folder is refused, and so is a pipe or a device: to open one may wait for ever, and it may
/// never end.
///
/// # Errors
/// It can't be opened, or is no regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    // Before it is opened: that alone waits for who writes into a pipe.
    refuse_special(path.metadata()?.file_type())?;
    let file = File::open(path)?;
    refuse_special(file.metadata()?.file_type())?;
    Ok(file)
}

fn refuse_special(kind: FileType) -> io::Result<()> {
    use std::os::unix::fs::FileTypeExt as _;
    let is = match kind {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => return Err(io::Error::new(io::ErrorKind::IsADirectory, "a folder; expected a file")),
        kind if kind.is_fifo() => "a pipe",
        kind if kind.is_socket() => "a socket",
        _ => "a device",
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{is}; expected a regular file")))
}

/// All bytes of a regular file. One that is longer than `most` is refused before it is read; one that grows meanwhile, as
/// soon as it is too long.
///
/// # Errors
/// It can't be read, is no regular file, or is too long.
pub fn read_at_most(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let too_long =
        |bytes: u64| io::Error::new(io::ErrorKind::FileTooLarge, format!("{bytes} bytes; expected at most {most}"));
    let file = open_regular(path)?;
    let length = file.metadata()?.len();
    if length > most {
        return Err(too_long(length));
    }
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(too_long(bytes.len() as u64)) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_file_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, socket) = (folder.path().join("pipe"), folder.path().join("socket"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let check = |path: &Path, expected: &str| {
            let error = read_at_most(path, 10).unwrap_err().to_string();
            assert_eq!(error, format!("{expected}; expected a regular file"));
        };
        check(&pipe, "a pipe");
        check(&socket, "a socket");
        check(Path::new("/dev/zero"), "a device");
        assert_eq!(open_regular(folder.path()).unwrap_err().kind(), io::ErrorKind::IsADirectory);
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        check(&link, "a pipe");
        std::fs::write(folder.path().join("file"), "12345").unwrap();
        assert_eq!(read_at_most(&folder.path().join("file"), 10).unwrap(), b"12345");
        assert!(read_at_most(&folder.path().join("file"), 4).is_err());
    }
}
