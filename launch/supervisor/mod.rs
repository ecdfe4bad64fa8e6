//! A graph of processes, from claim to sweep.
//!
//! The supervisor owns the domain, starts every service as a process of its own, listens to their health and watches over them.
//! What is done about who dies, hangs or is to end is decided in `echogrid_supervision`, which knows no processes; here it is
//! carried out.

mod child;
mod janitor;
mod ports;
mod run;
mod systemd;
mod usage;

use std::collections::BTreeMap;
use std::os::fd::BorrowedFd;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use child::{Line, ServiceProcess, logging_environment};
use echogrid_service::signals::Signals;
pub use echogrid_supervision::Event;
use echogrid_supervision::{Clock, Role, SLOW_FROM, Settings, Stage, Supervision, Unit};
use echogrid_topics::{Health, Received, ServiceState};
use janitor::{Cleaned, Janitor, Visitors};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;
use ports::Ports;
pub use run::{Graph, Observer, Outcome, Progress};
use systemd::Systemd;

/// Signals that follow each other this fast are one word: `timeout` and others signal a process and then its group.
const ONE_WORD: Duration = Duration::from_millis(200);
/// Progress is shown this often, and deadlines looked at.
const TICK: Duration = Duration::from_millis(100);

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
    let mut supervisor = Supervisor {
        services: Supervision::new(&roles(graph), settings(graph), now),
        janitor: None,
        visitors: Visitors::default(),
        graph,
        signals,
        asked: None,
        lines,
        sender,
        clock: Clock::new(now),
        wall: (now, None),
        systemd: Systemd::new(),
        outcome: Outcome::default(),
        ports,
    };
    supervisor.watch(observer)?;
    Ok(supervisor.finish(observer))
}

/// What each service is to the graph, in the order of their kinds.
fn roles(graph: &Graph<'_>) -> Vec<(String, Role)> {
    let mut services: Vec<_> = graph.services.iter().collect();
    services.sort_by_key(|(_, service)| service.kind);
    let roles = services.into_iter().map(|(name, service)| {
        let care = &service.care;
        (name.clone(), Role { wiring: service.wiring.clone(), restart: care.restart, required: care.required })
    });
    roles.collect()
}

fn settings(graph: &Graph<'_>) -> Settings {
    Settings {
        config: graph.supervision.clone(),
        alive_within: graph.alive_within,
        ready_within: graph.ready_within,
        is_resumable: graph.plan.synced,
        consumers: graph.plan.consumers.clone(),
    }
}

#[derive(Debug)]
struct Supervisor<'a> {
    // First: on an error the processes are killed before their domain is swept.
    services: Supervision<ServiceProcess>,
    janitor: Option<Janitor>,
    visitors: Visitors,
    graph: &'a Graph<'a>,
    signals: Signals,
    /// When the user asked to end last.
    asked: Option<Instant>,
    lines: Receiver<Line>,
    sender: Sender<Line>,
    /// The launcher's own time, for deadlines.
    clock: Clock,
    /// On the wall, for the summary: when it began, and when all were ready.
    wall: (Instant, Option<Instant>),
    systemd: Systemd,
    outcome: Outcome,
    ports: Ports,
}

