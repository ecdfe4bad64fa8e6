//! The shared memory of the machine.

use std::fs;
use std::os::unix::fs::MetadataExt;

use nix::sys::statfs::{TMPFS_MAGIC, statfs};
use nix::sys::statvfs::{FsFlags, statvfs};
use nix::unistd::{AccessFlags, access};

use super::error::io;
use super::others::whose;
use super::{DomainError, SHM};

/// What /dev/shm is, and how full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SharedMemory {
    /// The size of the file system, bytes.
    pub total_bytes: u64,
    /// What nobody uses yet.
    pub free_bytes: u64,
    /// The part of the free bytes that graphs (of any user) have reserved and not used so far.
    pub promised_bytes: u64,
    /// Files that can still be made; none where there is no limit.
    pub free_inodes: Option<u64>,
    /// Whether it lies in memory.
    pub is_tmpfs: bool,
    /// Whether files can be made there.
    pub is_writable: bool,
}

impl SharedMemory {
    /// Looks at the shared memory as it is now.
    ///
    /// # Errors
    /// There is none.
    pub fn look() -> Result<Self, DomainError> {
        let failed = |errno: nix::errno::Errno| io(SHM.as_ref())(errno.into());
        let stat = statvfs(SHM).map_err(failed)?;
        #[allow(clippy::useless_conversion)] // the types differ between platforms
        let (unit, blocks, free, inodes, free_inodes) = (
            u64::from(stat.fragment_size()),
            u64::from(stat.blocks()),
            u64::from(stat.blocks_available()),
            u64::from(stat.files()),
            u64::from(stat.files_available()),
        );
        let may_write = access(SHM, AccessFlags::W_OK | AccessFlags::X_OK).is_ok();
        Ok(Self {
            total_bytes: blocks * unit,
            free_bytes: free * unit,
            promised_bytes: promised_bytes(),
            free_inodes: (inodes > 0).then_some(free_inodes),
            is_tmpfs: statfs(SHM).map_err(failed)?.filesystem_type() == TMPFS_MAGIC,
            is_writable: may_write && !stat.flags().contains(FsFlags::ST_RDONLY),
        })
    }

    /// The size of /dev/shm that leaves `needed_bytes` free beside what is there.
    #[must_use]
    pub fn enough_mib(&self, needed_bytes: u64) -> u64 {
        let used = self.total_bytes.saturating_sub(self.free_bytes);
        used.saturating_add(needed_bytes).div_ceil(1 << 20)
    }
}

/// Objects are sparse: they take room only once they are written to.
fn promised_bytes() -> u64 {
    let ours = |entry: &fs::DirEntry| entry.file_name().to_str().and_then(whose).is_some();
    let objects = fs::read_dir(SHM).into_iter().flatten().flatten().filter(ours);
    objects.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len().saturating_sub(512 * meta.blocks())).sum()
}

/// Files that a graph of so many services can come to make in shared memory: measured 390 for five, tools included.
#[must_use]
pub fn files_needed(services: u64) -> u64 {
    384 + 128 * services
}

/// Checks that `needed_bytes` of shared memory are free, as a full /dev/shm kills with SIGBUS, later; and `needed_files`.
///
/// # Errors
/// [`DomainError::ShmTooSmall`], [`DomainError::ShmTooFewFiles`].
pub fn check_memory(needed_bytes: u64, needed_files: u64) -> Result<(), DomainError> {
    let memory = SharedMemory::look()?;
    if memory.free_bytes < needed_bytes {
        return Err(DomainError::ShmTooSmall {
            free_mib: memory.free_bytes >> 20,
            needed_mib: needed_bytes.div_ceil(1 << 20),
            enough_mib: memory.enough_mib(needed_bytes),
        });
    }
    match memory.free_inodes {
        Some(free) if free < needed_files => Err(DomainError::ShmTooFewFiles { free, needed: needed_files }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_shared_memory_is_said() {
        let error = check_memory(u64::MAX / 2, 1).unwrap_err().to_string();
        assert!(error.contains("MiB free") && error.contains("--shm-size"), "{error}");
        check_memory(1, 1).unwrap();
        // Where the number of files is not limited, so many are none too many.
        if let Err(error) = check_memory(1, u64::MAX) {
            assert!(error.to_string().contains("nr_inodes="), "{error}");
        }
    }

    #[test]
    fn the_size_that_is_named_is_enough() {
        let memory = SharedMemory {
            total_bytes: 64 << 20,
            free_bytes: 60 << 20,
            promised_bytes: 0,
            free_inodes: None,
            is_tmpfs: true,
            is_writable: true,
        };
        assert_eq!(memory.enough_mib(100 << 20), 104);
        assert_eq!(memory.enough_mib((100 << 20) + 1), 105);
    }
}
