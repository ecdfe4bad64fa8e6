//! Why a domain can't be used.

use std::path::{Path, PathBuf};

use super::SHM;
use super::others::User;

/// Why a domain can't be used.
#[derive(Debug, thiserror::Error)]
pub enum DomainError {
    /// Not a name.
    #[error("domain {0:?}: expected 1 to 20 of a-z, 0-9 and '-'")]
    BadName(String),
    /// A launcher runs in it.
    #[error("domain {name:?} is in use{by}; stop that echogrid or choose another name with --domain", by = .pid.map(|p| format!(" by process {p}")).unwrap_or_default())]
    InUse {
        /// The domain.
        name: String,
        /// The number of the launcher's process, if known.
        pid: Option<u32>,
    },
    /// Processes of a dead launcher will not leave.
    #[error(
        "domain {name:?}: processes of an earlier run are still alive; end them (fuser -k {held}) or choose another --domain",
        held = .held.display()
    )]
    Haunted {
        /// The domain.
        name: String,
        /// What they hold: nobody else does.
        held: PathBuf,
    },
    /// Nobody runs in it.
    #[error("domain {name:?}: no echogrid runs there (running: {running})")]
    NotRunning {
        /// The domain.
        name: String,
        /// Those that do run, for people.
        running: String,
    },
    /// It is another user's; what shared memory holds is private to its user.
    #[error(
        "domain {name:?} belongs to {user}: only that user can talk to it (run `{run_as} echogrid …`)",
        run_as = .user.run_as()
    )]
    OtherUser {
        /// The domain.
        name: String,
        /// Whose.
        user: User,
    },
    /// The directory belongs to somebody else.
    #[error("{path}: belongs to {owner}, not to {me}; {owner} or root must remove it", path = .path.display())]
    Foreign {
        /// The directory.
        path: PathBuf,
        /// The owner of the directory.
        owner: User,
        /// Us.
        me: User,
    },
    /// Not enough shared memory.
    #[error(
        "{SHM} has {free_mib} MiB free, this graph can need {needed_mib} MiB: free some, or enlarge it (mount -o remount,size={enough_mib}m {SHM}; for a container --shm-size={enough_mib}m)"
    )]
    ShmTooSmall {
        /// Free, MiB.
        free_mib: u64,
        /// Needed, MiB.
        needed_mib: u64,
        /// The size with which it would be enough, MiB.
        enough_mib: u64,
    },
    /// Not enough files in shared memory.
    #[error(
        "{SHM} has room for {free} more files, this graph can need {needed}: remove some, or allow more (mount -o remount,nr_inodes=64k {SHM})"
    )]
    ShmTooFewFiles {
        /// The number of files that can still be made.
        free: u64,
        /// The number of files that the graph can need.
        needed: u64,
    },
    /// The system refused.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// What was touched.
        path: PathBuf,
        /// What it said.
        source: std::io::Error,
    },
}

pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> DomainError {
    let path = path.to_owned();
    move |source| DomainError::Io { path, source }
}
