//! A graph of processes, from claim to sweep.
//!
//! The supervisor owns the domain, starts every service as a process of its own, listens to their
//! health, starts again who dies or hangs, and ends them all: upstream to downstream when the stream ends
//! or the user asks, at once when one of them is given up and nothing more can come.

mod child;
mod clock;
mod deadlines;
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
use echogrid_topics::{Health, Received, ServiceState};
pub use flow::{Place, consumers, onlookers, places, writers};
use janitor::{Cleaned, Janitor};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;
use policy::Decision;
use ports::Ports;
pub use run::{Event, Graph, Observer, Outcome, Progress};
use systemd::Systemd;
use unit::{Stage, Unit};

use crate::config::Strategy;

/// What a graph may take to save and leave when it is asked to.
const LEAVE_WITHIN: Duration = Duration::from_secs(10);
/// Likewise when a service failed, for those downstream of it.
const LEAVE_AFTER_FAILURE: Duration = Duration::from_secs(5);
/// Between the last request and the kill.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// Progress is shown this often, and deadlines looked at.
const TICK: Duration = Duration::from_millis(100);
/// The rank from which services make something of what is measured, which may take long: after sensor and odometry.
const SLOW_FROM: usize = 2;
/// A graph that needs to be made anew more often has something else wrong with it.
const REBUILDS_MAX: u32 = 3;

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

/// Why the graph is ending, and how far it has been pressed.
#[derive(Debug)]
struct Ending {
    asked: Instant,
    /// What all may take from one step forward to the next.
    within: Duration,
    deadline: Instant,
    pressed: u32,
}

