//! Domains: several echogrids on one machine, none of which sees another.
//!
//! A domain is a name. Its files are a directory on tmpfs (never on a disk, where creating ports
//! waits for fsync), a prefix in `/dev/shm`, and two lock files: one says that a launcher owns the
//! domain, the other that some process still lives in it. A domain that nobody holds is dead, and
//! whoever starts next sweeps what it left.

use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::unistd::Uid;

/// Where POSIX shared memory lives on Linux.
const SHM: &str = "/dev/shm";
/// Socket paths are limited to 108 bytes, and iceoryx2 needs most of them.
const LONGEST_NAME: usize = 20;
/// How long processes of a launcher that died may take to leave before a new one gives up.
const ORPHANS_LEAVE_WITHIN: Duration = Duration::from_secs(5);

/// How long others may hold a domain's lock only to look at it.
const GLANCES_END_WITHIN: Duration = Duration::from_secs(1);

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
        /// Its launcher, if known.
        pid: Option<u32>,
    },
    /// Processes of a dead launcher will not leave.
    #[error(
        "domain {0:?}: processes of an earlier run are still alive; end them (pkill -9 echogrid) or choose another --domain"
    )]
    Haunted(String),
    /// Nobody runs in it.
    #[error("domain {0:?}: no echogrid runs there (running: {1})")]
    NotRunning(String, String),
    /// The directory belongs to somebody else.
    #[error("{path}: belongs to user {owner}, not to {me}", path = .path.display())]
    Foreign {
        /// The directory.
        path: PathBuf,
        /// Its owner.
        owner: u32,
        /// Us.
        me: u32,
    },
    /// Not enough shared memory.
    #[error(
        "{SHM} has {free_mib} MiB free, this graph can need {needed_mib} MiB: free some, or enlarge it (mount -o remount,size=256m {SHM}; for a container --shm-size=256m)"
    )]
    ShmTooSmall {
        /// Free, MiB.
        free_mib: u64,
        /// Needed, MiB.
        needed_mib: u64,
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

fn io(path: &Path) -> impl FnOnce(std::io::Error) -> DomainError {
    let path = path.to_owned();
    move |source| DomainError::Io { path, source }
}

/// A domain by its name; nothing is touched before it is claimed or joined.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    name: String,
    base: PathBuf,
    uid: u32,
}

impl Domain {
    /// The domain of this name.
    ///
    /// # Errors
    /// [`DomainError::BadName`].
    pub fn named(name: &str) -> Result<Self, DomainError> {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(good) {
            return Err(DomainError::BadName(name.into()));
        }
        let uid = Uid::current().as_raw();
        Ok(Self { name: name.into(), base: PathBuf::from(format!("{SHM}/echogrid-{uid}")), uid })
    }

