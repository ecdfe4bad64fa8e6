//! Ports: where a process writes a topic ([`Output`]) or reads it ([`Input`]).

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, EventId, FileDescriptorBased, ipc};

use crate::message::{
    Ack, Fault, Health, LocalizationFix, LocalizationRequest, MapInfo, Message, PoseEstimate, RawOdometry, TileUpdate,
    TruePose, TrueWorld,
};
use crate::participant::{Participant, SENT, Sized, Slice, TopicError};
use crate::place::{Place, Step};
use crate::topic::Topic;
use crate::window::Window;
use crate::wire::{
    EstimateWire, FixWire, Header, HealthWire, LocalizationRequestWire, MapInfoWire, OdometryRawWire, ReadingWire,
    RobotWire, TileWire, TruePoseWire, TrueWorldWire, VerdictWire, Wire,
};

/// Header flag: the stream ends here.
const END: u32 = 1;
/// Header flag, on relayed topics: the process whose number `stamp_ns` is has been told all that counts.
const TOLD: u32 = 2;

type PublisherOf<W> = Publisher<ipc::Service, W, Header>;
type SubscriberOf<W> = Subscriber<ipc::Service, W, Header>;

#[derive(Debug)]
enum Out {
    Robot(PublisherOf<RobotWire>),
    Odometry(PublisherOf<OdometryRawWire>),
    Scan(PublisherOf<[ReadingWire]>),
    Estimate(PublisherOf<EstimateWire>),
    Tile(PublisherOf<TileWire>),
    Info(PublisherOf<MapInfoWire>),
    Verdicts(PublisherOf<[VerdictWire]>),
    Health(PublisherOf<HealthWire>),
    Truth(PublisherOf<TruePoseWire>),
    World(PublisherOf<TrueWorldWire>),
    Request(PublisherOf<LocalizationRequestWire>),
    Fix(PublisherOf<FixWire>),
}

#[derive(Debug)]
enum In {
    Robot(SubscriberOf<RobotWire>),
    Odometry(SubscriberOf<OdometryRawWire>),
    Scan(SubscriberOf<[ReadingWire]>),
    Estimate(SubscriberOf<EstimateWire>),
    Tile(SubscriberOf<TileWire>),
    Info(SubscriberOf<MapInfoWire>),
    Verdicts(SubscriberOf<[VerdictWire]>),
    Health(SubscriberOf<HealthWire>),
    Truth(SubscriberOf<TruePoseWire>),
    World(SubscriberOf<TrueWorldWire>),
    Request(SubscriberOf<LocalizationRequestWire>),
    Fix(SubscriberOf<FixWire>),
}

/// A topic to write to.
#[derive(Debug)]
pub struct Output {
    topic: Topic,
    port: Out,
    bell: Notifier<ipc::Service>,
    epoch: u64,
    life: u32,
    sequence: u64,
    /// What every consumer has stored is not sent again.
    stored: u64,
    window: Window,
    max_readings: usize,
    unrung: bool,
}

