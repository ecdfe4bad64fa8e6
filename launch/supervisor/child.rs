//! One process of the graph, seen from the launcher.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::Instant;

use anyhow::{Context, Result};
use echogrid_service::lifeline::LIFELINE_VARIABLE;
use echogrid_service::logging::{FILTER_VARIABLE, FORMAT_VARIABLE};
use echogrid_service::plan::{DOMAIN_VARIABLE, SERVICE_VARIABLE};
use echogrid_topics::{Health, ServiceState};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::config::{Exec, Service, ServiceKind};

/// A line that a process wrote to standard error.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) text: String,
}

/// A running (or ended) service.
#[derive(Debug)]
pub(super) struct Process {
    pub(super) name: String,
    pub(super) kind: ServiceKind,
    child: Child,
    started: Instant,
    last_heard: Option<Instant>,
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
        logging: &BTreeMap<&str, String>,
        lines: &Sender<Line>,
    ) -> Result<Self> {
        let mut command = match &service.exec {
            Exec::Builtin(builtin) => {
                let own = std::env::current_exe().context("finding the launcher's own executable")?;
                let mut command = Command::new(own);
                command.arg0(format!("echogrid-{}", builtin.name())).args(["service", builtin.name()]);
                command
            }
            Exec::Path(path) => Command::new(path),
        };
        command
            .args(&service.args)
            .env(DOMAIN_VARIABLE, domain)
            .env(SERVICE_VARIABLE, name)
            .env(LIFELINE_VARIABLE, "stdin")
            .envs(logging)
            .envs(&service.env)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // Ctrl-C is the launcher's to pass on, upstream first.
            .process_group(0);
        let mut child = command.spawn().with_context(|| format!("starting {name} ({})", service.exec))?;
        if let Some(stderr) = child.stderr.take() {
            let lines = lines.clone();
            std::thread::Builder::new()
                .name(format!("stderr of {name}"))
                .spawn(move || {
                    for line in BufReader::new(stderr).split(b'\n').map_while(Result::ok) {
                        let text = String::from_utf8_lossy(&line).into_owned();
                        if lines.send(Line { text }).is_err() {
                            break;
                        }
                    }
                })
                .context("starting a thread")?;
        }
        Ok(Self {
            name: name.into(),
            kind: service.kind,
            child,
            started: Instant::now(),
            last_heard: None,
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

    /// Whether it ended as it should.
    pub(super) fn succeeded(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// Whether it has said that it is ready.
    pub(super) fn is_ready(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state > ServiceState::Starting)
    }

    /// Takes note of what it says of itself.
    pub(super) fn hear(&mut self, health: Health) {
        self.last_heard = Some(Instant::now());
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
            let _ = kill(Pid::from_raw(self.pid() as i32), Signal::SIGTERM);
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
            (Some(status), None) if status.success() => "done".to_owned(),
            (Some(status), None) => match (status.code(), status.signal()) {
                (Some(code), _) => format!("exit code {code}"),
                (None, Some(signal)) => {
                    let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
                    format!("killed by signal {signal} ({name})")
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