    /// A domain in which no launcher runs, named after this process. (Containers may share shared
    /// memory and not process numbers.)
    #[must_use]
    pub fn unique() -> Self {
        let uid = Uid::current().as_raw();
        let base = PathBuf::from(format!("{SHM}/echogrid-{uid}"));
        let pid = std::process::id();
        let mut domain = Self { name: format!("run-{pid}"), base, uid };
        let mut more = 1;
        while is_owned(&domain) {
            more += 1;
            domain.name = format!("run-{pid}-{more}");
        }
        domain
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its directory, on tmpfs.
    #[must_use]
    pub fn dir(&self) -> PathBuf {
        self.base.join(&self.name)
    }

    /// What the names of its shared memory begin with. Names of domains hold no '_', so none is
    /// the beginning of another.
    #[must_use]
    pub fn prefix(&self) -> String {
        format!("eg{}_{}_", self.uid, self.name)
    }

    /// The file that tells iceoryx2 about the domain.
    #[must_use]
    pub fn iceoryx2_config(&self) -> PathBuf {
        // Where the iox2 command line looks when run from the domain's directory.
        self.dir().join("config/iceoryx2.toml")
    }

    fn owner_lock(&self) -> PathBuf {
        self.base.join(format!("{}.owner", self.name))
    }

    fn member_lock(&self) -> PathBuf {
        self.base.join(format!("{}.members", self.name))
    }

    /// Takes the domain for a launcher: waits for orphans of a dead one, sweeps what is left, and
    /// makes its directory. Also sweeps other domains whose launcher is dead.
    ///
    /// # Errors
    /// It is in use, or the system refuses.
    pub fn claim(self) -> Result<Claim, DomainError> {
        make_base(&self.base, self.uid)?;
        sweep_dead(&self);
        let owner = self.lock_as_owner()?;
        fs::write(self.owner_lock(), std::process::id().to_string()).map_err(io(&self.owner_lock()))?;
        let deadline = Instant::now() + ORPHANS_LEAVE_WITHIN;
        while lock(&self.member_lock(), FlockArg::LockExclusiveNonblock)?.is_none() {
            if Instant::now() > deadline {
                return Err(DomainError::Haunted(self.name));
            }
            // The kernel has no timed flock; orphans leave within 2 s.
            std::thread::sleep(Duration::from_millis(10));
        }
        self.wipe();
        let config = self.iceoryx2_config();
        let (dir, config_dir) = (self.dir(), self.dir().join("config"));
        for path in [&dir, &config_dir] {
            fs::create_dir_all(path).map_err(io(path))?;
        }
        let text = format!(
            "[global]\nroot-path = \"{}/\"\nprefix = \"{}\"\n\n\
             [global.creation-timeout]\nsecs = 0\nnanos = 500000000\n\n\
             # Only the launcher cleans up after the dead.\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n",
            dir.display(),
            self.prefix()
        );
        fs::write(&config, text).map_err(io(&config))?;
        Ok(Claim { domain: self, _owner: owner })
    }

    fn lock_as_owner(&self) -> Result<Flock<File>, DomainError> {
        let deadline = Instant::now() + GLANCES_END_WITHIN;
        loop {
            if let Some(owner) = lock(&self.owner_lock(), FlockArg::LockExclusiveNonblock)? {
                return Ok(owner);
            }
            let pid: Option<u32> = fs::read_to_string(self.owner_lock()).ok().and_then(|text| text.trim().parse().ok());
            let runs = pid.is_some_and(|pid| Path::new(&format!("/proc/{pid}")).exists());
            if runs || Instant::now() > deadline {
                return Err(DomainError::InUse { name: self.name.clone(), pid });
            }
            // Somebody looks whether the domain is dead, which takes the lock for a moment; the kernel
            // has no timed flock.
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Says that a process lives in the domain, for as long as the value is kept.
    ///
    /// # Errors
    /// The system refuses.
    pub fn join(&self) -> Result<Membership, DomainError> {
        if !self.iceoryx2_config().exists() {
            return Err(DomainError::NotRunning(self.name.clone(), running().join(", ")));
        }
        match lock(&self.member_lock(), FlockArg::LockSharedNonblock)? {
            Some(lock) => Ok(Membership { _lock: lock }),
            // Someone is about to sweep it.
            None => Err(DomainError::NotRunning(self.name.clone(), running().join(", "))),
        }
    }

    /// Removes everything the domain left. Call only while holding its locks.
    fn wipe(&self) {
        let prefix = self.prefix();
        for entry in fs::read_dir(SHM).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                // Gone already is as good.
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_dir_all(self.dir());
    }
}

/// A domain owned by a launcher. Dropping it removes every file of the domain: drop it after all
/// ports and processes are gone.
#[derive(Debug)]
pub struct Claim {
    domain: Domain,
    _owner: Flock<File>,
}

impl Claim {
    /// The domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.domain.wipe();
        // Removed while still locked: whoever opened them meanwhile sees that and opens anew.
        let _ = fs::remove_file(self.domain.member_lock());
        let _ = fs::remove_file(self.domain.owner_lock());
        // Succeeds only when this was the last domain.
        let _ = fs::remove_dir(&self.domain.base);
    }
}

/// Held by every process that lives in a domain.
#[derive(Debug)]
pub struct Membership {
    _lock: Flock<File>,
}

/// Checks that `needed_bytes` of shared memory are free: a full /dev/shm kills with SIGBUS, later.
///
/// # Errors
/// [`DomainError::ShmTooSmall`].
pub fn check_memory(needed_bytes: u64) -> Result<(), DomainError> {
    let stat =
        nix::sys::statvfs::statvfs(SHM).map_err(|errno| DomainError::Io { path: SHM.into(), source: errno.into() })?;
    #[allow(clippy::useless_conversion)] // the types differ between platforms
    let free = u64::from(stat.blocks_available()) * u64::from(stat.fragment_size());
    if free < needed_bytes {
        return Err(DomainError::ShmTooSmall { free_mib: free >> 20, needed_mib: needed_bytes.div_ceil(1 << 20) });
    }
    Ok(())
}

/// Names of the domains of this user in which a launcher runs.
#[must_use]
pub fn running() -> Vec<String> {
    let mut names: Vec<String> = known().into_iter().filter(is_owned).map(|d| d.name).collect();
    names.sort();
    names
}

fn known() -> Vec<Domain> {
    let base = PathBuf::from(format!("{SHM}/echogrid-{}", Uid::current().as_raw()));
    fs::read_dir(base)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Domain::named(entry.file_name().to_str()?.strip_suffix(".owner")?).ok())
        .collect()
}

fn is_owned(domain: &Domain) -> bool {
    matches!(glance(&domain.owner_lock()), Ok(Glance::Held))
}

/// Wipes every other domain of this user that no process holds any more.
fn sweep_dead(except: &Domain) {
    for domain in known().into_iter().filter(|domain| domain != except) {
        let Ok(Glance::Free(_owner)) = glance(&domain.owner_lock()) else { continue };
        let _members = match glance(&domain.member_lock()) {
            Ok(Glance::Free(members)) => Some(members),
            Ok(Glance::Absent) => None,
            Ok(Glance::Held) | Err(_) => continue,
        };
        tracing::debug!(domain = domain.name(), "sweeping what a dead launcher left");
        domain.wipe();
        let _ = fs::remove_file(domain.member_lock());
        let _ = fs::remove_file(domain.owner_lock());
    }
}

fn make_base(base: &Path, uid: u32) -> Result<(), DomainError> {
    loop {
        match fs::DirBuilder::new().mode(0o700).create(base) {
            Ok(()) => return Ok(()),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(io(base)(error)),
        }
        match fs::symlink_metadata(base) {
            Ok(meta) if meta.uid() == uid => return Ok(()),
            Ok(meta) => return Err(DomainError::Foreign { path: base.into(), owner: meta.uid(), me: uid }),
            // It went with the last domain just now.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(io(base)(error)),
        }
    }
}

/// What a look at a lock file shows.
enum Glance {
    /// Nobody holds it; we do now.
    Free(Flock<File>),
    /// Somebody holds it.
    Held,
    /// There is none.
    Absent,
}

/// Looks at a lock without making its file.
fn glance(path: &Path) -> Result<Glance, DomainError> {
    loop {
        let file = match OpenOptions::new().read(true).write(true).open(path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Glance::Absent),
            Err(error) => return Err(io(path)(error)),
        };
        match lock_file(file, path, FlockArg::LockExclusiveNonblock)? {
            Locked::Yes(lock) => return Ok(Glance::Free(lock)),
            Locked::Busy => return Ok(Glance::Held),
            Locked::Removed => {}
        }
    }
}