impl Output {
    /// Opens `topic` for writing, in the run `epoch`. The producer of a stream stays within the topic's window of the
    /// slowest of `consumers` (names of services), and starts when all have shown up.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn open(
        participant: &Participant,
        topic: Topic,
        max_readings: usize,
        epoch: u64,
        consumers: &[String],
    ) -> Result<Self, TopicError> {
        let port = match topic {
            Topic::RobotDescription => Out::Robot(publisher(participant, topic)?),
            Topic::OdometryRaw => Out::Odometry(publisher(participant, topic)?),
            Topic::RangeScan => Out::Scan(slice_publisher(participant, topic, max_readings)?),
            Topic::OdometryEstimate => Out::Estimate(publisher(participant, topic)?),
            Topic::MapTiles => Out::Tile(publisher(participant, topic)?),
            Topic::MapInfo => Out::Info(publisher(participant, topic)?),
            Topic::RangeVerdict => Out::Verdicts(slice_publisher(participant, topic, max_readings)?),
            Topic::Health => Out::Health(publisher(participant, topic)?),
            Topic::TruePose => Out::Truth(publisher(participant, topic)?),
            Topic::TrueWorld => Out::World(publisher(participant, topic)?),
            Topic::LocalizationRequest => Out::Request(publisher(participant, topic)?),
            Topic::LocalizationFix => Out::Fix(publisher(participant, topic)?),
        };
        // After the publisher, so that "a notifier appeared" means "a producer is there".
        let bell = participant
            .bell(topic)?
            .notifier_builder()
            .default_event_id(EventId::new(SENT))
            .create()
            .map_err(|e| failed(topic, "creating a notifier", e))?;
        let consumers = if topic.delivery().is_stream() { consumers } else { &[] };
        let life = new_epoch();
        let epoch = if topic.resumes() { epoch } else { life };
        Ok(Self {
            topic,
            port,
            bell,
            epoch,
            life: life as u32,
            sequence: 0,
            stored: 0,
            window: Window::new(topic, epoch, topic.qos(max_readings).window, consumers),
            max_readings,
            unrung: false,
        })
    }

    /// The topic.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
    }

    /// The last sequence sent.
    #[must_use]
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// How many more messages fit into the window of the slowest consumer now.
    #[must_use]
    pub fn room(&self) -> u64 {
        self.window.room(self.sequence)
    }

    /// Whether every consumer has been heard of.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.window.acknowledged().is_some()
    }

    /// The last sequence that no consumer will need again.
    #[must_use]
    pub fn acknowledged(&self) -> u64 {
        self.window.acknowledged().flatten().unwrap_or(if self.is_met() { u64::MAX } else { 0 })
    }

    /// Goes on after `sequence`, where an earlier life was; what every consumer has stored by now is only counted.
    pub fn resume(&mut self, sequence: u64) {
        self.sequence = sequence;
        self.stored = self.window.acknowledged().flatten().unwrap_or(0);
    }

    /// Whether every consumer has the next message, from an earlier life of ours.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.topic.resumes() && self.sequence < self.stored
    }

    /// Whether every consumer is done with all that was sent.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.window.is_drained(self.sequence)
    }

    /// The consumers that are not.
    #[must_use]
    pub fn lagging(&self) -> Vec<&str> {
        self.window.lagging(self.sequence)
    }

    /// Takes note of what a consumer says it is done with; whether it is one that was not there before.
    pub fn note(&mut self, health: &Health) -> bool {
        // What a consumer stored of an earlier life of ours is more than this one has sent so far.
        let sent = if self.topic.resumes() { u64::MAX } else { self.sequence };
        self.window.note(health, sent)
    }

    /// Sends a message, without waking anyone: [`Output::ring`] does.
    ///
    /// # Errors
    /// Shared memory refuses, the message belongs to another topic, or a scan is too long.
    pub fn send(&mut self, stamp_ns: u64, message: &Message) -> Result<(), TopicError> {
        let header = self.next_header(stamp_ns, 0);
        if self.is_stored(&header) {
            return Ok(());
        }
        let topic = self.topic;
        match (&self.port, message) {
            (Out::Robot(port), Message::Robot(robot)) => put(port, topic, header, robot.into()),
            (Out::Odometry(port), Message::Odometry(raw)) => put(port, topic, header, raw.into()),
            (Out::Scan(port), Message::Scan(readings)) => put_slice(port, topic, header, self.max_readings, readings),
            (Out::Estimate(port), Message::Estimate(estimate)) => put(port, topic, header, estimate.into()),
            (Out::Tile(port), Message::Tile(tile)) => put(port, topic, header, tile.into()),
            (Out::Info(port), Message::Info(info)) => put(port, topic, header, info.as_ref().into()),
            (Out::Verdicts(port), Message::Verdicts(verdicts)) => {
                put_slice(port, topic, header, self.max_readings, verdicts)
            }
            (Out::Health(port), Message::Health(health)) => put(port, topic, header, health.into()),
            (Out::Truth(port), Message::TruePose(pose)) => put(port, topic, header, pose.into()),
            (Out::World(port), Message::TrueWorld(world)) => put(port, topic, header, world.into()),
            (Out::Request(port), Message::Request(request)) => put(port, topic, header, request.as_ref().into()),
            (Out::Fix(port), Message::Fix(fix)) => put(port, topic, header, fix.into()),
            (_, message) => {
                Err(failed(topic, "sending", format!("a message of {} is not for it", message.topic().name())))
            }
        }?;
        self.sequence = header.sequence;
        self.unrung = true;
        Ok(())
    }

    /// Says that the stream ends here.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn end(&mut self, stamp_ns: u64) -> Result<(), TopicError> {
        let header = self.next_header(stamp_ns, END);
        if self.is_stored(&header) {
            return Ok(());
        }
        self.put_empty(header)
    }

    /// Says on a relayed topic that the process `pid`, which came anew, has been told all that counts.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn told(&mut self, pid: u32) -> Result<(), TopicError> {
        let header = self.next_header(u64::from(pid), TOLD);
        self.put_empty(header)
    }

    /// A message that says no more than its header does.
    fn put_empty(&mut self, header: Header) -> Result<(), TopicError> {
        let topic = self.topic;
        match &self.port {
            Out::Robot(port) => put(port, topic, header, RobotWire::default()),
            Out::Odometry(port) => put(port, topic, header, OdometryRawWire::default()),
            Out::Scan(port) => put_slice::<ReadingWire, echogrid_core::Reading>(port, topic, header, 1, &[]),
            Out::Estimate(port) => put(port, topic, header, EstimateWire::default()),
            Out::Tile(port) => put(port, topic, header, TileWire::default()),
            Out::Info(port) => put(port, topic, header, MapInfoWire::default()),
            Out::Verdicts(port) => {
                put_slice::<VerdictWire, (u16, echogrid_core::verdict::Verdict)>(port, topic, header, 1, &[])
            }
            Out::Health(port) => put(port, topic, header, HealthWire::default()),
            Out::Truth(port) => put(port, topic, header, TruePoseWire::default()),
            Out::World(port) => put(port, topic, header, TrueWorldWire::default()),
            Out::Request(port) => put(port, topic, header, LocalizationRequestWire::default()),
            Out::Fix(port) => put(port, topic, header, FixWire::default()),
        }?;
        self.sequence = header.sequence;
        self.unrung = true;
        Ok(())
    }

    /// Hands the latest messages to consumers that came late.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn welcome(&mut self) -> Result<(), TopicError> {
        match &self.port {
            Out::Robot(port) => port.update_connections(),
            Out::Odometry(port) => port.update_connections(),
            Out::Scan(port) => port.update_connections(),
            Out::Estimate(port) => port.update_connections(),
            Out::Tile(port) => port.update_connections(),
            Out::Info(port) => port.update_connections(),
            Out::Verdicts(port) => port.update_connections(),
            Out::Health(port) => port.update_connections(),
            Out::Truth(port) => port.update_connections(),
            Out::World(port) => port.update_connections(),
            Out::Request(port) => port.update_connections(),
            Out::Fix(port) => port.update_connections(),
        }
        .map_err(|e| failed(self.topic, "connecting", e))?;
        self.unrung = true;
        self.ring()
    }

    /// Wakes the consumers if there is something new.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn ring(&mut self) -> Result<(), TopicError> {
        if self.unrung {
            self.bell.notify().map_err(|e| failed(self.topic, "notifying", e))?;
            self.unrung = false;
        }
        Ok(())
    }

    fn next_header(&self, stamp_ns: u64, flags: u32) -> Header {
        Header { sequence: self.sequence + 1, epoch: self.epoch, stamp_ns, flags, life: self.life }
    }

    /// Whether every consumer has it: then it is counted and not sent.
    fn is_stored(&mut self, header: &Header) -> bool {
        let is_stored = self.is_known();
        if is_stored {
            self.sequence = header.sequence;
        }
        is_stored
    }
}

