//! A graph that has ended.

use std::process::ExitStatus;

use echogrid_topics::Domain;
use serde_json::Value;

use crate::leftovers;

/// A launcher that has ended.
#[derive(Debug)]
pub struct Ended {
    /// How.
    pub status: ExitStatus,
    /// All of its standard output.
    pub stdout: String,
    /// All of its standard error: log lines and the error it ended with.
    pub stderr: String,
    pub(crate) kept: Kept,
}

/// The domain of a graph, and what is to be said of it should the test fail. Dropped, it leaves nothing.
#[derive(Debug)]
pub(crate) struct Kept {
    pub(crate) domain: Domain,
    pub(crate) log: String,
    is_ours: bool,
}

impl Kept {
    pub(crate) fn new(domain: Domain) -> Self {
        Self { domain, log: String::new(), is_ours: true }
    }

    /// What stays where the domain was moved on.
    pub(crate) fn nothing() -> Self {
        Self { domain: Domain::unique(), log: String::new(), is_ours: false }
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        if !self.is_ours {
            return;
        }
        if std::thread::panicking() {
            eprintln!("--- graph {}\n{}\n---", self.domain.name(), self.log);
        }
        // Another launcher may have it by now, or have had it all the time.
        if !echogrid_topics::domain::running().iter().any(|name| name == self.domain.name()) {
            leftovers::sweep(&self.domain);
        }
    }
}

impl Ended {
    /// The summary of a graph that was started with `--json` and ended well: among others `restarts` (by service),
    /// `given_up`, `lost_messages` and `faulty_messages`.
    ///
    /// # Panics
    /// It failed, or its summary is no JSON.
    #[must_use]
    #[allow(clippy::panic)] // a test that asks for what is not there has failed
    pub fn summary(&self) -> Value {
        assert!(self.status.success(), "{}:\n{}", self.status, self.stderr);
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }

    /// How often each service was started again, in all; of a graph that was started with `--json` and ended well.
    ///
    /// # Panics
    /// As [`Ended::summary`].
    #[must_use]
    pub fn restarts(&self) -> u64 {
        self.summary()["restarts"].as_object().into_iter().flatten().filter_map(|(_, count)| count.as_u64()).sum()
    }

    /// Everything of the graph that is still there: processes, and files in shared memory.
    #[must_use]
    pub fn leftovers(&self) -> Vec<String> {
        leftovers::leftovers(&self.kept.domain)
    }
}
