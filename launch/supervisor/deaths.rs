//! What comes after the death of a service: another life, an end of the graph, or the graph without it; and shared memory made
//! anew where the dead broke it.

use std::time::Instant;

use anyhow::Result;
use echogrid_topics::{Health, ServiceState};

use super::Supervisor;
use super::child::Process;
use super::janitor::{Cleaned, Janitor};
use super::policy::{self, Decision};
use super::run::{Event, Observer};
use super::unit::Stage;
use crate::config::{Restart, Strategy};

/// A graph that needs to be made anew more often has something else wrong with it.
const REBUILDS_MAX: u32 = 3;

impl Supervisor<'_> {
    pub(super) fn reap(&mut self, observer: &mut dyn Observer) -> Result<()> {
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
    pub(super) fn buried(&mut self, index: usize, why: &str, observer: &mut dyn Observer) -> Result<()> {
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
                let policy = if restart == Restart::Never { String::new() } else { format!("; {policy}") };
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
    pub(super) fn given_up(
        &mut self,
        index: usize,
        why: &str,
        policy: String,
        observer: &mut dyn Observer,
    ) -> Result<()> {
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
    pub(super) fn restart_downstream(&mut self, index: usize, due: Instant) {
        let rank = self.units[index].place.rank;
        for unit in self.units.iter_mut().filter(|unit| unit.place.rank > rank && unit.place.is_told) {
            if let Some(process) = unit.alive_mut() {
                process.kill();
                unit.stage = Stage::Waiting(due);
            }
        }
    }

    /// Nobody is to wait for a service that is given up.
    pub(super) fn go_on_without(&mut self, index: usize, why: &str, observer: &mut dyn Observer) -> Result<()> {
        let name = &self.units[index].name;
        observer.event(&Event::GivenUp { name, why });
        self.outcome.given_up.push(format!("{name}: {why}"));
        self.tell_who_is_gone()
    }

    /// Whoever waits for one that has left need not: it may have left before it could be heard.
    pub(super) fn tell_who_is_gone(&mut self) -> Result<()> {
        for unit in self.units.iter().filter(|unit| matches!(unit.stage, Stage::Done | Stage::Lost)) {
            let gone = Health::new(unit.name.clone(), std::process::id(), ServiceState::Gone);
            self.ports.word.send(0, &gone)?;
        }
        Ok(self.ports.word.ring()?)
    }

    pub(super) fn look_at_the_janitor(&mut self, observer: &mut dyn Observer) -> Result<()> {
        match self.janitor.as_mut().map_or(Cleaned::Done, Janitor::look) {
            Cleaned::NotYet => return Ok(()),
            Cleaned::Done => self.janitor = None,
            Cleaned::Failed if self.janitor.as_ref().is_some_and(|janitor| !janitor.is_for_services) => {
                self.janitor = None;
            }
            Cleaned::Failed => {
                self.janitor = None;
                self.rebuild("what a dead process left could not be cleaned up", observer)?;
            }
        }
        // Whoever comes next sweeps what is left of a graph that ends.
        let domain = &self.graph.domain;
        if std::mem::take(&mut self.needs_janitor) && self.units.iter().any(|u| matches!(u.stage, Stage::Waiting(_))) {
            self.janitor = Some(Janitor::start(domain, true)?);
        } else if self.ending.is_none() {
            let processes = 1 + self.units.iter().filter(|unit| unit.stage == Stage::Alive).count();
            if self.visitors.may_be_dead(domain, processes, self.now) {
                self.janitor = Some(Janitor::start(domain, false)?);
            }
        }
        Ok(())
    }

    /// Makes the shared memory of the graph anew: what was stored of each service is elsewhere.
    pub(super) fn rebuild(&mut self, why: &str, observer: &mut dyn Observer) -> Result<()> {
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
}