/// What came in.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
pub enum Received {
    /// A message.
    Message(Header, Message),
    /// The stream ended.
    End(Header),
    /// All that counts was told to this process.
    Told(Header, u32),
    /// A message that broke its contract; it was dropped.
    Faulty(Header, Fault),
}

/// A topic to read from.
#[derive(Debug)]
pub struct Input {
    topic: Topic,
    port: In,
    bell: Listener<ipc::Service>,
    place: Place,
}

impl Input {
    /// Opens `topic` for reading, from the oldest message its producer still holds.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn open(participant: &Participant, topic: Topic) -> Result<Self, TopicError> {
        // Before the subscriber, so that no wake-up falls between.
        let bell = participant
            .bell(topic)?
            .listener_builder()
            .create()
            .map_err(|e| failed(topic, "creating a listener", e))?;
        let port = match topic {
            Topic::RobotDescription => In::Robot(subscriber(participant, topic)?),
            Topic::OdometryRaw => In::Odometry(subscriber(participant, topic)?),
            Topic::RangeScan => In::Scan(slice_subscriber(participant, topic)?),
            Topic::OdometryEstimate => In::Estimate(subscriber(participant, topic)?),
            Topic::MapTiles => In::Tile(subscriber(participant, topic)?),
            Topic::MapInfo => In::Info(subscriber(participant, topic)?),
            Topic::RangeVerdict => In::Verdicts(slice_subscriber(participant, topic)?),
            Topic::Health => In::Health(subscriber(participant, topic)?),
            Topic::TruePose => In::Truth(subscriber(participant, topic)?),
            Topic::TrueWorld => In::World(subscriber(participant, topic)?),
            Topic::LocalizationRequest => In::Request(subscriber(participant, topic)?),
            Topic::LocalizationFix => In::Fix(subscriber(participant, topic)?),
        };
        Ok(Self { topic, port, bell, place: Place::default() })
    }

    /// The topic.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
    }

    /// Goes on after message `sequence` of the run `epoch`, whose stamp was `stamp_ns`: nothing before is new, and another
    /// run's is a fault.
    pub fn resume(&mut self, epoch: u64, sequence: u64, stamp_ns: u64) {
        self.place = Place::after(epoch, sequence, stamp_ns);
    }

    /// Readable when there may be something new.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the listener owns the descriptor and outlives the borrow.
        unsafe { BorrowedFd::borrow_raw(self.bell.file_descriptor().native_handle()) }
    }

    /// Takes note of the wake-ups so far. Call before reading until [`Input::receive`] gives none.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn hush(&self) -> Result<(), TopicError> {
        self.bell.try_wait(|_| {}).map(|_| ()).map_err(|e| failed(self.topic, "draining its event", e))
    }

    /// The next message that was not here before.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn receive(&mut self) -> Result<Option<Received>, TopicError> {
        while let Some(received) = self.receive_any()? {
            let (Received::Message(header, _)
            | Received::End(header)
            | Received::Told(header, _)
            | Received::Faulty(header, _)) = &received;
            let header = *header;
            let is_good = !matches!(received, Received::Faulty(..));
            match self.place.follow(self.topic.delivery(), &header, is_good) {
                Step::New => return Ok(Some(received)),
                Step::Known => {}
                Step::Faulty(fault) => return Ok(Some(Received::Faulty(header, fault))),
            }
        }
        Ok(None)
    }

    fn receive_any(&mut self) -> Result<Option<Received>, TopicError> {
        let topic = self.topic;
        match &self.port {
            In::Robot(port) => get(port, topic, |w: &RobotWire| w.try_into().map(Message::Robot)),
            In::Odometry(port) => {
                get(port, topic, |w: &OdometryRawWire| RawOdometry::try_from(w).map(Message::Odometry))
            }
            In::Scan(port) => get_slice(port, topic, |w: &[ReadingWire]| {
                Ok(Message::Scan(w.iter().map(echogrid_core::Reading::from).collect()))
            }),
            In::Estimate(port) => get(port, topic, |w: &EstimateWire| PoseEstimate::try_from(w).map(Message::Estimate)),
            In::Tile(port) => get(port, topic, |w: &TileWire| TileUpdate::try_from(w).map(Message::Tile)),
            In::Info(port) => {
                get(port, topic, |w: &MapInfoWire| MapInfo::try_from(w).map(|info| Message::Info(Box::new(info))))
            }
            In::Verdicts(port) => get_slice(port, topic, |w: &[VerdictWire]| {
                w.iter().map(TryInto::try_into).collect::<Result<_, _>>().map(Message::Verdicts)
            }),
            In::Health(port) => get(port, topic, |w: &HealthWire| Health::try_from(w).map(Message::Health)),
            In::Truth(port) => get(port, topic, |w: &TruePoseWire| TruePose::try_from(w).map(Message::TruePose)),
            In::World(port) => get(port, topic, |w: &TrueWorldWire| TrueWorld::try_from(w).map(Message::TrueWorld)),
            In::Request(port) => get(port, topic, |w: &LocalizationRequestWire| {
                LocalizationRequest::try_from(w).map(|request| Message::Request(Box::new(request)))
            }),
            In::Fix(port) => get(port, topic, |w: &FixWire| LocalizationFix::try_from(w).map(Message::Fix)),
        }
    }

    /// Whether there is something to receive.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn has_messages(&self) -> Result<bool, TopicError> {
        match &self.port {
            In::Robot(port) => port.has_samples(),
            In::Odometry(port) => port.has_samples(),
            In::Scan(port) => port.has_samples(),
            In::Estimate(port) => port.has_samples(),
            In::Tile(port) => port.has_samples(),
            In::Info(port) => port.has_samples(),
            In::Verdicts(port) => port.has_samples(),
            In::Health(port) => port.has_samples(),
            In::Truth(port) => port.has_samples(),
            In::World(port) => port.has_samples(),
            In::Request(port) => port.has_samples(),
            In::Fix(port) => port.has_samples(),
        }
        .map_err(|e| failed(self.topic, "looking for messages", e))
    }

    /// How far this input has been read.
    #[must_use]
    pub fn taken(&self) -> Ack {
        Ack { topic: self.topic, epoch: self.place.epoch, sequence: self.place.sequence }
    }

    /// Stamp of the latest message, nanoseconds.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        self.place.stamp_ns()
    }

    /// Messages that never arrived, by the gaps in the sequence (streams only).
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.place.lost
    }
}

