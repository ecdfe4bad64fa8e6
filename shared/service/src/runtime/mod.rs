//! A service's ends of the graph, in four parts: its `ports`, its `vitals`, its `memory`, and the loop of its life
//! (`crate::life`) that they serve.

mod ends;
mod memory;
mod ports;
mod recovery;
#[cfg(test)]
mod tests;
mod vitals;

use std::future::poll_fn;
use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_topics::{Ack, Command, Header, Message, Participant, ServiceState, Topic};
pub use ends::Ends;
use memory::Memory;
use ports::{Found, Ports};
use vitals::Vitals;
pub use vitals::{Stop, Terminated};

use crate::host::Orders;
use crate::mutants::Mutant;
use crate::outbox::Outbox;
use crate::plan::Plan;
use crate::store::{Entry, Unrepeatable};
use crate::{Service, in_words};

/// What was read but not yet acknowledged is acknowledged this soon …
const ACKNOWLEDGE_WITHIN: Duration = Duration::from_millis(50);
/// … or this soon where the run goes as fast as the graph can take it: a producer upstream may wait for nothing else.
const ACKNOWLEDGE_AT_MAX_RATE_WITHIN: Duration = Duration::from_millis(2);

/// What a service is to take next.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
pub enum Taken {
    /// A message.
    Message(Header, Message),
    /// The end of an input stream.
    End(Topic),
    /// An order that was carried out in an earlier life of the service, and is once more.
    Command(Command),
}

/// A life of a service, as far as it is the same for all.
#[derive(Debug)]
pub struct Runtime {
    name: String,
    plan: Plan,
    ports: Ports,
    vitals: Vitals,
    memory: Memory,
    orders: Option<Box<dyn Orders>>,
    /// All that came in is taken care of for good.
    is_finished: bool,
    // Last: ports go before the process leaves the domain.
    _participant: Option<Participant>,
}

