//! A graph of processes, from claim to sweep.
//!
//! The supervisor owns the domain, starts every service as a process of its own, listens to their
//! health, starts again who dies or hangs, and ends them all: upstream to downstream when the stream ends
//! or the user asks, at once when one of them is given up and nothing more can come.

mod child;
mod clock;
mod deadlines;
mod deaths;
mod ending;
mod flow;
mod janitor;
mod policy;
mod ports;
mod run;
mod signs;
mod systemd;
mod unit;

use std::collections::BTreeMap;
use std::os::fd::BorrowedFd;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use child::{Line, Process, logging_environment};
use clock::Clock;
use deadlines::Debt;
use echogrid_service::signals::Signals;
use echogrid_topics::Received;
use ending::Ending;
pub use flow::{Place, consumers, onlookers, places, writers};
use janitor::{Janitor, Visitors};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;
use ports::Ports;
pub use run::{Event, Graph, Observer, Outcome, Progress};
use systemd::Systemd;
use unit::{Stage, Unit};

/// What a graph may take to save and leave when it is asked to.
const LEAVE_WITHIN: Duration = Duration::from_secs(10);
/// Between the last request and the kill.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// Progress is shown this often, and deadlines looked at.
const TICK: Duration = Duration::from_millis(100);
/// The rank from which services make something of what is measured, which may take long: after sensor and odometry.
const SLOW_FROM: usize = 2;

/// Runs a graph to its end.
///
/// # Errors
/// It could not be started. What goes wrong later is in the [`Outcome`].
pub fn run(mut graph: Graph<'_>, observer: &mut dyn Observer) -> Result<Outcome> {
    // Before any thread is started: threads inherit what is blocked.
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
    let ports = Ports::create(&mut graph)?;
    let graph = &graph;
    let (sender, lines) = channel();
    let now = Instant::now();
    // Upstream to downstream: the order in which they will be asked to stop.
    let places = places(graph.services);
    let place = |name: &String| places.get(name).copied().unwrap_or(Place { rank: 0, is_told: false });
    let mut units: Vec<Unit> =
        graph.services.iter().map(|(name, service)| Unit::new(name, service, place(name), now)).collect();
    units.sort_by_key(|unit| (unit.place.rank, unit.service.kind));
    let mut supervisor = Supervisor {
        units,
        writers: writers(graph.services),
        janitor: None,
        visitors: Visitors::default(),
        needs_janitor: false,
        graph,
        signals,
        lines,
        sender,
        clock: Clock::new(now),
        now,
        wall: (now, None),
        ready: None,
        first_output: None,
        ending: None,
        failed: None,
        waiting_since: None,
        winding_down: None,
        mark: Vec::new(),
        rebuilds: 0,
        systemd: Systemd::new(),
        outcome: Outcome::default(),
        ports,
    };
    supervisor.watch(observer)?;
    Ok(supervisor.finish(observer))
}

#[derive(Debug)]
struct Supervisor<'a> {
    // First: on an error the processes are killed before their domain is swept.
    units: Vec<Unit>,
    /// Who writes each topic.
    writers: BTreeMap<String, Vec<String>>,
    janitor: Option<Janitor>,
    visitors: Visitors,
    /// Somebody died since the janitor began.
    needs_janitor: bool,
    graph: &'a Graph<'a>,
    signals: Signals,
    lines: Receiver<Line>,
    sender: Sender<Line>,
    clock: Clock,
    /// What time it is for deadlines: the launcher's own.
    now: Instant,
    /// On the wall, for the summary: when it began, and when all were ready.
    wall: (Instant, Option<Instant>),
    ready: Option<Instant>,
    /// When the sensor was first known to have sent something.
    first_output: Option<Instant>,
    ending: Option<Ending>,
    /// The rank of the service farthest upstream that failed.
    failed: Option<usize>,
    /// Who waits in vain for something of the sensor, since when.
    waiting_since: Option<(Debt, Instant)>,
    /// Those downstream of this rank are asked to end, one rank after the other, as nobody upstream will tell them.
    winding_down: Option<usize>,
    /// How far all were when that was looked at last.
    mark: Vec<(u32, u64)>,
    rebuilds: u32,
    systemd: Systemd,
    outcome: Outcome,
    ports: Ports,
}