fn failed(topic: Topic, what: &'static str, reason: impl ToString) -> TopicError {
    TopicError::Topic { topic: topic.name(), what, reason: reason.to_string() }
}

/// Differs between any two lives of any producers on this machine.
fn new_epoch() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which means "no message yet".
    (since.as_nanos() as u64) | 1
}

fn publisher<W: Wire>(participant: &Participant, topic: Topic) -> Result<PublisherOf<W>, TopicError> {
    let factory: Sized<W> = participant.sized(topic)?;
    let builder =
        factory.publisher_builder().max_loaned_samples(1).backpressure_strategy(BackpressureStrategy::DiscardData);
    builder.create().map_err(|e| failed(topic, "creating a publisher", e))
}

fn slice_publisher<W: Wire>(
    participant: &Participant,
    topic: Topic,
    max_len: usize,
) -> Result<PublisherOf<[W]>, TopicError> {
    let factory: Slice<W> = participant.slice(topic)?;
    let builder = factory
        .publisher_builder()
        .max_loaned_samples(1)
        .initial_max_slice_len(max_len.max(1))
        .allocation_strategy(AllocationStrategy::Static)
        .backpressure_strategy(BackpressureStrategy::DiscardData);
    builder.create().map_err(|e| failed(topic, "creating a publisher", e))
}

