//! Whoever is started from a thread that has this filter asks before it changes a file, and waits for the answer.

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::libc;

/// `_IOWR('!', 0, struct seccomp_notif)`, `_IOWR('!', 1, struct seccomp_notif_resp)`.
const RECEIVE: libc::Ioctl = 0xC050_2100_u32 as libc::Ioctl;
const ANSWER: libc::Ioctl = 0xC018_2101_u32 as libc::Ioctl;
/// Where the number of the call stands in `struct seccomp_data`.
const NUMBER_AT: u32 = 0;
/// The longest path that a call names.
const PATH_MAX: usize = 4096;

/// What a call does to a file, and which of its arguments says to which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Call {
    Write,
    WriteAt,
    WriteParts,
    Truncate,
    Sync,
    SyncData,
    Rename { to: usize },
    Remove { path: usize },
}

impl Call {
    #[cfg(target_arch = "x86_64")]
    const OLD: [(libc::c_long, Self); 2] =
        [(libc::SYS_rename, Self::Rename { to: 1 }), (libc::SYS_unlink, Self::Remove { path: 0 })];
    #[cfg(not(target_arch = "x86_64"))]
    const OLD: [(libc::c_long, Self); 0] = [];
    const ALL: [(libc::c_long, Self); 9] = [
        (libc::SYS_write, Self::Write),
        (libc::SYS_pwrite64, Self::WriteAt),
        (libc::SYS_writev, Self::WriteParts),
        (libc::SYS_ftruncate, Self::Truncate),
        (libc::SYS_fsync, Self::Sync),
        (libc::SYS_fdatasync, Self::SyncData),
        (libc::SYS_renameat, Self::Rename { to: 3 }),
        (libc::SYS_renameat2, Self::Rename { to: 3 }),
        (libc::SYS_unlinkat, Self::Remove { path: 1 }),
    ];

    fn known() -> impl Iterator<Item = (libc::c_long, Self)> {
        Self::OLD.into_iter().chain(Self::ALL)
    }
}

/// A process that asks, and waits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Question {
    id: u64,
    /// The thread.
    pub(super) thread: u32,
    pub(super) call: Call,
    arguments: [u64; 6],
}

impl Question {
    /// The file or folder that would change; none where it is no file, or the thread is gone.
    pub(super) fn path(&self) -> Option<PathBuf> {
        match self.call {
            Call::Rename { to: path } | Call::Remove { path } => self.text(self.arguments[path]),
            _ => std::fs::read_link(self.descriptor()).ok(),
        }
    }

    /// A way to what the first argument has open.
    pub(super) fn descriptor(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/fd/{}", self.thread, self.arguments[0]))
    }

    fn text(&self, at: u64) -> Option<PathBuf> {
        let mut bytes = vec![0; PATH_MAX];
        let read = self.memory().ok()?.read_at(&mut bytes, at).ok()?;
        let end = bytes[..read].iter().position(|byte| *byte == 0)?;
        Some(Path::new(std::str::from_utf8(&bytes[..end]).ok()?).to_path_buf())
    }

    fn memory(&self) -> io::Result<File> {
        File::open(format!("/proc/{}/mem", self.thread))
    }

    /// Writes the first half of what the process is about to write, in its place.
    pub(super) fn write_half(&self) -> io::Result<()> {
        // Of other calls the third argument is no length.
        let at = match self.call {
            Call::WriteAt => self.arguments[3],
            Call::Write => self.position()?,
            _ => return Ok(()),
        };
        let mut bytes = vec![0; self.arguments[2] as usize / 2];
        self.memory()?.read_exact_at(&mut bytes, self.arguments[1])?;
        File::options().write(true).open(self.descriptor())?.write_all_at(&bytes, at)
    }

    fn position(&self) -> io::Result<u64> {
        let text = std::fs::read_to_string(format!("/proc/{}/fdinfo/{}", self.thread, self.arguments[0]))?;
        let at = text.lines().find_map(|line| line.strip_prefix("pos:")?.trim().parse().ok());
        at.ok_or_else(|| io::Error::other("no position"))
    }

