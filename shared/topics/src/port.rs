//! Ports: where a process writes a topic ([`Output`]) or reads it ([`Input`]).

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, EventId, FileDescriptorBased, ipc};

use crate::message::{
    Ack, Fault, Health, LocalizationFix, LocalizationRequest, MapInfo, Message, PoseEstimate, RawOdometry,
    ServiceState, TileUpdate, TruePose, TrueWorld,
};
use crate::participant::{Participant, SENT, Sized, Slice, TopicError};
use crate::topic::{Delivery, Topic};
use crate::wire::{
    EstimateWire, FixWire, Header, HealthWire, LocalizationRequestWire, MapInfoWire, OdometryRawWire, ReadingWire,
    RobotWire, TileWire, TruePoseWire, TrueWorldWire, VerdictWire, Wire,
};

/// Header flag: the stream ends here.
const END: u32 = 1;

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

/// A consumer that a producer waits for.
#[derive(Debug, Clone)]
struct Consumer {
    name: String,
    /// None until it has said that it is there.
    acknowledged: Option<u64>,
}

/// A topic to write to.
#[derive(Debug)]
pub struct Output {
    topic: Topic,
    port: Out,
    bell: Notifier<ipc::Service>,
    epoch: u64,
    sequence: u64,
    window: u64,
    max_readings: usize,
    consumers: Vec<Consumer>,
    unrung: bool,
}

impl Output {
    /// Opens `topic` for writing. On a lossless topic the producer stays within the topic's window
    /// of the slowest of `consumers` (names of services), and starts when all have shown up.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn open(
        participant: &Participant,
        topic: Topic,
        max_readings: usize,
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
        let consumers = if topic.delivery() == Delivery::Lossless { consumers } else { &[] };
        Ok(Self {
            topic,
            port,
            bell,
            epoch: new_epoch(),
            sequence: 0,
            window: topic.qos(max_readings).window,
            max_readings,
            consumers: consumers.iter().map(|name| Consumer { name: name.clone(), acknowledged: None }).collect(),
            unrung: false,
        })
    }

    /// The topic.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
    }

    /// How many more messages fit into the window of the slowest consumer now.
    #[must_use]
    pub fn room(&self) -> u64 {
        let mut room = u64::MAX;
        for consumer in &self.consumers {
            let Some(acknowledged) = consumer.acknowledged else { return 0 };
            room = room.min((acknowledged + self.window).saturating_sub(self.sequence));
        }
        room
    }

    /// Whether every consumer has integrated all that was sent.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.consumers.iter().all(|consumer| consumer.acknowledged == Some(self.sequence))
    }

    /// The consumers that have not integrated all that was sent.
    #[must_use]
    pub fn lagging(&self) -> Vec<&str> {
        let behind = |consumer: &&Consumer| consumer.acknowledged != Some(self.sequence);
        self.consumers.iter().filter(behind).map(|consumer| consumer.name.as_str()).collect()
    }

    /// Takes note of what a consumer says it has integrated.
    pub fn note(&mut self, health: &Health) {
        let Some(consumer) = self.consumers.iter_mut().find(|consumer| consumer.name == health.service) else { return };
        if health.state == ServiceState::Starting {
            return;
        }
        let Some(Ack { epoch, sequence, .. }) = health.acks.iter().find(|ack| ack.topic == self.topic) else { return };
        let sequence = if *epoch == self.epoch { (*sequence).min(self.sequence) } else { 0 };
        consumer.acknowledged = Some(consumer.acknowledged.unwrap_or(0).max(sequence));
    }

    /// Sends a message, without waking anyone: [`Output::ring`] does.
    ///
    /// # Errors
    /// Shared memory refuses, the message belongs to another topic, or a scan is too long.
    pub fn send(&mut self, stamp_ns: u64, message: &Message) -> Result<(), TopicError> {
        let header = self.next_header(stamp_ns, 0);
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
        Header { sequence: self.sequence + 1, epoch: self.epoch, stamp_ns, flags, reserved: 0 }
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
    /// A message that broke its contract; it was dropped.
    Faulty(Header, Fault),
}

/// A topic to read from.
#[derive(Debug)]
pub struct Input {
    topic: Topic,
    port: In,
    bell: Listener<ipc::Service>,
    epoch: u64,
    sequence: u64,
    lost: u64,
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
        Ok(Self { topic, port, bell, epoch: 0, sequence: 0, lost: 0 })
    }

    /// The topic.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
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

    /// The next message.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn receive(&mut self) -> Result<Option<Received>, TopicError> {
        let topic = self.topic;
        let received = match &self.port {
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
        }?;
        if let Some(Received::Message(header, _) | Received::End(header) | Received::Faulty(header, _)) = &received {
            self.follow(*header);
        }
        Ok(received)
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

    /// How far this input has been read, as its producer wants to know it.
    #[must_use]
    pub fn ack(&self) -> Ack {
        Ack { topic: self.topic, epoch: self.epoch, sequence: self.sequence }
    }

    /// Messages that never arrived, by the gaps in the sequence (lossless topics only).
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    fn follow(&mut self, header: Header) {
        if self.topic.delivery() == Delivery::Lossless {
            // A faulty producer may count as it likes.
            let expected = if header.epoch == self.epoch { self.sequence.saturating_add(1) } else { 1 };
            self.lost = self.lost.saturating_add(header.sequence.saturating_sub(expected));
        }
        self.epoch = header.epoch;
        self.sequence = header.sequence;
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
    match decode() {
        Ok(message) => Received::Message(header, message),
        Err(fault) => Received::Faulty(header, fault),
    }
}