fn subscriber<W: Wire>(participant: &Participant, topic: Topic) -> Result<SubscriberOf<W>, TopicError> {
    let factory: Sized<W> = participant.sized(topic)?;
    factory.subscriber_builder().create().map_err(|e| failed(topic, "creating a subscriber", e))
}

fn slice_subscriber<W: Wire>(participant: &Participant, topic: Topic) -> Result<SubscriberOf<[W]>, TopicError> {
    let factory: Slice<W> = participant.slice(topic)?;
    factory.subscriber_builder().create().map_err(|e| failed(topic, "creating a subscriber", e))
}

fn put<W: Wire>(port: &PublisherOf<W>, topic: Topic, header: Header, wire: W) -> Result<(), TopicError> {
    let mut sample = port.loan_uninit().map_err(|e| failed(topic, "sending", e))?;
    *sample.user_header_mut() = header;
    sample.write_payload(wire).send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
}

fn put_slice<'a, W, T>(
    port: &PublisherOf<[W]>,
    topic: Topic,
    header: Header,
    max_len: usize,
    items: &'a [T],
) -> Result<(), TopicError>
where
    W: Wire + From<&'a T>,
{
    if items.len() > max_len {
        let reason = format!("{} readings in one scan, at most {max_len} fit", items.len());
        return Err(failed(topic, "sending", reason));
    }
    let mut sample = port.loan_slice_uninit(items.len()).map_err(|e| failed(topic, "sending", e))?;
    *sample.user_header_mut() = header;
    let sample = sample.write_from_fn(|i| W::from(&items[i]));
    sample.send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
}

fn get<W: Wire>(
    port: &SubscriberOf<W>,
    topic: Topic,
    decode: impl Fn(&W) -> Result<Message, Fault>,
) -> Result<Option<Received>, TopicError> {
    let sample = port.receive().map_err(|e| failed(topic, "receiving", e))?;
    Ok(sample.map(|sample| judge(*sample.user_header(), || decode(sample.payload()))))
}

fn get_slice<W: Wire>(
    port: &SubscriberOf<[W]>,
    topic: Topic,
    decode: impl Fn(&[W]) -> Result<Message, Fault>,
) -> Result<Option<Received>, TopicError> {
    let sample = port.receive().map_err(|e| failed(topic, "receiving", e))?;
    Ok(sample.map(|sample| judge(*sample.user_header(), || decode(sample.payload()))))
}

fn judge(header: Header, decode: impl FnOnce() -> Result<Message, Fault>) -> Received {
    if header.flags & END != 0 {
        return Received::End(header);
    }
    if header.flags & TOLD != 0 {
        return Received::Told(header, u32::try_from(header.stamp_ns).unwrap_or(0));
    }
    match decode() {
        Ok(message) => Received::Message(header, message),
        Err(fault) => Received::Faulty(header, fault),
    }
}
