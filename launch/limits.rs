//! How many files a process may have open: most of those of a graph are connections in shared memory.

use nix::sys::resource::{Resource, getrlimit, setrlimit};

/// The most files that one process of a graph of so many services can need. Measured: 180 in the mapper of five.
#[must_use]
pub fn files_needed(services: u64) -> u64 {
    192 + 32 * services
}

/// Raises the limit of this process and of those it starts to `needed`, as far as it may.
pub fn allow_files(needed: u64) {
    if let Ok((soft, hard)) = getrlimit(Resource::RLIMIT_NOFILE)
        && soft < needed
    {
        // What is too little is said by whoever can't open a file; it may be enough.
        let _ = setrlimit(Resource::RLIMIT_NOFILE, needed.min(hard), hard);
    }
}
