//! One process of the graph, in the launcher's hand.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;

use anyhow::{Context, Result};
use echogrid_service::lifeline::LIFELINE_VARIABLE;
use echogrid_service::logging::{FILTER_VARIABLE, FORMAT_VARIABLE};
use echogrid_service::plan::{DOMAIN_VARIABLE, GONE_VARIABLE, SERVICE_VARIABLE};
use echogrid_service::signals::unblock;
use echogrid_supervision::{End, Process, Usage};
use nix::sys::signal::{Signal, kill};
use rustix::process::{Pid, PidfdFlags, Resource, Rlimit, pidfd_open, prlimit, setpriority_process};

use super::usage;
use crate::config::{Care, Exec, Service, Speech};

/// The launcher's own executable: the one that runs, whatever lies in its place by now.
pub(super) const OWN: &str = "/proc/self/exe";

/// A line that a process wrote to standard error.
#[derive(Debug)]
pub(super) struct Line {
    /// The service.
    pub(super) name: String,
    pub(super) text: String,
}

/// The process of a service.
#[derive(Debug)]
pub(super) struct ServiceProcess {
    name: String,
    child: Child,
    pidfd: OwnedFd,
    status: Option<ExitStatus>,
}

impl ServiceProcess {
    /// Starts a service in `domain`. Its standard input is its lifeline; what it writes to
    /// standard error goes to `lines`.
    pub(super) fn start(
        name: &str,
        service: &Service,
        domain: &str,
        gone: &str,
        logging: &BTreeMap<&str, String>,
        lines: &Sender<Line>,
    ) -> Result<Self> {
        let mut command = command_of(service);
        command
            .args(&service.args)
            .env(DOMAIN_VARIABLE, domain)
            .env(SERVICE_VARIABLE, name)
            .env(LIFELINE_VARIABLE, "stdin")
            .env(GONE_VARIABLE, gone)
            // The launcher alone speaks to systemd.
            .env_remove("NOTIFY_SOCKET")
            .env_remove("WATCHDOG_USEC")
            .env_remove("WATCHDOG_PID")
            .envs(logging)
            .envs(&service.env)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // Ctrl-C is the launcher's to pass on, upstream first.
            .process_group(0);
        let mut child = command.spawn().with_context(|| format!("starting {name} ({})", service.exec))?;
        let pidfd = pidfd(&child)?;
        limit(&child, name, &service.care)?;
        if let Some(stderr) = child.stderr.take() {
            let (lines, service) = (lines.clone(), name.to_owned());
            std::thread::Builder::new()
                .name(format!("stderr of {name}"))
                .spawn(move || {
                    for line in BufReader::new(stderr).split(b'\n').map_while(Result::ok) {
                        let text = String::from_utf8_lossy(&line).into_owned();
                        if lines.send(Line { name: service.clone(), text }).is_err() {
                            break;
                        }
                    }
                })
                .context("starting a thread")?;
        }
        Ok(Self { name: name.into(), child, pidfd, status: None })
    }

    /// Readable when it is gone.
    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        self.pidfd.as_fd()
    }
}

impl Process for ServiceProcess {
    fn pid(&self) -> u32 {
        self.child.id()
    }

    fn ask_to_stop(&mut self) {
        // Gone already is as good.
        let _ = kill(nix::unistd::Pid::from_raw(self.pid() as i32), Signal::SIGTERM);
    }

    fn kill(&mut self) {
        if self.status.is_none() {
            let _ = self.child.kill();
            self.status = self.child.wait().ok();
        }
    }

    fn look(&mut self) -> Result<()> {
        if self.status.is_none() {
            self.status = self.child.try_wait().with_context(|| format!("waiting for {}", self.name))?;
        }
        Ok(())
    }

    fn end(&self) -> Option<End> {
        let status = self.status?;
        // Who neither left nor was killed has not ended.
        status.code().map(End::Code).or_else(|| status.signal().map(End::Signal))
    }

    fn usage(&self) -> Option<Usage> {
        usage::of(self.pid())
    }
}

impl Drop for ServiceProcess {
    fn drop(&mut self) {
        self.kill();
    }
}

/// What is started for a service.
fn command_of(service: &Service) -> Command {
    let own = |name: &str| {
        let mut command = Command::new(OWN);
        command.arg0(format!("echogrid-{name}")).args(["service", name]);
        command
    };
    match (&service.exec, service.speaks) {
        (Exec::Builtin(builtin), _) => own(builtin.name()),
        (Exec::Path(path), None) => {
            let mut command = Command::new(path);
            // SAFETY: between fork and exec this sets the mask of the only thread, by one call of the system.
            unsafe { command.pre_exec(unblock) };
            command
        }
        (Exec::Path(path), Some(Speech::Carmen)) => {
            let mut command = own("lines");
            command.arg("--").args(service.replays.then_some(echogrid_lines::REPLAYS)).arg(path);
            command
        }
    }
}

/// A descriptor that is readable when the process is gone.
pub(super) fn pidfd(child: &Child) -> Result<OwnedFd> {
    pidfd_open(Pid::from_child(child), PidfdFlags::empty()).context("watching over a process (pidfd_open)")
}

/// What the process may use.
fn limit(child: &Child, name: &str, care: &Care) -> Result<()> {
    let pid = Some(Pid::from_child(child));
    let limit = |resource, most| {
        let limit = Rlimit { current: Some(most), maximum: Some(most) };
        prlimit(pid, resource, limit).map(drop)
    };
    if care.nice != 0 {
        setpriority_process(pid, care.nice).with_context(|| format!("services.{name}.nice = {}", care.nice))?;
    }
    if care.memory_max_mib > 0 {
        limit(Resource::As, care.memory_max_mib.saturating_mul(1 << 20))
            .with_context(|| format!("services.{name}.memory_max_mib = {}", care.memory_max_mib))?;
    }
    if care.open_files_max > 0 {
        limit(Resource::Nofile, care.open_files_max)
            .with_context(|| format!("services.{name}.open_files_max = {}", care.open_files_max))?;
    }
    Ok(())
}

/// Where the logs of the services go, as their environment.
pub(super) fn logging_environment(filter: Option<&str>, json: bool) -> BTreeMap<&'static str, String> {
    let mut environment = BTreeMap::new();
    if let Some(filter) = filter {
        environment.insert(FILTER_VARIABLE, filter.to_owned());
    }
    if json {
        environment.insert(FORMAT_VARIABLE, "json".to_owned());
    }
    environment
}
