//! A folder that one graph alone saves to.

use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use anyhow::{Context, Result, bail};
use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::sys::stat::{major, minor};

/// Takes a folder for as long as what is given back is kept; a lock on the folder itself, which goes with its holder however
/// that ends. None where the file system knows no locks.
///
/// # Errors
/// Another graph saves there.
pub(super) fn take(folder: &Path) -> Result<Option<Flock<File>>> {
    let opened = File::open(folder).with_context(|| folder.display().to_string())?;
    match Flock::lock(opened, FlockArg::LockExclusiveNonblock) {
        Ok(lock) => Ok(Some(lock)),
        Err((opened, Errno::EWOULDBLOCK)) => {
            let holder = holder(&opened).map_or(String::new(), |pid| format!(" (process {pid})"));
            bail!(
                "{}: another graph saves its map there{holder}; end it, or choose another folder with --out",
                folder.display()
            )
        }
        Err(_) => Ok(None),
    }
}

/// The process that holds the lock, as the system lists them.
fn holder(folder: &File) -> Option<u32> {
    let meta = folder.metadata().ok()?;
    let locked = format!("{:02x}:{:02x}:{}", major(meta.dev()), minor(meta.dev()), meta.ino());
    let locks = fs::read_to_string("/proc/locks").ok()?;
    let line =
        locks.lines().find(|line| line.contains("FLOCK") && line.split_whitespace().any(|word| word == locked))?;
    line.split_whitespace().nth(4)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_graph() {
        let folder = tempfile::tempdir().unwrap();
        let first = take(folder.path()).unwrap();
        assert!(first.is_some());
        let error = take(folder.path()).unwrap_err().to_string();
        assert!(error.contains("another graph saves its map there") && error.contains("--out"), "{error}");
        drop(first);
        assert!(take(folder.path()).unwrap().is_some());
    }
}
