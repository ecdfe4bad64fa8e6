//! What is left of a graph, and how it goes.

use std::path::Path;
use std::time::{Duration, Instant};

use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_topics::Domain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// A killed process is gone within milliseconds, unless the machine is very busy.
const GONE_WITHIN: Duration = Duration::from_secs(10);
/// Looking whether a domain is dead takes no longer, on a very busy machine.
const GLANCES_END_WITHIN: Duration = Duration::from_secs(5);

/// Files of a domain in shared memory.
#[must_use]
pub fn files(domain: &Domain) -> Vec<String> {
    let prefix = domain.prefix();
    let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    let mut files: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with(&prefix))
        .collect();
    let own = domain.dir();
    let siblings = own.parent().map(std::fs::read_dir).into_iter().flatten().flatten().flatten();
    let stem = domain.name().to_owned();
    files.extend(
        siblings
            .filter(|entry| Path::new(&entry.file_name()).file_stem().is_some_and(|name| name == stem.as_str()))
            .map(|entry| entry.path().display().to_string()),
    );
    files
}

/// Everything of a domain that is there: processes, and files in shared memory.
#[must_use]
pub fn leftovers(domain: &Domain) -> Vec<String> {
    let deadline = Instant::now() + GLANCES_END_WITHIN;
    loop {
        let mut left = survivors_after(domain, Duration::ZERO);
        left.extend(files(domain));
        let is_lock = |file: &String| file.ends_with(".owner") || file.ends_with(".members");
        if left.is_empty() || !left.iter().all(is_lock) || Instant::now() >= deadline {
            return left;
        }
        // Another launcher that starts may have found the domain just before it went, and locks it to sweep it.
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until no process of a domain is left, at most for `patience`; those that are, else.
pub(crate) fn survivors_after(domain: &Domain, patience: Duration) -> Vec<String> {
    let deadline = Instant::now() + patience;
    loop {
        let alive = processes(domain);
        if alive.is_empty() || Instant::now() >= deadline {
            return alive.into_iter().map(|(pid, comm)| format!("process {pid} {comm}")).collect();
        }
        // The kernel tells only a parent of a death; the parent is what died.
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Ends what is left of a graph whose launcher is gone, and removes its files.
pub(crate) fn sweep(domain: &Domain) {
    for (pid, _) in processes(domain) {
        // Gone already is as good.
        let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
    }
    survivors_after(domain, GONE_WITHIN);
    if !files(domain).is_empty() {
        // To claim a domain is to wipe it, unless somebody runs in it.
        drop(domain.clone().claim());
    }
}

/// Processes started by the launcher of a domain: they carry its name in their environment.
pub(crate) fn processes(domain: &Domain) -> Vec<(i32, String)> {
    let mark = format!("{DOMAIN_VARIABLE}={}", domain.name());
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter_map(|entry| {
            let pid = entry.file_name().to_str()?.parse().ok()?;
            // Unreadable: not ours, or gone.
            let environment = std::fs::read(entry.path().join("environ")).ok()?;
            environment.split(|byte| *byte == 0).find(|variable| *variable == mark.as_bytes())?;
            let comm = std::fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
            Some((pid, comm.trim().to_owned()))
        })
        .collect()
}
