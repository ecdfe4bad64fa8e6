//! What comes after the death of a service: another life, an end of the graph, or the graph without it; and shared memory made
//! anew where the dead broke it.

use std::time::Instant;

use anyhow::Result;
use echogrid_topics::{Delivery, Topic};

use crate::config::{Restart, Strategy};
use crate::event::Event;
use crate::life::{Life, Process};
use crate::policy::{self, Decision};
use crate::unit::Stage;
use crate::{Supervision, Tell};

/// A graph that needs to be made anew more often has something else wrong with it.
const REBUILDS_MAX: u32 = 3;

impl<P: Process> Supervision<P> {
    /// The services whose processes have ended since this was asked last. Their last words may still be on their way: hear them
    /// before [`Supervision::bury`].
    ///
    /// # Errors
    /// The system does not say.
    pub fn reap(&mut self) -> Result<Vec<usize>> {
        let mut dead = Vec::new();
        for (index, unit) in self.units.iter_mut().enumerate() {
            if unit.alive_mut().map_or(Ok(false), Life::reap)? {
                dead.push(index);
            }
        }
        Ok(dead)
    }

    /// What comes after the deaths of these services.
    pub fn bury(&mut self, dead: &[usize], tell: Tell<'_>) {
        for index in dead {
            let how = self.units[*index].how();
            self.buried(*index, &how, tell);
        }
    }

    /// What comes after the death of a service.
    pub(crate) fn buried(&mut self, index: usize, why: &str, tell: Tell<'_>) {
        let unit = &mut self.units[index];
        tell(&Event::Ended { name: &unit.name, how: why.to_owned() });
        if unit.life.as_ref().is_some_and(|process| process.succeeded(unit.is_source())) {
            unit.stage = Stage::Done;
            self.has_news_of_gone = true;
            return;
        }
        if !unit.place.is_told
            && unit.life.as_ref().is_some_and(|process| process.asked > 0 && process.was_terminated())
        {
            // Nobody waits for it, and it went when it was asked.
            (unit.stage, self.is_unclean) = (Stage::Done, true);
            self.has_news_of_gone = true;
            return;
        }
        self.is_unclean = true;
        let found_no_graph = unit.life.as_ref().is_some_and(Life::found_no_graph) && unit.failed_to_start();
        let restart = unit.role.restart;
        if self.ending.is_some()
            && self.failed.is_none()
            && unit.is_source()
            && unit.life.as_ref().is_some_and(Life::was_terminated)
        {
            // Whoever stopped the graph told everybody (`systemctl kill`): what it had given is what there is.
            unit.stage = Stage::Lost;
            self.winding_down.get_or_insert(0);
            self.has_news_of_gone = true;
            return;
        }
        // Until all is saved, those who are to save it are needed.
        let is_over = self.ending.as_ref().is_some_and(|ending| {
            let is_needed = unit.place.is_told && !unit.is_source();
            self.failed.is_some() || ending.pressed > 0 || !is_needed || self.abandoned
        });
        let is_bereft = self.ending.is_some() && self.is_bereft(index);
        let unit = &mut self.units[index];
        let decision = policy::decide(&self.settings.config, restart, is_over, &mut unit.recent, unit.well, self.now);
        match decision {
            Decision::Restart(..) if unit.life.as_ref().is_some_and(Life::failed_in_vain) => {
                self.given_up(index, why, String::new(), tell);
            }
            Decision::Restart(..) if is_bereft => {
                let policy = "; who would tell it again what it had read has left by now".to_owned();
                self.given_up(index, why, policy, tell);
            }
            Decision::Restart(after, number) => {
                unit.restarts += 1;
                tell(&Event::Restarting { name: &unit.name, why, number, after });
                let due = self.now + after;
                unit.stage = Stage::Waiting(due);
                if self.settings.config.strategy == Strategy::RestForOne {
                    self.restart_downstream(index, due);
                }
                if found_no_graph {
                    self.rebuild("a service could not enter the graph three times in a row", tell);
                }
            }
            Decision::GiveUp(policy) => {
                let policy = if restart == Restart::Never { String::new() } else { format!("; {policy}") };
                self.given_up(index, why, policy, tell);
            }
            Decision::Leave => {
                unit.stage = Stage::Lost;
                // Who died of being pressed to leave is a consequence, not a cause; who failed meanwhile has not saved what it had.
                let is_pressed = self.ending.as_ref().is_some_and(|ending| ending.pressed > 0);
                if !is_pressed || !unit.life.as_ref().is_some_and(Life::was_terminated) {
                    self.failures.push(format!("{}: {why}", unit.name));
                }
                let rank = unit.place.rank;
                self.end_after_failure(rank);
            }
        }
    }

    /// Whether a service reads what is told anew to whoever comes, and who tells it has left before it was done: in a graph that
    /// ends early, those upstream leave first.
    fn is_bereft(&self, index: usize) -> bool {
        let reads = &self.units[index].role.wiring.reads;
        let relayed = Topic::ALL.into_iter().filter(|topic| topic.delivery() == Delivery::Relayed);
        let read = relayed.filter(|topic| reads.iter().any(|name| name == topic.name()));
        let mut writers = read.filter_map(|topic| self.writers.get(topic.name())).flatten();
        writers.any(|name| {
            let writer = self.units.iter().find(|unit| unit.name == *name);
            writer.is_some_and(|writer| !writer.is_here() && !writer.is_finished())
        })
    }

    /// A service is not started again; the graph goes on without it if it can.
    fn given_up(&mut self, index: usize, why: &str, policy: String, tell: Tell<'_>) {
        let unit = &mut self.units[index];
        unit.stage = Stage::Lost;
        if !unit.role.required {
            self.go_on_without(index, why, tell);
            return;
        }
        self.failures.push(format!("{}: {why}{policy}", unit.name));
        let rank = unit.place.rank;
        self.end_after_failure(rank);
    }

    /// The strategy `rest_for_one`: what is derived from a service begins where it does.
    fn restart_downstream(&mut self, index: usize, due: Instant) {
        let rank = self.units[index].place.rank;
        for unit in self.units.iter_mut().filter(|unit| unit.place.rank > rank && unit.place.is_told) {
            // Those upstream have heard that nobody comes after one that is done.
            if let Some(process) = unit.alive_mut().filter(|process| !process.is_finished()) {
                process.kill();
                unit.stage = Stage::Waiting(due);
            }
        }
    }

    /// Nobody is to wait for a service that is given up.
    fn go_on_without(&mut self, index: usize, why: &str, tell: Tell<'_>) {
        let name = &self.units[index].name;
        tell(&Event::GivenUp { name, why });
        self.given_up.push(format!("{name}: {why}"));
        self.has_news_of_gone = true;
    }

    /// Has the shared memory of the graph made anew: what was stored of each service is elsewhere.
    pub fn rebuild(&mut self, why: &str, tell: Tell<'_>) {
        self.rebuilds += 1;
        if self.rebuilds > REBUILDS_MAX || self.ending.is_some() {
            self.failures.push(format!("the graph's shared memory is broken: {why}"));
            self.end_after_failure(0);
            return;
        }
        tell(&Event::Rebuilt { why });
        let now = self.now;
        for unit in &mut self.units {
            if let Some(process) = unit.alive_mut() {
                process.kill();
                unit.stage = Stage::Waiting(now);
            }
        }
        (self.is_unclean, self.is_broken) = (false, true);
    }
}