impl Runtime {
    /// The plan of the run.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What time it is.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.vitals.host.now()
    }

    /// Whether the service writes this topic in this graph.
    #[must_use]
    pub fn writes(&self, topic: Topic) -> bool {
        self.ports.sink(topic).is_some()
    }

    /// How many messages there will be in all.
    pub fn set_total(&mut self, total: u64) {
        self.vitals.total = total;
    }

    /// Says what the service is doing now.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn set_state(&mut self, state: ServiceState) -> Result<()> {
        self.vitals.state = state;
        self.publish_health()
    }

    /// Says why the service is about to leave; whether a launcher hears it.
    pub fn fail(&mut self, error: &str) -> bool {
        self.vitals.last_error = error.into();
        self.set_state(ServiceState::Failed).is_ok() && self.vitals.host.is_launched()
    }

    /// Why the service is to end, if it is.
    #[must_use]
    pub fn stop(&self) -> Option<Stop> {
        self.vitals.stop
    }

    /// The next message of any input that is `welcome`; the robot description before all others.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn take(&mut self, welcome: impl Fn(Topic) -> bool) -> Result<Option<Taken>> {
        if let Some(entry) = self.memory.replay(&self.ports) {
            return Ok(self.take_effect_again(entry));
        }
        for index in 0..self.ports.sources.len() {
            let topic = self.ports.sources[index].port.topic();
            while welcome(topic) && self.memory.may_read(&self.ports, index) {
                match self.ports.look(index, self.vitals.host.pid())? {
                    Some(Found::Message(header, message)) => {
                        if let Message::Robot(robot) = &message {
                            tracing::info!(robot = robot.name, sensors = robot.sensors.len(), "robot seen");
                        }
                        self.memory.write_down(&self.ports, header.stamp_ns, &message)?;
                        self.vitals.count(topic, header.stamp_ns);
                        return Ok(Some(Taken::Message(header, message)));
                    }
                    // A producer that waits for this wants to leave.
                    Some(Found::End) => {
                        self.vitals.hasten(Duration::ZERO);
                        return Ok(Some(Taken::End(topic)));
                    }
                    Some(Found::Faulty(header, fault)) => {
                        if self.vitals.faults == 0 {
                            let (topic, sequence) = (topic.name(), header.sequence);
                            tracing::warn!(topic, sequence, %fault, "message refused; further ones are only counted");
                        }
                        self.vitals.faults += 1;
                    }
                    Some(Found::Nothing) => {}
                    None => break,
                }
            }
            if self.ports.is_first(index) {
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// What took effect in an earlier life takes effect again.
    fn take_effect_again(&mut self, entry: Entry) -> Option<Taken> {
        let (topic, message) = match entry.what {
            Unrepeatable::Robot(robot) => (Topic::RobotDescription, Message::Robot(robot)),
            Unrepeatable::Fix(fix) => (Topic::LocalizationFix, Message::Fix(fix)),
            Unrepeatable::Command(_, command) => return Some(Taken::Command(command)),
            // A sensor's alone, which takes nothing.
            Unrepeatable::End => return None,
        };
        let of_topic = self.ports.sources.iter_mut().filter(|source| source.port.topic() == topic);
        of_topic.for_each(|source| source.seen = true);
        self.vitals.progress += 1;
        self.vitals.stamp_ns = self.vitals.stamp_ns.max(entry.stamp_ns);
        Some(Taken::Message(Header { stamp_ns: entry.stamp_ns, ..Header::default() }, message))
    }

    /// Says what the service can't go on without; none: it is at work.
    pub fn set_waits_for(&mut self, topic: Option<Topic>) {
        self.vitals.waits_for = topic;
    }

    /// Says how what the service measures with is doing.
    pub fn set_note(&mut self, note: String) {
        self.vitals.set_note(note);
    }

    /// The input whose next message the service can't go on without, when it has taken all that is `welcome`.
    #[must_use]
    pub fn awaited_input(&self, welcome: impl Fn(Topic) -> bool) -> Option<Topic> {
        self.ports.awaited_input(welcome)
    }

    /// The first output that some consumer is not done with.
    #[must_use]
    pub fn awaited_output(&self) -> Option<Topic> {
        self.ports.awaited_output()
    }

    /// Whether every input stream that `counts` has ended, and nothing of earlier lives is still to take effect.
    #[must_use]
    pub fn inputs_ended(&self, counts: impl Fn(Topic) -> bool) -> bool {
        self.memory.replaying.is_empty() && self.ports.inputs_ended(counts)
    }

    /// Whether there is an input stream that `counts`: a service that has none goes on until it is asked to end.
    #[must_use]
    pub fn has_streams(&self, counts: impl Fn(Topic) -> bool) -> bool {
        self.ports.has_streams(counts)
    }

    /// Answers the user's orders; those that change something are written down first, with where that was.
    ///
    /// # Errors
    /// Shared memory refuses, or the disk does.
    pub fn serve(
        &mut self,
        at: Option<u64>,
        is_live: bool,
        mut carry_out: impl FnMut(Command) -> Result<String>,
    ) -> Result<()> {
        if !self.memory.replaying.is_empty() {
            // First those of earlier lives.
            return Ok(());
        }
        let at = at.map_or_else(|| self.ports.position(), |at| vec![at]);
        let Some(orders) = &mut self.orders else { return Ok(()) };
        let (memory, stamp_ns) = (&mut self.memory, self.vitals.stamp_ns);
        let mut known = memory.orders.clone();
        let mut write_down = |order: Option<u64>, command: Command| match command {
            // It changes no map.
            Command::Save | Command::Tiles => Ok(()),
            // What comes of it is measured.
            Command::Drive { .. } if is_live && order.is_none() => Ok(()),
            _ => memory.write_down_order(&at, stamp_ns, order, command),
        };
        Ok(orders.serve(&mut |order, command| {
            if order.is_some_and(|order| known.contains(&order)) {
                return Ok("told before this process was started, in place of another; it counts".into());
            }
            known.extend(order);
            let done = write_down(order, command).and_then(|()| carry_out(command));
            done.map_err(|error| in_words(&error))
        })?)
    }

    /// Sends what the windows of the consumers have room for, and wakes them.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn flush(&mut self, outbox: &mut Outbox) -> Result<()> {
        self.ports.flush(outbox, &self.name)
    }

    /// Sends a sensor's message if there is room for it.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn send(&mut self, stamp_ns: u64, message: &Message) -> Result<bool> {
        let is_sent = self.ports.send(stamp_ns, message, &self.name)?;
        if is_sent {
            self.vitals.count(message.topic(), stamp_ns);
        }
        Ok(is_sent)
    }

    /// Wakes the consumers of what was sent.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn ring(&mut self) -> Result<()> {
        self.ports.ring()
    }

    /// Tells whoever came to an output what counts, in the words of the service.
    pub fn welcome_newcomers(&mut self, service: &mut impl Service, out: &mut Outbox) {
        while let Some(topic) = self.ports.take_newcomer() {
            service.welcome(topic, out);
        }
    }

    /// Says on every output stream that it ends here, to whoever has not heard it.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn end_outputs(&mut self) -> Result<()> {
        self.ports.end(self.vitals.stamp_ns)
    }

    /// Whether every consumer has integrated all that was sent.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.ports.is_drained()
    }

    /// Leaves early: what came in is stored as far as was said before.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn leave(&mut self) -> Result<()> {
        let (messages, lost, refused) = (self.vitals.progress, self.ports.lost(), self.vitals.faults);
        tracing::info!(messages, lost, refused, complete = self.is_finished, "ended");
        self.set_state(ServiceState::Finished)
    }

    /// Leaves when all that came in is taken care of, downstream too. Whoever sent what is not stored waits until the launcher has
    /// heard that, and says that this service is gone: a last word that is lost has to leave them there for another in its place.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn finish(&mut self) -> Result<()> {
        self.is_finished = true;
        if Mutant::LeavesUnheard.lives() {
            self.publish_health()?;
        }
        self.leave()
    }

    /// Waits until something happened, at most for `patience`; takes note of signals, of the
    /// launcher's death and of acknowledgements, and says how the service is doing when that is due.
    ///
    /// # Errors
    /// The system refuses, or the service was asked twice to stop.
    pub async fn attend(&mut self, patience: Duration) -> Result<()> {
        self.publish_health_if_due()?;
        let patience = patience.min(self.vitals.quiet_for());
        let woken = poll_fn(|_| {
            let (ports, vitals) = (&self.ports, &mut self.vitals);
            let mut fds: Vec<BorrowedFd<'_>> = ports.sources.iter().filter_map(|source| source.port.fd()).collect();
            let (ear, host) = vitals.ear_and_host();
            fds.extend(ear.fd());
            fds.extend(self.orders.iter().flat_map(|orders| orders.fds()));
            host.poll_wait(&fds, patience)
        });
        let woken = woken.await?;
        self.vitals.wake(&woken)?;
        self.ports.hush()?;
        self.hear()?;
        self.publish_health_if_due()
    }

    /// Listens to what the others say of themselves.
    fn hear(&mut self) -> Result<()> {
        let (heard, arrivals) = self.vitals.hear()?;
        heard.iter().for_each(|health| self.ports.note(health));
        if arrivals {
            // They get the latest of what was sent before they came, and hear of us.
            self.ports.welcome()?;
            self.vitals.hasten(Duration::ZERO);
        }
        Ok(())
    }

    fn publish_health_if_due(&mut self) -> Result<()> {
        let acks = self.acknowledged();
        let pending = || {
            let sources = self.ports.sources.iter().zip(&acks);
            sources.map(|(source, ack)| (source, ack.sequence.saturating_sub(source.published)))
        };
        let far_ahead = pending().any(|(source, pending)| source.window != u64::MAX && pending >= source.window / 4);
        if !far_ahead && pending().any(|(_, pending)| pending > 0) {
            let is_at_max_rate = self.plan.rate.is_none();
            self.vitals.hasten(if is_at_max_rate { ACKNOWLEDGE_AT_MAX_RATE_WITHIN } else { ACKNOWLEDGE_WITHIN });
        }
        if far_ahead || self.vitals.quiet_for().is_zero() { self.publish_health() } else { Ok(()) }
    }

    /// What the producers need not keep for us any longer, by input.
    fn acknowledged(&self) -> Vec<Ack> {
        if self.is_finished {
            return self.ports.sources.iter().map(|source| source.port.taken()).collect();
        }
        self.memory.acknowledged(&self.ports)
    }

    fn publish_health(&mut self) -> Result<()> {
        let acks = self.acknowledged();
        for (source, ack) in self.ports.sources.iter_mut().zip(&acks) {
            source.published = ack.sequence;
        }
        self.vitals.say(&self.name, acks, self.ports.lost())
    }
}
