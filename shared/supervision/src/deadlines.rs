//! How it is known that a service hangs, or waits for what will never come.
//!
//! Being slow is no fault. Who works (uses the processor, reads, writes, wants to), is stopped by somebody, or waits for one
//! that does, has all the time it wants; and who waits for another is never the one to blame.

use std::time::{Duration, Instant};

use echogrid_topics::{Health, Topic};

use crate::event::Event;
use crate::life::Process;
use crate::unit::{Stage, Unit};
use crate::{Supervision, Tell};

/// For how long nobody may do anything while a service waits for what the sensor owes it: its end, or what robot it is.
const OWED_WITHIN: Duration = Duration::from_secs(5);
/// Somebody who says nothing for longer is busy, or hangs.
pub(crate) const SILENT_AFTER: Duration = Duration::from_secs(1);
/// How far it is looked for the one that others wait for.
const LONGEST_CHAIN: usize = 6;

impl<P: Process> Supervision<P> {
    /// Looks at every process, and says of each once if it is silent for a reason.
    pub(crate) fn look_at_processes(&mut self, tell: Tell<'_>) {
        let (now, alive_within) = (self.now, self.settings.alive_within);
        for unit in self.units.iter_mut().filter(|unit| unit.stage == Stage::Alive) {
            let Some(process) = unit.life.as_mut() else { continue };
            process.look(now);
            let silent = now.saturating_duration_since(process.silent_since());
            let what = match process.signs.stopped() {
                Some(since) if now.saturating_duration_since(since) > OWED_WITHIN => {
                    format!("is stopped (process {}); it is waited for", process.pid())
                }
                None if process.ready_at.is_some() && silent > alive_within && process.signs.is_excused() => {
                    format!("has been at one step for {} s (process {}); it works", silent.as_secs(), process.pid())
                }
                _ => {
                    if silent < SILENT_AFTER && std::mem::take(&mut process.told_silent) {
                        tell(&Event::Note { name: &unit.name, what: "goes on".into() });
                    }
                    continue;
                }
            };
            if !std::mem::replace(&mut process.told_silent, true) {
                tell(&Event::Note { name: &unit.name, what });
            }
        }
    }

    /// A service that hangs, and how that is known.
    pub(crate) fn hanging(&mut self) -> Option<(usize, String)> {
        let now = self.now;
        let first_within = Duration::from_secs_f64(self.settings.config.first_output_within_s);
        if self.units.iter().any(|unit| unit.is_source() && unit.progress() > 0) {
            self.first_output.get_or_insert(now);
        }
        let all_ready = self.units.iter().filter(|unit| unit.is_here()).all(Unit::is_ready);
        for index in 0..self.units.len() {
            if self.is_excused_by_others(index)
                && let Some(process) = self.units[index].alive_mut()
            {
                process.waited = Some(now);
            }
        }
        let hangs = |unit: &Unit<P>| {
            let process = unit.alive()?;
            let excused = process.signs.excused();
            let too_long = |since: Instant, limit: Duration, what: &str| {
                let since = excused.map_or(since, |excused| excused.max(since));
                let late = now.saturating_duration_since(since) > limit;
                late.then(|| format!("{what} for {} s: it hangs", limit.as_secs()))
            };
            let waited = |since: Instant| process.waited.map_or(since, |waited| waited.max(since));
            let Some(ready_at) = process.ready_at else {
                return too_long(waited(process.started), self.settings.ready_within, "not ready")
                    .map(|why| (why, false));
            };
            if let Some(why) = too_long(process.silent_since(), self.settings.alive_within, "no sign of life") {
                return Some((why, false));
            }
            // Whoever waits for somebody that is being started is not silent by itself.
            let since = if unit.is_source() { self.ready } else { self.first_output.filter(|_| self.is_fed(unit)) }
                .filter(|_| all_ready && unit.is_running() && unit.progress() == 0)?;
            too_long(waited(since.max(ready_at)), first_within, "not a single message").map(|why| (why, true))
        };
        let found = self.units.iter().enumerate().find_map(|(index, unit)| hangs(unit).map(|how| (index, how)));
        let (index, (why, may_wait)) = found?;
        // Who waits for another is not the one to blame.
        let (blamed, waits) = if may_wait { self.blamed(index) } else { (index, String::new()) };
        Some((blamed, why + &waits))
    }

