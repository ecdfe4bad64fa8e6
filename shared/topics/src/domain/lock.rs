//! Lock files: who holds one lives.

use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::unistd::Uid;

use super::error::io;
use super::private::{make_base, open_lock};
use super::{DomainError, SHM};

/// What a look at a lock file shows.
pub(super) enum Glance {
    /// Nobody holds it.
    Free,
    /// Somebody holds it.
    Held,
    /// There is none.
    Absent,
}

/// Looks at a lock without making its file.
pub(super) fn glance(path: &Path) -> Result<Glance, DomainError> {
    loop {
        let file = match OpenOptions::new().read(true).write(true).open(path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Glance::Absent),
            Err(error) => return Err(io(path)(error)),
        };
        match lock_file(file, path, FlockArg::LockExclusiveNonblock)? {
            Locked::Yes(_) => return Ok(Glance::Free),
            Locked::Busy => return Ok(Glance::Held),
            Locked::Removed => {}
        }
    }
}

/// Opens and locks a file, made if it is not there; none if somebody else holds it.
pub(super) fn lock(path: &Path, how: FlockArg) -> Result<Option<Flock<File>>, DomainError> {
    loop {
        let file = match open_lock(path) {
            Ok(file) => file,
            // The base directory went with the last domain just now.
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let base = path.parent().unwrap_or(Path::new(SHM));
                make_base(base, Uid::current().as_raw())?;
                continue;
            }
            Err(error) => return Err(io(path)(error)),
        };
        match lock_file(file, path, how)? {
            Locked::Yes(lock) => return Ok(Some(lock)),
            Locked::Busy => return Ok(None),
            Locked::Removed => {}
        }
    }
}

enum Locked {
    Yes(Flock<File>),
    Busy,
    /// The file was removed while we opened it: a lock on it protects nothing.
    Removed,
}

fn lock_file(file: File, path: &Path, how: FlockArg) -> Result<Locked, DomainError> {
    let locked = match Flock::lock(file, how) {
        Ok(locked) => locked,
        Err((_, Errno::EWOULDBLOCK)) => return Ok(Locked::Busy),
        Err((_, errno)) => return Err(io(path)(errno.into())),
    };
    let same = |meta: &fs::Metadata| locked.metadata().is_ok_and(|held| held.ino() == meta.ino());
    if fs::metadata(path).is_ok_and(|meta| same(&meta)) { Ok(Locked::Yes(locked)) } else { Ok(Locked::Removed) }
}
