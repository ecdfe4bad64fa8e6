//! Other users' graphs: nobody but their user can join them, not even root (whose objects they could not open, and would wait
//! for). What can be told of them are the names in /dev/shm.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::os::unix::fs::MetadataExt;

use nix::unistd::Uid;

use super::{Domain, SHM};

/// A user, for people.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct User {
    /// The number of the user.
    pub uid: u32,
    /// The name, if the system knows one.
    pub name: Option<String>,
}

impl User {
    /// The user of this number.
    #[must_use]
    pub fn of(uid: u32) -> Self {
        let known = nix::unistd::User::from_uid(Uid::from_raw(uid)).ok().flatten();
        Self { uid, name: known.map(|user| user.name) }
    }

    /// The user that this process runs as.
    #[must_use]
    pub fn current() -> Self {
        Self::of(Uid::current().as_raw())
    }

    /// What begins a command that is to run as this user.
    #[must_use]
    pub fn run_as(&self) -> String {
        match &self.name {
            Some(name) => format!("sudo -u {name}"),
            None => format!("sudo -u '#{}'", self.uid),
        }
    }
}

impl fmt::Display for User {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "user {}", self.uid)?;
        self.name.as_ref().map_or(Ok(()), |name| write!(f, " ({name})"))
    }
}

/// The domains of other users that have shared memory, running or left behind.
#[must_use]
pub fn others() -> BTreeMap<User, BTreeSet<String>> {
    let me = Uid::current().as_raw();
    let mut found: BTreeMap<u32, BTreeSet<String>> = BTreeMap::new();
    for entry in fs::read_dir(SHM).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((uid, domain)) = name.to_str().and_then(whose).filter(|(uid, _)| *uid != me) else { continue };
        // Anybody can give a file any name.
        if entry.metadata().is_ok_and(|meta| meta.uid() == uid) {
            found.entry(uid).or_default().insert(domain.to_owned());
        }
    }
    found.into_iter().map(|(uid, domains)| (User::of(uid), domains)).collect()
}

/// Who else has a domain of this name.
pub(super) fn owner_of(name: &str) -> Option<User> {
    others().into_iter().find(|(_, domains)| domains.contains(name)).map(|(user, _)| user)
}

/// User and domain of an object in shared memory, by its name: `eg<uid>_<domain>_…`.
pub(super) fn whose(object: &str) -> Option<(u32, &str)> {
    let (uid, rest) = object.strip_prefix("eg")?.split_once('_')?;
    let (domain, _) = rest.split_once('_')?;
    Some((uid.parse().ok()?, Domain::is_name(domain).then_some(domain)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_tell_whose_they_are() {
        assert_eq!(whose("eg1000_lab-2_0354a2_17.data"), Some((1000, "lab-2")));
        for other in ["eg1000_lab", "eg_lab_x", "eg-1_lab_x", "eg1000_Lab_x", "eg1000__x", "sem.lab", "echogrid-1000"] {
            assert_eq!(whose(other), None, "{other}");
        }
    }

    #[test]
    fn users_have_names() {
        assert_eq!(User::of(0).to_string(), "user 0 (root)");
        let nobody_at_all = User { uid: 4_000_000_000, name: None };
        assert_eq!(nobody_at_all.to_string(), "user 4000000000");
        assert_eq!(nobody_at_all.run_as(), "sudo -u '#4000000000'");
    }
}
