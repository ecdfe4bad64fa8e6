//! What of a folder has reached the disk, as far as those who wrote it asked for that.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A file, under whatever name.
type Inode = u64;

/// Names and contents that outlive a failure of power.
#[derive(Debug, Default)]
pub(super) struct Durable {
    names: BTreeMap<PathBuf, Inode>,
    contents: BTreeMap<Inode, Vec<u8>>,
}

impl Durable {
    /// All that is there now.
    pub(super) fn of(folder: &Path) -> io::Result<Self> {
        let mut durable = Self::default();
        for (path, inode) in files(folder)? {
            durable.contents.insert(inode, fs::read(&path)?);
            durable.names.insert(path, inode);
        }
        Ok(durable)
    }

    /// What is open there, a file or a folder, is synced.
    pub(super) fn sync(&mut self, open: &Path, path: &Path) -> io::Result<()> {
        let meta = fs::metadata(open)?;
        if meta.is_dir() {
            self.names.retain(|name, _| name.parent() != Some(path));
            let there = files(path)?;
            self.names.extend(there.into_iter().filter(|(name, _)| name.parent() == Some(path)));
        } else {
            self.contents.insert(meta.ino(), fs::read(open)?);
        }
        Ok(())
    }

    /// Brings a folder to what it is after the power failed: files hold what was synced of them. Those whose names were not
    /// are gone, if it is to be so `strictly`; most file systems keep them.
    pub(super) fn restore(&self, folder: &Path, strictly: bool) -> io::Result<()> {
        let there = files(folder)?;
        let names = if strictly { self.names.clone() } else { there.clone() };
        there.keys().try_for_each(fs::remove_file)?;
        let empty = Vec::new();
        names.iter().try_for_each(|(path, inode)| fs::write(path, self.contents.get(inode).unwrap_or(&empty)))
    }
}

/// Every file below a folder.
fn files(folder: &Path) -> io::Result<BTreeMap<PathBuf, Inode>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // Gone since.
        let Ok(meta) = fs::symlink_metadata(&path) else { continue };
        if meta.is_dir() {
            found.extend(files(&path)?);
        } else {
            found.insert(path, meta.ino());
        }
    }
    Ok(found)
}
