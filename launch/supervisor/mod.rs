//! A graph of processes, from claim to sweep.
//!
//! The supervisor owns the domain, starts every service as a process of its own, listens to their
//! health, and ends them all: upstream to downstream when the stream ends or the user asks, at once
//! when one of them fails and nothing more can come.

mod child;

use std::collections::BTreeMap;
use std::os::fd::BorrowedFd;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use child::{Line, Process, logging_environment};
use echogrid_service::Plan;
use echogrid_service::signals::Signals;
use echogrid_topics::{Domain, Health, Input, MapInfo, Message, Owner, Received, ServiceState, Topic, TrueWorld};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;

use crate::config::{Service, ServiceKind};

/// What a graph may take to save and leave when it is asked to.
const LEAVE_WITHIN: Duration = Duration::from_secs(10);
/// Likewise when a service failed, for those downstream of it.
const LEAVE_AFTER_FAILURE: Duration = Duration::from_secs(5);
/// From the sensor's exit until its readers have heard that the streams ended.
const END_WITHIN: Duration = Duration::from_secs(5);
/// Between the last request and the kill.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// Progress is shown this often, and deadlines looked at.
const TICK: Duration = Duration::from_millis(100);

/// What is to be run.
#[derive(Debug)]
pub struct Graph<'a> {
    /// Where.
    pub domain: Domain,
    /// The processes.
    pub services: &'a BTreeMap<String, Service>,
    /// What they are told.
    pub plan: Plan,
    /// What they log (`ECHOGRID_LOG`); none: as the environment says.
    pub log_filter: Option<&'a str>,
    /// Whether they log as JSON.
    pub log_json: bool,
    /// From one sign of life to the next. Writing a large map to a slow disk is one step.
    pub alive_within: Duration,
    /// A service that has not become ready for so long hangs.
    pub ready_within: Duration,
}

/// How the run is doing.
#[derive(Debug)]
pub struct Progress<'a> {
    /// The sensor's health, once heard.
    pub sensor: Option<&'a Health>,
    /// How many services are ready, and of how many.
    pub ready: (usize, usize),
}

/// Something that happens once.
#[derive(Debug)]
pub enum Event<'a> {
    /// A process was started.
    Started {
        /// The service.
        name: &'a str,
        /// Its process.
        pid: u32,
    },
    /// Every service is ready.
    Ready,
    /// A process is gone.
    Ended {
        /// The service.
        name: &'a str,
        /// How, for people.
        how: String,
    },
}

