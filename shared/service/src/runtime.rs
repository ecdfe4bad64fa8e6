//! A service's ends of the graph: its ports, what it acknowledges, what it waits for.

use std::collections::{BTreeSet, VecDeque};
use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_topics::{
    Ack, Command, ControlServer, Delivery, Domain, Health, Message, Output, Participant, Received, ServiceState, Topic,
};
use echogrid_topics::{Header, Input as Port};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::Signal;

use crate::in_words;
use crate::lifeline::Lifeline;
use crate::outbox::Outbox;
use crate::plan::{DOMAIN_VARIABLE, GONE_VARIABLE, Plan, SERVICE_VARIABLE};
use crate::signals::{Caught, Signals};
use crate::store::{Entry, Moment, Store, Unrepeatable};

/// A service says that it is alive at least this often.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// What was read but not yet acknowledged is acknowledged this soon.
const ACKNOWLEDGE_WITHIN: Duration = Duration::from_millis(50);

/// A signal that was not the launcher's: the service leaves as if it had been killed, so that it is started again.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("{} from process {}, which is not its launcher", .0.signal, .0.sender)]
pub struct Terminated(pub Caught);

/// Why a service is to end before its inputs do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// It was asked to.
    Asked,
    /// Its launcher is gone: nobody downstream can be waited for.
    Orphaned,
}

/// What a service is to take next.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
pub enum Taken {
    /// A message.
    Message(Header, Message),
    /// An order that was carried out in an earlier life of the service, and is once more.
    Command(Command),
}

/// Whether the end of a stream, said in the life `epoch` of its producer, is meant for a process that was last told all that
/// counts by the life `told`.
fn is_meant_for_us(delivery: Delivery, told: u64, epoch: u64) -> bool {
    delivery != Delivery::Relayed || told == epoch
}

/// An input.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) port: Port,
    pub(crate) ended: bool,
    pub(crate) seen: bool,
    /// The life of the producer of a relayed stream that has told this process all that counts; the end of another is not
    /// meant for it: it was said to an earlier process, or before this one was met.
    told: u64,
    /// Of what was lost, that which an earlier life of the service missed.
    pub(crate) lost_before: u64,
    published: u64,
}

impl Source {
    pub(crate) fn resumes(&self) -> bool {
        self.port.topic().resumes()
    }

    fn lost(&self) -> u64 {
        self.lost_before + self.port.lost()
    }
}

/// An output.
#[derive(Debug)]
pub(crate) struct Sink {
    pub(crate) port: Output,
    /// Whether its end was said, to everyone who is there.
    ended: bool,
    /// Somebody came who needs to be told all that counts.
    newcomer: bool,
    /// Processes that are being told, and do not know yet that they were.
    untold: Vec<u32>,
}

/// Ports and vital signs of one process.
#[derive(Debug)]
pub struct Runtime {
    pub(crate) name: String,
    pub(crate) plan: Plan,
    pub(crate) sources: Vec<Source>,
    pub(crate) sinks: Vec<Sink>,
    health_out: Output,
    health_in: Port,
    control: Option<ControlServer>,
    signals: Signals,
    lifeline: Option<Lifeline>,
    state: ServiceState,
    pub(crate) progress: u64,
    total: u64,
    pub(crate) stamp_ns: u64,
    /// Of the first message of a stream, over all lives.
    pub(crate) first_stamp_ns: Option<u64>,
    pub(crate) faults: u64,
    last_error: String,
    health_due: Instant,
    /// None where nobody would restart the service.
    pub(crate) store: Option<Store>,
    /// What is stored, and may be gone back to; the latest last.
    pub(crate) generations: VecDeque<(u64, Moment)>,
    /// What took effect in an earlier life after what was gone back to.
    pub(crate) replaying: VecDeque<Entry>,
    pub(crate) stored_at: Instant,
    /// Number of the next message of a live sensor.
    pub(crate) spooled: u64,
    /// All that came in is taken care of for good.
    is_finished: bool,
    stop: Option<Stop>,
    waits_for: Option<Topic>,
    /// Processes heard of.
    known: BTreeSet<u32>,
    // Last: ports go before the process leaves the domain.
    _participant: Participant,
}

