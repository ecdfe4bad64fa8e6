//! One process of the graph, seen from the launcher.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::Instant;

use anyhow::{Context, Result};
use echogrid_service::lifeline::LIFELINE_VARIABLE;
use echogrid_service::logging::{FILTER_VARIABLE, FORMAT_VARIABLE};
use echogrid_service::plan::{DOMAIN_VARIABLE, GONE_VARIABLE, SERVICE_VARIABLE};
use echogrid_service::process::{IN_VAIN, NO_GRAPH};
use echogrid_topics::{Health, ServiceState};
use nix::sys::signal::{Signal, kill};
use rustix::process::{Pid, PidfdFlags, Resource, Rlimit, pidfd_open, prlimit, setpriority_process};

use super::signs::Signs;
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

/// A life of a service.
#[derive(Debug)]
pub(super) struct Process {
    name: String,
    child: Child,
    pidfd: OwnedFd,
    pub(super) started: Instant,
    /// When it said that it is ready.
    pub(super) ready_at: Option<Instant>,
    last_heard: Option<Instant>,
    /// What the system shows of it.
    pub(super) signs: Signs,
    /// When it last waited for one that had a reason to keep it waiting.
    pub(super) waited: Option<Instant>,
    /// Whether it was said that it is silent.
    pub(super) told_silent: bool,
    pub(super) health: Option<Health>,
    pub(super) status: Option<ExitStatus>,
    /// SIGTERMs sent so far.
    pub(super) asked: u32,
}

impl Process {
    /// Starts a service in `domain`. Its standard input is its lifeline; what it writes to
    /// standard error goes to `lines`.
    pub(super) fn start(
        name: &str,
        service: &Service,
        domain: &str,
        gone: &str,
        logging: &BTreeMap<&str, String>,
        lines: &Sender<Line>,
        now: Instant,
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
        Ok(Self {
            name: name.into(),
            child,
            pidfd,
            started: now,
            ready_at: None,
            last_heard: None,
            signs: Signs::default(),
            waited: None,
            told_silent: false,
            health: None,
            status: None,
            asked: 0,
        })
    }

    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    pub(super) fn is_alive(&self) -> bool {
        self.status.is_none()
    }

    /// Whether it did all that it was there for. Who leaves while it takes messages, and was not asked to, did not, however
    /// well it says that it went; of a sensor those who wait for the end of its streams know better.
    pub(super) fn succeeded(&self, is_sensor: bool) -> bool {
        let state = self.health.as_ref().map_or(ServiceState::Starting, |health| health.state);
        let may_leave = is_sensor || self.asked > 0 || state > ServiceState::Running;
        self.status.is_some_and(|status| status.success() && may_leave) || state == ServiceState::Finished
    }

    /// Whether it died of a signal that asks to end.
    pub(super) fn was_terminated(&self) -> bool {
        let Some(status) = self.status else { return false };
        let signal = status.signal().or(status.code().map(|code| code - 128));
        let asks = [Signal::SIGHUP, Signal::SIGINT, Signal::SIGTERM];
        signal.is_some_and(|signal| asks.iter().any(|asks| *asks as i32 == signal))
    }

    /// Whether it said that it could not enter the graph.
    pub(super) fn found_no_graph(&self) -> bool {
        self.status.and_then(|status| status.code()) == Some(i32::from(NO_GRAPH))
    }

    /// Whether it failed for a reason that another process would meet, too.
    pub(super) fn failed_in_vain(&self) -> bool {
        self.status.and_then(|status| status.code()) == Some(i32::from(IN_VAIN))
    }

    /// Whether it has said that it is ready.
    pub(super) fn is_ready(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state > ServiceState::Starting)
    }

    /// Readable when it is gone.
    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        self.pidfd.as_fd()
    }

    /// Takes note of what it says of itself.
    pub(super) fn hear(&mut self, health: Health, now: Instant) {
        self.last_heard = Some(now);
        if health.state > ServiceState::Starting {
            self.ready_at.get_or_insert(now);
        }
        self.health = Some(health);
    }

    /// Since when nothing was heard of it.
    pub(super) fn silent_since(&self) -> Instant {
        self.last_heard.unwrap_or(self.started)
    }

    /// Looks whether it has ended.
    pub(super) fn reap(&mut self) -> Result<bool> {
        if self.status.is_none() {
            self.status = self.child.try_wait().with_context(|| format!("waiting for {}", self.name))?;
            return Ok(self.status.is_some());
        }
        Ok(false)
    }

    /// Asks it to end.
    pub(super) fn ask_to_stop(&mut self) {
        if self.is_alive() {
            self.asked += 1;
            // Gone already is as good.
            let _ = kill(nix::unistd::Pid::from_raw(self.pid() as i32), Signal::SIGTERM);
        }
    }

    /// Asks it to end, if that was not done yet.
    pub(super) fn ask_once(&mut self) {
        if self.asked == 0 {
            self.ask_to_stop();
        }
    }

    /// Ends it now.
    pub(super) fn kill(&mut self) {
        if self.is_alive() {
            let _ = self.child.kill();
            self.status = self.child.wait().ok();
        }
    }

    /// How it ended, for people.
    pub(super) fn end(&self) -> String {
        let told = self.health.as_ref().map(|health| health.last_error.as_str()).filter(|error| !error.is_empty());
        match (self.status, told) {
            (_, Some(error)) => error.to_owned(),
            (None, None) => "still running".to_owned(),
            (Some(status), None) if status.success() && !self.succeeded(false) => {
                "left, though its streams had not ended".to_owned()
            }
            (Some(status), None) if status.success() => "done".to_owned(),
            (Some(status), None) => match (status.code(), status.signal()) {
                (Some(code), _) => format!("exit code {code}"),
                (None, Some(signal)) => {
                    let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
                    // What iceoryx2 maps is not reserved: memory that is full is found out when it is written.
                    let hint = if name == "SIGBUS" { ": is /dev/shm full? See echogrid doctor" } else { "" };
                    format!("killed by signal {signal} ({name}){hint}")
                }
                (None, None) => status.to_string(),
            },
        }
    }
}

impl Drop for Process {
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
        (Exec::Path(path), None) => Command::new(path),
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