/// What people see of a run while it lasts.
pub trait Observer {
    /// Called as things happen.
    fn event(&mut self, event: &Event<'_>);
    /// Called about ten times a second.
    fn progress(&mut self, progress: &Progress<'_>);
    /// A line that a service logged.
    fn line(&mut self, line: &str);
}

/// How a run ended.
#[derive(Debug, Default)]
pub struct Outcome {
    /// The map in numbers, as the mapper last told.
    pub map: Option<MapInfo>,
    /// The world, if the sensor is a simulator that tells.
    pub world: Option<TrueWorld>,
    /// The last health of each service.
    pub health: BTreeMap<String, Health>,
    /// Whether the user stopped it.
    pub stopped: bool,
    /// Start to all services ready.
    pub startup: Duration,
    /// All services ready to all services gone.
    pub elapsed: Duration,
    /// The services that failed and how; the first is the cause.
    pub failures: Vec<String>,
    /// Services that had to be killed.
    pub killed: Vec<String>,
}

/// Which services read which topic, by the roles in the graph.
#[must_use]
pub fn consumers(services: &BTreeMap<String, Service>) -> BTreeMap<String, Vec<String>> {
    let mut consumers: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, service) in services {
        let inputs = match service.kind {
            ServiceKind::Sensor => &[][..],
            ServiceKind::Odometry => echogrid_odometry::INPUTS,
            ServiceKind::Localizer => echogrid_localizer::INPUTS,
            ServiceKind::Mapper => echogrid_mapper::INPUTS,
            ServiceKind::Publisher => echogrid_publisher::INPUTS,
        };
        for topic in inputs {
            consumers.entry(topic.name().into()).or_default().push(name.clone());
        }
    }
    consumers
}

/// Runs a graph to its end.
///
/// # Errors
/// It could not be started. What goes wrong later is in the [`Outcome`].
pub fn run(graph: &Graph<'_>, observer: &mut dyn Observer) -> Result<Outcome> {
    // Before any thread is started: threads inherit what is blocked.
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP, Signal::SIGCHLD])?;
    let names: Vec<&str> = graph.services.keys().map(String::as_str).collect();
    let owner = Owner::create(graph.domain.clone(), graph.plan.max_readings, &names)?;
    graph.plan.write(owner.domain())?;
    let health = Input::open(owner.participant(), Topic::Health)?;
    let info = Input::open(owner.participant(), Topic::MapInfo)?;
    let world = Input::open(owner.participant(), Topic::TrueWorld)?;
    let (sender, lines) = channel();
    let mut supervisor = Supervisor {
        processes: Vec::new(),
        signals,
        health,
        info,
        world,
        lines,
        started: Instant::now(),
        alive_within: graph.alive_within,
        ready_within: graph.ready_within,
        ready: None,
        ending: None,
        failed: None,
        sensor_gone_since: None,
        outcome: Outcome::default(),
        _owner: owner,
    };
    supervisor.start_all(graph, &sender, observer)?;
    drop(sender);
    supervisor.watch(observer)?;
    Ok(supervisor.finish(observer))
}

/// Why the graph is ending, and how far it has been pressed.
#[derive(Debug)]
struct Ending {
    deadline: Instant,
    pressed: u32,
}

#[derive(Debug)]
struct Supervisor {
    // First: on an error the processes are killed before their domain is swept.
    processes: Vec<Process>,
    signals: Signals,
    health: Input,
    info: Input,
    world: Input,
    lines: Receiver<Line>,
    started: Instant,
    alive_within: Duration,
    ready_within: Duration,
    ready: Option<Instant>,
    ending: Option<Ending>,
    /// The service farthest upstream that failed.
    failed: Option<ServiceKind>,
    sensor_gone_since: Option<Instant>,
    outcome: Outcome,
    _owner: Owner,
}

impl Supervisor {
    fn start_all(&mut self, graph: &Graph<'_>, lines: &Sender<Line>, observer: &mut dyn Observer) -> Result<()> {
        let environment = logging_environment(graph.log_filter, graph.log_json);
        // Upstream to downstream: the order in which they will be asked to stop.
        let mut services: Vec<_> = graph.services.iter().collect();
        services.sort_by_key(|(_, service)| service.kind);
        for (name, service) in services {
            let process = Process::start(name, service, graph.domain.name(), &environment, lines)?;
            observer.event(&Event::Started { name, pid: process.pid() });
            self.processes.push(process);
        }
        Ok(())
    }

    fn watch(&mut self, observer: &mut dyn Observer) -> Result<()> {
        while self.processes.iter().any(Process::is_alive) {
            self.wait()?;
            self.take_signals()?;
            self.take_messages()?;
            if self.ready.is_none() && self.processes.iter().all(Process::is_ready) {
                self.ready = Some(Instant::now());
                observer.event(&Event::Ready);
            }
            self.reap(observer)?;
            self.check_deadlines(observer);
            self.wind_down();
            self.show(observer);
        }
        Ok(())
    }

    fn wait(&self) -> Result<()> {
        let fds: [BorrowedFd<'_>; 3] = [self.signals.fd(), self.health.fd(), self.info.fd()];
        let mut fds = fds.map(|fd| PollFd::new(fd, PollFlags::POLLIN));
        match poll(&mut fds, PollTimeout::from(TICK.as_millis() as u16)) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => Err(errno).context("waiting for the services"),
        }
    }

