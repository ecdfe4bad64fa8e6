//! Cleans up what dead processes left in a domain.
//!
//! The control plane of iceoryx2 0.10.0 is not crash-atomic: a process that is killed in the wrong microsecond leaves
//! things that its own cleaner trips over. What is found here depends on the file layout of that version.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, FilePath, SemanticString, ipc};

use crate::domain::{Domain, SHM};
use crate::participant::{TopicError, path_bytes};

/// Where iceoryx2 has a folder for each process.
const NODES: &str = "nodes";
/// What is being made is left alone for so long.
const GRACE: Duration = Duration::from_millis(200);
/// For what one dead process left.
const WITHIN: Duration = Duration::from_secs(1);

/// What was found and removed.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Cleaned {
    /// Processes whose ports are free again.
    pub processes: usize,
    /// Those that something is left of.
    pub failed: usize,
    /// Shared memory that was never given a size.
    pub unsized_memory: usize,
    /// Files of processes that died while they were written.
    pub unfinished: usize,
    /// Files that belong to no process any more.
    pub orphans: usize,
}

/// Cleans up after the dead of `domain`. It can hang: to be called in a process of its own, one at a time.
///
/// # Errors
/// The domain has no configuration.
pub fn clean(domain: &Domain) -> Result<Cleaned, TopicError> {
    let mut cleaned = Cleaned::default();
    let failed = |reason: String| TopicError::Node { domain: domain.name().into(), name: "janitor".into(), reason };
    let path = domain.iceoryx2_config();
    let file = FilePath::new(path_bytes(&path)).map_err(|e| failed(format!("{e:?}")))?;
    let config = Config::setup_global_config_from_file(&file).map_err(|e| failed(format!("{e:?}")))?;
    let prefix = domain.prefix();
    // Opened by anyone, memory without a size has them wait for ever.
    for entry in fs::read_dir(SHM).into_iter().flatten().flatten() {
        let is_ours = entry.file_name().to_string_lossy().starts_with(&prefix);
        if is_ours && entry.metadata().is_ok_and(|meta| meta.is_file() && meta.len() == 0 && is_old(&meta)) {
            cleaned.unsized_memory += usize::from(fs::remove_file(entry.path()).is_ok());
        }
    }
    let nodes = PathBuf::from(config.global.node_dir().to_string());
    let (mut known, mut dead) = (BTreeSet::new(), Vec::new());
    let listed = Node::<ipc::Service>::list(config, |state| {
        known.insert(state.node_id().value().to_string());
        if let NodeState::Dead(node) = state {
            dead.push(node);
        }
        CallbackProgression::Continue
    });
    listed.map_err(|e| failed(format!("{e:?}")))?;
    for node in dead {
        // What was not finished is not seen by the cleaner, and keeps it from removing the rest.
        let folder = nodes.join(node.id().value().to_string());
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let is_tag = entry.file_name().to_string_lossy().ends_with("_tag");
            let unfinished = entry.metadata().is_ok_and(|meta| meta.permissions().mode() & 0o777 == 0o600);
            if is_tag && unfinished {
                cleaned.unfinished += usize::from(fs::remove_file(entry.path()).is_ok());
            }
        }
        match node.blocking_remove_stale_resources(WITHIN) {
            Ok(()) => cleaned.processes += 1,
            Err(_) => cleaned.failed += 1,
        }
    }
    for entry in fs::read_dir(&nodes).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(meta) = entry.metadata().ok().filter(is_old) else { continue };
        let monitor = |id: &str| nodes.join(format!("{prefix}{id}.node_monitor"));
        if meta.is_dir() {
            if !known.contains(&name) && !monitor(&name).exists() {
                cleaned.orphans += usize::from(fs::remove_dir_all(entry.path()).is_ok());
            }
        } else if let Some(id) = name.strip_prefix(&prefix).and_then(|rest| rest.split('.').next()) {
            let unfinished = meta.permissions().mode() & 0o777 == 0o200;
            if !known.contains(id) && (unfinished || !monitor(id).exists()) {
                cleaned.orphans += usize::from(fs::remove_file(entry.path()).is_ok());
            }
        }
    }
    Ok(cleaned)
}

/// How many processes are in a domain, or were and left something: a look at a folder.
#[must_use]
pub fn residents(domain: &Domain) -> usize {
    let entries = fs::read_dir(domain.dir().join(NODES)).into_iter().flatten().flatten();
    entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())).count()
}

fn is_old(meta: &fs::Metadata) -> bool {
    meta.modified().ok().and_then(|at| at.elapsed().ok()).is_some_and(|age| age > GRACE)
}
