//! A launcher that runs, and what is done to it and its services.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::support::ECHOGRID;

/// The launcher among the victims.
pub(super) const LAUNCHER: &str = "launcher";

/// A launcher, and what it says.
pub(super) struct Running {
    child: Child,
    lines: Receiver<String>,
    pub(super) heard: Vec<String>,
    /// The latest process of each service.
    services: BTreeMap<String, i32>,
    /// Who is stopped, and until when.
    stopped: Vec<(i32, Instant)>,
}

impl Running {
    pub(super) fn start(arguments: &[String]) -> Self {
        let mut command = Command::new(ECHOGRID);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let stderr = child.stderr.take().unwrap();
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            BufReader::new(stderr)
                .lines()
                .map_while(Result::ok)
                .take_while(|line| sender.send(line.clone()).is_ok())
                .count()
        });
        Self { child, lines, heard: Vec::new(), services: BTreeMap::new(), stopped: Vec::new() }
    }

    /// Listens for so long; the service that was started last meanwhile, none; or that all is over.
    pub(super) fn listen(&mut self, patience: Duration) -> Result<Option<String>, ()> {
        let deadline = Instant::now() + patience;
        loop {
            let next = self.stopped.iter().map(|(_, until)| *until).fold(deadline, Instant::min);
            match self.lines.recv_timeout(next.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    let started =
                        line.split_once(" started (process ").map(|(name, rest)| (name.to_owned(), rest.to_owned()));
                    self.heard.push(line);
                    if let Some((name, rest)) = started {
                        self.services.insert(name.clone(), rest.trim_end_matches(')').parse().unwrap());
                        return Ok(Some(name));
                    }
                }
                Err(RecvTimeoutError::Timeout) if next < deadline => self.have_them_go_on(Instant::now()),
                Err(RecvTimeoutError::Timeout) => {
                    self.have_them_go_on(Instant::now());
                    return Ok(None);
                }
                Err(RecvTimeoutError::Disconnected) => return Err(()),
            }
        }
    }

    /// Who has been stopped for long enough goes on.
    fn have_them_go_on(&mut self, now: Instant) {
        let (over, still): (Vec<_>, Vec<_>) = self.stopped.drain(..).partition(|(_, until)| *until <= now);
        self.stopped = still;
        for (process, _) in over {
            let _ = kill(Pid::from_raw(process), Signal::SIGCONT);
        }
    }

    /// Those that there are: the services, and the launcher last.
    pub(super) fn names(&self) -> Vec<String> {
        self.services.keys().cloned().chain([LAUNCHER.to_owned()]).collect()
    }

    pub(super) fn has_services(&self) -> bool {
        !self.services.is_empty()
    }

    fn process(&self, name: &str) -> i32 {
        self.services.get(name).copied().unwrap_or(self.child.id() as i32)
    }

    /// Sends a signal; whether there was somebody to get it.
    pub(super) fn signal(&self, name: &str, signal: Signal) -> bool {
        kill(Pid::from_raw(self.process(name)), signal).is_ok()
    }

    /// Stops somebody for so long.
    pub(super) fn stop(&mut self, name: &str, pause: Duration) -> bool {
        self.stopped.push((self.process(name), Instant::now() + pause));
        self.signal(name, Signal::SIGSTOP)
    }

    /// Waits for the end of a launcher that says no more; its exit code, none if it was killed.
    pub(super) fn end(&mut self) -> Option<i32> {
        self.have_them_go_on(Instant::now() + Duration::from_secs(3600));
        self.child.wait().unwrap().code()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.have_them_go_on(Instant::now() + Duration::from_secs(3600));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
