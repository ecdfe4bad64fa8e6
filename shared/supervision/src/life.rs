//! One life of a service: a process, and what was heard and seen of it.

use std::time::Instant;

use anyhow::Result;
use echogrid_service::mutants::Mutant;
use echogrid_service::process::{IN_VAIN, NO_GRAPH};
use echogrid_topics::{Health, ServiceState};
use nix::sys::signal::Signal;

use crate::signs::{Signs, Usage};

/// A process, as whoever started it has it in hand.
pub trait Process {
    /// The number of the process.
    fn pid(&self) -> u32;

    /// Asks it to end; gone already is as good.
    fn ask_to_stop(&mut self);

    /// Ends it now: when this returns, it has an [`Process::end`].
    fn kill(&mut self);

    /// Finds out whether it has ended.
    ///
    /// # Errors
    /// The system does not say.
    fn look(&mut self) -> Result<()>;

    /// How it ended, as far as that was found out.
    fn end(&self) -> Option<End>;

    /// What the system shows of it, if it shows anything.
    fn usage(&self) -> Option<Usage>;
}

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// It left with this exit code.
    Code(i32),
    /// A signal of this number killed it.
    Signal(i32),
}

/// A life of a service.
#[derive(Debug)]
pub struct Life<P> {
    process: P,
    pub(crate) started: Instant,
    /// When it said that it is ready.
    pub(crate) ready_at: Option<Instant>,
    last_heard: Option<Instant>,
    /// What the system shows of it.
    pub(crate) signs: Signs,
    /// When it last waited for one that had a reason to keep it waiting.
    pub(crate) waited: Option<Instant>,
    /// Whether it was said that it is silent.
    pub(crate) told_silent: bool,
    /// The last thing that it said of itself.
    pub(crate) health: Option<Health>,
    /// Requests to end that it was sent so far.
    pub(crate) asked: u32,
    is_reaped: bool,
}

impl<P: Process> Life<P> {
    pub(crate) fn new(process: P, started: Instant) -> Self {
        Self {
            process,
            started,
            ready_at: None,
            last_heard: None,
            signs: Signs::default(),
            waited: None,
            told_silent: false,
            health: None,
            asked: 0,
            is_reaped: false,
        }
    }

    /// The process of this life.
    pub fn process(&self) -> &P {
        &self.process
    }

    /// The process of this life, to be changed.
    pub fn process_mut(&mut self) -> &mut P {
        &mut self.process
    }

    /// The number of the process.
    pub fn pid(&self) -> u32 {
        self.process.pid()
    }

    /// Looks at what the system shows of it.
    pub(crate) fn look(&mut self, now: Instant) {
        let process = &self.process;
        self.signs.look(|| process.usage(), now);
    }

    /// Whether it has ended, and nobody took note of that yet.
    pub(crate) fn reap(&mut self) -> Result<bool> {
        if self.is_reaped {
            return Ok(false);
        }
        self.process.look()?;
        self.is_reaped = self.process.end().is_some();
        Ok(self.is_reaped)
    }

    /// Whether it did all that it was there for. Who leaves while it takes messages, and was not asked to, did not, however
    /// well it says that it went; of a sensor those who wait for the end of its streams know better.
    pub(crate) fn succeeded(&self, is_sensor: bool) -> bool {
        let state = self.health.as_ref().map_or(ServiceState::Starting, |health| health.state);
        let may_leave = is_sensor || self.asked > 0 || state > ServiceState::Running || Mutant::SignalStops.lives();
        (self.process.end() == Some(End::Code(0)) && may_leave) || self.is_finished()
    }

    /// Whether it died of a signal that asks to end.
    pub(crate) fn was_terminated(&self) -> bool {
        let signal = match self.process.end() {
            Some(End::Signal(signal)) => signal,
            Some(End::Code(code)) => code - 128,
            None => return false,
        };
        [Signal::SIGHUP, Signal::SIGINT, Signal::SIGTERM].iter().any(|asks| *asks as i32 == signal)
    }

    /// Whether it said that it could not enter the graph.
    pub(crate) fn found_no_graph(&self) -> bool {
        self.process.end() == Some(End::Code(i32::from(NO_GRAPH)))
    }

    /// Whether it failed for a reason that another process would meet, too.
    pub(crate) fn failed_in_vain(&self) -> bool {
        self.process.end() == Some(End::Code(i32::from(IN_VAIN)))
    }

    /// Whether it has said that it is ready.
    pub(crate) fn is_ready(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state > ServiceState::Starting)
    }

    /// Whether it has said that it is done.
    pub(crate) fn is_finished(&self) -> bool {
        self.health.as_ref().is_some_and(|health| health.state == ServiceState::Finished)
    }

    /// Takes note of what it says of itself.
    pub(crate) fn hear(&mut self, health: Health, now: Instant) {
        self.last_heard = Some(now);
        if health.state > ServiceState::Starting {
            self.ready_at.get_or_insert(now);
        }
        self.health = Some(health);
    }

    /// Since when nothing was heard of it.
    pub(crate) fn silent_since(&self) -> Instant {
        self.last_heard.unwrap_or(self.started)
    }

    /// Asks it to end.
    pub(crate) fn ask_to_stop(&mut self) {
        if self.process.end().is_none() {
            self.asked += 1;
            self.process.ask_to_stop();
        }
    }

    /// Asks it to end, if that was not done yet.
    pub(crate) fn ask_once(&mut self) {
        if self.asked == 0 {
            self.ask_to_stop();
        }
    }

    /// Ends it now.
    pub(crate) fn kill(&mut self) {
        if self.process.end().is_none() {
            self.process.kill();
        }
        // Whoever killed it knows that it is dead.
        self.is_reaped = true;
    }

    /// How it ended, for people.
    pub(crate) fn how(&self) -> String {
        let told = self.health.as_ref().map(|health| health.last_error.as_str()).filter(|error| !error.is_empty());
        match (self.process.end(), told) {
            (_, Some(error)) => error.to_owned(),
            (None, None) => "still running".to_owned(),
            (Some(End::Code(0)), None) if !self.succeeded(false) => "left, though its streams had not ended".to_owned(),
            (Some(End::Code(0)), None) => "done".to_owned(),
            (Some(End::Code(code)), None) => format!("exit code {code}"),
            (Some(End::Signal(signal)), None) => {
                let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
                // What iceoryx2 maps is not reserved: memory that is full is found out when it is written.
                let hint = if name == "SIGBUS" { ": is /dev/shm full? See echogrid doctor" } else { "" };
                format!("killed by signal {signal} ({name}){hint}")
            }
        }
    }
}
