//! A service's ends of the graph: its ports, what it acknowledges, what it waits for.

use std::collections::BTreeSet;
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
use crate::plan::{DOMAIN_VARIABLE, Plan, SERVICE_VARIABLE};
use crate::signals::Signals;

/// A service says that it is alive at least this often.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// A sensor's first messages and its robot description belong together.
const ROBOT_WITHIN: Duration = Duration::from_secs(5);
/// What was read but not yet acknowledged is acknowledged this soon.
const ACKNOWLEDGE_WITHIN: Duration = Duration::from_millis(50);

/// Why a service is to end before its inputs do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// It was asked to.
    Asked,
    /// Its launcher is gone: nobody downstream can be waited for.
    Orphaned,
}

#[derive(Debug)]
struct Source {
    port: Port,
    ended: bool,
    seen: bool,
    published: u64,
}

/// Ports and vital signs of one process.
#[derive(Debug)]
pub struct Runtime {
    name: String,
    plan: Plan,
    sources: Vec<Source>,
    outputs: Vec<Output>,
    health_out: Output,
    health_in: Option<Port>,
    control: Option<ControlServer>,
    signals: Signals,
    lifeline: Option<Lifeline>,
    state: ServiceState,
    progress: u64,
    total: u64,
    stamp_ns: u64,
    faults: u64,
    last_error: String,
    health_due: Instant,
    stop: Option<Stop>,
    /// Since when there are messages but no robot description.
    without_robot_since: Option<Instant>,
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
        let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM])?;
        let lifeline = Lifeline::attach();
        let name = std::env::var(SERVICE_VARIABLE).unwrap_or_else(|_| default_name.into());
        let domain = std::env::var(DOMAIN_VARIABLE)
            .with_context(|| format!("{DOMAIN_VARIABLE} is not set: name the domain of a running graph (--domain)"))?;
        let domain = Domain::named(&domain)?;
        let participant = Participant::join(&domain, &name)?;
        let plan = Plan::read(&domain)?;
        let open = |topic: Topic| Output::open(&participant, topic, plan.max_readings, plan.consumers_of(topic));
        let health_out = open(Topic::Health)?;
        // Subscribers before publishers: whoever hears of us can rely on our being able to hear.
        let sources = inputs
            .iter()
            .map(|topic| {
                let port = Port::open(&participant, *topic)?;
                Ok(Source { port, ended: false, seen: false, published: 0 })
            })
            .collect::<Result<_>>()?;
        let health_in = if outputs.is_empty() { None } else { Some(Port::open(&participant, Topic::Health)?) };
        let outputs = outputs.iter().map(|topic| open(*topic)).collect::<Result<_, _>>()?;
        // A service that joins a running graph by hand is not one that the launcher knows.
        let control =
            std::env::var_os(SERVICE_VARIABLE).map(|_| ControlServer::open(&participant, &name)).transpose()?;
        Ok(Self {
            name,
            control,
            plan,
            sources,
            outputs,
            health_out,
            health_in,
            signals,
            lifeline,
            state: ServiceState::Starting,
            progress: 0,
            total: 0,
            stamp_ns: 0,
            faults: 0,
            last_error: String::new(),
            health_due: Instant::now(),
            stop: None,
            without_robot_since: None,
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
    pub fn take(&mut self, welcome: impl Fn(Topic) -> bool) -> Result<Option<(Header, Message)>> {
        for index in 0..self.sources.len() {
            while welcome(self.sources[index].port.topic()) {
                let source = &mut self.sources[index];
                match source.port.receive()? {
                    Some(Received::Message(header, message)) => {
                        source.seen = true;
                        self.progress += 1;
                        self.stamp_ns = self.stamp_ns.max(header.stamp_ns);
                        return Ok(Some((header, message)));
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
                self.check_for_robot()?;
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// Without a robot description nothing else is read. A sensor that sends none but goes on to
    /// send readings would have the graph wait for ever.
    fn check_for_robot(&mut self) -> Result<()> {
        if self.without_robot_since.is_none() {
            for source in &self.sources {
                if source.port.topic().delivery() == Delivery::Lossless && source.port.has_messages()? {
                    self.without_robot_since = Some(Instant::now());
                }
            }
        }
        let waited = self.without_robot_since.map_or(Duration::ZERO, |since| since.elapsed());
        anyhow::ensure!(
            waited < ROBOT_WITHIN,
            "the sensor has sent messages but no {} for {} s (refused as faulty: {})",
            Topic::RobotDescription.name(),
            ROBOT_WITHIN.as_secs(),
            self.faults
        );
        Ok(())
    }

    /// Whether every input stream that `counts` has ended.
    #[must_use]
    pub fn inputs_ended(&self, counts: impl Fn(Topic) -> bool) -> bool {
        let mut topics = self.sources.iter().map(|source| (source.port.topic(), source.ended));
        topics.all(|(topic, ended)| ended || topic.delivery() != Delivery::Lossless || !counts(topic))
    }

    /// Answers the user's orders.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn serve(&mut self, mut carry_out: impl FnMut(Command) -> Result<String>) -> Result<()> {
        let Some(control) = &mut self.control else { return Ok(()) };
        Ok(control.serve(|command| carry_out(command).map_err(|error| in_words(&error)))?)
    }

    /// Sends what the windows of the consumers have room for, and wakes them.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn flush(&mut self, outbox: &mut Outbox) -> Result<()> {
        while let Some((stamp_ns, message)) = outbox.front() {
            let topic = message.topic();
            let output =
                self.outputs.iter_mut().find(|output| output.topic() == topic).with_context(|| {
                    format!("{} wrote to {}, which is not among its outputs", self.name, topic.name())
                })?;
            if output.room() == 0 {
                break;
            }
            output.send(*stamp_ns, message)?;
            outbox.pop();
        }
        self.outputs.iter_mut().try_for_each(Output::ring)?;
        Ok(())
    }

    /// Sends a sensor's message if there is room for it.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn send(&mut self, stamp_ns: u64, message: &Message) -> Result<bool> {
        let topic = message.topic();
        let output = self
            .outputs
            .iter_mut()
            .find(|output| output.topic() == topic)
            .with_context(|| format!("{} wrote to {}, which is not among its outputs", self.name, topic.name()))?;
        if output.room() == 0 {
            return Ok(false);
        }
        output.send(stamp_ns, message)?;
        self.progress += 1;
        self.stamp_ns = self.stamp_ns.max(stamp_ns);
        Ok(true)
    }

    /// Wakes the consumers of what was sent.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn ring(&mut self) -> Result<()> {
        Ok(self.outputs.iter_mut().try_for_each(Output::ring)?)
    }

    /// Says on every output stream that it ends here.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn end_outputs(&mut self) -> Result<()> {
        for output in &mut self.outputs {
            if output.topic().delivery() == Delivery::Lossless {
                output.end(self.stamp_ns)?;
            }
            output.ring()?;
        }
        Ok(())
    }

    /// Whether every consumer has integrated all that was sent.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.outputs.iter().all(Output::is_drained)
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
            while self.signals.next()?.is_some() {
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
        if let Some(port) = &mut self.health_in {
            port.hush()?;
            let mut arrivals = false;
            while let Some(received) = port.receive()? {
                if let Received::Message(_, Message::Health(health)) = received {
                    self.outputs.iter_mut().for_each(|output| output.note(&health));
                    arrivals |= !self.known.contains(&health.pid);
                    self.known.insert(health.pid);
                }
            }
            if arrivals {
                // They get the latest of what was sent before they came.
                self.outputs.iter_mut().try_for_each(Output::welcome)?;
            }
        }
        self.publish_health_if_due()
    }

    fn poll(&self, patience: Duration) -> Result<(bool, bool)> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![self.signals.fd()];
        fds.extend(self.lifeline.as_ref().filter(|_| self.stop != Some(Stop::Orphaned)).map(Lifeline::fd));
        let watched_lifeline = fds.len() == 2;
        fds.extend(self.sources.iter().map(|source| source.port.fd()));
        fds.extend(self.health_in.as_ref().map(Port::fd));
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
        let pending = |source: &Source| source.port.ack().sequence.saturating_sub(source.published);
        let far_ahead = self.sources.iter().any(|source| {
            let window = source.port.topic().qos(self.plan.max_readings).window;
            window != u64::MAX && pending(source) >= window / 4
        });
        if !far_ahead && self.sources.iter().any(|source| pending(source) > 0) {
            self.health_due = self.health_due.min(Instant::now() + ACKNOWLEDGE_WITHIN);
        }
        if far_ahead || Instant::now() >= self.health_due { self.publish_health() } else { Ok(()) }
    }

    fn publish_health(&mut self) -> Result<()> {
        let acks: Vec<Ack> = self.sources.iter().map(|source| source.port.ack()).collect();
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
            faults: self.faults,
            lost: self.sources.iter().map(|source| source.port.lost()).sum(),
            acks,
            last_error: self.last_error.clone(),
        };
        self.health_out.send(self.stamp_ns, &Message::Health(health))?;
        self.health_out.ring()?;
        self.health_due = Instant::now() + HEARTBEAT;
        Ok(())
    }
}
