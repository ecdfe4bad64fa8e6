//! The vital signs of a process: what it says of itself, what it hears of the others, whether it is to end.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_topics::{Ack, Health, Input as Port, Message, Output, Received, ServiceState, Topic};

use crate::host::{Host, Told, Woken};
use crate::mutants::Mutant;
use crate::signals::Caught;

/// A service says that it is alive at least this often.
const HEARTBEAT: Duration = Duration::from_millis(250);

/// A signal that was not the launcher's: the service leaves as if it had been killed, so that it is started again.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("{} from process {}, which is not its launcher", .0.signal, .0.sender)]
pub struct Terminated(pub Caught);

/// Why a service is to end before its inputs do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// It was asked to.
    Asked,
    /// The launcher is gone: nobody downstream can be waited for.
    Orphaned,
}

/// What is known of a service by itself, and said to the others.
#[derive(Debug)]
pub(crate) struct Vitals {
    pub(crate) host: Box<dyn Host>,
    mouth: Output,
    ear: Port,
    pub(crate) state: ServiceState,
    pub(crate) progress: u64,
    pub(crate) total: u64,
    pub(crate) stamp_ns: u64,
    /// Of the first message of a stream, over all lives.
    pub(crate) first_stamp_ns: Option<u64>,
    pub(crate) faults: u64,
    pub(crate) last_error: String,
    note: String,
    pub(crate) stop: Option<Stop>,
    pub(crate) waits_for: Option<Topic>,
    due: Instant,
    /// Processes heard of.
    known: BTreeSet<u32>,
}

impl Vitals {
    /// Of a process that has done nothing yet; it speaks by `mouth` and hears by `ear`.
    pub(crate) fn new(host: Box<dyn Host>, mouth: Output, ear: Port) -> Self {
        let due = host.now();
        Self {
            host,
            mouth,
            ear,
            state: ServiceState::Starting,
            progress: 0,
            total: 0,
            stamp_ns: 0,
            first_stamp_ns: None,
            faults: 0,
            last_error: String::new(),
            note: String::new(),
            stop: None,
            waits_for: None,
            due,
            known: BTreeSet::new(),
        }
    }

    /// Where the others are heard, and what to wait with.
    pub(crate) fn ear_and_host(&mut self) -> (&Port, &mut dyn Host) {
        (&self.ear, self.host.as_mut())
    }

    /// One more message was handled.
    pub(crate) fn count(&mut self, topic: Topic, stamp_ns: u64) {
        self.progress += 1;
        self.stamp_ns = self.stamp_ns.max(stamp_ns);
        if topic.delivery().is_stream() {
            self.first_stamp_ns.get_or_insert(stamp_ns);
        }
    }

    /// How what the service measures with is doing; said at once where that is something else than before.
    pub(crate) fn set_note(&mut self, note: String) {
        if self.note != note {
            self.note = note;
            self.hasten(Duration::ZERO);
        }
    }

    /// Something is to be said within so long.
    pub(crate) fn hasten(&mut self, within: Duration) {
        self.due = self.due.min(self.host.now() + within);
    }

    /// How long until something is to be said.
    pub(crate) fn quiet_for(&self) -> Duration {
        self.due.saturating_duration_since(self.host.now())
    }

    /// Says how the service `name` is doing, and what its producers need not keep for it any longer.
    pub(crate) fn say(&mut self, name: &str, acks: Vec<Ack>, lost: u64) -> Result<()> {
        let health = Health {
            service: name.to_owned(),
            pid: self.host.pid(),
            state: self.state,
            progress: self.progress,
            total: self.total,
            stamp_ns: self.stamp_ns,
            first_stamp_ns: self.first_stamp_ns.unwrap_or(0),
            faults: self.faults,
            lost,
            acks,
            waits_for: self.waits_for,
            last_error: self.last_error.clone(),
            note: self.note.clone(),
        };
        self.mouth.send(self.stamp_ns, &Message::Health(health))?;
        self.mouth.ring()?;
        self.due = self.host.now() + HEARTBEAT;
        Ok(())
    }

    /// What the others say of themselves; whether one of them was not heard before.
    pub(crate) fn hear(&mut self) -> Result<(Vec<Health>, bool)> {
        self.ear.hush()?;
        let (mut heard, mut arrivals) = (Vec::new(), false);
        while let Some(received) = self.ear.receive()? {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            arrivals |= self.known.insert(health.pid);
            heard.push(health);
        }
        Ok((heard, arrivals))
    }

    /// Takes note of what happened while the process waited.
    ///
    /// # Errors
    /// It is to leave at once.
    pub(crate) fn wake(&mut self, woken: &Woken) -> Result<()> {
        for told in &woken.told {
            match told {
                Told::Leave(caught) if !Mutant::SignalStops.lives() => return Err(Terminated(*caught).into()),
                Told::Stop | Told::Leave(_) => {
                    anyhow::ensure!(self.stop != Some(Stop::Asked), "asked twice to stop: leaving at once");
                    self.stop.get_or_insert(Stop::Asked);
                }
            }
        }
        if woken.orphaned {
            self.stop = Some(Stop::Orphaned);
        }
        Ok(())
    }
}
