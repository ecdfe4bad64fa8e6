//! A process that is no service of the graph and meddles with its topics.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use echogrid_service::plan::{DOMAIN_VARIABLE, SERVICE_VARIABLE};
use echogrid_topics::Domain;

use crate::fault::Mode;
use crate::program::fault_program;

/// A process that meddles with a topic until it is dropped.
#[derive(Debug)]
pub struct Stranger {
    child: Child,
}

impl Stranger {
    /// Starts one, and waits until it has begun.
    #[allow(clippy::expect_used, clippy::panic)] // a test that can't start has failed
    pub(crate) fn start(domain: &Domain, mode: Mode, topic: &str) -> Self {
        let mut child = Command::new(fault_program())
            .args([mode.word(), topic])
            .env(DOMAIN_VARIABLE, domain.name())
            .env_remove(SERVICE_VARIABLE)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("stdout is piped");
        let _ = BufReader::new(stdout).read_line(&mut line);
        assert!(!line.is_empty(), "{} did not come to meddle with {topic}", mode.word());
        Self { child }
    }

    /// The number of the stranger's process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Kills it: it has no time to tidy up.
    pub fn kill(mut self) {
        let _ = self.child.kill();
    }
}

impl Drop for Stranger {
    fn drop(&mut self) {
        // It leaves when its standard input closes.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}