    fn take_signals(&mut self) -> Result<()> {
        while let Some(signal) = self.signals.next()? {
            if signal == Signal::SIGCHLD {
                continue;
            }
            if self.outcome.stopped {
                // The second time: now.
                self.ending = Some(Ending { deadline: Instant::now(), pressed: 2 });
            } else {
                self.outcome.stopped = true;
                self.end(LEAVE_WITHIN);
            }
        }
        Ok(())
    }

    /// Ends the stream at its source; the rest drains, saves and leaves by itself.
    fn end(&mut self, within: Duration) {
        for process in self.processes.iter_mut().filter(|process| process.kind == ServiceKind::Sensor) {
            process.ask_to_stop();
        }
        self.ending.get_or_insert(Ending { deadline: Instant::now() + within, pressed: 0 });
    }

    /// A service of this kind is no more, and nobody downstream will hear the end of its streams.
    fn end_after_failure(&mut self, kind: ServiceKind) {
        self.failed = Some(self.failed.map_or(kind, |failed| failed.min(kind)));
        self.end(LEAVE_AFTER_FAILURE);
    }

    /// After a failure those downstream save what they have. They are asked one after the other: who
    /// is asked has heard the last of whoever was before it.
    fn wind_down(&mut self) {
        let Some(failed) = self.failed else { return };
        let downstream = self.processes.iter().filter(|process| process.is_alive() && process.kind > failed);
        if let Some(next) = downstream.map(|process| process.kind).min() {
            for process in self.processes.iter_mut().filter(|process| process.kind == next && process.asked == 0) {
                process.ask_to_stop();
            }
        } else if let Some(ending) = self.ending.as_mut().filter(|ending| ending.pressed == 0) {
            // Those upstream wait in vain for the one that failed.
            ending.deadline = ending.deadline.min(Instant::now() + LAST_WORDS);
        }
    }

    fn take_messages(&mut self) -> Result<()> {
        self.health.hush()?;
        while let Some(received) = self.health.receive()? {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            if let Some(process) = self.processes.iter_mut().find(|process| process.name == health.service) {
                process.hear(health);
            }
        }
        self.info.hush()?;
        while let Some(received) = self.info.receive()? {
            if let Received::Message(_, Message::Info(info)) = received {
                self.outcome.map = Some(*info);
            }
        }
        self.world.hush()?;
        while let Some(received) = self.world.receive()? {
            if let Received::Message(_, Message::TrueWorld(world)) = received {
                self.outcome.world = Some(world);
            }
        }
        Ok(())
    }

    fn reap(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let mut failed = Vec::new();
        for process in &mut self.processes {
            if !process.reap()? {
                continue;
            }
            observer.event(&Event::Ended { name: &process.name, how: process.end() });
            if !process.succeeded() {
                failed.push((process.name.clone(), process.kind));
            }
        }
        if !failed.is_empty() {
            // Its last words may still be on their way.
            self.take_messages()?;
        }
        for (name, kind) in failed {
            let end = self.processes.iter().find(|process| process.name == name).map(Process::end).unwrap_or_default();
            // Who was pressed to leave is a consequence, not a cause.
            if self.ending.as_ref().is_none_or(|ending| ending.pressed == 0) {
                self.outcome.failures.push(format!("{name}: {end}"));
            }
            self.end_after_failure(kind);
        }
        Ok(())
    }

