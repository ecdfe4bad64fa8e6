//! The program whose lines are read.

use core::time::Duration;
use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};

use anyhow::{Context, Result};
use echogrid_formats::log::carmen::{PrintedLine, PrintedLines};
use echogrid_service::signals;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, getppid};

use crate::BECOME;

/// Lines that are read ahead; a program that prints more waits, by its pipe.
const AHEAD: usize = 256;
/// How long a program may take to leave when it is told to.
const LEAVES_WITHIN_MS: u16 = 2000;

/// Who binds a program to this process before becoming it: this crate's `main`, wherever it is.
#[derive(Debug, Clone)]
pub struct Binder {
    /// The executable that binds.
    pub program: PathBuf,
    /// The arguments of the executable before those of this crate's `main`.
    pub arguments: &'static [&'static str],
}

/// A program and its arguments.
#[derive(Debug, Clone)]
pub struct Called {
    /// A path, or a name on `PATH`.
    pub program: OsString,
    /// What it gets besides.
    pub arguments: Vec<OsString>,
}

/// A running program. Dropping it ends it.
#[derive(Debug)]
pub struct Program {
    name: String,
    child: Child,
    /// Readable when it is gone.
    pidfd: OwnedFd,
    lines: Receiver<io::Result<PrintedLine>>,
    is_buried: bool,
}

/// How a program ended.
#[derive(Debug, thiserror::Error)]
#[error("{name}: {how}")]
pub struct Ended {
    name: String,
    how: String,
}

impl Program {
    /// Starts it. It dies with this process, or rather with the thread that calls this.
    ///
    /// # Errors
    /// It can't be started.
    pub fn start(binder: &Binder, called: &Called, is_live: bool) -> Result<Self> {
        let name = called.program.to_string_lossy().into_owned();
        let mut child = Command::new(&binder.program)
            .args(binder.arguments)
            .args([BECOME, &std::process::id().to_string()])
            .arg(&called.program)
            .args(&called.arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting {name}"))?;
        let pidfd =
            rustix::process::pidfd_open(rustix::process::Pid::from_child(&child), rustix::process::PidfdFlags::empty())
                .context("watching over a process (pidfd_open)")?;
        let output = child.stdout.take().context("a program without an output")?;
        let (sender, lines) = sync_channel(AHEAD);
        std::thread::Builder::new()
            .name("lines".to_owned())
            .spawn(move || read(output, is_live, &sender))
            .context("starting a thread")?;
        Ok(Self { name, child, pidfd, lines, is_buried: false })
    }

    /// The next line; none if there was none for so long.
    ///
    /// # Errors
    /// [`Ended`], if the program died; reading failed.
    pub fn next_line(&mut self, patience: Duration) -> Result<Printed> {
        match self.lines.recv_timeout(patience) {
            Ok(line) => Ok(Printed::Line(line.with_context(|| format!("reading what {} prints", self.name))?)),
            // What it started may hold its output open for ever.
            Err(RecvTimeoutError::Timeout) if self.leaves_within(0)? => self.end().map(|()| Printed::End),
            Err(RecvTimeoutError::Timeout) => Ok(Printed::Nothing),
            Err(RecvTimeoutError::Disconnected) => self.end().map(|()| Printed::End),
        }
    }

    /// The number of the program's process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// After its output has ended, or itself: whether all is well with that.
    fn end(&mut self) -> Result<()> {
        if !self.leaves_within(LEAVES_WITHIN_MS)? {
            return Ok(());
        }
        let status = self.bury()?;
        if status.success() {
            return Ok(());
        }
        let ended = Ended { name: self.name.clone(), how: how(status) };
        // Starting it again may help, whatever it printed.
        Err(io::Error::other(ended).into())
    }

    /// Whether it leaves by itself, within so long.
    fn leaves_within(&self, millis: u16) -> Result<bool> {
        let mut fds = [PollFd::new(self.pidfd.as_fd(), PollFlags::POLLIN)];
        match poll(&mut fds, PollTimeout::from(millis)) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::EINTR) => Ok(false),
            Err(errno) => Err(errno).context("waiting for a program to leave"),
        }
    }

    /// How it ended, of one that has; what it started and left behind is told to end, while its number is still its own.
    fn bury(&mut self) -> io::Result<ExitStatus> {
        if !core::mem::replace(&mut self.is_buried, true) {
            self.signal(Signal::SIGTERM);
        }
        self.child.wait()
    }

    fn signal(&self, signal: Signal) {
        // Its whole group: a shell's children, too. Gone already is as good.
        let group = Pid::from_raw(-i32::try_from(self.child.id()).unwrap_or(0));
        let _ = kill(group, signal);
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        if self.is_buried {
            return;
        }
        self.signal(Signal::SIGTERM);
        if !self.leaves_within(LEAVES_WITHIN_MS).unwrap_or(false) {
            self.signal(Signal::SIGKILL);
        }
        let _ = self.bury();
    }
}

/// What a program printed next.
#[derive(Debug, PartialEq, Eq)]
pub enum Printed {
    /// A line.
    Line(PrintedLine),
    /// Nothing yet.
    Nothing,
    /// Nothing more.
    End,
}

fn read(output: impl io::Read, is_live: bool, sender: &SyncSender<io::Result<PrintedLine>>) {
    let mut lines = match PrintedLines::new(output) {
        Ok(lines) => lines,
        Err(error) => return drop(sender.send(Err(error))),
    };
    while let Some(line) = lines.next_line().transpose() {
        let arrived_ns = is_live.then(now_ns);
        let is_over = line.is_err();
        if sender.send(line.map(|line| PrintedLine { arrived_ns, ..line })).is_err() || is_over {
            return;
        }
    }
}

/// Becomes the program that `arguments` name behind the number of the process that it is bound to.
pub(crate) fn become_bound(mut arguments: impl Iterator<Item = OsString>) -> ExitCode {
    let parent = arguments.next().and_then(|number| number.to_str()?.parse().ok());
    let (Some(parent), Some(program)) = (parent, arguments.next()) else { return ExitCode::from(2) };
    let bound = nix::sys::prctl::set_pdeathsig(Signal::SIGTERM);
    // Whoever died before that is not told.
    if bound.is_err() || getppid() != Pid::from_raw(parent) {
        return ExitCode::FAILURE;
    }
    // This process was started with what its parent blocks, and is told of its parent's death by one of these signals.
    if signals::unblock().is_err() {
        return ExitCode::FAILURE;
    }
    let error = Command::new(&program).args(arguments).exec();
    let _ = io::Write::write_all(&mut io::stderr(), format!("{}: {error}\n", program.to_string_lossy()).as_bytes());
    ExitCode::from(127)
}

fn how(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => {
            let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
            format!("was killed by signal {signal} ({name})")
        }
        (None, None) => status.to_string(),
    }
}

/// Time since the machine was started, nanoseconds: the same for all processes, whoever sets its clock.
fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}
