//! How it is known that a service hangs, or waits for what will never come.
//!
//! Being slow is no fault. Who works (uses the processor, reads, writes, wants to), is stopped by somebody, or waits for one
//! that does, has all the time it wants; and who waits for another is never the one to blame.

use std::time::{Duration, Instant};

use echogrid_topics::{Health, Topic};

use super::Supervisor;
use super::run::{Event, Observer};
use super::unit::{Stage, Unit};
use crate::config::ServiceKind;

/// For how long nobody may do anything while a service waits for what the sensor owes it: its end, or what robot it is.
const OWED_WITHIN: Duration = Duration::from_secs(5);
/// Somebody who says nothing for longer is busy, or hangs.
pub(super) const SILENT_AFTER: Duration = Duration::from_secs(1);
/// How far it is looked for the one that others wait for.
const LONGEST_CHAIN: usize = 6;

impl Supervisor<'_> {
    /// Looks at every process, and says of each once if it is silent for a reason.
    pub(super) fn look_at_processes(&mut self, observer: &mut dyn Observer) {
        let (now, alive_within) = (self.now, self.graph.alive_within);
        for unit in self.units.iter_mut().filter(|unit| unit.stage == Stage::Alive) {
            let Some(process) = unit.process.as_mut() else { continue };
            process.signs.look(process.pid(), now);
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
                        observer.event(&Event::Note { name: &unit.name, what: "goes on".into() });
                    }
                    continue;
                }
            };
            if !std::mem::replace(&mut process.told_silent, true) {
                observer.event(&Event::Note { name: &unit.name, what });
            }
        }
    }

    /// A service that hangs, and how that is known.
    pub(super) fn hanging(&mut self) -> Option<(usize, String)> {
        let now = self.now;
        let first_within = Duration::from_secs_f64(self.graph.supervision.first_output_within_s);
        if self.units.iter().any(|unit| unit.kind == ServiceKind::Sensor && unit.progress() > 0) {
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
        let hangs = |unit: &Unit| {
            let process = unit.alive()?;
            let excused = process.signs.excused();
            let too_long = |since: Instant, limit: Duration, what: &str| {
                let since = excused.map_or(since, |excused| excused.max(since));
                let late = now.saturating_duration_since(since) > limit;
                late.then(|| format!("{what} for {} s: it hangs", limit.as_secs()))
            };
            let waited = |since: Instant| process.waited.map_or(since, |waited| waited.max(since));
            let Some(ready_at) = process.ready_at else {
                return too_long(waited(process.started), self.graph.ready_within, "not ready");
            };
            if let Some(why) = too_long(process.silent_since(), self.graph.alive_within, "no sign of life") {
                return Some(why);
            }
            // Whoever waits for somebody that is being started is not silent by itself.
            let since = match unit.kind {
                ServiceKind::Sensor => self.ready,
                ServiceKind::Odometry | ServiceKind::Mapper => self.first_output,
                ServiceKind::Localizer | ServiceKind::Publisher => None,
            }
            .filter(|_| all_ready && unit.is_running() && unit.progress() == 0)?;
            too_long(waited(since.max(ready_at)), first_within, "not a single message")
        };
        self.units.iter().enumerate().find_map(|(index, unit)| hangs(unit).map(|why| (index, why)))
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
        let readers = self.graph.plan.consumers_of(topic);
        let writes = writer(topic) == Some(unit.kind);
        let others = self.units.iter().enumerate().filter(|(_, other)| {
            if writes { readers.contains(&other.name) } else { writer(topic) == Some(other.kind) }
        });
        others.map(|(index, _)| index).collect()
    }

    /// What the sensor owes those who wait for it while nothing happens: the end of its streams when it has ended, and what
    /// robot it is when it has said anything else.
    pub(super) fn check_for_what_is_owed(&mut self) {
        let waiting = self.owed().filter(|_| self.ending.is_none());
        match (waiting, &self.waiting_since) {
            (None, _) => self.waiting_since = None,
            (Some(debt), Some((before, since))) if debt == *before => {
                if self.now.saturating_duration_since(*since) > OWED_WITHIN {
                    self.outcome.failures.push(debt.failure());
                    self.end_after_failure(ServiceKind::Sensor);
                }
            }
            (Some(debt), _) => self.waiting_since = Some((debt, self.now)),
        }
    }

    fn owed(&self) -> Option<Debt> {
        let heard = |unit| self.heard(unit);
        let sensor = self.units.iter().find(|unit| unit.kind == ServiceKind::Sensor)?;
        if sensor.is_here() && heard(sensor).is_none() {
            return None;
        }
        self.units.iter().find_map(|unit| {
            let health: &Health = heard(unit).filter(|_| unit.is_running())?;
            let topic = health.waits_for.filter(|topic| writer(*topic) == Some(ServiceKind::Sensor))?;
            let is_owed = match topic {
                Topic::RobotDescription => sensor.has_ended() || sensor.progress() > 0,
                _ => sensor.has_ended(),
            };
            let (name, progress, faults) = (unit.name.clone(), health.progress, health.faults);
            is_owed.then_some(Debt { topic, name, progress, faults })
        })
    }

    /// What a service said just now; who is silent is busy, and may yet say or take what is missing.
    fn heard<'u>(&self, unit: &'u Unit) -> Option<&'u Health> {
        let process = unit.alive()?;
        let is_heard = self.now.saturating_duration_since(process.silent_since()) <= SILENT_AFTER;
        process.health.as_ref().filter(|_| is_heard && process.signs.stopped().is_none())
    }

    /// Takes note of how far all who are still here have come; whether that is farther than before. One that goes on
    /// regardless of a request to end keeps nobody.
    pub(super) fn gets_on(&mut self) -> bool {
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
            // One step may take long, and what it writes to be slow.
            at_work |= silent > SILENT_AFTER
                && match stopped_for {
                    Some(stopped_for) => stopped_for < self.graph.alive_within,
                    None => process.signs.is_excused() || (process.is_ready() && silent < self.graph.alive_within),
                };
            mark.push((state, unit.progress()));
        }
        let moved = self.mark != mark;
        self.mark = mark;
        (moved || at_work) && !ignored
    }
}

/// What a service waits for in vain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Debt {
    topic: Topic,
    /// Who waits.
    name: String,
    /// Messages that it has taken.
    progress: u64,
    /// Messages that it refused.
    faults: u64,
}

impl Debt {
    fn failure(&self) -> String {
        let Self { topic, name, faults, .. } = self;
        let seconds = OWED_WITHIN.as_secs();
        match topic {
            Topic::RobotDescription => format!(
                "the sensor has sent messages but no {} for {seconds} s, which {name} waits for (refused as faulty: {faults})",
                topic.name()
            ),
            _ => format!(
                "sensor: left without saying that its streams end ({name} waits for the end of {})",
                topic.name()
            ),
        }
    }
}

/// Who writes a topic.
fn writer(topic: Topic) -> Option<ServiceKind> {
    Some(match topic {
        Topic::RobotDescription | Topic::OdometryRaw | Topic::RangeScan | Topic::TruePose | Topic::TrueWorld => {
            ServiceKind::Sensor
        }
        Topic::OdometryEstimate | Topic::LocalizationRequest => ServiceKind::Odometry,
        Topic::LocalizationFix => ServiceKind::Localizer,
        Topic::MapTiles | Topic::MapInfo | Topic::RangeVerdict => ServiceKind::Mapper,
        Topic::Health => return None,
    })
}
