//! How a client comes to an emulated robot: a pseudo-terminal, or TCP.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::Sensor;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;

use super::Emulator;

/// Packets are late by no more than this.
const LOOK_EVERY: u16 = 5;

/// A way to the robot.
#[derive(Debug)]
pub struct Door {
    kind: Kind,
    /// A link to the terminal, taken away in the end.
    link: Option<PathBuf>,
}

#[derive(Debug)]
enum Kind {
    Terminal {
        robot: File,
        /// Held open: else the robot would hear of every client that leaves, as an error.
        _client: OwnedFd,
        name: PathBuf,
    },
    Tcp {
        listener: TcpListener,
        client: Option<TcpStream>,
    },
}

impl Door {
    /// A pseudo-terminal of its own; `link`, if given, leads to it.
    ///
    /// # Errors
    /// There is none left, or the link can't be made: a file of this name is there, say.
    pub fn terminal(link: Option<&Path>) -> Result<Self> {
        let pair = openpty(None, None).context("making a pseudo-terminal")?;
        let mut settings = tcgetattr(&pair.slave)?;
        cfmakeraw(&mut settings);
        tcsetattr(&pair.slave, SetArg::TCSANOW, &settings)?;
        fcntl(&pair.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
        let name = ttyname(&pair.slave)?;
        if let Some(link) = link {
            // One that an earlier emulator left leads nowhere.
            if link.is_symlink() && !link.exists() {
                std::fs::remove_file(link).with_context(|| link.display().to_string())?;
            }
            std::os::unix::fs::symlink(&name, link).with_context(|| link.display().to_string())?;
        }
        let kind = Kind::Terminal { robot: pair.master.into(), _client: pair.slave, name };
        Ok(Self { kind, link: link.map(Path::to_path_buf) })
    }

    /// A port of this machine.
    ///
    /// # Errors
    /// It is in use, or not ours.
    pub fn tcp(address: SocketAddr) -> Result<Self> {
        let listener = TcpListener::bind(address).with_context(|| address.to_string())?;
        listener.set_nonblocking(true)?;
        Ok(Self { kind: Kind::Tcp { listener, client: None }, link: None })
    }

    /// What a client names as its port.
    #[must_use]
    pub fn name(&self) -> String {
        match (&self.kind, &self.link) {
            (_, Some(link)) => link.display().to_string(),
            (Kind::Terminal { name, .. }, None) => name.display().to_string(),
            (Kind::Tcp { listener, .. }, None) => {
                listener.local_addr().map_or_else(|error| error.to_string(), |address| format!("tcp:{address}"))
            }
        }
    }

    /// What a client sent; waits a little.
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let timeout = PollTimeout::from(LOOK_EVERY);
        // A signal ends the wait, and nothing else: there is nothing to read then.
        let wait = |fd: BorrowedFd<'_>| {
            let _ = poll(&mut [PollFd::new(fd, PollFlags::POLLIN)], timeout);
        };
        let read = match &mut self.kind {
            Kind::Terminal { robot, .. } => {
                wait(robot.as_fd());
                robot.read(into)
            }
            Kind::Tcp { listener, client } => {
                wait(client.as_ref().map_or(listener.as_fd(), AsFd::as_fd));
                match client {
                    Some(stream) => match stream.read(into) {
                        Ok(0) => {
                            *client = None;
                            Ok(0)
                        }
                        other => other,
                    },
                    None => listener.accept().and_then(|(stream, _)| {
                        stream.set_nonblocking(true)?;
                        stream.set_nodelay(true)?;
                        *client = Some(stream);
                        Ok(0)
                    }),
                }
            }
        };
        match read {
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
            Err(error) => match &mut self.kind {
                Kind::Tcp { client, .. } => {
                    *client = None;
                    Ok(0)
                }
                Kind::Terminal { .. } => Err(error),
            },
            other => other,
        }
    }

    /// A line has no memory: what nobody takes is lost.
    fn write(&mut self, bytes: &[u8]) {
        match &mut self.kind {
            Kind::Terminal { robot, .. } => drop(robot.write(bytes)),
            Kind::Tcp { client: Some(stream), .. } => drop(stream.write(bytes)),
            Kind::Tcp { client: None, .. } => {}
        }
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
    }
}

/// Lets clients talk to the robot until `is_over` says so, in real time.
///
/// # Errors
/// The door's or the world's.
pub fn serve<S: Sensor>(
    emulator: &mut Emulator<S>,
    door: &mut Door,
    mut is_over: impl FnMut(&Emulator<S>) -> bool,
) -> Result<()> {
    let start = Instant::now();
    let mut bytes = [0; 1024];
    while !is_over(emulator) {
        let count = door.read(&mut bytes).context("reading what a client sends")?;
        let now: Duration = start.elapsed();
        let answer = emulator.step(&bytes[..count], now)?;
        if !answer.is_empty() {
            door.write(&answer);
        }
    }
    Ok(())
}
