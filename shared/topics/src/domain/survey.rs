//! Which domains of this user there are: running, or dead and left behind.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use nix::fcntl::FlockArg;
use nix::unistd::Uid;

use super::lock::{Glance, glance, lock};
use super::others::whose;
use super::{Domain, SHM, base_of};

/// A graph that runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Running {
    /// The name of the graph's domain.
    pub name: String,
    /// The number of the launcher's process, if known.
    pub launcher: Option<u32>,
}

/// What a graph left of which no process lives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leftover {
    /// The name of the domain that the graph had.
    pub name: String,
    /// The number of files that are left.
    pub files: usize,
    /// The room that they take.
    pub bytes: u64,
}

/// Names of the domains of this user in which a launcher runs.
#[must_use]
pub fn running() -> Vec<String> {
    graphs().into_iter().map(|graph| graph.name).collect()
}

/// The domains of this user in which a launcher runs, by name.
#[must_use]
pub fn graphs() -> Vec<Running> {
    let owned = known().into_iter().filter(is_owned);
    owned.map(|domain| Running { launcher: domain.launcher(), name: domain.name }).collect()
}

/// What dead graphs of this user left, by name.
#[must_use]
pub fn leftovers() -> Vec<Leftover> {
    known().iter().filter(|domain| is_dead(domain)).filter_map(Leftover::of).collect()
}

/// Removes what dead graphs of this user left, and tells what it was. Never touches a domain in which a process lives.
pub fn clean() -> Vec<Leftover> {
    let swept = sweep_dead(None);
    // Succeeds only when no domain is left.
    let _ = fs::remove_dir(base_of(Uid::current().as_raw()));
    swept
}

pub(super) fn is_owned(domain: &Domain) -> bool {
    matches!(glance(&domain.owner_lock()), Ok(Glance::Held))
}

fn is_dead(domain: &Domain) -> bool {
    let is_free = |path: PathBuf| matches!(glance(&path), Ok(Glance::Free | Glance::Absent));
    is_free(domain.owner_lock()) && is_free(domain.member_lock())
}

/// Wipes every other domain of this user that no process holds any more; those that refuse stay.
pub(super) fn sweep_dead(except: Option<&Domain>) -> Vec<Leftover> {
    let mut swept = Vec::new();
    for domain in known().into_iter().filter(|domain| Some(domain) != except && is_dead(domain)) {
        // Who looked first may be outrun: what counts is who holds the locks.
        let Ok(Some(_owner)) = lock(&domain.owner_lock(), FlockArg::LockExclusiveNonblock) else { continue };
        let Ok(Some(_members)) = lock(&domain.member_lock(), FlockArg::LockExclusiveNonblock) else { continue };
        tracing::debug!(domain = domain.name(), "sweeping what a dead launcher left");
        swept.extend(Leftover::of(&domain));
        domain.wipe();
        let _ = fs::remove_file(domain.member_lock());
        let _ = fs::remove_file(domain.owner_lock());
    }
    swept
}

/// Every domain of this user of which there is a lock, a directory or an object, by name.
fn known() -> Vec<Domain> {
    let uid = Uid::current().as_raw();
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(base_of(uid)).into_iter().flatten().flatten() {
        let name = entry.file_name();
        names.extend(Path::new(&name).file_stem().and_then(|stem| stem.to_str()).map(str::to_owned));
    }
    for entry in fs::read_dir(SHM).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let ours = name.to_str().and_then(whose).filter(|(owner, _)| *owner == uid);
        // What another user named like ours we could not remove.
        if entry.metadata().is_ok_and(|meta| meta.uid() == uid) {
            names.extend(ours.map(|(_, domain)| domain.to_owned()));
        }
    }
    names.iter().filter_map(|name| Domain::named(name).ok()).collect()
}

impl Leftover {
    /// None if there is nothing any more.
    fn of(domain: &Domain) -> Option<Self> {
        let mut paths = vec![domain.dir(), domain.owner_lock(), domain.member_lock()];
        paths.extend(domain.objects());
        let (files, bytes) = paths.iter().map(|path| size_of(path)).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (files > 0).then(|| Self { name: domain.name.clone(), files, bytes })
    }
}

/// Files at and below a path, and the room that they take.
fn size_of(path: &Path) -> (usize, u64) {
    let Ok(meta) = fs::symlink_metadata(path) else { return (0, 0) };
    if !meta.is_dir() {
        return (1, 512 * meta.blocks());
    }
    let inside = fs::read_dir(path).into_iter().flatten().flatten().map(|entry| size_of(&entry.path()));
    inside.fold((1, 0), |a, b| (a.0 + b.0, a.1 + b.1))
}