impl Runtime {
    /// Enters the graph that the environment names (see [`DOMAIN_VARIABLE`]) as `default_name`,
    /// unless the environment names the service too.
    ///
    /// # Errors
    /// There is no such graph, or shared memory refuses.
    pub fn enter(default_name: &str, inputs: &[Topic], outputs: &[Topic]) -> Result<Self> {
        let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
        let lifeline = Lifeline::attach();
        let name = std::env::var(SERVICE_VARIABLE).unwrap_or_else(|_| default_name.into());
        let domain = std::env::var(DOMAIN_VARIABLE)
            .with_context(|| format!("{DOMAIN_VARIABLE} is not set: name the domain of a running graph (--domain)"))?;
        let domain = Domain::named(&domain)?;
        let participant = Participant::join(&domain, &name)?;
        let plan = Plan::read(&domain)?;
        let gone = std::env::var(GONE_VARIABLE).unwrap_or_default();
        let open = |topic: Topic| {
            let there = |name: &&String| gone.split(',').all(|gone| gone != name.as_str());
            let consumers: Vec<String> = plan.consumers_of(topic).iter().filter(there).cloned().collect();
            Output::open(&participant, topic, plan.max_readings, plan.epoch, &consumers)
        };
        let health_out = open(Topic::Health)?;
        // Subscribers before publishers: whoever hears of us can rely on our being able to hear.
        let sources = inputs
            .iter()
            .map(|topic| {
                let mut port = Port::open(&participant, *topic)?;
                if topic.resumes() {
                    port.resume(plan.epoch, 0, 0);
                }
                Ok(Source { port, ended: false, seen: false, told: 0, lost_before: 0, published: 0 })
            })
            .collect::<Result<_>>()?;
        let health_in = Port::open(&participant, Topic::Health)?;
        let keeps_generations = outputs.iter().any(|topic| topic.resumes());
        let sinks = outputs
            .iter()
            .map(|topic| Ok(Sink { port: open(*topic)?, ended: false, newcomer: false, untold: Vec::new() }));
        let sinks = sinks.collect::<Result<_, echogrid_topics::TopicError>>()?;
        // A service that joins a running graph by hand is not one that the launcher knows.
        let control =
            std::env::var_os(SERVICE_VARIABLE).map(|_| ControlServer::open(&participant, &name)).transpose()?;
        // Nor would anybody restart it.
        let folder = plan.state.as_ref().filter(|_| control.is_some());
        let store = folder.map(|folder| {
            Store::open(&folder.join(format!("{name}.redb")), plan.epoch, plan.synced, keeps_generations)
        });
        Ok(Self {
            store: store.transpose()?,
            generations: VecDeque::new(),
            replaying: VecDeque::new(),
            stored_at: Instant::now(),
            spooled: 0,
            is_finished: false,
            name,
            control,
            plan,
            sources,
            sinks,
            health_out,
            health_in,
            signals,
            lifeline,
            state: ServiceState::Starting,
            progress: 0,
            total: 0,
            stamp_ns: 0,
            first_stamp_ns: None,
            faults: 0,
            last_error: String::new(),
            health_due: Instant::now(),
            stop: None,
            waits_for: None,
            known: BTreeSet::new(),
            _participant: participant,
        })
    }

    /// The plan of the run.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// How many messages there will be in all.
    pub fn set_total(&mut self, total: u64) {
        self.total = total;
    }

