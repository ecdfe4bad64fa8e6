//! A graph that runs.

use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use echogrid_topics::Domain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::ended::{Ended, Kept};
use crate::fault::Mode;
use crate::leftovers;
use crate::program::{cannot_start, owned};
use crate::{PATIENCE, Stranger, TopicReader, View};

/// How long the word of a service may take before it is looked whether the graph is still there.
const LOOK_EVERY: Duration = Duration::from_millis(500);

static NEXT: AtomicU32 = AtomicU32::new(0);

/// A launcher under test. Dropping it ends the graph at once and removes what is left of it; where the test failed, its log
/// is printed.
#[derive(Debug)]
pub struct GraphProcess {
    child: Child,
    program: OsString,
    kept: Kept,
    lines: Receiver<String>,
    heard: Vec<String>,
    health: Option<TopicReader>,
    view: View,
    has_ended: bool,
}

impl GraphProcess {
    /// Starts `binary` (an `echogrid`) with `arguments`, in a domain that no other test has, and
    /// verbose, so that there is something to wait for.
    ///
    /// # Panics
    /// The program can't be started.
    #[must_use]
    pub fn start<I>(binary: impl AsRef<Path>, arguments: I) -> Self
    where
        I: IntoIterator,
        I::Item: AsRef<OsStr>,
    {
        let name = format!("t{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        Self::start_in(&name, binary, arguments)
    }

    /// Starts `binary` as [`GraphProcess::start`] does, in the domain `name`.
    ///
    /// # Panics
    /// The name is no domain, or the program can't be started.
    #[must_use]
    #[allow(clippy::expect_used, clippy::panic)] // a test that can't start has failed
    pub fn start_in<I>(name: &str, binary: impl AsRef<Path>, arguments: I) -> Self
    where
        I: IntoIterator,
        I::Item: AsRef<OsStr>,
    {
        let domain = Domain::named(name).expect("a name of a domain");
        let mut child = Command::new(binary.as_ref())
            .args(owned(arguments))
            .args(["--verbose", "--domain", name])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{}", cannot_start(binary.as_ref(), &error)));
        let stderr = child.stderr.take().expect("stderr is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self {
            child,
            program: binary.as_ref().into(),
            kept: Kept::new(domain),
            lines,
            heard: Vec::new(),
            health: None,
            view: View::default(),
            has_ended: false,
        }
    }

    /// The launcher's process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// The domain that it runs in.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.kept.domain
    }

    /// Waits until a line of standard error contains `text`, and gives that line.
    ///
    /// # Panics
    /// No such line within two minutes, or the program ended before.
    pub fn wait_for(&mut self, text: &str) -> String {
        self.wait_for_nth(text, 1)
    }

