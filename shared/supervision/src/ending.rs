//! How a graph is ended: the stream at its source, then those downstream, one after the other.

use std::time::{Duration, Instant};

use echogrid_service::mutants::Mutant;
use echogrid_topics::Topic;

use crate::life::{Life, Process};
use crate::unit::{Stage, Unit};
use crate::{LAST_WORDS, LEAVE_WITHIN, SLOW_FROM, Supervision};

/// What those downstream of a service that failed may take to save and leave.
const LEAVE_AFTER_FAILURE: Duration = Duration::from_secs(5);

/// Why the graph is ending, and how far it has been pressed.
#[derive(Debug)]
pub(crate) struct Ending {
    pub(crate) asked: Instant,
    /// When somebody was last seen to wait for what one upstream is still working on.
    pub(crate) worked: Option<Instant>,
    /// What all may take from one step forward to the next.
    pub(crate) within: Duration,
    pub(crate) deadline: Instant,
    pub(crate) pressed: u32,
}

impl<P: Process> Supervision<P> {
    /// Ends the stream at its source; the rest drains, saves and leaves by itself.
    pub(crate) fn end(&mut self, within: Duration) {
        self.leave_to_the_next_run();
        let mut nobody_tells = false;
        for unit in self.units.iter_mut().filter(|unit| unit.is_source()) {
            let is_here = unit.is_here();
            match unit.alive_mut() {
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
        self.ending.get_or_insert(Ending { asked, worked: None, within, deadline, pressed: 0 });
    }

    /// After a failure a spooled run is to be resumed: nobody is to think that a stream has ended, and those that are not
    /// downstream of who failed are gone on from what they have stored.
    fn leave_to_the_next_run(&mut self) {
        let Some(failed) = self.failed.filter(|_| self.settings.is_resumable) else { return };
        let is_left = |unit: &&mut Unit<P>| {
            unit.is_source() || (unit.place.is_told && unit.place.rank <= failed && !Mutant::ForgetsTheGivenUp.lives())
        };
        for unit in self.units.iter_mut().filter(is_left) {
            if let Some(life) = unit.alive_mut() {
                life.kill();
                unit.stage = Stage::Lost;
            }
        }
    }

    /// A service of this rank is no more, and nobody downstream will hear the end of its streams.
    pub(crate) fn end_after_failure(&mut self, rank: usize) {
        self.failed = Some(self.failed.map_or(rank, |failed| failed.min(rank)));
        self.winding_down = self.failed;
        self.end(LEAVE_AFTER_FAILURE);
    }

    /// Who stopped the graph does not want to wait until a slow mapper has taken in all that was on its way to it.
    pub(crate) fn hurry(&mut self) {
        let Some(ending) = self.ending.as_ref().filter(|_| self.failed.is_none() && self.winding_down.is_none()) else {
            return;
        };
        let sensor_runs = self.units.iter().any(|unit| unit.is_source() && unit.is_running());
        let since = ending.worked.unwrap_or(ending.asked);
        if sensor_runs || self.now.saturating_duration_since(since) < LEAVE_WITHIN {
            return;
        }
        // Who only gives on what comes to it is through with it soon; those that make something of it may be slow. Whoever answers those
        // upstream goes on doing so until they have left: they would wait for it in vain.
        let slow = |unit: &&Unit<P>| unit.is_here() && unit.place.is_told && unit.place.rank >= SLOW_FROM;
        let (answering, others): (Vec<_>, Vec<_>) =
            self.units.iter().filter(slow).partition(|unit| !self.asks(unit).is_empty());
        let next: Vec<String> = match others.iter().map(|unit| unit.place.rank).min() {
            Some(rank) => {
                others.into_iter().filter(|unit| unit.place.rank == rank).map(|unit| unit.name.clone()).collect()
            }
            None => {
                let asking = answering.iter().flat_map(|unit| self.asks(unit)).filter(|unit| unit.is_here());
                let asking: Vec<String> = asking.map(|unit| unit.name.clone()).collect();
                if asking.is_empty() { answering.into_iter().map(|unit| unit.name.clone()).collect() } else { asking }
            }
        };
        // Who has nothing to do until one upstream is through with its work (SLAM, at the end) is not the one that is slow: asked now, it
        // would leave without what that comes to.
        if self.units.iter().any(|unit| next.contains(&unit.name) && self.waits_for_work(unit)) {
            let now = self.now;
            self.ending.iter_mut().for_each(|ending| ending.worked = Some(now));
            return;
        }
        let here = self.units.iter_mut().filter(|unit| unit.is_here() && next.contains(&unit.name));
        here.filter(|unit| unit.is_running()).filter_map(Unit::alive_mut).for_each(Life::ask_once);
    }

    /// Whether a service waits for what one upstream that is no sensor has still to give, and that one is at work; or waits, in turn, for
    /// whoever answers it, and is at work.
    fn waits_for_work(&self, of: &Unit<P>) -> bool {
        let waits_for = |unit: &Unit<P>| unit.alive().and_then(|life| life.health.as_ref()?.waits_for);
        let (mut waiting, mut met) = (vec![of], vec![of.name.as_str()]);
        while let Some(unit) = waiting.pop() {
            let topic = waits_for(unit);
            let writers = topic.and_then(|topic| self.writers.get(topic.name())).map_or(&[][..], Vec::as_slice);
            let is_writer = |other: &&Unit<P>| {
                let answers = || !self.asks(other).is_empty();
                writers.contains(&other.name)
                    && !other.is_source()
                    && (other.place.rank < of.place.rank || answers())
                    && other.is_here()
            };
            for writer in self.units.iter().filter(is_writer) {
                if self.is_at_work(writer) {
                    return true;
                }
                if !met.contains(&writer.name.as_str()) {
                    met.push(&writer.name);
                    waiting.push(writer);
                }
            }
        }
        false
    }

    /// Whether a service waits for nobody, as it says; or, of one that answers others, uses the processor: what it said last was before it
    /// was asked.
    fn is_at_work(&self, unit: &Unit<P>) -> bool {
        let Some((life, health)) = unit.alive().and_then(|life| Some((life, life.health.as_ref()?))) else {
            return false;
        };
        health.waits_for.is_none() || life.signs.is_excused() && !self.asks(unit).is_empty()
    }

    /// Those upstream of a service that read what it writes: they ask, and it answers.
    fn asks(&self, of: &Unit<P>) -> Vec<&Unit<P>> {
        let written =
            self.writers.iter().filter(|(topic, names)| *topic != Topic::Health.name() && names.contains(&of.name));
        let readers = written.filter_map(|(topic, _)| self.settings.consumers.get(topic)).flatten();
        let upstream = |unit: &&Unit<P>| !unit.is_source() && unit.place.rank < of.place.rank;
        readers.filter_map(|name| self.units.iter().find(|unit| unit.name == *name)).filter(upstream).collect()
    }

    /// Those that no stream tells of its end are asked to end when all the others have: one after the other, as what one of
    /// them writes another may read.
    pub(crate) fn release_those_not_told(&mut self) {
        let is_over = !self.units.iter().any(|unit| unit.place.is_told && unit.is_here());
        if !is_over || !self.units.iter().any(Unit::is_here) {
            return;
        }
        let (asked, within) = (self.now, LEAVE_WITHIN);
        self.ending.get_or_insert(Ending { asked, worked: None, within, deadline: asked + within, pressed: 0 });
        for unit in self.units.iter_mut().filter(|unit| matches!(unit.stage, Stage::Waiting(_))) {
            unit.stage = Stage::Lost;
        }
        let next = self.units.iter().filter(|unit| unit.is_here()).map(|unit| unit.place.rank).min();
        let next = self.units.iter_mut().filter(|unit| Some(unit.place.rank) == next);
        next.filter_map(Unit::alive_mut).for_each(Life::ask_once);
    }

    /// When nobody upstream will tell them, those downstream save what they have. They are asked one after the other: who
    /// is asked has heard the last of whoever was before it.
    pub(crate) fn wind_down(&mut self) {
        // Of a robot that was never described nobody has heard what could end.
        let robot = self.writers.get(Topic::RobotDescription.name());
        let describes = |unit: &&Unit<P>| robot.is_some_and(|writers| writers.contains(&unit.name));
        let mut sources = self.units.iter().filter(|unit| unit.is_source()).filter(describes);
        if self.ending.is_some() && sources.any(|sensor| sensor.stage == Stage::Done && sensor.progress() == 0) {
            self.winding_down.get_or_insert(0);
        }
        let Some(from) = self.winding_down else { return };
        let downstream = self.units.iter().filter(|unit| unit.is_here() && unit.place.rank > from);
        if let Some(next) = downstream.map(|unit| unit.place.rank).min() {
            let next = self.units.iter_mut().filter(|unit| unit.place.rank == next);
            // Before it is ready a request would end it at once.
            let ready = next.filter(|unit| unit.is_ready() || self.failed.is_some());
            ready.filter_map(Unit::alive_mut).for_each(Life::ask_once);
        } else if let Some(ending) = self.ending.as_mut().filter(|ending| ending.pressed == 0) {
            // Those upstream wait in vain for the one that failed.
            ending.within = ending.within.min(LAST_WORDS);
            ending.deadline = ending.deadline.min(self.now + LAST_WORDS);
        }
    }
}