    fn check_deadlines(&mut self, observer: &mut dyn Observer) {
        let now = Instant::now();
        for process in self.processes.iter_mut().filter(|process| process.is_alive()) {
            let (limit, what) = if process.is_ready() {
                (self.alive_within, "no sign of life")
            } else {
                (self.ready_within, "not ready")
            };
            if now.saturating_duration_since(process.silent_since()) > limit {
                let name = process.name.clone();
                self.outcome.failures.push(format!("{name}: {what} for {} s: it hangs", limit.as_secs()));
                process.kill();
                observer.event(&Event::Ended { name: &process.name, how: process.end() });
                let kind = process.kind;
                self.end_after_failure(kind);
                break;
            }
        }
        self.check_for_a_missing_end(now);
        let Some(ending) = self.ending.as_mut().filter(|ending| now >= ending.deadline) else { return };
        ending.deadline = now + LAST_WORDS;
        ending.pressed += 1;
        let kill = ending.pressed > 2;
        for process in self.processes.iter_mut().filter(|process| process.is_alive()) {
            if kill {
                self.outcome.killed.push(process.name.clone());
                process.kill();
            } else {
                process.ask_to_stop();
            }
        }
    }

    /// A sensor that left without ending its streams leaves the others waiting.
    fn check_for_a_missing_end(&mut self, now: Instant) {
        let sensor_gone = self.processes.iter().any(|p| p.kind == ServiceKind::Sensor && p.succeeded());
        let odometry_gone = self.processes.iter().any(|p| p.kind == ServiceKind::Odometry && p.succeeded());
        let waiting = |p: &Process| {
            let waits_for_sensor = match p.kind {
                ServiceKind::Odometry => true,
                // All poses have come; what may be missing is the end of the scans.
                ServiceKind::Mapper => odometry_gone,
                ServiceKind::Sensor | ServiceKind::Localizer | ServiceKind::Publisher => false,
            };
            waits_for_sensor && p.health.as_ref().is_some_and(|h| h.state == ServiceState::Running)
        };
        if !sensor_gone || self.ending.is_some() || !self.processes.iter().any(|p| p.is_alive() && waiting(p)) {
            self.sensor_gone_since = None;
        } else if now.saturating_duration_since(*self.sensor_gone_since.get_or_insert(now)) > END_WITHIN {
            self.outcome.failures.push("sensor: left without saying that its streams end".into());
            self.end_after_failure(ServiceKind::Sensor);
        }
    }

    fn show(&mut self, observer: &mut dyn Observer) {
        while let Ok(line) = self.lines.try_recv() {
            observer.line(&line.text);
        }
        let sensor = self.processes.iter().find(|process| process.kind == ServiceKind::Sensor);
        let ready = self.processes.iter().filter(|process| process.is_ready()).count();
        observer.progress(&Progress {
            sensor: sensor.and_then(|process| process.health.as_ref()),
            ready: (ready, self.processes.len()),
        });
    }

    fn finish(mut self, observer: &mut dyn Observer) -> Outcome {
        // What was said last; an error of reading it is not worth losing the outcome for.
        let _ = self.take_messages();
        // Ends when the processes' ends of the pipes are closed, which they are.
        while let Ok(line) = self.lines.recv_timeout(TICK) {
            observer.line(&line.text);
        }
        let now = Instant::now();
        let ready = self.ready.unwrap_or(now);
        self.outcome.startup = ready.saturating_duration_since(self.started);
        self.outcome.elapsed = now.saturating_duration_since(ready);
        for process in &self.processes {
            if let Some(health) = &process.health {
                self.outcome.health.insert(process.name.clone(), health.clone());
            }
        }
        std::mem::take(&mut self.outcome)
    }
}

impl Outcome {
    /// The error that the run ended with, if it did.
    ///
    /// # Errors
    /// One clear error: the cause, and who had to be killed.
    pub fn check(&self) -> Result<()> {
        if self.failures.is_empty() && self.killed.is_empty() {
            return Ok(());
        }
        let killed = if self.killed.is_empty() {
            String::new()
        } else {
            format!(" (would not leave and was killed: {})", self.killed.join(", "))
        };
        match self.failures.first() {
            Some(cause) => bail!("{cause}{killed}"),
            None => bail!("the graph did not end in time{killed}"),
        }
    }
}
