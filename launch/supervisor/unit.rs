//! One service of the graph, over all its lives.

use std::collections::VecDeque;
use std::time::Instant;

use echogrid_topics::{Health, ServiceState};

use super::child::Process;
use super::flow::Place;
use crate::config::Service;

/// Starts in a row that found no graph to enter, after which the graph itself is taken for broken.
const FAILED_STARTS: u32 = 3;

/// Where a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// It is to be started then.
    Waiting(Instant),
    /// Its process runs.
    Alive,
    /// It has done all that it was there for.
    Done,
    /// It will not be started again.
    Lost,
}

/// A service of the graph.
#[derive(Debug)]
pub(super) struct Unit {
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) service: Service,
    pub(super) stage: Stage,
    /// The last of its lives.
    pub(super) process: Option<Process>,
    /// When it was restarted, as far as that counts.
    pub(super) recent: VecDeque<Instant>,
    pub(super) restarts: u32,
    /// The last thing heard of it, whichever life.
    pub(super) health: Option<Health>,
    failed_starts: u32,
    /// When it was last known to be ready, whichever life; before it ever was: when the graph began.
    pub(super) well: Instant,
}

impl Unit {
    pub(super) fn new(name: &str, service: &Service, place: Place, now: Instant) -> Self {
        Self {
            name: name.into(),
            place,
            well: now,
            service: service.clone(),
            stage: Stage::Waiting(now),
            process: None,
            recent: VecDeque::new(),
            restarts: 0,
            health: None,
            failed_starts: 0,
        }
    }

    /// Whether streams begin with it.
    pub(super) fn is_source(&self) -> bool {
        self.service.wiring.source
    }

    /// Whether there is or will be a process.
    pub(super) fn is_here(&self) -> bool {
        matches!(self.stage, Stage::Alive | Stage::Waiting(_))
    }

    /// Its process, while it runs.
    pub(super) fn alive(&self) -> Option<&Process> {
        self.process.as_ref().filter(|_| self.stage == Stage::Alive)
    }

    /// Likewise.
    pub(super) fn alive_mut(&mut self) -> Option<&mut Process> {
        self.process.as_mut().filter(|_| self.stage == Stage::Alive)
    }

    /// Whether its present life has said that it is ready.
    pub(super) fn is_ready(&self) -> bool {
        self.stage == Stage::Done || self.alive().is_some_and(Process::is_ready)
    }

    /// Whether its present life takes messages.
    pub(super) fn is_running(&self) -> bool {
        let health = self.alive().and_then(|process| process.health.as_ref());
        health.is_some_and(|health| health.state == ServiceState::Running)
    }

    /// Messages that its present life has taken in (a sensor: given out).
    pub(super) fn progress(&self) -> u64 {
        self.alive().and_then(|process| process.health.as_ref()).map_or(0, |health| health.progress)
    }

    /// Whether it has nothing more to send.
    pub(super) fn has_ended(&self) -> bool {
        self.stage == Stage::Done || self.health.as_ref().is_some_and(|health| health.state >= ServiceState::Draining)
    }

    /// Takes note of what it says of itself, if it is its present life that says it; whether it is the first word of that.
    pub(super) fn hear(&mut self, health: Health, now: Instant) -> bool {
        let Some(process) = self.process.as_mut().filter(|process| process.pid() == health.pid) else { return false };
        let is_first = process.health.is_none();
        process.hear(health.clone(), now);
        if process.is_ready() {
            (self.failed_starts, self.well) = (0, now);
        }
        self.health = Some(health);
        is_first
    }

    /// Takes note that a life ended before it had begun; whether that is the graph's fault.
    pub(super) fn failed_to_start(&mut self) -> bool {
        self.failed_starts += 1;
        if self.failed_starts < FAILED_STARTS {
            return false;
        }
        self.failed_starts = 0;
        true
    }

    /// How its last life ended, for people.
    pub(super) fn end(&self) -> String {
        self.process.as_ref().map(Process::end).unwrap_or_default()
    }
}