impl<'a> Supervisor<'a> {
    fn watch(&mut self, observer: &mut dyn Observer) -> Result<()> {
        while self.units.iter().any(Unit::is_here) {
            self.start_who_is_due(observer)?;
            self.wait()?;
            self.now = self.clock.look(Instant::now());
            self.take_signals(observer)?;
            self.take_messages()?;
            if self.ready.is_none() && self.units.iter().all(Unit::is_ready) {
                self.ready = Some(self.now);
                self.wall.1 = Some(Instant::now());
                self.systemd.ready();
                observer.event(&Event::Ready);
            }
            self.reap(observer)?;
            self.look_at_processes(observer);
            self.check_deadlines(observer)?;
            self.look_at_the_janitor(observer)?;
            self.hurry();
            self.wind_down();
            self.release_those_not_told();
            self.systemd.watchdog();
            self.show(observer);
        }
        Ok(())
    }

    /// Starts the services whose time has come, once nothing is left of their dead.
    fn start_who_is_due(&mut self, observer: &mut dyn Observer) -> Result<()> {
        if self.janitor.is_some() || self.needs_janitor {
            return Ok(());
        }
        let now = self.now;
        let gone: Vec<&str> = self
            .units
            .iter()
            .filter(|unit| matches!(unit.stage, Stage::Done | Stage::Lost))
            .map(|unit| unit.name.as_str())
            .collect();
        let gone = gone.join(",");
        let environment = logging_environment(self.graph.log_filter, self.graph.log_json);
        let domain = self.graph.domain.name();
        for unit in self.units.iter_mut().filter(|unit| matches!(unit.stage, Stage::Waiting(due) if due <= now)) {
            let process = Process::start(&unit.name, &unit.service, domain, &gone, &environment, &self.sender, now)?;
            observer.event(&Event::Started { name: &unit.name, pid: process.pid() });
            unit.process = Some(process);
            unit.stage = Stage::Alive;
        }
        Ok(())
    }

