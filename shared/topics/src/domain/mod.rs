//! Domains: several echogrids on one machine, none of which sees another.
//!
//! A domain is a name. Its files are a directory on tmpfs (never on a disk, where creating ports
//! waits for fsync), a prefix in `/dev/shm`, and two lock files: one says that a launcher owns the
//! domain, the other that some process still lives in it. A domain that nobody holds is dead, and
//! whoever starts next sweeps what it left.

mod error;
mod lock;
mod memory;
mod others;
mod private;
mod survey;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::fcntl::{Flock, FlockArg};
use nix::unistd::Uid;

pub use error::DomainError;
pub use memory::{SharedMemory, check_memory, files_needed};
pub use others::{User, others};
pub use private::{Exposed, exposed, write as write_private};
pub use survey::{Leftover, Running, clean, graphs, leftovers, running};

use lock::lock;
use private::{make_base, make_dir, make_new};
use survey::{is_owned, sweep_dead};

/// Where POSIX shared memory lives on Linux.
pub const SHM: &str = "/dev/shm";
/// Socket paths are limited to 108 bytes, and iceoryx2 needs most of them.
const LONGEST_NAME: usize = 20;
/// How long processes of a launcher that died may take to leave before a new one gives up.
const ORPHANS_LEAVE_WITHIN: Duration = Duration::from_secs(5);
/// Shared memory that must be free beyond what the topics need, for states to be stored there: several large maps.
const MAPS_BYTES: u64 = 256 << 20;
/// How long others may hold a domain's lock only to look at it.
const GLANCES_END_WITHIN: Duration = Duration::from_secs(1);

/// The directory of a user's domains. Its mode keeps everybody else out.
#[must_use]
pub fn base_of(uid: u32) -> PathBuf {
    PathBuf::from(format!("{SHM}/echogrid-{uid}"))
}

/// Shared memory that must be free for states of at most `kept_bytes` besides maps to be stored there; else they are in the folder for
/// temporary files.
#[must_use]
pub fn states_bytes(kept_bytes: u64) -> u64 {
    MAPS_BYTES.saturating_add(kept_bytes)
}

/// A domain by its name; nothing is touched before it is claimed or joined.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    name: String,
    base: PathBuf,
    uid: u32,
}

impl Domain {
    /// Whether a launcher has it now.
    pub(crate) fn has_launcher(&self) -> bool {
        survey::is_owned(self)
    }

    /// The domain of this name.
    ///
    /// # Errors
    /// [`DomainError::BadName`].
    pub fn named(name: &str) -> Result<Self, DomainError> {
        if !Self::is_name(name) {
            return Err(DomainError::BadName(name.into()));
        }
        let uid = Uid::current().as_raw();
        Ok(Self { name: name.into(), base: base_of(uid), uid })
    }

    /// Whether a domain can be called this.
    fn is_name(name: &str) -> bool {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        (1..=LONGEST_NAME).contains(&name.len()) && name.chars().all(good)
    }

    /// A domain in which no launcher runs, named after this process. (Containers may share shared
    /// memory and not process numbers.)
    #[must_use]
    pub fn unique() -> Self {
        let uid = Uid::current().as_raw();
        let pid = std::process::id();
        let mut domain = Self { name: format!("run-{pid}"), base: base_of(uid), uid };
        let mut more = 1;
        while is_owned(&domain) {
            more += 1;
            domain.name = format!("run-{pid}-{more}");
        }
        domain
    }

