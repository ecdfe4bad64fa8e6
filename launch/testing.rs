//! For integration tests: a whole graph of processes in a domain of its own.
//!
//! ```no_run
//! use echogrid::testing::GraphProcess;
//!
//! let mut graph = GraphProcess::start("target/release/echogrid", ["map", "drive.log", "--rate", "1"]);
//! graph.wait_for("all services ready");
//! graph.kill("mapper");
//! let ended = graph.wait();
//! assert!(!ended.status.success());
//! assert!(ended.stderr.contains("mapper"));
//! assert_eq!(ended.leftovers(), Vec::<String>::new());
//! ```
//!
//! Nothing here sleeps for luck: every wait ends with a condition, or fails with what was said so far.

use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_topics::Domain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// A wait that takes longer has failed. Generous: test machines are slow and busy.
const PATIENCE: Duration = Duration::from_secs(120);

static NEXT: AtomicU32 = AtomicU32::new(0);

/// A launcher under test. Dropping it kills it; its services leave by themselves.
#[derive(Debug)]
pub struct GraphProcess {
    child: Child,
    domain: Domain,
    lines: Receiver<String>,
    heard: Vec<String>,
}

/// A launcher that has ended.
#[derive(Debug)]
pub struct Ended {
    /// How.
    pub status: ExitStatus,
    /// All of its standard output.
    pub stdout: String,
    /// All of its standard error: log lines and the error it ended with.
    pub stderr: String,
    domain: Domain,
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

    /// As [`GraphProcess::start`], in the domain `name`.
    ///
    /// # Panics
    /// The name is no domain, or the program can't be started.
    #[must_use]
    #[allow(clippy::expect_used)] // a test that can't start has failed
    pub fn start_in<I>(name: &str, binary: impl AsRef<Path>, arguments: I) -> Self
    where
        I: IntoIterator,
        I::Item: AsRef<OsStr>,
    {
        let domain = Domain::named(name).expect("a name of a domain");
        let arguments: Vec<OsString> = arguments.into_iter().map(|a| a.as_ref().to_owned()).collect();
        let mut child = Command::new(binary.as_ref())
            .args(&arguments)
            .args(["--verbose", "--domain", name])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let stderr = child.stderr.take().expect("stderr is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, domain, lines, heard: Vec::new() }
    }

    /// The launcher's process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Waits until a line of standard error contains `text`, and gives that line.
    ///
    /// # Panics
    /// No such line within two minutes, or the program ended before.
    #[allow(clippy::panic)] // a wait that ends without its condition is a failed test
    pub fn wait_for(&mut self, text: &str) -> String {
        if let Some(line) = self.heard.iter().find(|line| line.contains(text)) {
            return line.clone();
        }
        let deadline = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    self.heard.push(line.clone());
                    if line.contains(text) {
                        return line;
                    }
                }
                Err(RecvTimeoutError::Timeout) => panic!("no {text:?} in time; heard:\n{}", self.heard.join("\n")),
                Err(RecvTimeoutError::Disconnected) => {
                    panic!("ended without {text:?}; heard:\n{}", self.heard.join("\n"))
                }
            }
        }
    }

    /// The process of a service.
    ///
    /// # Panics
    /// It was not started in time.
    #[allow(clippy::expect_used)] // written by the launcher itself
    pub fn pid_of(&mut self, service: &str) -> u32 {
        let line = self.wait_for(&format!("{service} started (process "));
        let number = line.rsplit("(process ").next().and_then(|rest| rest.trim_end_matches(')').parse().ok());
        number.expect("the line ends with the process id")
    }

    /// Kills a service (SIGKILL).
    ///
    /// # Panics
    /// It was not started in time.
    pub fn kill(&mut self, service: &str) {
        let pid = self.pid_of(service);
        // Gone already is as good.
        let _ = kill(Pid::from_raw(pid as i32), Signal::SIGKILL);
    }

    /// Sends the launcher a signal.
    pub fn signal(&self, signal: Signal) {
        // Gone already is as good.
        let _ = kill(Pid::from_raw(self.pid() as i32), signal);
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
                Err(RecvTimeoutError::Timeout) => panic!("did not end in time; heard:\n{}", self.heard.join("\n")),
            }
        }
        let mut stdout = String::new();
        let pipe = self.child.stdout.as_mut().expect("stdout is piped");
        pipe.read_to_string(&mut stdout).expect("stdout is text");
        let status = self.child.wait().expect("the program can be waited for");
        Ended { status, stdout, stderr: self.heard.join("\n"), domain: self.domain.clone() }
    }

    /// Waits until no process of the graph is left, at most for `patience`; those that are, else.
    #[must_use]
    pub fn survivors_after(&self, patience: Duration) -> Vec<String> {
        survivors_after(&self.domain, patience)
    }
}

impl Drop for GraphProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Ended {
    /// Everything of the graph that is still there: processes, and files in shared memory.
    #[must_use]
    pub fn leftovers(&self) -> Vec<String> {
        let mut left = survivors_after(&self.domain, Duration::ZERO);
        left.extend(files(&self.domain));
        left
    }
}

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

fn survivors_after(domain: &Domain, patience: Duration) -> Vec<String> {
    let deadline = Instant::now() + patience;
    loop {
        let alive = processes(domain);
        if alive.is_empty() || Instant::now() >= deadline {
            return alive;
        }
        // The kernel tells only a parent of a death; the parent is what died.
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Processes started by the launcher of a domain: they carry its name in their environment.
fn processes(domain: &Domain) -> Vec<String> {
    let mark = format!("{DOMAIN_VARIABLE}={}", domain.name());
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter(|entry| {
            // Unreadable: not ours, or gone.
            let environment = std::fs::read(entry.path().join("environ")).unwrap_or_default();
            environment.split(|byte| *byte == 0).any(|variable| variable == mark.as_bytes())
        })
        .map(|entry| {
            let comm = std::fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
            format!("process {} {}", entry.file_name().to_string_lossy(), comm.trim())
        })
        .collect()
}