    /// Waits until `n` lines of standard error contain `text`, and gives the last of them.
    ///
    /// # Panics
    /// Not as many within two minutes, or the program ended before.
    #[allow(clippy::panic)] // a wait that ends without its condition is a failed test
    pub fn wait_for_nth(&mut self, text: &str, n: usize) -> String {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let mut found = self.heard.iter().filter(|line| line.contains(text));
            if let Some(line) = found.nth(n.saturating_sub(1)) {
                return line.clone();
            }
            match self.lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) => self.heard.push(line),
                Err(RecvTimeoutError::Timeout) => panic!("no {text:?} ({n} ×) in time"),
                Err(RecvTimeoutError::Disconnected) => panic!("ended without {text:?} ({n} ×)"),
            }
        }
    }

    /// Waits until what the services say of themselves is as wanted; `what` that is, for whoever reads of its failure.
    ///
    /// # Panics
    /// It is not within two minutes, or the graph ended before.
    #[allow(clippy::panic)] // a wait that ends without its condition is a failed test
    pub fn wait_until(&mut self, what: &str, condition: impl Fn(&View) -> bool) {
        // Before that there is no domain to look into.
        self.wait_for(" started (process ");
        let deadline = Instant::now() + PATIENCE;
        while !condition(&self.view) {
            assert!(Instant::now() < deadline, "not in time: {what}; last: {}", self.view);
            let health =
                self.health.get_or_insert_with(|| TopicReader::start(&self.program, &self.kept.domain, "health"));
            match health.next_within(LOOK_EVERY) {
                Ok(message) => self.view.note(&message),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    let ended = self.child.try_wait().map_or(true, |status| status.is_some());
                    assert!(!ended, "ended before: {what}; last: {}", self.view);
                    // It was made anew, or the reader came too early.
                    self.health = None;
                }
            }
        }
    }

    /// Waits until a service has taken in (a sensor: given out) so many messages.
    ///
    /// # Panics
    /// As [`GraphProcess::wait_until`].
    pub fn wait_for_progress(&mut self, service: &str, messages: u64) {
        self.wait_until(&format!("{service} has {messages} messages"), |view| view.progress(service) >= messages);
    }

    /// Reads a topic (`map/info`, …) from now on; what is kept for whoever comes late comes first.
    ///
    /// # Panics
    /// It was not started in time.
    pub fn topic(&mut self, name: &str) -> TopicReader {
        self.wait_for(" started (process ");
        TopicReader::start(&self.program, &self.kept.domain, name)
    }

    /// The process of a service: of its latest life.
    ///
    /// # Panics
    /// It was not started in time.
    #[allow(clippy::expect_used)] // written by the launcher itself
    pub fn pid_of(&mut self, service: &str) -> u32 {
        let started = format!("{service} started (process ");
        self.wait_for(&started);
        self.heard.extend(self.lines.try_iter());
        let line = self.heard.iter().rfind(|line| line.contains(&started));
        let number =
            line.and_then(|line| line.rsplit("(process ").next()).and_then(|rest| rest.split(')').next()?.parse().ok());
        number.expect("the line ends with the process id")
    }

    /// Kills a service (SIGKILL).
    ///
    /// # Panics
    /// It was not started in time.
    pub fn kill(&mut self, service: &str) {
        self.signal_to(service, Signal::SIGKILL);
    }

    /// Stops a service (SIGSTOP): it says nothing any more, and hears nothing.
    ///
    /// # Panics
    /// It was not started in time.
    pub fn stop(&mut self, service: &str) {
        self.signal_to(service, Signal::SIGSTOP);
    }

    /// Has a stopped service go on (SIGCONT).
    ///
    /// # Panics
    /// It was not started in time.
    pub fn go_on(&mut self, service: &str) {
        self.signal_to(service, Signal::SIGCONT);
    }

    /// Sends a service a signal.
    ///
    /// # Panics
    /// It was not started in time.
    pub fn signal_to(&mut self, service: &str, signal: Signal) {
        let pid = self.pid_of(service);
        // Gone already is as good.
        let _ = kill(Pid::from_raw(pid as i32), signal);
    }

    /// Sends the launcher a signal.
    pub fn signal(&self, signal: Signal) {
        // Gone already is as good.
        let _ = kill(Pid::from_raw(self.pid() as i32), signal);
    }

    /// Has a stranger write garbage into a topic. When this returns, it has.
    ///
    /// # Panics
    /// It could not.
    pub fn garbage(&mut self, topic: &str) -> Stranger {
        self.stranger(Mode::GarbageOn, topic)
    }

    /// Has a stranger read a topic, a message every 50 ms.
    ///
    /// # Panics
    /// It could not.
    pub fn slow_reader(&mut self, topic: &str) -> Stranger {
        self.stranger(Mode::SlowReader, topic)
    }

    fn stranger(&mut self, mode: Mode, topic: &str) -> Stranger {
        self.wait_for(" started (process ");
        Stranger::start(&self.kept.domain, mode, topic)
    }

    /// Waits for the launcher to end.
    ///
    /// # Panics
    /// It does not end within two minutes.
    #[must_use]
    #[allow(clippy::panic, clippy::expect_used)] // a wait that ends without its condition is a failed test
    pub fn wait(mut self) -> Ended {
        let deadline = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) => self.heard.push(line),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("did not end in time"),
            }
        }
        let mut stdout = String::new();
        let pipe = self.child.stdout.as_mut().expect("stdout is piped");
        pipe.read_to_string(&mut stdout).expect("stdout is text");
        let status = self.child.wait().expect("the program can be waited for");
        self.has_ended = true;
        self.health = None;
        let stderr = self.heard.join("\n");
        let mut kept = std::mem::replace(&mut self.kept, Kept::nothing());
        kept.log.clone_from(&stderr);
        Ended { status, stdout, stderr, kept }
    }

    /// Waits until no process of the graph is left, at most for `patience`; those that are, else.
    #[must_use]
    pub fn survivors_after(&self, patience: Duration) -> Vec<String> {
        leftovers::survivors_after(&self.kept.domain, patience)
    }
}

impl Drop for GraphProcess {
    fn drop(&mut self) {
        if self.has_ended {
            return;
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.health = None;
        self.heard.extend(self.lines.try_iter());
        self.kept.log = self.heard.join("\n");
    }
}