    /// The name of the domain.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The directory of the domain, on tmpfs.
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
        sweep_dead(Some(&self));
        let owner = self.lock_as_owner()?;
        write_private(&self.owner_lock(), std::process::id().to_string().as_bytes())?;
        let deadline = Instant::now() + ORPHANS_LEAVE_WITHIN;
        while lock(&self.member_lock(), FlockArg::LockExclusiveNonblock)?.is_none() {
            if Instant::now() > deadline {
                return Err(DomainError::Haunted { held: self.member_lock(), name: self.name });
            }
            // The kernel has no timed flock; orphans leave within 2 s.
            std::thread::sleep(Duration::from_millis(10));
        }
        self.wipe();
        self.furnish()?;
        Ok(Claim { domain: self, _owner: owner })
    }

    /// Makes its directory, and the file that tells iceoryx2 about it.
    fn furnish(&self) -> Result<(), DomainError> {
        let config = self.iceoryx2_config();
        let (dir, config_dir) = (self.dir(), self.dir().join("config"));
        for path in [&dir, &config_dir] {
            make_dir(path)?;
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
        write_private(&config, text.as_bytes())
    }

    fn lock_as_owner(&self) -> Result<Flock<File>, DomainError> {
        let deadline = Instant::now() + GLANCES_END_WITHIN;
        loop {
            if let Some(owner) = lock(&self.owner_lock(), FlockArg::LockExclusiveNonblock)? {
                return Ok(owner);
            }
            let pid = self.launcher();
            let runs = pid.is_some_and(|pid| Path::new(&format!("/proc/{pid}")).exists());
            if runs || Instant::now() > deadline {
                return Err(DomainError::InUse { name: self.name.clone(), pid });
            }
            // Somebody looks whether the domain is dead, which takes the lock for a moment; the kernel
            // has no timed flock.
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The launcher that claimed it last.
    fn launcher(&self) -> Option<u32> {
        fs::read_to_string(self.owner_lock()).ok()?.trim().parse().ok()
    }

    /// Says that a process lives in the domain, for as long as the value is kept.
    ///
    /// # Errors
    /// The system refuses.
    pub fn join(&self) -> Result<Membership, DomainError> {
        if !self.iceoryx2_config().exists() {
            return Err(self.not_running());
        }
        match lock(&self.member_lock(), FlockArg::LockSharedNonblock)? {
            Some(lock) => Ok(Membership { _lock: lock }),
            // Someone is about to sweep it.
            None => Err(self.not_running()),
        }
    }

    /// Why it can't be joined.
    fn not_running(&self) -> DomainError {
        if let Some(user) = others::owner_of(&self.name) {
            return DomainError::OtherUser { name: self.name.clone(), user };
        }
        let running = running().join(", ");
        DomainError::NotRunning {
            name: self.name.clone(),
            running: if running.is_empty() { "none".into() } else { running },
        }
    }

    /// Its objects in shared memory.
    fn objects(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let entries = fs::read_dir(SHM).into_iter().flatten().flatten();
        let own = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        own.map(|entry| entry.path()).collect()
    }

    /// Where its services may store their states: in memory, and where there is none to spare.
    fn states(&self) -> [PathBuf; 2] {
        let name = format!("echogrid-{}-{}.state", self.uid, self.name);
        [self.base.join(format!("{}.state", self.name)), std::env::temp_dir().join(name)]
    }

    /// Removes everything the domain left. Call only while holding its locks.
    fn wipe(&self) {
        self.wipe_shared_memory();
        for folder in self.states() {
            let _ = fs::remove_dir_all(folder);
        }
    }

    fn wipe_shared_memory(&self) {
        for object in self.objects() {
            // Gone already is as good.
            let _ = fs::remove_file(object);
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
    /// The domain that is claimed.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// A folder, made now, in which services store their states, of at most `kept_bytes` besides maps. It outlives shared memory that
    /// is made anew, and goes with the claim.
    ///
    /// # Errors
    /// The system refuses.
    pub fn state_dir(&self, kept_bytes: u64) -> Result<PathBuf, DomainError> {
        let [in_memory, on_disk] = self.domain.states();
        let folder = if check_memory(states_bytes(kept_bytes), 0).is_ok() { in_memory } else { on_disk };
        // `/tmp` is everybody's, and the name can be guessed.
        make_new(&folder, self.domain.uid)?;
        Ok(folder)
    }

    /// Takes everything out of shared memory that is the domain's, and begins anew. No other process may be in it.
    ///
    /// # Errors
    /// The system refuses.
    pub(crate) fn renew(&self) -> Result<(), DomainError> {
        self.domain.wipe_shared_memory();
        self.domain.furnish()
    }

    /// Takes away what group and others may do with what is in shared memory by now.
    ///
    /// # Errors
    /// The system refuses.
    pub(crate) fn make_private(&self) -> Result<(), DomainError> {
        private::close(&self.domain.prefix())
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
        assert!(matches!(domain.join(), Err(DomainError::NotRunning { .. })));
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
        let lock = lock(&domain.owner_lock(), FlockArg::LockExclusiveNonblock).unwrap().unwrap();
        fs::create_dir_all(domain.dir()).unwrap();
        fs::write(domain.owner_lock(), "1").unwrap();
        fs::write(&stray, "x").unwrap();
        drop(lock);
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
}
