//! A topic, read by a process of its own: iceoryx2 knows one domain per process, and tests have many.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use echogrid_topics::Domain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::PATIENCE;

/// Messages of a topic as they come, those first that are kept for whoever comes late.
#[derive(Debug)]
pub struct TopicReader {
    child: Child,
    lines: Receiver<Value>,
    topic: String,
}

impl TopicReader {
    #[allow(clippy::expect_used)] // a test that can't start has failed
    pub(crate) fn start(echogrid: &OsStr, domain: &Domain, topic: &str) -> Self {
        let mut child = Command::new(echogrid)
            .args(["topic", "echo", topic, "--json", "--domain", domain.name()])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        let stdout = child.stdout.take().expect("stdout is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            let values = BufReader::new(stdout).lines().map_while(Result::ok);
            for value in values.filter_map(|line| serde_json::from_str(&line).ok()) {
                if sender.send(value).is_err() {
                    break;
                }
            }
        });
        Self { child, lines, topic: topic.to_owned() }
    }

    /// The next message within `patience`: an object with `sequence`, `epoch`, `stamp_ns`, and `message`, `fault` or `end`.
    ///
    /// # Errors
    /// Whether it is only late, or there will be none.
    pub fn next_within(&mut self, patience: Duration) -> Result<Value, RecvTimeoutError> {
        self.lines.recv_timeout(patience)
    }

    /// Waits for a message that is as wanted, and gives it.
    ///
    /// # Panics
    /// None comes within two minutes, or before the graph ends.
    #[allow(clippy::panic)] // a wait that ends without its condition is a failed test
    pub fn wait_until(&mut self, what: &str, mut condition: impl FnMut(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        let mut last = Value::Null;
        loop {
            match self.next_within(deadline.saturating_duration_since(Instant::now())) {
                Ok(value) if condition(&value) => return value,
                Ok(value) => last = value,
                Err(error) => panic!("{}: no message such that {what} ({error}); the last: {last}", self.topic),
            }
        }
    }
}

impl Drop for TopicReader {
    fn drop(&mut self) {
        // It takes its port out of shared memory, unlike one that is killed.
        let _ = kill(Pid::from_raw(self.child.id() as i32), Signal::SIGTERM);
        let _ = self.child.wait();
    }
}