#[derive(Debug)]
struct Supervisor<'a> {
    // First: on an error the processes are killed before their domain is swept.
    units: Vec<Unit>,
    /// Who writes each topic.
    writers: BTreeMap<String, Vec<String>>,
    janitor: Option<Janitor>,
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

    /// Ends the stream at its source; the rest drains, saves and leaves by itself.
    fn end(&mut self, within: Duration) {
        // After a failure a spooled run is to be resumed: nobody is to think that its stream has ended.
        let resumable = self.failed.is_some() && self.graph.plan.synced;
        let mut nobody_tells = false;
        for unit in self.units.iter_mut().filter(|unit| unit.is_source()) {
            let is_here = unit.is_here();
            match unit.alive_mut() {
                Some(process) if resumable => {
                    process.kill();
                    unit.stage = Stage::Lost;
                }
                Some(process) => process.ask_to_stop(),
                // It would begin anew, and nobody would ask it to end again.
                None if is_here => {
                    unit.stage = Stage::Lost;
                    nobody_tells = true;
                }
                None => {}
            }
        }
        // Who waits to be started again would come to an end.
        if self.failed.is_some() {
            self.units
                .iter_mut()
                .filter(|unit| matches!(unit.stage, Stage::Waiting(_)))
                .for_each(|unit| unit.stage = Stage::Lost);
        } else if nobody_tells {
            self.winding_down.get_or_insert(0);
        }
        let (asked, deadline) = (self.now, self.now + within);
        self.ending.get_or_insert(Ending { asked, within, deadline, pressed: 0 });
    }

    /// A service of this rank is no more, and nobody downstream will hear the end of its streams.
    fn end_after_failure(&mut self, rank: usize) {
        self.failed = Some(self.failed.map_or(rank, |failed| failed.min(rank)));
        self.winding_down = self.failed;
        self.end(LEAVE_AFTER_FAILURE);
    }

    /// Who stopped the graph does not want to wait until a slow mapper has taken in all that was on its way to it.
    fn hurry(&mut self) {
        let Some(ending) = self.ending.as_ref().filter(|_| self.failed.is_none() && self.winding_down.is_none()) else {
            return;
        };
        let sensor_runs = self.units.iter().any(|unit| unit.is_source() && unit.is_running());
        if sensor_runs || self.now.saturating_duration_since(ending.asked) < LEAVE_WITHIN {
            return;
        }
        // Who only gives on what comes to it is through with it soon; those that make something of it may be slow.
        let is_slow = |unit: &&mut Unit| unit.is_here() && unit.place.is_told && unit.place.rank >= SLOW_FROM;
        let Some(next) = self.units.iter_mut().filter(is_slow).map(|unit| unit.place.rank).min() else { return };
        let here = self.units.iter_mut().filter(|unit| unit.is_here() && unit.place.rank == next);
        here.filter(|unit| unit.is_running()).filter_map(Unit::alive_mut).for_each(Process::ask_once);
    }

    /// Those that no stream tells of its end are asked to end when all the others have: one after the other, as what one of
    /// them writes another may read.
    fn release_those_not_told(&mut self) {
        let is_over = !self.units.iter().any(|unit| unit.place.is_told && unit.is_here());
        if !is_over || !self.units.iter().any(Unit::is_here) {
            return;
        }
        let (asked, within) = (self.now, LEAVE_WITHIN);
        self.ending.get_or_insert(Ending { asked, within, deadline: asked + within, pressed: 0 });
        for unit in self.units.iter_mut().filter(|unit| matches!(unit.stage, Stage::Waiting(_))) {
            unit.stage = Stage::Lost;
        }
        let next = self.units.iter().filter(|unit| unit.is_here()).map(|unit| unit.place.rank).min();
        let next = self.units.iter_mut().filter(|unit| Some(unit.place.rank) == next);
        next.filter_map(Unit::alive_mut).for_each(Process::ask_once);
    }

    /// When nobody upstream will tell them, those downstream save what they have. They are asked one after the other: who
    /// is asked has heard the last of whoever was before it.
    fn wind_down(&mut self) {
        let Some(from) = self.winding_down else { return };
        let downstream = self.units.iter().filter(|unit| unit.is_here() && unit.place.rank > from);
        if let Some(next) = downstream.map(|unit| unit.place.rank).min() {
            let next = self.units.iter_mut().filter(|unit| unit.place.rank == next);
            // Before it is ready a request would end it at once.
            let ready = next.filter(|unit| unit.is_ready() || self.failed.is_some());
            ready.filter_map(Unit::alive_mut).for_each(Process::ask_once);
        } else if let Some(ending) = self.ending.as_mut().filter(|ending| ending.pressed == 0) {
            // Those upstream wait in vain for the one that failed.
            ending.within = ending.within.min(LAST_WORDS);
            ending.deadline = ending.deadline.min(self.now + LAST_WORDS);
        }
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

    fn reap(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let mut dead = Vec::new();
        for (index, unit) in self.units.iter_mut().enumerate() {
            if unit.alive_mut().map_or(Ok(false), Process::reap)? {
                dead.push(index);
            }
        }
        if !dead.is_empty() {
            // Their last words may still be on their way.
            self.take_messages()?;
        }
        for index in dead {
            let how = self.units[index].end();
            self.buried(index, &how, observer)?;
        }
        Ok(())
    }

    /// What comes after the death of a service.
    fn buried(&mut self, index: usize, why: &str, observer: &mut dyn Observer) -> Result<()> {
        let graph = self.graph;
        let unit = &mut self.units[index];
        observer.event(&Event::Ended { name: &unit.name, how: why.to_owned() });
        if unit.process.as_ref().is_some_and(|process| process.succeeded(unit.is_source())) {
            unit.stage = Stage::Done;
            return self.tell_who_is_gone();
        }
        if !unit.place.is_told
            && unit.process.as_ref().is_some_and(|process| process.asked > 0 && process.was_terminated())
        {
            // Nobody waits for it, and it went when it was asked.
            (unit.stage, self.needs_janitor) = (Stage::Done, true);
            return self.tell_who_is_gone();
        }
        self.needs_janitor = true;
        let found_no_graph = unit.process.as_ref().is_some_and(Process::found_no_graph) && unit.failed_to_start();
        let restart = unit.service.care.restart;
        if self.ending.is_some()
            && self.failed.is_none()
            && unit.is_source()
            && unit.process.as_ref().is_some_and(Process::was_terminated)
        {
            // Whoever stopped the graph told everybody (`systemctl kill`): what it had given is what there is.
            unit.stage = Stage::Lost;
            self.winding_down.get_or_insert(0);
            return self.tell_who_is_gone();
        }
        // Until all is saved, those who are to save it are needed.
        let is_over = self.ending.as_ref().is_some_and(|ending| {
            let is_needed = unit.place.is_told && !unit.is_source();
            self.failed.is_some() || ending.pressed > 0 || !is_needed || self.outcome.abandoned
        });
        let decision = policy::decide(graph.supervision, restart, is_over, &mut unit.recent, unit.well, self.now);
        match decision {
            Decision::Restart(..) if unit.process.as_ref().is_some_and(Process::failed_in_vain) => {
                self.given_up(index, why, String::new(), observer)?;
            }
            Decision::Restart(after, number) => {
                unit.restarts += 1;
                observer.event(&Event::Restarting { name: &unit.name, why, number, after });
                let due = self.now + after;
                unit.stage = Stage::Waiting(due);
                if graph.supervision.strategy == Strategy::RestForOne {
                    self.restart_downstream(index, due);
                }
                if found_no_graph {
                    self.rebuild("a service could not enter the graph three times in a row", observer)?;
                }
            }
            Decision::GiveUp(policy) => {
                let policy =
                    if restart == crate::config::Restart::Never { String::new() } else { format!("; {policy}") };
                self.given_up(index, why, policy, observer)?;
            }
            Decision::Leave => {
                unit.stage = Stage::Lost;
                // Who was pressed to leave is a consequence, not a cause.
                if self.ending.as_ref().is_none_or(|ending| ending.pressed == 0) {
                    self.outcome.failures.push(format!("{}: {why}", unit.name));
                }
                let rank = unit.place.rank;
                self.end_after_failure(rank);
            }
        }
        Ok(())
    }

    /// A service is not started again; the graph goes on without it if it can.
    fn given_up(&mut self, index: usize, why: &str, policy: String, observer: &mut dyn Observer) -> Result<()> {
        let unit = &mut self.units[index];
        unit.stage = Stage::Lost;
        if !unit.service.care.required {
            return self.go_on_without(index, why, observer);
        }
        self.outcome.failures.push(format!("{}: {why}{policy}", unit.name));
        let rank = unit.place.rank;
        self.end_after_failure(rank);
        Ok(())
    }

    /// The strategy `rest_for_one`: what is derived from a service begins where it does.
    fn restart_downstream(&mut self, index: usize, due: Instant) {
        let rank = self.units[index].place.rank;
        for unit in self.units.iter_mut().filter(|unit| unit.place.rank > rank && unit.place.is_told) {
            if let Some(process) = unit.alive_mut() {
                process.kill();
                unit.stage = Stage::Waiting(due);
            }
        }
    }

    /// Nobody is to wait for a service that is given up.
    fn go_on_without(&mut self, index: usize, why: &str, observer: &mut dyn Observer) -> Result<()> {
        let name = &self.units[index].name;
        observer.event(&Event::GivenUp { name, why });
        self.outcome.given_up.push(format!("{name}: {why}"));
        self.tell_who_is_gone()
    }

    /// Whoever waits for one that has left need not: it may have left before it could be heard.
    fn tell_who_is_gone(&mut self) -> Result<()> {
        for unit in self.units.iter().filter(|unit| matches!(unit.stage, Stage::Done | Stage::Lost)) {
            let gone = Health::new(unit.name.clone(), std::process::id(), ServiceState::Gone);
            self.ports.word.send(0, &gone)?;
        }
        Ok(self.ports.word.ring()?)
    }

    fn look_at_the_janitor(&mut self, observer: &mut dyn Observer) -> Result<()> {
        match self.janitor.as_mut().map_or(Cleaned::Done, Janitor::look) {
            Cleaned::NotYet => return Ok(()),
            Cleaned::Done => self.janitor = None,
            Cleaned::Failed => {
                self.janitor = None;
                self.rebuild("what a dead process left could not be cleaned up", observer)?;
            }
        }
        // Whoever comes next sweeps what is left of a graph that ends.
        if std::mem::take(&mut self.needs_janitor) && self.units.iter().any(|u| matches!(u.stage, Stage::Waiting(_))) {
            self.janitor = Some(Janitor::start(self.graph.domain.name())?);
        }
        Ok(())
    }

    /// Makes the shared memory of the graph anew: what was stored of each service is elsewhere.
    fn rebuild(&mut self, why: &str, observer: &mut dyn Observer) -> Result<()> {
        self.rebuilds += 1;
        if self.rebuilds > REBUILDS_MAX || self.ending.is_some() {
            self.outcome.failures.push(format!("the graph's shared memory is broken: {why}"));
            self.end_after_failure(0);
            return Ok(());
        }
        observer.event(&Event::Rebuilt { why });
        let now = self.now;
        for unit in &mut self.units {
            if let Some(process) = unit.alive_mut() {
                process.kill();
                unit.stage = Stage::Waiting(now);
            }
        }
        (self.janitor, self.needs_janitor) = (None, false);
        self.ports.renew(self.graph)
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
