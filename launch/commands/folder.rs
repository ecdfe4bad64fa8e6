//! A folder that one graph alone saves to.

use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use echogrid_formats::sweep_unfinished;
use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::sys::stat::{major, minor};

/// A folder that is ours.
#[derive(Debug)]
pub(super) struct Taken {
    folder: PathBuf,
    /// None where the file system knows no locks.
    lock: Option<Flock<File>>,
}

impl Taken {
    /// Removes what was begun here by processes that were killed.
    fn sweep(&self) {
        // Without the lock another graph may be about to write it. What can't be removed costs nothing but its room.
        if self.lock.is_some()
            && let Err(error) = sweep_unfinished(&self.folder)
        {
            tracing::debug!(%error, folder = %self.folder.display(), "files in the making are left");
        }
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        self.sweep();
    }
}

/// Takes a folder for as long as what is given back is kept, which must outlive all who write there; a lock on the folder
/// itself, which goes with its holder however that ends. What killed processes had begun to write is removed, now and then.
///
/// # Errors
/// Another graph saves there.
pub(super) fn take(folder: &Path) -> Result<Taken> {
    let opened = File::open(folder).with_context(|| folder.display().to_string())?;
    let lock = match Flock::lock(opened, FlockArg::LockExclusiveNonblock) {
        Ok(lock) => Some(lock),
        Err((opened, Errno::EWOULDBLOCK)) => {
            let holder = holder(&opened).map_or(String::new(), |pid| format!(" (process {pid})"));
            bail!(
                "{}: another graph saves its map there{holder}; end it, or choose another folder with --out",
                folder.display()
            )
        }
        Err(_) => None,
    };
    let taken = Taken { folder: folder.into(), lock };
    taken.sweep();
    Ok(taken)
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
        assert!(first.lock.is_some());
        let error = take(folder.path()).unwrap_err().to_string();
        assert!(error.contains("another graph saves its map there") && error.contains("--out"), "{error}");
        drop(first);
        let part = folder.path().join(".echogrid-Ab12.part");
        std::fs::write(&part, "half").unwrap();
        let second = take(folder.path()).unwrap();
        assert!(second.lock.is_some() && !part.exists());
        std::fs::write(&part, "half").unwrap();
        drop(second);
        assert!(!part.exists());
    }
}
