//! What is done about services that die, hang, or are to end.
//!
//! Decisions alone: no process is started here, no message received, no clock read. Whoever has the processes in hand (the
//! launcher, or a simulation of one) tells what it sees and what time it is, and is told whom to start, and what to clean up.

mod clock;
pub mod config;
mod deadlines;
mod deaths;
mod ending;
mod event;
mod flow;
mod life;
mod policy;
mod signs;
#[cfg(test)]
mod tests;
mod unit;
mod wiring;
mod words;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

pub use clock::Clock;
use config::{Restart, SupervisionConfig};
use deadlines::Debt;
use echogrid_service::mutants::Mutant;
use echogrid_topics::{Health, Topic};
use ending::Ending;
pub use event::Event;
pub use flow::{FlowPosition, consumers, onlookers, places, writers};
pub use life::{End, Life, Process};
pub use signs::Usage;
pub use unit::{Stage, Unit};
pub use wiring::Wiring;
use words::Words;

/// What a graph may take to save and leave when it is asked to.
const LEAVE_WITHIN: Duration = Duration::from_secs(10);
/// Between the last request and the kill.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// The rank from which services make something of what is measured, which may take long: after sensor and odometry.
pub const SLOW_FROM: usize = 2;

/// Whoever is told what happens.
pub type Tell<'a> = &'a mut dyn FnMut(&Event<'_>);

/// What a service is to its graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Role {
    /// What it reads and writes.
    pub wiring: Wiring,
    /// Whether it is started again.
    pub restart: Restart,
    /// Whether the graph ends when it is given up; else the others go on without it.
    pub required: bool,
}

impl AsRef<Wiring> for Role {
    fn as_ref(&self) -> &Wiring {
        &self.wiring
    }
}

/// How a graph is watched over.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What happens when a service dies or hangs.
    pub config: SupervisionConfig,
    /// The longest time from one sign of life to the next. Writing a large map to a slow disk is one step.
    pub alive_within: Duration,
    /// A service that has not become ready for so long hangs.
    pub ready_within: Duration,
    /// Whether the run can be gone on with when it failed.
    pub is_resumable: bool,
    /// Whom the producer of each topic waits for.
    pub consumers: BTreeMap<String, Vec<String>>,
}

/// The services of a graph, and what is decided about them.
#[derive(Debug)]
pub struct Supervision<P> {
    /// The services, upstream to downstream: the order in which they are asked to end.
    pub units: Vec<Unit<P>>,
    /// Somebody died whose leftovers have to be cleaned up before anybody is started.
    pub is_unclean: bool,
    /// The shared memory of the graph has to be made anew.
    pub is_broken: bool,
    /// Whoever waits for a service that has left for good has to be told: it may have left before it could be heard.
    has_news_of_gone: bool,
    words: Words,
    /// Whether the user ended the run.
    pub stopped: bool,
    /// Whether the user did so twice: nobody is waited for.
    pub abandoned: bool,
    /// The services that failed and how; the first is the cause.
    pub failures: Vec<String>,
    /// Services that had to be killed.
    pub killed: Vec<String>,
    /// Services that were given up while the others went on, and why.
    pub given_up: Vec<String>,
    /// The time at which all were ready for the first time.
    pub ready: Option<Instant>,
    settings: Settings,
    /// Who writes each topic.
    writers: BTreeMap<String, Vec<String>>,
    /// What time it is for deadlines.
    now: Instant,
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
}

impl<P: Process> Supervision<P> {
    /// The supervision of a graph of these services, none of which was started.
    /// Of those at one place in the flow of streams the first come first.
    #[must_use]
    pub fn new(services: &[(String, Role)], settings: Settings, now: Instant) -> Self {
        let by_name: BTreeMap<String, Role> = services.iter().cloned().collect();
        let places = places(&by_name);
        let place = |name: &String| places.get(name).copied().unwrap_or(FlowPosition { rank: 0, is_told: false });
        let mut units: Vec<Unit<P>> =
            services.iter().map(|(name, role)| Unit::new(name, role.clone(), place(name), now)).collect();
        units.sort_by_key(|unit| unit.place.rank);
        Self {
            units,
            is_unclean: false,
            is_broken: false,
            has_news_of_gone: false,
            words: Words::new(now),
            stopped: false,
            abandoned: false,
            failures: Vec::new(),
            killed: Vec::new(),
            given_up: Vec::new(),
            ready: None,
            settings,
            writers: writers(&by_name),
            now,
            first_output: None,
            ending: None,
            failed: None,
            waiting_since: None,
            winding_down: None,
            mark: Vec::new(),
            rebuilds: 0,
        }
    }

    /// Whether nobody is there any more, nor will be.
    #[must_use]
    pub fn is_over(&self) -> bool {
        !self.units.iter().any(Unit::is_here)
    }

