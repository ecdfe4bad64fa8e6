//! How a payload lies in a topic: one wire type, or a slice of them.

use core::fmt::Debug;

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, AttributeSpecifier, BackpressureStrategy, ipc};

use crate::contract::Fault;
use crate::participant::{MAX_NODES, Participant, TopicError, attribute_failed, failed, service_name};
use crate::topic::{Qos, Topic};
use crate::wire::{Header, Wire, bytes_of};

type PublisherOf<P> = Publisher<ipc::Service, P, Header>;
type SubscriberOf<P> = Subscriber<ipc::Service, P, Header>;

/// What iceoryx2 can carry.
pub trait Shape: Debug {
    /// The wire type that it is made of.
    type Element: Wire;
    /// Where a process writes them.
    type Out: Debug + UpdateConnections;
    /// Where a process reads them.
    type In: Debug;
    /// Whether it is a slice of them.
    const IS_SLICE: bool;

    /// Makes a topic of such payloads; it is there for as long as what this gives.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn create(node: &Node<ipc::Service>, topic: Topic, qos: &Qos) -> Result<Box<dyn Debug>, TopicError>;

    /// Opens a port to write them; slices hold at most `max_len`.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn publisher(participant: &Participant, topic: Topic, max_len: usize) -> Result<Self::Out, TopicError>;

    /// Opens a port to read them.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn subscriber(participant: &Participant, topic: Topic) -> Result<Self::In, TopicError>;

    /// Takes the next one.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn take<R>(port: &Self::In, topic: Topic, judge: impl FnOnce(&Header, &Self) -> R)
    -> Result<Option<R>, TopicError>;

    /// Sends a payload that says nothing: all is in the header.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn put_nothing(port: &Self::Out, topic: Topic, header: Header) -> Result<(), TopicError>;
}

/// A payload that carries a `T`.
pub trait Payload<T>: Shape {
    /// Sends it.
    ///
    /// # Errors
    /// Shared memory refuses, or it is longer than `max_len`.
    fn put(port: &Self::Out, topic: Topic, header: Header, content: &T, max_len: usize) -> Result<(), TopicError>;

    /// Reads it.
    ///
    /// # Errors
    /// It breaks its contract.
    fn read(&self) -> Result<T, Fault>;

    /// Adds its bytes as they would lie in shared memory.
    fn put_bytes(content: &T, into: &mut Vec<u8>);
}

macro_rules! create {
    ($node:ident, $topic:ident, $qos:ident, $payload:ty, $schema:expr) => {{
        let key = "schema".try_into().map_err(attribute_failed)?;
        let value = $schema.try_into().map_err(attribute_failed)?;
        let attributes = AttributeSpecifier::new().define(&key, &value).map_err(attribute_failed)?;
        let factory = $node
            .service_builder(&service_name($topic.name())?)
            .publish_subscribe::<$payload>()
            .user_header::<Header>()
            .max_nodes(MAX_NODES)
            .max_publishers($qos.publishers)
            .max_subscribers($qos.subscribers)
            .history_size($qos.history)
            .subscriber_max_buffer_size($qos.buffer)
            .subscriber_max_borrowed_samples(2)
            // A stalled consumer must never block a sensor; back-pressure is by acknowledgement.
            .enable_safe_overflow(true)
            .create_with_attributes(&attributes)
            .map_err(|e| failed($topic, "creating it", e))?;
        Ok(Box::new(factory))
    }};
}

impl<W: Wire> Shape for W {
    type Element = W;
    type Out = PublisherOf<W>;
    type In = SubscriberOf<W>;
    const IS_SLICE: bool = false;

    fn create(node: &Node<ipc::Service>, topic: Topic, qos: &Qos) -> Result<Box<dyn Debug>, TopicError> {
        create!(node, topic, qos, W, W::SCHEMA)
    }

    fn publisher(participant: &Participant, topic: Topic, _: usize) -> Result<Self::Out, TopicError> {
        let factory = participant.sized::<W>(topic)?;
        let builder =
            factory.publisher_builder().max_loaned_samples(1).backpressure_strategy(BackpressureStrategy::DiscardData);
        builder.create().map_err(|e| failed(topic, "creating a publisher", e))
    }

    fn subscriber(participant: &Participant, topic: Topic) -> Result<Self::In, TopicError> {
        let factory = participant.sized::<W>(topic)?;
        factory.subscriber_builder().create().map_err(|e| failed(topic, "creating a subscriber", e))
    }

