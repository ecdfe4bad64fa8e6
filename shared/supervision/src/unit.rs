//! One service of the graph, over all its lives.

use std::collections::VecDeque;
use std::time::Instant;

use echogrid_topics::{Health, ServiceState};

use crate::Role;
use crate::flow::FlowPosition;
use crate::life::{Life, Process};

/// Starts in a row that found no graph to enter, after which the graph itself is taken for broken.
const FAILED_STARTS: u32 = 3;

/// Where a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// It is to be started then.
    Waiting(Instant),
    /// The process runs.
    Alive,
    /// It has done all that it was there for.
    Done,
    /// It will not be started again.
    Lost,
}

/// A service of the graph.
#[derive(Debug)]
pub struct Unit<P> {
    /// The name of the service in the graph.
    pub name: String,
    /// The place of the service in the flow of streams.
    pub place: FlowPosition,
    pub(crate) role: Role,
    /// The stage of its lives that the service is in.
    pub stage: Stage,
    /// The last of its lives.
    pub(crate) life: Option<Life<P>>,
    /// When it was restarted, as far as that counts.
    pub(crate) recent: VecDeque<Instant>,
    /// How often it was started again.
    pub restarts: u32,
    /// The last thing heard of it, whichever life.
    pub health: Option<Health>,
    failed_starts: u32,
    /// When it was last known to be ready, whichever life; before it ever was: when the graph began.
    pub(crate) well: Instant,
}

impl<P: Process> Unit<P> {
    pub(crate) fn new(name: &str, role: Role, place: FlowPosition, now: Instant) -> Self {
        Self {
            name: name.into(),
            place,
            well: now,
            role,
            stage: Stage::Waiting(now),
            life: None,
            recent: VecDeque::new(),
            restarts: 0,
            health: None,
            failed_starts: 0,
        }
    }

    /// Whether streams begin with it.
    pub fn is_source(&self) -> bool {
        self.role.wiring.source
    }

    /// Whether there is or will be a process.
    pub fn is_here(&self) -> bool {
        matches!(self.stage, Stage::Alive | Stage::Waiting(_))
    }

    /// The life of the service, while it runs.
    pub fn alive(&self) -> Option<&Life<P>> {
        self.life.as_ref().filter(|_| self.stage == Stage::Alive)
    }

    /// The life of the service, to be changed, while it runs.
    pub fn alive_mut(&mut self) -> Option<&mut Life<P>> {
        self.life.as_mut().filter(|_| self.stage == Stage::Alive)
    }

    /// Whether its present life has said that it is ready.
    pub fn is_ready(&self) -> bool {
        self.stage == Stage::Done || self.alive().is_some_and(Life::is_ready)
    }

    /// Whether its present life takes messages.
    pub(crate) fn is_running(&self) -> bool {
        let health = self.alive().and_then(|life| life.health.as_ref());
        health.is_some_and(|health| health.state == ServiceState::Running)
    }

    /// Messages that its present life has taken in (a sensor: given out).
    pub(crate) fn progress(&self) -> u64 {
        self.alive().and_then(|life| life.health.as_ref()).map_or(0, |health| health.progress)
    }

    /// Whether it has nothing more to send.
    pub fn has_ended(&self) -> bool {
        self.stage == Stage::Done || self.health.as_ref().is_some_and(|health| health.state >= ServiceState::Draining)
    }

    /// Whether it said that it was done with all that it was there for.
    pub(crate) fn is_finished(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state == ServiceState::Finished)
    }

    /// Takes note of what it says of itself, if it is its present life that says it; whether it is the first word of that, or the last.
    pub(crate) fn hear(&mut self, health: Health, now: Instant) -> bool {
        let Some(life) = self.life.as_mut().filter(|life| life.pid() == health.pid) else { return false };
        let (is_first, was_finished) = (life.health.is_none(), life.is_finished());
        life.hear(health.clone(), now);
        let is_last = life.is_finished() && !was_finished;
        if life.is_ready() {
            (self.failed_starts, self.well) = (0, now);
        }
        self.health = Some(health);
        is_first || is_last
    }

    /// Takes note that a life ended before it had begun; whether that is the graph's fault.
    pub(crate) fn failed_to_start(&mut self) -> bool {
        self.failed_starts += 1;
        if self.failed_starts < FAILED_STARTS {
            return false;
        }
        self.failed_starts = 0;
        true
    }

    /// How its last life ended, for people.
    pub(crate) fn how(&self) -> String {
        self.life.as_ref().map(Life::how).unwrap_or_default()
    }
}