    /// Whether the graph is ending.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.ending.is_some()
    }

    /// The services that are to be started by now, unless there is something to clean up first.
    #[must_use]
    pub fn due(&self) -> Vec<usize> {
        let is_due = |unit: &Unit<P>| matches!(unit.stage, Stage::Waiting(due) if due <= self.now);
        (0..self.units.len()).filter(|index| is_due(&self.units[*index])).collect()
    }

    /// The time at which the next service is to be started, if any is.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        let due = self.units.iter().filter_map(|unit| match unit.stage {
            Stage::Waiting(due) => Some(due),
            _ => None,
        });
        due.min()
    }

    /// A service was started.
    pub fn started(&mut self, index: usize, process: P) {
        let unit = &mut self.units[index];
        unit.life = Some(Life::new(process, self.now));
        unit.stage = Stage::Alive;
    }

    /// The services that have left for good, or said that they are done. Of a run that is cut short and can be resumed only
    /// those are that were done: the others come again, and what they have not stored is to be kept for them.
    pub fn gone(&self) -> impl Iterator<Item = &str> {
        let is_cut = self.failed.is_some() || self.ending.as_ref().is_some_and(|ending| ending.pressed > 0);
        let comes_again = self.settings.is_resumable && is_cut && !Mutant::ForgetsTheGivenUp.lives();
        let is_gone = move |unit: &&Unit<P>| match unit.stage {
            Stage::Done => !comes_again || unit.is_finished(),
            Stage::Lost => !(comes_again && unit.role.required),
            Stage::Alive => unit.alive().is_some_and(Life::is_finished),
            Stage::Waiting(_) => false,
        };
        self.units.iter().filter(is_gone).map(|unit| unit.name.as_str())
    }

    /// Tells the supervision what time it is now.
    pub fn is_now(&mut self, now: Instant) {
        self.now = now;
    }

    /// What time it is for deadlines.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.now
    }

    /// The user ends the run; the second time: at once.
    pub fn stop(&mut self) {
        if std::mem::replace(&mut self.stopped, true) {
            self.abandoned = true;
            let (asked, within) = (self.now, Duration::ZERO);
            self.ending = Some(Ending { asked, worked: None, within, deadline: asked, pressed: 2 });
        } else {
            self.end(LEAVE_WITHIN);
        }
    }

    /// Takes note of what a service says of itself.
    pub fn hear(&mut self, health: Health) {
        let now = self.now;
        if let Some(unit) = self.units.iter_mut().find(|unit| unit.name == health.service)
            && unit.hear(health, now)
        {
            // It may have been started before somebody left, or nobody need wait for it any longer.
            self.has_news_of_gone = true;
        }
    }

    /// Whether all are ready for the first time.
    pub fn has_become_ready(&mut self) -> bool {
        let has = self.ready.is_none() && self.units.iter().all(Unit::is_ready);
        if has {
            self.ready = Some(self.now);
        }
        has
    }

    /// Finds out who hangs, whose time is over, and who is to be asked to end next.
    pub fn look(&mut self, tell: Tell<'_>) {
        self.look_at_processes(tell);
        self.check_deadlines(tell);
        self.hurry();
        self.wind_down();
        self.release_those_not_told();
    }

    fn check_deadlines(&mut self, tell: Tell<'_>) {
        let now = self.now;
        while let Some((index, why)) = self.hanging() {
            if let Some(life) = self.units[index].alive_mut() {
                life.kill();
            }
            self.buried(index, &why, tell);
        }
        self.check_for_what_is_owed();
        let gets_on = self.ending.is_some() && self.gets_on();
        if let Some(ending) = self.ending.as_mut().filter(|ending| gets_on && ending.pressed == 0) {
            ending.deadline = ending.deadline.max(now + ending.within);
        }
        let Some(ending) = self.ending.as_mut().filter(|ending| now >= ending.deadline) else { return };
        ending.deadline = now + LAST_WORDS;
        ending.pressed += 1;
        let kill = ending.pressed > 2;
        for unit in &mut self.units {
            let name = unit.name.clone();
            if matches!(unit.stage, Stage::Waiting(_)) {
                unit.stage = Stage::Lost;
                // What it would have done is not done.
                if unit.role.required {
                    self.failures.push(format!("{name}: it died, and there was no time left to start it again"));
                }
            }
            let Some(life) = unit.alive_mut() else { continue };
            if kill {
                self.killed.push(name);
                life.kill();
                unit.stage = Stage::Lost;
            } else {
                life.ask_to_stop();
            }
        }
    }

    fn consumers_of(&self, topic: Topic) -> &[String] {
        self.settings.consumers.get(topic.name()).map_or(&[], Vec::as_slice)
    }
}