    /// Says what the service is doing now.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn set_state(&mut self, state: ServiceState) -> Result<()> {
        self.state = state;
        self.publish_health()
    }

    /// Says why the service is about to leave; whether a launcher hears it.
    pub fn fail(&mut self, error: &str) -> bool {
        self.last_error = error.into();
        self.set_state(ServiceState::Failed).is_ok() && self.lifeline.is_some()
    }

    /// Why the service is to end, if it is.
    #[must_use]
    pub fn stop(&self) -> Option<Stop> {
        self.stop
    }

    /// The next message of any input that is `welcome`; the robot description before all others.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn take(&mut self, welcome: impl Fn(Topic) -> bool) -> Result<Option<Taken>> {
        if let Some(entry) = self.replay() {
            return Ok(Some(self.again(entry)));
        }
        for index in 0..self.sources.len() {
            while welcome(self.sources[index].port.topic()) && self.may_read(index) {
                let source = &mut self.sources[index];
                match source.port.receive()? {
                    Some(Received::Message(_, Message::Robot(_))) if source.seen => {
                        // A restarted sensor describes its robot once more.
                    }
                    Some(Received::Message(header, message)) => {
                        if let Message::Robot(robot) = &message {
                            tracing::info!(robot = robot.name, sensors = robot.sensors.len(), "robot seen");
                        }
                        source.seen = true;
                        self.write_down(header.stamp_ns, &message)?;
                        self.count(message.topic(), header.stamp_ns);
                        return Ok(Some(Taken::Message(header, message)));
                    }
                    Some(Received::Told(header, pid)) => {
                        if pid == std::process::id() {
                            source.told = header.epoch;
                        }
                    }
                    Some(Received::End(header))
                        if !is_meant_for_us(source.port.topic().delivery(), source.told, header.epoch) =>
                    {
                        tracing::debug!(topic = source.port.topic().name(), "an end that was said to somebody else");
                    }
                    Some(Received::End(_)) => {
                        source.ended = true;
                        // A producer that waits for this wants to leave.
                        self.health_due = Instant::now();
                    }
                    Some(Received::Faulty(header, fault)) => {
                        if self.faults == 0 {
                            let (topic, sequence) = (source.port.topic().name(), header.sequence);
                            tracing::warn!(topic, sequence, %fault, "message refused; further ones are only counted");
                        }
                        self.faults += 1;
                    }
                    None => break,
                }
            }
            let source = &self.sources[index];
            if source.port.topic() == Topic::RobotDescription && !source.seen {
                // Without a robot description nothing else is read.
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// What took effect in an earlier life takes effect again.
    fn again(&mut self, entry: Entry) -> Taken {
        let (topic, message) = match entry.what {
            Unrepeatable::Robot(robot) => (Topic::RobotDescription, Message::Robot(robot)),
            Unrepeatable::Fix(fix) => (Topic::LocalizationFix, Message::Fix(fix)),
            Unrepeatable::Command(command) => return Taken::Command(command),
        };
        self.sources.iter_mut().filter(|source| source.port.topic() == topic).for_each(|source| source.seen = true);
        self.progress += 1;
        self.stamp_ns = self.stamp_ns.max(entry.stamp_ns);
        Taken::Message(Header { stamp_ns: entry.stamp_ns, ..Header::default() }, message)
    }

    /// Says what the service can't go on without; none: it is at work.
    pub fn set_waits_for(&mut self, topic: Option<Topic>) {
        self.waits_for = topic;
    }

    /// The input whose next message the service can't go on without, when it has taken all that is `welcome`.
    #[must_use]
    pub fn awaited_input(&self, welcome: impl Fn(Topic) -> bool) -> Option<Topic> {
        let topics = || self.sources.iter().map(|source| (source.port.topic(), source));
        let open = || topics().filter(|(topic, source)| topic.delivery().is_stream() && !source.ended);
        let robot = topics().find(|(topic, source)| *topic == Topic::RobotDescription && !source.seen);
        // A stream is left where it is until an answer has come.
        let answer = || topics().find(|(topic, _)| !topic.delivery().is_stream() && *topic != Topic::RobotDescription);
        let holds = open().any(|(topic, _)| !welcome(topic));
        robot.or_else(|| answer().filter(|_| holds)).or_else(|| open().next()).map(|(topic, _)| topic)
    }

    /// The first output that some consumer is not done with.
    #[must_use]
    pub fn awaited_output(&self) -> Option<Topic> {
        let open = |sink: &&Sink| !sink.port.is_met() || !sink.port.is_drained();
        self.sinks.iter().find(open).map(|sink| sink.port.topic())
    }

    /// Whether every input stream that `counts` has ended.
    #[must_use]
    pub fn inputs_ended(&self, counts: impl Fn(Topic) -> bool) -> bool {
        let mut topics = self.sources.iter().map(|source| (source.port.topic(), source.ended));
        self.replaying.is_empty()
            && topics.all(|(topic, ended)| ended || !topic.delivery().is_stream() || !counts(topic))
    }

    /// Answers the user's orders; those that change something are written down first, with where that was.
    ///
    /// # Errors
    /// Shared memory refuses, or the disk does.
    pub fn serve(&mut self, at: Option<u64>, mut carry_out: impl FnMut(Command) -> Result<String>) -> Result<()> {
        if !self.replaying.is_empty() {
            // First those of earlier lives.
            return Ok(());
        }
        let at = at.map_or_else(|| self.position(), |at| vec![at]);
        let Some(control) = &mut self.control else { return Ok(()) };
        let (store, stamp_ns) = (&mut self.store, self.stamp_ns);
        let mut write_down = |command: Command| match store.as_mut().filter(|_| command != Command::Save) {
            Some(store) => store.write_down(&Entry { at: at.clone(), stamp_ns, what: Unrepeatable::Command(command) }),
            None => Ok(()),
        };
        Ok(control.serve(|command| {
            let done = write_down(command).and_then(|()| carry_out(command));
            done.map_err(|error| in_words(&error))
        })?)
    }

    fn sink(&mut self, topic: Topic) -> Result<&mut Sink> {
        let name = &self.name;
        let sink = self.sinks.iter_mut().find(|sink| sink.port.topic() == topic);
        sink.with_context(|| format!("{name} wrote to {}, which is not among its outputs", topic.name()))
    }

    /// Sends what the windows of the consumers have room for, and wakes them.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn flush(&mut self, outbox: &mut Outbox) -> Result<()> {
        while let Some((stamp_ns, message)) = outbox.front() {
            let sink = self.sink(message.topic())?;
            if sink.port.room() == 0 {
                break;
            }
            sink.port.send(*stamp_ns, message)?;
            outbox.pop();
        }
        if outbox.is_empty() {
            self.say_what_was_told()?;
        }
        self.ring()
    }

    /// All that the service had to say is on its way: whoever came anew has been told.
    fn say_what_was_told(&mut self) -> Result<()> {
        for sink in self.sinks.iter_mut().filter(|sink| !sink.newcomer) {
            for pid in std::mem::take(&mut sink.untold) {
                sink.port.told(pid)?;
            }
        }
        Ok(())
    }

    /// Whether every consumer has the next message of `topic`, from an earlier life of ours.
    #[must_use]
    pub fn is_known(&self, topic: Topic) -> bool {
        self.sinks.iter().any(|sink| sink.port.topic() == topic && sink.port.is_known())
    }

    /// Sends a sensor's message if there is room for it.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn send(&mut self, stamp_ns: u64, message: &Message) -> Result<bool> {
        let sink = self.sink(message.topic())?;
        if sink.port.room() == 0 {
            return Ok(false);
        }
        sink.port.send(stamp_ns, message)?;
        self.count(message.topic(), stamp_ns);
        Ok(true)
    }

    /// One more message was handled.
    fn count(&mut self, topic: Topic, stamp_ns: u64) {
        self.progress += 1;
        self.stamp_ns = self.stamp_ns.max(stamp_ns);
        if topic.delivery().is_stream() {
            self.first_stamp_ns.get_or_insert(stamp_ns);
        }
    }

    /// Wakes the consumers of what was sent.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn ring(&mut self) -> Result<()> {
        Ok(self.sinks.iter_mut().try_for_each(|sink| sink.port.ring())?)
    }

    /// The output that somebody came to who was not there when it was written; each is told once.
    pub fn take_newcomer(&mut self) -> Option<Topic> {
        let sink = self.sinks.iter_mut().find(|sink| sink.newcomer)?;
        sink.newcomer = false;
        // The newcomer has not heard of it.
        sink.ended &= sink.port.topic().resumes();
        Some(sink.port.topic())
    }

    /// Says on every output stream that it ends here, to whoever has not heard it.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn end_outputs(&mut self) -> Result<()> {
        let stamp_ns = self.stamp_ns;
        // Who was not met yet has heard nothing that could end.
        let may_end = |sink: &&mut Sink| {
            let is_relayed = sink.port.topic().delivery() == Delivery::Relayed;
            !sink.ended && (!is_relayed || (sink.port.is_met() && !sink.newcomer && sink.untold.is_empty()))
        };
        for sink in self.sinks.iter_mut().filter(may_end) {
            if sink.port.topic().delivery().is_stream() {
                sink.port.end(stamp_ns)?;
            }
            sink.ended = true;
            sink.port.ring()?;
        }
        Ok(())
    }

    /// What came in is stored as far as was said before.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn leave(&mut self) -> Result<()> {
        self.tell_the_end();
        self.set_state(ServiceState::Finished)
    }

    /// All that came in is taken care of, downstream too: whoever sent it may leave.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn finish(&mut self) -> Result<()> {
        self.is_finished = true;
        self.tell_the_end();
        self.set_state(ServiceState::Finished)
    }

    fn tell_the_end(&self) {
        let lost: u64 = self.sources.iter().map(Source::lost).sum();
        tracing::info!(messages = self.progress, lost, refused = self.faults, complete = self.is_finished, "ended");
    }

    /// Whether every consumer has integrated all that was sent.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.sinks.iter().all(|sink| sink.port.is_drained() && !sink.newcomer && sink.untold.is_empty())
    }

    /// Waits until something happened, at most for `patience`; takes note of signals, of the
    /// launcher's death and of acknowledgements, and says how the service is doing when that is due.
    ///
    /// # Errors
    /// The system refuses, or the service was asked twice to stop.
    pub fn attend(&mut self, patience: Duration) -> Result<()> {
        self.publish_health_if_due()?;
        let patience = patience.min(self.health_due.saturating_duration_since(Instant::now()));
        let (signalled, orphaned) = self.poll(patience)?;
        if signalled {
            while let Some(caught) = self.signals.next()? {
                // Nobody but the launcher knows whether the others have heard the last of this service.
                if self.lifeline.is_some() && caught.sender != std::os::unix::process::parent_id() {
                    return Err(Terminated(caught).into());
                }
                anyhow::ensure!(self.stop != Some(Stop::Asked), "asked twice to stop: leaving at once");
                self.stop.get_or_insert(Stop::Asked);
            }
        }
        if orphaned {
            self.stop = Some(Stop::Orphaned);
        }
        for source in &self.sources {
            source.port.hush()?;
        }
        self.hear()?;
        self.publish_health_if_due()
    }

    /// Listens to what the others say of themselves.
    fn hear(&mut self) -> Result<()> {
        self.health_in.hush()?;
        let mut arrivals = false;
        while let Some(received) = self.health_in.receive()? {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            for sink in &mut self.sinks {
                let is_new = sink.port.note(&health);
                if is_new && sink.port.topic().delivery() == Delivery::Relayed {
                    sink.newcomer = true;
                    sink.untold.push(health.pid);
                }
            }
            arrivals |= self.known.insert(health.pid);
        }
        if arrivals {
            // They get the latest of what was sent before they came, and hear of us.
            self.sinks.iter_mut().try_for_each(|sink| sink.port.welcome())?;
            self.health_due = Instant::now();
        }
        Ok(())
    }

    fn poll(&self, patience: Duration) -> Result<(bool, bool)> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![self.signals.fd()];
        fds.extend(self.lifeline.as_ref().filter(|_| self.stop != Some(Stop::Orphaned)).map(Lifeline::fd));
        let watched_lifeline = fds.len() == 2;
        fds.extend(self.sources.iter().map(|source| source.port.fd()));
        fds.push(self.health_in.fd());
        fds.extend(self.control.as_ref().map(ControlServer::fd));
        let mut fds: Vec<PollFd<'_>> = fds.into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        // Rounded up: a loop that waits for 0 ms until 0.9 ms have passed would spin.
        let millis = patience.as_micros().div_ceil(1000);
        let timeout = PollTimeout::try_from(i32::try_from(millis).unwrap_or(i32::MAX)).unwrap_or(PollTimeout::MAX);
        match poll(&mut fds, timeout) {
            Ok(_) | Err(Errno::EINTR) => {}
            Err(errno) => return Err(errno).context("waiting for messages"),
        }
        let ready = |index: usize| fds[index].revents().is_some_and(|events| !events.is_empty());
        Ok((ready(0), watched_lifeline && ready(1)))
    }

    fn publish_health_if_due(&mut self) -> Result<()> {
        let acks = self.acknowledged();
        let pending = || {
            self.sources.iter().zip(&acks).map(|(source, ack)| (source, ack.sequence.saturating_sub(source.published)))
        };
        let far_ahead = pending().any(|(source, pending)| {
            let window = source.port.topic().qos(self.plan.max_readings).window;
            window != u64::MAX && pending >= window / 4
        });
        if !far_ahead && pending().any(|(_, pending)| pending > 0) {
            self.health_due = self.health_due.min(Instant::now() + ACKNOWLEDGE_WITHIN);
        }
        if far_ahead || Instant::now() >= self.health_due { self.publish_health() } else { Ok(()) }
    }

    /// What the producers need not keep for us any longer, by input.
    fn acknowledged(&self) -> Vec<Ack> {
        let stored = self.usable();
        let mut stored = stored.into_iter().flat_map(|moment| moment.read.iter());
        let acks = self.sources.iter().map(|source| {
            let taken = source.port.taken();
            if self.is_finished {
                return taken;
            }
            // The end counts when all is done that comes of it.
            let end = u64::from(source.ended);
            let sequence = match &self.store {
                Some(_) if source.resumes() => stored.next().map_or(0, |read| read.sequence - u64::from(read.ended)),
                _ => taken.sequence.saturating_sub(end),
            };
            Ack { sequence, ..taken }
        });
        acks.collect()
    }

    fn publish_health(&mut self) -> Result<()> {
        let acks = self.acknowledged();
        for (source, ack) in self.sources.iter_mut().zip(&acks) {
            source.published = ack.sequence;
        }
        let health = Health {
            service: self.name.clone(),
            pid: std::process::id(),
            state: self.state,
            progress: self.progress,
            total: self.total,
            stamp_ns: self.stamp_ns,
            first_stamp_ns: self.first_stamp_ns.unwrap_or(0),
            faults: self.faults,
            lost: self.sources.iter().map(Source::lost).sum(),
            acks,
            waits_for: self.waits_for,
            last_error: self.last_error.clone(),
        };
        self.health_out.send(self.stamp_ns, &Message::Health(health))?;
        self.health_out.ring()?;
        self.health_due = Instant::now() + HEARTBEAT;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_before_all_was_told_is_meant_for_somebody_else() {
        // Nobody has told us anything; another life of the producer has; this one has.
        let relayed = [0, 6, 7].map(|told| is_meant_for_us(Delivery::Relayed, told, 7));
        assert_eq!(relayed, [false, false, true]);
        // What is numbered through the whole run is for everybody.
        assert!(is_meant_for_us(Delivery::Lossless, 0, 7));
    }
}
