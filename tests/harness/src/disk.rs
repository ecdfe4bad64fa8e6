//! Disks without room.

use std::io::Write;
use std::path::Path;

use nix::sys::statvfs::statvfs;

/// What tmpfs gives room by.
pub const PAGE: u64 = 4096;
/// The file that takes the room.
pub const BALLAST: &str = "ballast";

/// Fills the small tmpfs that `folder` lies on until so many bytes are free; see [`crate::namespace`].
///
/// # Panics
/// It can't be filled so.
#[allow(clippy::expect_used)] // a test that can't be set up has failed
pub fn fill(folder: &Path, free_bytes: u64) {
    let ballast = folder.join(BALLAST);
    let _ = std::fs::remove_file(&ballast);
    let free = || statvfs(folder).map(|stat| stat.blocks_available() * stat.fragment_size()).expect("a file system");
    let mut file = std::fs::File::create(&ballast).expect("the ballast can be made");
    let full = free().saturating_sub(free_bytes) / PAGE * PAGE;
    file.write_all(&vec![7; full as usize]).expect("there is room for the ballast");
    drop(file);
    assert_eq!(free(), free_bytes / PAGE * PAGE);
}

/// Fills it to the last byte while others write to it, too.
///
/// # Panics
/// It has no end.
#[allow(clippy::expect_used)] // a test that can't be set up has failed
pub fn fill_up(folder: &Path) {
    let mut file = std::fs::File::create(folder.join(BALLAST)).expect("the ballast can be made");
    let full = (0..1 << 20).find_map(|_| file.write_all(&[7; PAGE as usize]).err());
    assert_eq!(full.expect("a small disk").kind(), std::io::ErrorKind::StorageFull);
}

/// Gives the room back.
pub fn empty(folder: &Path) {
    let _ = std::fs::remove_file(folder.join(BALLAST));
}