/// Opens and locks a file, made if it is not there; none if somebody else holds it.
fn lock(path: &Path, how: FlockArg) -> Result<Option<Flock<File>>, DomainError> {
    loop {
        let file = match OpenOptions::new().create(true).truncate(false).read(true).write(true).open(path) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        assert!(Domain::named("robot-1").is_ok());
        for bad in ["", "Robot", "a_b", "a/b", "..", "a-name-that-is-too-long"] {
            assert!(matches!(Domain::named(bad), Err(DomainError::BadName(_))), "{bad:?}");
        }
    }

    #[test]
    fn no_prefix_begins_another() {
        let (short, long) = (Domain::named("a").unwrap(), Domain::named("a-b").unwrap());
        assert!(!long.prefix().starts_with(&short.prefix()));
    }

    #[test]
    fn a_domain_has_one_owner_and_leaves_nothing() {
        let domain = Domain::named(&format!("t-{}", std::process::id())).unwrap();
        let claim = domain.clone().claim().unwrap();
        assert!(
            matches!(domain.clone().claim(), Err(DomainError::InUse { pid: Some(pid), .. }) if pid == std::process::id())
        );
        assert!(running().contains(&domain.name));
        let member = domain.join().unwrap();
        drop(member);
        drop(claim);
        assert!(!domain.dir().exists());
        assert!(!domain.owner_lock().exists() && !domain.member_lock().exists());
        assert!(matches!(domain.join(), Err(DomainError::NotRunning(..))));
    }

    #[test]
    fn a_glance_at_a_domain_does_not_keep_its_launcher_out() {
        let domain = Domain::named(&format!("g-{}", std::process::id())).unwrap();
        make_base(&domain.base, domain.uid).unwrap();
        let glance = lock(&domain.owner_lock(), FlockArg::LockExclusiveNonblock).unwrap().unwrap();
        let claimant = std::thread::spawn({
            let domain = domain.clone();
            move || domain.claim().map(drop)
        });
        // Whichever comes first, the launcher gets in.
        drop(glance);
        claimant.join().unwrap().unwrap();
    }

    #[test]
    fn a_dead_domain_is_swept() {
        let domain = Domain::named(&format!("d-{}", std::process::id())).unwrap();
        // What a SIGKILLed launcher leaves: files, and locks that nobody holds.
        let stray = PathBuf::from(format!("{SHM}/{}stray", domain.prefix()));
        fs::create_dir_all(domain.dir()).unwrap();
        fs::write(domain.owner_lock(), "1").unwrap();
        fs::write(&stray, "x").unwrap();
        let other = Domain::named(&format!("e-{}", std::process::id())).unwrap();
        let claim = other.claim().unwrap();
        // If another start is at it already, it is not swept twice.
        let deadline = Instant::now() + Duration::from_secs(10);
        while stray.exists() || domain.dir().exists() {
            assert!(Instant::now() < deadline, "not swept");
            std::thread::yield_now();
        }
        drop(claim);
    }

    #[test]
    fn a_unique_domain_is_another_while_it_is_in_use() {
        let first = Domain::unique();
        let claim = first.clone().claim().unwrap();
        assert_ne!(Domain::unique(), first);
        drop(claim);
        assert_eq!(Domain::unique(), first);
    }

    #[test]
    fn too_little_shared_memory_is_said() {
        let error = check_memory(u64::MAX / 2).unwrap_err().to_string();
        assert!(error.contains("MiB free") && error.contains("--shm-size"), "{error}");
        check_memory(1).unwrap();
    }
}