    /// The process that the thread is of; none if it is gone.
    pub(super) fn process(&self) -> Option<i32> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.thread)).ok()?;
        status.lines().find_map(|line| line.strip_prefix("Tgid:")?.trim().parse().ok())
    }
}

/// Where the questions arrive.
#[derive(Debug)]
pub(super) struct Listener(OwnedFd);

impl Listener {
    /// Puts the filter on the calling thread, for good, and on whatever it starts.
    ///
    /// # Errors
    /// The system knows no such thing, or does not allow it.
    pub(super) fn on_this_thread() -> io::Result<Self> {
        let statement = |code: u32, k: u32| libc::sock_filter { code: code as u16, jt: 0, jf: 0, k };
        let load = libc::BPF_LD | libc::BPF_W | libc::BPF_ABS;
        let mut program = vec![statement(load, NUMBER_AT)];
        for (number, _) in Call::known() {
            let is_it = libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K;
            // Goes on with the next statement if it is, and past it else.
            program.push(libc::sock_filter { code: is_it as u16, jt: 0, jf: 1, k: number as u32 });
            program.push(statement(libc::BPF_RET | libc::BPF_K, libc::SECCOMP_RET_USER_NOTIF));
        }
        program.push(statement(libc::BPF_RET | libc::BPF_K, libc::SECCOMP_RET_ALLOW));
        let program = libc::sock_fprog { len: program.len() as u16, filter: program.as_mut_ptr() };
        // SAFETY: neither call keeps a pointer; the program outlives the second.
        let fd = unsafe {
            Errno::result(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))?;
            let (set, new) = (libc::SECCOMP_SET_MODE_FILTER, libc::SECCOMP_FILTER_FLAG_NEW_LISTENER);
            Errno::result(libc::syscall(libc::SYS_seccomp, set, new, &raw const program))?
        };
        // SAFETY: the system has just made it, for us.
        Ok(Self(unsafe { OwnedFd::from_raw_fd(fd as i32) }))
    }

    /// The next question; none when nobody is left who could ask.
    pub(super) fn next(&self) -> io::Result<Option<Question>> {
        loop {
            let mut fds = [nix::poll::PollFd::new(std::os::fd::AsFd::as_fd(&self.0), nix::poll::PollFlags::POLLIN)];
            nix::poll::poll(&mut fds, nix::poll::PollTimeout::NONE)?;
            let happened = fds[0].revents().unwrap_or(nix::poll::PollFlags::empty());
            if !happened.contains(nix::poll::PollFlags::POLLIN) {
                return Ok(None);
            }
            // SAFETY: all zeros is a value of this type, and the one that is asked for.
            let mut asked: libc::seccomp_notif = unsafe { std::mem::zeroed() };
            // SAFETY: it is written to a value of the type that the number of the request tells.
            match Errno::result(unsafe { libc::ioctl(self.0.as_raw_fd(), RECEIVE, &raw mut asked) }) {
                Ok(_) => {
                    let number = libc::c_long::from(asked.data.nr);
                    let call = Call::known().find(|(known, _)| *known == number).map(|(_, call)| call);
                    let Some(call) = call else { continue };
                    return Ok(Some(Question { id: asked.id, thread: asked.pid, call, arguments: asked.data.args }));
                }
                // Gone before it was heard.
                Err(Errno::ENOENT | Errno::EINTR) => {}
                Err(errno) => return Err(errno.into()),
            }
        }
    }

    /// Has the call done, or fail as told. Whoever asked may be gone.
    pub(super) fn answer(&self, question: &Question, fails: Option<Errno>) {
        let flags = if fails.is_none() { libc::SECCOMP_USER_NOTIF_FLAG_CONTINUE as u32 } else { 0 };
        let error = fails.map_or(0, |errno| -(errno as i32));
        let mut answer = libc::seccomp_notif_resp { id: question.id, val: 0, error, flags };
        // SAFETY: it is read from a value of the type that the number of the request tells.
        unsafe { libc::ioctl(self.0.as_raw_fd(), ANSWER, &raw mut answer) };
    }
}