    /// Who keeps a service waiting, over however many others, and for whom it does on which topic; the service itself if it
    /// waits for nobody.
    fn blamed(&self, index: usize) -> (usize, String) {
        let (mut chain, mut waits) = (vec![index], String::new());
        while let Some(last) = chain.last()
            && let Some(next) = self.waited_for(*last).into_iter().find(|next| !chain.contains(next))
        {
            let topic = self.units[*last].alive().and_then(|process| process.health.as_ref()?.waits_for);
            waits = format!(" ({} waits for it on {})", self.units[*last].name, topic.map_or("", Topic::name));
            chain.push(next);
        }
        (chain.pop().unwrap_or(index), waits)
    }

    /// Whether a service waits for one that works, is stopped, or is on its way.
    fn is_excused_by_others(&self, index: usize) -> bool {
        let mut reached = vec![index];
        for _ in 0..LONGEST_CHAIN {
            let next: Vec<usize> = reached.iter().flat_map(|index| self.waited_for(*index)).collect();
            let is_busy = |index: &usize| {
                let unit = &self.units[*index];
                let silent = |since| self.now.saturating_duration_since(since) > SILENT_AFTER;
                unit.alive().map_or(unit.is_here(), |process| {
                    !process.is_ready() || process.signs.is_excused() || silent(process.silent_since())
                })
            };
            if next.iter().any(is_busy) {
                return true;
            }
            let more: Vec<usize> = next.into_iter().filter(|index| !reached.contains(index)).collect();
            if more.is_empty() {
                return false;
            }
            reached.extend(more);
        }
        false
    }

    /// The services that one says it can't go on without.
    fn waited_for(&self, index: usize) -> Vec<usize> {
        let unit = &self.units[index];
        let Some(topic) = unit.alive().and_then(|process| process.health.as_ref()?.waits_for) else {
            return Vec::new();
        };
        let none = Vec::new();
        let writers = self.writers.get(topic.name()).unwrap_or(&none);
        let others = if writers.contains(&unit.name) { self.consumers_of(topic) } else { writers };
        let others = self.units.iter().enumerate().filter(|(_, other)| others.contains(&other.name));
        others.map(|(index, _)| index).collect()
    }

    /// Whether the first message of a source is soon followed by one for this service: it reads a stream of a source's.
    fn is_fed(&self, unit: &Unit<P>) -> bool {
        let is_of_source = |topic: &Topic| {
            let writers = self.writers.get(topic.name()).into_iter().flatten();
            writers.filter_map(|name| self.units.iter().find(|unit| unit.name == *name)).any(Unit::is_source)
        };
        // Of the truth a sensor may know nothing.
        let streams = [Topic::OdometryRaw, Topic::RangeScan];
        streams
            .iter()
            .any(|topic| unit.role.wiring.reads.iter().any(|name| name == topic.name()) && is_of_source(topic))
    }

    /// A service that takes messages, and does not say that it reads what it is waited for on: who waits for it is not to blame.
    fn does_not_read(&self) -> Option<Debt> {
        self.units.iter().find_map(|unit| {
            let health = self.heard(unit).filter(|_| unit.is_running())?;
            let is_read = |topic: &Topic| health.acks.iter().any(|ack| ack.topic == *topic);
            let waited = |topic: &Topic| self.consumers_of(*topic).contains(&unit.name);
            let streams = Topic::ALL.into_iter().filter(|topic| topic.delivery().is_stream());
            let topic = streams.into_iter().find(|topic| waited(topic) && !is_read(topic))?;
            let writer = self.writers.get(topic.name()).and_then(|writers| writers.first()).cloned()?;
            Some(Debt { topic, name: unit.name.clone(), what: Owed::Acknowledgement { writer } })
        })
    }

    /// What the sensor owes those who wait for it while nothing happens: the end of its streams when it has ended, and what
    /// robot it is when it has said anything else.
    pub(crate) fn check_for_what_is_owed(&mut self) {
        let waiting = self.does_not_read().or_else(|| self.owed()).filter(|_| self.ending.is_none());
        match (waiting, &self.waiting_since) {
            (None, _) => self.waiting_since = None,
            (Some(debt), Some((before, since))) if debt == *before => {
                if self.now.saturating_duration_since(*since) > OWED_WITHIN {
                    self.failures.push(debt.failure());
                    self.end_after_failure(0);
                }
            }
            (Some(debt), _) => self.waiting_since = Some((debt, self.now)),
        }
    }

