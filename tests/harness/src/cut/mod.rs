//! A program that fails, dies, or loses its power at its n-th change to the files of a folder: at a write, a sync, a rename, a
//! removal.
//!
//! All processes of the program are held at each such call (seccomp), so that the changes of all of them have one order.

mod disk;
mod listener;

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc::channel;

use disk::Durable;
use echogrid_topics::Domain;
use listener::{Call, Listener, Question};
use nix::errno::Errno;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::leftovers;

/// What becomes of the change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It fails so, once.
    Fails(Errno),
    /// It and all after it fail so: a disk that is full, or broken.
    FailsOn(Errno),
    /// Whoever makes it is killed before.
    Killed,
    /// The whole graph is killed before.
    AllKilled,
    /// The whole graph is killed in the midst of it: half is written.
    Torn,
    /// The whole graph is killed, and what was not synced is lost; names are kept.
    PowerFails,
    /// The whole graph is killed, what was not synced is lost, and names that were not synced, too.
    PowerFailsStrictly,
}

impl Fate {
    /// All of them, with the errors that disks have.
    pub const ALL: [Self; 9] = [
        Self::Fails(Errno::EIO),
        Self::Fails(Errno::ENOSPC),
        Self::FailsOn(Errno::EIO),
        Self::FailsOn(Errno::ENOSPC),
        Self::Killed,
        Self::AllKilled,
        Self::Torn,
        Self::PowerFails,
        Self::PowerFailsStrictly,
    ];

    fn is_power(self) -> bool {
        matches!(self, Self::PowerFails | Self::PowerFailsStrictly)
    }
}

/// What became of the program.
#[derive(Debug)]
pub struct Ran {
    /// How it ended, and what it said.
    pub output: Output,
    /// The changes that it made, or tried to.
    pub changes: u64,
    /// The change that was cut.
    pub cut: Option<String>,
}

/// Runs `command`, a launcher in `domain`, to its end; change number `at` (from 0) to a file below `folder` has this fate.
///
/// # Errors
/// The system can't hold processes so, or the program can't be started.
pub fn run(command: &mut Command, domain: &Domain, folder: &Path, cut: Option<(u64, Fate)>) -> io::Result<Ran> {
    let (sender, listeners) = channel();
    std::thread::scope(|scope| {
        let program = scope.spawn(move || {
            // The filter goes with this thread; its questions are answered by the other.
            let listener = Listener::on_this_thread()?;
            let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
            // The other waits for it until this thread ends.
            let _ = sender.send((listener, child.id() as i32));
            child.wait_with_output()
        });
        let ended = || program.join().map_err(|_| io::Error::other("the thread of the program panicked"))?;
        let Ok((listener, launcher)) = listeners.recv() else { return Err(ended().err().unwrap_or(Errno::EIO.into())) };
        let mut watch = Watch { listener, launcher, domain, folder, cut, changes: 0, told: None, durable: None };
        watch.watch()?;
        let output = ended()?;
        if let (Some((_, fate)), Some(durable), Some(_)) = (cut, &watch.durable, &watch.told) {
            durable.restore(folder, fate == Fate::PowerFailsStrictly)?;
        }
        Ok(Ran { output, changes: watch.changes, cut: watch.told })
    })
}

#[derive(Debug)]
struct Watch<'a> {
    listener: Listener,
    launcher: i32,
    domain: &'a Domain,
    folder: &'a Path,
    cut: Option<(u64, Fate)>,
    changes: u64,
    told: Option<String>,
    durable: Option<Durable>,
}

impl Watch<'_> {
    /// Answers until nobody is left.
    fn watch(&mut self) -> io::Result<()> {
        if self.cut.is_some_and(|(_, fate)| fate.is_power()) {
            self.durable = Some(Durable::of(self.folder)?);
        }
        while let Some(question) = self.listener.next()? {
            let path = question.path().filter(|path| path.starts_with(self.folder));
            let fails = path.map_or(Ok(None), |path| self.change(&question, path))?;
            self.listener.answer(&question, fails);
        }
        Ok(())
    }

    /// A file is about to change; how that fails, if it does.
    fn change(&mut self, question: &Question, path: PathBuf) -> io::Result<Option<Errno>> {
        let number = self.changes;
        self.changes += 1;
        let Some((at, fate)) = self.cut.filter(|(at, _)| *at <= number) else {
            return self.note(question, &path).map(|()| None);
        };
        let fails = match fate {
            Fate::FailsOn(errno) => Some(errno),
            _ if at != number => return self.note(question, &path).map(|()| None),
            Fate::Fails(errno) => Some(errno),
            Fate::Killed => {
                question.process().into_iter().for_each(end);
                None
            }
            Fate::AllKilled | Fate::Torn | Fate::PowerFails | Fate::PowerFailsStrictly => {
                if fate == Fate::Torn {
                    // A pipe that closed meanwhile is as good as killed before.
                    let _ = question.write_half();
                }
                self.end_all();
                None
            }
        };
        self.told.get_or_insert_with(|| format!("{:?} {}", question.call, path.display()));
        Ok(fails)
    }

    /// Takes note of what will have reached the disk.
    fn note(&mut self, question: &Question, path: &Path) -> io::Result<()> {
        // What comes after the power has failed is no longer written down.
        let durable = self.durable.as_mut().filter(|_| self.told.is_none());
        match (durable, question.call) {
            (Some(durable), Call::Sync | Call::SyncData) => durable.sync(&question.descriptor(), path),
            _ => Ok(()),
        }
    }

    fn end_all(&self) {
        end(self.launcher);
        leftovers::processes(self.domain).into_iter().for_each(|(process, _)| end(process));
    }
}

fn end(process: i32) {
    // Gone already is as good.
    let _ = kill(Pid::from_raw(process), Signal::SIGKILL);
}
