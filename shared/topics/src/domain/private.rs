//! What a graph makes is for its user alone, whatever the umask.

use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use super::error::io;
use super::others::{User, whose};
use super::{DomainError, SHM};

/// Permissions of group and others.
const OF_OTHERS: u32 = 0o077;

/// Makes the directory of a user's domains, or mends it: what is in it is protected by it.
pub(super) fn make_base(base: &Path, uid: u32) -> Result<(), DomainError> {
    loop {
        match DirBuilder::new().mode(0o700).create(base) {
            Ok(()) => return set_mode(base, 0o700),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(io(base)(error)),
        }
        match fs::symlink_metadata(base) {
            Ok(meta) if meta.uid() != uid => {
                return Err(DomainError::Foreign { path: base.into(), owner: User::of(meta.uid()), me: User::of(uid) });
            }
            Ok(meta) if !meta.is_dir() => return Err(io(base)(ErrorKind::NotADirectory.into())),
            Ok(meta) if meta.mode() & 0o777 == 0o700 => return Ok(()),
            Ok(_) => return set_mode(base, 0o700),
            // It went with the last domain just now.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(io(base)(error)),
        }
    }
}

/// Makes a directory below that of the user.
pub(super) fn make_dir(path: &Path) -> Result<(), DomainError> {
    match DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(io(path)(error)),
        _ => set_mode(path, 0o700),
    }
}

/// Makes a directory where there must be nothing yet, whoever may write there: no link is followed, and nobody else's is used.
pub(super) fn make_new(path: &Path, uid: u32) -> Result<(), DomainError> {
    match DirBuilder::new().mode(0o700).create(path) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => match fs::symlink_metadata(path) {
            Ok(meta) if meta.uid() != uid => {
                Err(DomainError::Foreign { path: path.into(), owner: User::of(meta.uid()), me: User::of(uid) })
            }
            _ => Err(io(path)(error)),
        },
        Err(error) => Err(io(path)(error)),
    }
}

/// Opens a lock file, made if it is not there.
pub(super) fn open_lock(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().create(true).truncate(false).read(true).write(true).mode(0o600).open(path)
}

/// Writes a file that only this user can read.
///
/// # Errors
/// The system refuses.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), DomainError> {
    let mut file =
        OpenOptions::new().create(true).truncate(true).write(true).mode(0o600).open(path).map_err(io(path))?;
    // One that was there keeps the mode it had.
    file.set_permissions(Permissions::from_mode(0o600)).map_err(io(path))?;
    file.write_all(bytes).map_err(io(path))
}

fn set_mode(path: &Path, mode: u32) -> Result<(), DomainError> {
    match fs::set_permissions(path, Permissions::from_mode(mode)) {
        // It went with the last domain just now.
        Err(error) if error.kind() != ErrorKind::NotFound => Err(io(path)(error)),
        _ => Ok(()),
    }
}

/// Takes away what group and others may do with the shared memory that begins with `prefix`: iceoryx2 lets everybody write to its
/// counter of nodes.
pub(super) fn close(prefix: &str) -> Result<(), DomainError> {
    for entry in fs::read_dir(SHM).map_err(io(SHM.as_ref()))?.flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix)
            && entry.metadata().is_ok_and(|meta| meta.is_file() && meta.mode() & OF_OTHERS != 0)
        {
            set_mode(&entry.path(), 0o600)?;
        }
    }
    Ok(())
}

/// Something named like ours that others can get at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exposed {
    /// The path of the file or directory.
    pub path: PathBuf,
    /// The number of the user who owns it.
    pub owner: u32,
    /// The permission bits of the file or directory.
    pub mode: u32,
}

/// The user's directory and shared memory, as far as they belong to or are open to others.
#[must_use]
pub fn exposed(uid: u32) -> Vec<Exposed> {
    let base = format!("echogrid-{uid}");
    let ours = |name: &str| name == base || whose(name).is_some_and(|(owner, _)| owner == uid);
    let entries = fs::read_dir(SHM).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_str().is_some_and(ours));
    ours.filter_map(|entry| {
        let meta = entry.metadata().ok()?;
        let (path, owner, mode) = (entry.path(), meta.uid(), meta.mode() & 0o777);
        (owner != uid || mode & OF_OTHERS != 0).then_some(Exposed { path, owner, mode })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().mode() & 0o777
    }

    #[test]
    fn a_new_directory_follows_no_link_and_takes_nobodys_place() {
        let folder = std::env::temp_dir().join(format!("echogrid-new-{}", std::process::id()));
        let uid = nix::unistd::Uid::current().as_raw();
        DirBuilder::new().create(&folder).unwrap();
        let (elsewhere, link) = (folder.join("elsewhere"), folder.join("link"));
        DirBuilder::new().create(&elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, &link).unwrap();
        assert!(make_new(&link, uid).is_err());
        assert!(matches!(make_new(&link, uid + 1), Err(DomainError::Foreign { .. })));
        let new = folder.join("new");
        make_new(&new, uid).unwrap();
        assert_eq!(mode(&new), 0o700);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_is_there_already_is_mended() {
        let base = std::env::temp_dir().join(format!("echogrid-private-{}", std::process::id()));
        let uid = nix::unistd::Uid::current().as_raw();
        DirBuilder::new().create(&base).unwrap();
        fs::set_permissions(&base, Permissions::from_mode(0o755)).unwrap();
        make_base(&base, uid).unwrap();
        assert_eq!(mode(&base), 0o700);
        let file = base.join("plan.toml");
        fs::write(&file, "old and long").unwrap();
        fs::set_permissions(&file, Permissions::from_mode(0o666)).unwrap();
        write(&file, b"new").unwrap();
        assert_eq!((mode(&file), fs::read(&file).unwrap()), (0o600, b"new".to_vec()));
        let foreign = make_base(&base, uid + 1).unwrap_err();
        assert!(matches!(foreign, DomainError::Foreign { .. }), "{foreign}");
        fs::remove_dir_all(&base).unwrap();
        // Not a place for a directory.
        fs::write(&base, "").unwrap();
        assert!(make_base(&base, uid).is_err());
        fs::remove_file(&base).unwrap();
    }
}