    fn owed(&self) -> Option<Debt> {
        let heard = |unit| self.heard(unit);
        let sensor = self.units.iter().find(|unit| unit.is_source())?;
        if sensor.is_here() && heard(sensor).is_none() {
            return None;
        }
        self.units.iter().find_map(|unit| {
            let health: &Health = heard(unit).filter(|_| unit.is_running())?;
            let is_sensors =
                |topic: &Topic| self.writers.get(topic.name()).is_some_and(|writers| writers.contains(&sensor.name));
            let topic = health.waits_for.filter(is_sensors)?;
            let is_owed = match topic {
                Topic::RobotDescription => sensor.has_ended() || sensor.progress() > 0,
                _ => sensor.has_ended(),
            };
            let (name, progress, faults) = (unit.name.clone(), health.progress, health.faults);
            is_owed.then_some(Debt { topic, name, what: Owed::Stream { progress, faults } })
        })
    }

    /// What a service said just now; who is silent is busy, and may yet say or take what is missing.
    fn heard<'u>(&self, unit: &'u Unit<P>) -> Option<&'u Health> {
        let process = unit.alive()?;
        let is_heard = self.now.saturating_duration_since(process.silent_since()) <= SILENT_AFTER;
        process.health.as_ref().filter(|_| is_heard && process.signs.stopped().is_none())
    }

    /// Takes note of how far all who are still here have come; whether that is farther than before. One that goes on
    /// regardless of a request to end keeps nobody.
    pub(crate) fn gets_on(&mut self) -> bool {
        let now = self.now;
        let mut mark = Vec::new();
        let (mut at_work, mut ignored) = (false, false);
        for unit in &self.units {
            let Some(process) = unit.alive() else {
                mark.push((0, u64::from(unit.is_here())));
                continue;
            };
            let silent = now.saturating_duration_since(process.silent_since());
            let state = process.health.as_ref().map_or(0, |health| health.state as u32);
            ignored |= process.asked > 0 && unit.is_running() && silent <= SILENT_AFTER;
            let stopped_for = process.signs.stopped().map(|since| now.saturating_duration_since(since));
            // One step may take long, and what it writes to be slow; but who was asked to leave and never said a word is in no step.
            at_work |= silent > SILENT_AFTER
                && (process.asked == 0 || process.is_ready())
                && match stopped_for {
                    Some(stopped_for) => stopped_for < self.settings.alive_within,
                    None => process.signs.is_excused() || (process.is_ready() && silent < self.settings.alive_within),
                };
            mark.push((state, unit.progress()));
        }
        let moved = self.mark != mark;
        self.mark = mark;
        (moved || at_work) && !ignored
    }
}

/// What is waited for in vain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Debt {
    topic: Topic,
    /// Who waits; of an acknowledgement: who owes it.
    name: String,
    what: Owed,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Owed {
    /// What the sensor has to say, to one that has taken and refused so many messages.
    Stream { progress: u64, faults: u64 },
    /// Word of how far the topic has been read, to its writer.
    Acknowledgement { writer: String },
}

impl Debt {
    fn failure(&self) -> String {
        let Self { topic, name, what } = self;
        let (topic, seconds) = (*topic, OWED_WITHIN.as_secs());
        match what {
            Owed::Acknowledgement { writer } => format!(
                "{name}: it takes messages, but does not acknowledge {}, on which {writer} waits for it; if it does not read \
                 that, say in the graph file what it does: [services.{name}] reads = [...]",
                topic.name()
            ),
            Owed::Stream { faults, .. } if topic == Topic::RobotDescription => format!(
                "the sensor has sent messages but no {} for {seconds} s, which {name} waits for (refused as faulty: {faults})",
                topic.name()
            ),
            Owed::Stream { .. } => format!(
                "sensor: left without saying that its streams end ({name} waits for the end of {})",
                topic.name()
            ),
        }
    }
}