impl Supervisor<'_> {
    fn watch(&mut self, observer: &mut dyn Observer) -> Result<()> {
        while !self.services.is_over() {
            self.start_who_is_due(observer)?;
            self.wait()?;
            self.services.is_now(self.clock.look(Instant::now()));
            self.take_signals(observer)?;
            self.take_messages()?;
            if self.services.has_become_ready() {
                self.wall.1 = Some(Instant::now());
                self.systemd.ready();
                observer.event(&Event::Ready);
            }
            let dead = self.services.reap()?;
            if !dead.is_empty() {
                // Their last words may still be on their way.
                self.take_messages()?;
            }
            let mut tell = |event: &Event<'_>| observer.event(event);
            self.services.bury(&dead, &mut tell);
            self.services.look(&mut tell);
            self.look_at_the_janitor(observer)?;
            self.mend()?;
            self.systemd.watchdog();
            self.show(observer);
        }
        Ok(())
    }

    /// Starts the services whose time has come, once nothing is left of their dead.
    fn start_who_is_due(&mut self, observer: &mut dyn Observer) -> Result<()> {
        if self.janitor.is_some() || self.services.is_unclean {
            return Ok(());
        }
        let gone = self.services.gone().collect::<Vec<_>>().join(",");
        let environment = logging_environment(self.graph.log_filter, self.graph.log_json);
        let domain = self.graph.domain.name();
        for index in self.services.due() {
            let name = &self.services.units[index].name;
            let Some(service) = self.graph.services.get(name) else { continue };
            let process = ServiceProcess::start(name, service, domain, &gone, &environment, &self.sender)?;
            observer.event(&Event::Started { name, pid: echogrid_supervision::Process::pid(&process) });
            self.services.started(index, process);
        }
        Ok(())
    }

    fn wait(&self) -> Result<()> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![self.signals.fd()];
        fds.extend([self.ports.health.fd(), self.ports.info.fd()].into_iter().flatten());
        fds.extend(self.services.units.iter().filter_map(Unit::alive).map(|life| life.process().fd()));
        fds.extend(self.janitor.as_ref().map(Janitor::fd));
        let mut fds: Vec<PollFd<'_>> = fds.into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        // While the janitor is at work its end is what to wait for.
        let due = self.services.next_due().filter(|_| self.janitor.is_none());
        let patience = due.map_or(TICK, |due| due.saturating_duration_since(self.services.now())).min(TICK);
        match poll(&mut fds, PollTimeout::from(patience.as_micros().div_ceil(1000) as u16)) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => Err(errno).context("waiting for the services"),
        }
    }

    fn take_signals(&mut self, observer: &mut dyn Observer) -> Result<()> {
        while let Some(caught) = self.signals.next()? {
            self.systemd.stopping();
            if is_same_word(&mut self.asked, Instant::now()) {
                continue;
            }
            if !self.services.stopped {
                observer.event(&Event::Stopping { signal: caught.signal.as_str() });
            }
            self.services.stop();
        }
        Ok(())
    }

    fn take_messages(&mut self) -> Result<()> {
        self.ports.health.hush()?;
        while let Some(received) = self.ports.health.receive()? {
            let Received::Message(_, health) = received else { continue };
            if self.graph.services.contains_key(&health.service) {
                let first_ns = Some(health.first_stamp_ns).filter(|first_ns| *first_ns > 0);
                self.outcome.first_ns = self.outcome.first_ns.into_iter().chain(first_ns).min();
                self.services.hear(health);
            }
        }
        self.tell_who_is_gone()?;
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

    /// Whoever waits for one that has left need not: it may have left before it could be heard.
    fn tell_who_is_gone(&mut self) -> Result<()> {
        for name in self.services.words() {
            self.ports.word.send(0, &Health::new(name, std::process::id(), ServiceState::Gone))?;
        }
        Ok(self.ports.word.ring()?)
    }

    fn look_at_the_janitor(&mut self, observer: &mut dyn Observer) -> Result<()> {
        match self.janitor.as_mut().map_or(Cleaned::Done, Janitor::look) {
            Cleaned::NotYet => return Ok(()),
            Cleaned::Done => self.janitor = None,
            Cleaned::Failed if self.janitor.as_ref().is_some_and(|janitor| !janitor.is_for_services) => {
                self.janitor = None;
            }
            Cleaned::Failed => {
                self.janitor = None;
                let mut tell = |event: &Event<'_>| observer.event(event);
                self.services.rebuild("what a dead process left could not be cleaned up", &mut tell);
            }
        }
        // Whoever comes next sweeps what is left of a graph that ends.
        let (domain, services) = (&self.graph.domain, &mut self.services);
        let is_anybody_due = services.next_due().is_some();
        if std::mem::take(&mut services.is_unclean) && is_anybody_due {
            self.janitor = Some(Janitor::start(domain, true)?);
        } else if !services.is_ending() {
            let processes = 1 + services.units.iter().filter(|unit| unit.stage == Stage::Alive).count();
            if self.visitors.may_be_dead(domain, processes, services.now()) {
                self.janitor = Some(Janitor::start(domain, false)?);
            }
        }
        Ok(())
    }

    /// Makes shared memory anew where that was decided, and tells who is gone.
    fn mend(&mut self) -> Result<()> {
        if std::mem::take(&mut self.services.is_broken) {
            self.janitor = None;
            self.ports.renew(self.graph)?;
        }
        self.tell_who_is_gone()
    }

    fn show(&mut self, observer: &mut dyn Observer) {
        while let Ok(line) = self.lines.try_recv() {
            observer.line(&line.name, &line.text);
        }
        let units = &self.services.units;
        let sensor = units.iter().find(|unit| unit.is_source());
        let ready = units.iter().filter(|unit| unit.is_ready()).count();
        let is_over = self.services.is_ending() || sensor.is_some_and(Unit::has_ended);
        let finishing = || units.iter().rev().filter(|unit| is_over && unit.is_here());
        // Those upstream wait for those downstream; but one of them may still be at work (SLAM), and the others wait for that.
        let works = |unit: &&Unit<_>| unit.health.as_ref().is_some_and(|health| health.waits_for.is_none());
        let upstream = finishing().filter(|unit| !unit.is_source() && unit.place.rank < SLOW_FROM).rfind(works);
        let downstream = finishing().filter(|unit| unit.place.rank >= SLOW_FROM);
        let finishing: Vec<&Unit<_>> = upstream.map_or_else(|| downstream.collect(), |unit| vec![unit]);
        observer.progress(&Progress {
            finishing: finishing.into_iter().map(|unit| unit.name.as_str()).collect(),
            sensor: sensor.and_then(|unit| unit.health.as_ref()),
            ready: (ready, units.len()),
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
        let services = &mut self.services;
        let units = services.units.iter_mut();
        let (mut restarts, mut heard) = (BTreeMap::new(), BTreeMap::new());
        for unit in units {
            if unit.restarts > 0 {
                restarts.insert(unit.name.clone(), unit.restarts);
            }
            heard.extend(unit.health.take().map(|health| (unit.name.clone(), health)));
        }
        Outcome {
            health: heard,
            stopped: services.stopped,
            abandoned: services.abandoned,
            startup: ready.saturating_duration_since(self.wall.0),
            elapsed: now.saturating_duration_since(ready),
            failures: std::mem::take(&mut services.failures),
            killed: std::mem::take(&mut services.killed),
            given_up: std::mem::take(&mut services.given_up),
            restarts,
            ..std::mem::take(&mut self.outcome)
        }
    }
}

/// Whether a signal that comes now belongs to the one before; that is `asked`, and then this.
fn is_same_word(asked: &mut Option<Instant>, now: Instant) -> bool {
    asked.replace(now).is_some_and(|asked| now.duration_since(asked) < ONE_WORD)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_at_once_are_one_word_and_a_second_press_is_another() {
        let (mut asked, begun) = (None, Instant::now());
        let mut comes = |millis| is_same_word(&mut asked, begun + Duration::from_millis(millis));
        assert_eq!([0, 1, 2, 202, 300, 1000].map(&mut comes), [false, true, true, false, true, false]);
    }
}