    fn wait(&self) -> Result<()> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![self.signals.fd()];
        fds.extend([self.ports.health.fd(), self.ports.info.fd()].into_iter().flatten());
        fds.extend(self.units.iter().filter_map(Unit::alive).map(Process::fd));
        fds.extend(self.janitor.as_ref().map(Janitor::fd));
        let mut fds: Vec<PollFd<'_>> = fds.into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        let now = self.now;
        let due = self.units.iter().filter_map(|unit| match unit.stage {
            Stage::Waiting(due) => Some(due.saturating_duration_since(now)),
            _ => None,
        });
        // While the janitor is at work its end is what to wait for.
        let due = due.min().filter(|_| self.janitor.is_none());
        let patience = due.unwrap_or(TICK).min(TICK).as_micros().div_ceil(1000);
        match poll(&mut fds, PollTimeout::from(patience as u16)) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => Err(errno).context("waiting for the services"),
        }
    }

    fn take_signals(&mut self, observer: &mut dyn Observer) -> Result<()> {
        while let Some(caught) = self.signals.next()? {
            self.systemd.stopping();
            if self.outcome.stopped {
                // The second time: now.
                self.outcome.abandoned = true;
                let (asked, within) = (self.now, Duration::ZERO);
                self.ending = Some(Ending { asked, within, deadline: asked, pressed: 2 });
            } else {
                self.outcome.stopped = true;
                observer.event(&Event::Stopping { signal: caught.signal.as_str() });
                self.end(LEAVE_WITHIN);
            }
        }
        Ok(())
    }

    fn take_messages(&mut self) -> Result<()> {
        self.ports.health.hush()?;
        let mut newcomers = false;
        while let Some(received) = self.ports.health.receive()? {
            let Received::Message(_, health) = received else { continue };
            if let Some(unit) = self.units.iter_mut().find(|unit| unit.name == health.service) {
                let first_ns = Some(health.first_stamp_ns).filter(|first_ns| *first_ns > 0);
                self.outcome.first_ns = self.outcome.first_ns.into_iter().chain(first_ns).min();
                newcomers |= unit.hear(health, self.now);
            }
        }
        if newcomers {
            self.tell_who_is_gone()?;
        }
        self.ports.info.hush()?;
        while let Some(received) = self.ports.info.receive()? {
            if let Received::Message(_, info) = received {
                self.outcome.map = Some(info);
            }
        }
        self.ports.world.hush()?;
        while let Some(received) = self.ports.world.receive()? {
            if let Received::Message(_, world) = received {
                self.outcome.world = Some(world);
            }
        }
        Ok(())
    }

    fn check_deadlines(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let now = self.now;
        while let Some((index, why)) = self.hanging() {
            if let Some(process) = self.units[index].alive_mut() {
                process.kill();
            }
            self.buried(index, &why, observer)?;
        }
        self.check_for_what_is_owed();
        let gets_on = self.ending.is_some() && self.gets_on();
        if let Some(ending) = self.ending.as_mut().filter(|ending| gets_on && ending.pressed == 0) {
            ending.deadline = ending.deadline.max(now + ending.within);
        }
        let Some(ending) = self.ending.as_mut().filter(|ending| now >= ending.deadline) else { return Ok(()) };
        ending.deadline = now + LAST_WORDS;
        ending.pressed += 1;
        let kill = ending.pressed > 2;
        for unit in &mut self.units {
            if matches!(unit.stage, Stage::Waiting(_)) {
                unit.stage = Stage::Lost;
            }
            let name = unit.name.clone();
            let Some(process) = unit.alive_mut() else { continue };
            if kill {
                self.outcome.killed.push(name);
                process.kill();
                unit.stage = Stage::Lost;
            } else {
                process.ask_to_stop();
            }
        }
        Ok(())
    }

    fn show(&mut self, observer: &mut dyn Observer) {
        while let Ok(line) = self.lines.try_recv() {
            observer.line(&line.name, &line.text);
        }
        let sensor = self.units.iter().find(|unit| unit.is_source());
        let ready = self.units.iter().filter(|unit| unit.is_ready()).count();
        let is_over = self.ending.is_some() || sensor.is_some_and(Unit::has_ended);
        let finishing = self.units.iter().rev().filter(|unit| is_over && unit.is_here());
        // Those upstream wait for those downstream.
        let finishing = finishing.filter(|unit| unit.place.rank >= SLOW_FROM).map(|unit| unit.name.as_str());
        observer.progress(&Progress {
            finishing: finishing.collect(),
            sensor: sensor.and_then(|unit| unit.health.as_ref()),
            ready: (ready, self.units.len()),
        });
    }

    fn finish(mut self, observer: &mut dyn Observer) -> Outcome {
        // What was said last; an error of reading it is not worth losing the outcome for.
        let _ = self.take_messages();
        // Ends when the processes' ends of the pipes are closed, which they are.
        drop(std::mem::replace(&mut self.sender, channel().0));
        while let Ok(line) = self.lines.recv_timeout(TICK) {
            observer.line(&line.name, &line.text);
        }
        let now = Instant::now();
        let ready = self.wall.1.unwrap_or(now);
        self.outcome.startup = ready.saturating_duration_since(self.wall.0);
        self.outcome.elapsed = now.saturating_duration_since(ready);
        for unit in &mut self.units {
            if unit.restarts > 0 {
                self.outcome.restarts.insert(unit.name.clone(), unit.restarts);
            }
            if let Some(health) = unit.health.take() {
                self.outcome.health.insert(unit.name.clone(), health);
            }
        }
        std::mem::take(&mut self.outcome)
    }
}