    fn take<R>(port: &Self::In, topic: Topic, judge: impl FnOnce(&Header, &W) -> R) -> Result<Option<R>, TopicError> {
        let sample = port.receive().map_err(|e| failed(topic, "receiving", e))?;
        Ok(sample.map(|sample| judge(sample.user_header(), sample.payload())))
    }

    fn put_nothing(port: &Self::Out, topic: Topic, header: Header) -> Result<(), TopicError> {
        let mut sample = port.loan_uninit().map_err(|e| failed(topic, "sending", e))?;
        *sample.user_header_mut() = header;
        sample.write_payload(W::default()).send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
    }
}

impl<W, T> Payload<T> for W
where
    W: Wire + for<'a> From<&'a T>,
    T: for<'a> TryFrom<&'a W, Error: Into<Fault>>,
{
    fn put(port: &Self::Out, topic: Topic, header: Header, content: &T, _: usize) -> Result<(), TopicError> {
        let mut sample = port.loan_uninit().map_err(|e| failed(topic, "sending", e))?;
        *sample.user_header_mut() = header;
        sample.write_payload(content.into()).send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
    }

    fn read(&self) -> Result<T, Fault> {
        self.try_into().map_err(Into::into)
    }

    fn put_bytes(content: &T, into: &mut Vec<u8>) {
        into.extend_from_slice(bytes_of(&W::from(content)));
    }
}

impl<W: Wire> Shape for [W] {
    type Element = W;
    type Out = PublisherOf<[W]>;
    type In = SubscriberOf<[W]>;
    const IS_SLICE: bool = true;

    fn create(node: &Node<ipc::Service>, topic: Topic, qos: &Qos) -> Result<Box<dyn Debug>, TopicError> {
        create!(node, topic, qos, [W], W::SCHEMA)
    }

    fn publisher(participant: &Participant, topic: Topic, max_len: usize) -> Result<Self::Out, TopicError> {
        let factory = participant.slice::<W>(topic)?;
        let builder = factory
            .publisher_builder()
            .max_loaned_samples(1)
            .initial_max_slice_len(max_len.max(1))
            .allocation_strategy(AllocationStrategy::Static)
            .backpressure_strategy(BackpressureStrategy::DiscardData);
        builder.create().map_err(|e| failed(topic, "creating a publisher", e))
    }

    fn subscriber(participant: &Participant, topic: Topic) -> Result<Self::In, TopicError> {
        let factory = participant.slice::<W>(topic)?;
        factory.subscriber_builder().create().map_err(|e| failed(topic, "creating a subscriber", e))
    }

    fn take<R>(port: &Self::In, topic: Topic, judge: impl FnOnce(&Header, &[W]) -> R) -> Result<Option<R>, TopicError> {
        let sample = port.receive().map_err(|e| failed(topic, "receiving", e))?;
        Ok(sample.map(|sample| judge(sample.user_header(), sample.payload())))
    }

    fn put_nothing(port: &Self::Out, topic: Topic, header: Header) -> Result<(), TopicError> {
        let mut sample = port.loan_slice_uninit(0).map_err(|e| failed(topic, "sending", e))?;
        *sample.user_header_mut() = header;
        sample.write_from_fn(|_| W::default()).send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
    }
}

impl<W, E> Payload<Vec<E>> for [W]
where
    W: Wire + for<'a> From<&'a E>,
    E: for<'a> TryFrom<&'a W, Error: Into<Fault>> + 'static,
{
    fn put(port: &Self::Out, topic: Topic, header: Header, content: &Vec<E>, max_len: usize) -> Result<(), TopicError> {
        if content.len() > max_len {
            let reason = format!("{} readings in one scan, at most {max_len} fit", content.len());
            return Err(failed(topic, "sending", reason));
        }
        let mut sample = port.loan_slice_uninit(content.len()).map_err(|e| failed(topic, "sending", e))?;
        *sample.user_header_mut() = header;
        let sample = sample.write_from_fn(|i| W::from(&content[i]));
        sample.send().map(|_| ()).map_err(|e| failed(topic, "sending", e))
    }

    fn read(&self) -> Result<Vec<E>, Fault> {
        self.iter().map(|element| element.try_into().map_err(Into::into)).collect()
    }

    fn put_bytes(content: &Vec<E>, into: &mut Vec<u8>) {
        content.iter().for_each(|element| into.extend_from_slice(bytes_of(&W::from(element))));
    }
}
