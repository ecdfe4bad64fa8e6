//! Ports over shared memory: an iceoryx2 publisher or subscriber of each topic's type, and the event that wakes.

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, EventId, FileDescriptorBased, ipc};

use crate::message::{
    Fault, Health, LocalizationFix, LocalizationRequest, MapInfo, Message, PoseEstimate, RawOdometry, TileUpdate,
    TruePose, TrueWorld,
};
use crate::participant::{Participant, SENT, Sized, Slice, TopicError};
use crate::port::{Carrier, Mailbox, Received};
use crate::topic::Topic;
use crate::wire::{
    EstimateWire, FixWire, Header, HealthWire, LocalizationRequestWire, MapInfoWire, OdometryRawWire, ReadingWire,
    RobotWire, TileWire, TruePoseWire, TrueWorldWire, VerdictWire, Wire,
};

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
struct Writer {
    topic: Topic,
    port: Out,
    bell: Notifier<ipc::Service>,
    max_readings: usize,
}

/// Opens `topic` for writing.
pub(crate) fn carrier(
    participant: &Participant,
    topic: Topic,
    max_readings: usize,
) -> Result<Box<dyn Carrier>, TopicError> {
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
    Ok(Box::new(Writer { topic, port, bell, max_readings }))
}

impl Carrier for Writer {
    fn put(&mut self, header: Header, message: Option<&Message>) -> Result<(), TopicError> {
        match message {
            Some(message) => self.put_message(header, message),
            None => self.put_empty(header),
        }
    }

    fn connect(&mut self) -> Result<(), TopicError> {
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
        .map_err(|e| failed(self.topic, "connecting", e))
    }

    fn notify(&mut self) -> Result<(), TopicError> {
        self.bell.notify().map(drop).map_err(|e| failed(self.topic, "notifying", e))
    }
}

impl Writer {
    fn put_message(&self, header: Header, message: &Message) -> Result<(), TopicError> {
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
        }
    }

    fn put_empty(&self, header: Header) -> Result<(), TopicError> {
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
        }
    }
}

/// A topic to read from.
#[derive(Debug)]
struct Reader {
    topic: Topic,
    port: In,
    bell: Listener<ipc::Service>,
}

/// Opens `topic` for reading.
pub(crate) fn mailbox(participant: &Participant, topic: Topic) -> Result<Box<dyn Mailbox>, TopicError> {
    // Before the subscriber, so that no wake-up falls between.
    let bell =
        participant.bell(topic)?.listener_builder().create().map_err(|e| failed(topic, "creating a listener", e))?;
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
    Ok(Box::new(Reader { topic, port, bell }))
}

impl Mailbox for Reader {
    fn fd(&self) -> Option<BorrowedFd<'_>> {
        // SAFETY: the listener owns the descriptor and outlives the borrow.
        Some(unsafe { BorrowedFd::borrow_raw(self.bell.file_descriptor().native_handle()) })
    }

    fn hush(&self) -> Result<(), TopicError> {
        self.bell.try_wait(|_| {}).map(drop).map_err(|e| failed(self.topic, "draining its event", e))
    }

    fn get(&mut self) -> Result<Option<Received>, TopicError> {
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
}

fn failed(topic: Topic, what: &'static str, reason: impl ToString) -> TopicError {
    TopicError::Topic { topic: topic.name(), what, reason: reason.to_string() }
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
    Ok(sample.map(|sample| Received::judge(*sample.user_header(), || decode(sample.payload()))))
}

fn get_slice<W: Wire>(
    port: &SubscriberOf<[W]>,
    topic: Topic,
    decode: impl Fn(&[W]) -> Result<Message, Fault>,
) -> Result<Option<Received>, TopicError> {
    let sample = port.receive().map_err(|e| failed(topic, "receiving", e))?;
    Ok(sample.map(|sample| Received::judge(*sample.user_header(), || decode(sample.payload()))))
}
