//! Topics that a graph file declares: the launcher makes them like all others, and what their bytes mean is known to the processes
//! that write and read them.

use std::os::fd::BorrowedFd;

use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{AttributeSpecifier, BackpressureStrategy, EventId, FileDescriptorBased, ipc};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use serde::{Deserialize, Serialize};

use crate::participant::{MAX_NODES, Participant, SENT, TopicError, attribute_failed, failed, service_name, verifier};
use crate::topic::{Delivery, Qos};
use crate::wire::Header;

/// The alignment that every payload is given, bytes; a type of a smaller one fits.
const ALIGN: usize = 8;
/// The longest name of a topic and of its type, bytes.
const NAME_BYTES_MAX: usize = 64;
/// The most bytes of a message.
pub const BYTES_MAX: usize = 1 << 20;

/// What a declared topic promises: none of them has anybody wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DeclaredDelivery {
    /// The latest value counts; a late joiner gets it.
    #[default]
    Latest,
    /// Whoever does not keep up misses some.
    Droppable,
}

impl From<DeclaredDelivery> for Delivery {
    fn from(delivery: DeclaredDelivery) -> Self {
        match delivery {
            DeclaredDelivery::Latest => Self::Latest,
            DeclaredDelivery::Droppable => Self::Droppable,
        }
    }
}

/// A topic that a graph file declares, without its name.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct DeclaredTopic {
    /// The name of the payload's type, version included, as iceoryx2 is told it.
    #[serde(rename = "type")]
    pub type_name: String,
    /// The size of the payload, 1 to [`BYTES_MAX`] bytes.
    pub bytes: usize,
    /// What the topic promises.
    pub delivery: DeclaredDelivery,
}

impl DeclaredTopic {
    /// Whether a graph file may call a topic so: parts of a-z, 0-9, - and _, with / between them, which orders do not use.
    #[must_use]
    pub fn is_name(name: &str) -> bool {
        let is_part = |part: &str| {
            !part.is_empty() && part.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-_".contains(&b))
        };
        name.len() <= NAME_BYTES_MAX && name.split('/').all(is_part) && name.split('/').next() != Some("control")
    }

    /// Whether a type may be called so: 1 to 64 printable characters of ASCII without a space.
    #[must_use]
    pub fn is_type_name(name: &str) -> bool {
        (1..=NAME_BYTES_MAX).contains(&name.len()) && name.bytes().all(|b| b.is_ascii_graphic())
    }

    pub(crate) fn qos(&self) -> Qos {
        let Self { bytes: element_size, .. } = *self;
        match self.delivery {
            DeclaredDelivery::Latest => Qos { element_size, ..Qos::LATEST },
            DeclaredDelivery::Droppable => Qos { history: 0, buffer: 16, element_size, ..Qos::LATEST },
        }
    }

    fn detail(&self, name: &str) -> Result<TypeDetail, TopicError> {
        TypeDetail::__internal_new_from_parts(TypeVariant::FixedSize, &self.type_name, self.bytes, ALIGN)
            .map_err(|e| failed(name, "naming its type", format!("{e:?}")))
    }

    /// Makes the topic; it is there for as long as what this gives.
    pub(crate) fn create(
        &self,
        node: &Node<ipc::Service>,
        name: &str,
    ) -> Result<Box<dyn core::fmt::Debug>, TopicError> {
        let key = "schema".try_into().map_err(attribute_failed)?;
        let value = self.type_name.as_str().try_into().map_err(attribute_failed)?;
        let attributes = AttributeSpecifier::new().define(&key, &value).map_err(attribute_failed)?;
        let (qos, builder) = (self.qos(), self.builder(node, name)?.user_header::<Header>());
        let factory = builder
            .max_nodes(MAX_NODES)
            .max_publishers(qos.publishers)
            .max_subscribers(qos.subscribers)
            .history_size(qos.history)
            .subscriber_max_buffer_size(qos.buffer)
            .subscriber_max_borrowed_samples(2)
            .enable_safe_overflow(true)
            .create_with_attributes(&attributes)
            .map_err(|e| failed(name, "creating it", e))?;
        Ok(Box::new(factory))
    }

    fn builder(
        &self,
        node: &Node<ipc::Service>,
        name: &str,
    ) -> Result<Builder<[CustomPayloadMarker], (), ipc::Service>, TopicError> {
        let builder = node.service_builder(&service_name(name)?).publish_subscribe::<[CustomPayloadMarker]>();
        // SAFETY: what is read and written is bytes, as many as the detail says.
        Ok(unsafe { builder.__internal_set_payload_type_details(&self.detail(name)?) })
    }
}

/// A declared topic to write to.
#[derive(Debug)]
pub struct DeclaredOutput {
    name: String,
    bytes: usize,
    publisher: Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>,
    bell: Notifier<ipc::Service>,
    life: u64,
    sequence: u64,
}

impl DeclaredOutput {
    /// Opens the topic of this name for writing.
    ///
    /// # Errors
    /// The launcher made no such topic, or shared memory refuses.
    pub fn open(participant: &Participant, name: &str, topic: &DeclaredTopic) -> Result<Self, TopicError> {
        let builder = topic.builder(participant.node(), name)?.user_header::<CustomHeaderMarker>();
        let header = TypeDetail::new::<Header>(TypeVariant::FixedSize);
        // SAFETY: every header that is sent is a `Header`.
        let builder = unsafe { builder.__internal_set_user_header_type_details(&header) };
        let factory = builder.open_with_attributes(&verifier(&topic.type_name)?);
        let publisher = factory
            .map_err(|e| failed(name, "opening it", e))?
            .publisher_builder()
            .max_loaned_samples(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed(name, "creating a publisher", e))?;
        let bell = participant.bell_of(name)?.notifier_builder().default_event_id(EventId::new(SENT)).create();
        let bell = bell.map_err(|e| failed(name, "creating a notifier", e))?;
        let life = crate::port::new_epoch();
        Ok(Self { name: name.to_owned(), bytes: topic.bytes, publisher, bell, life, sequence: 0 })
    }

    /// Sends a message and wakes whoever reads the topic.
    ///
    /// # Errors
    /// The payload has not the declared size, or shared memory refuses.
    pub fn send(&mut self, stamp_ns: u64, payload: &[u8]) -> Result<(), TopicError> {
        if payload.len() != self.bytes {
            let reason = format!("{} bytes, declared are {}", payload.len(), self.bytes);
            return Err(failed(&self.name, "sending", reason));
        }
        let sequence = self.sequence + 1;
        let Self { life, .. } = *self;
        let header = Header { sequence, epoch: life, stamp_ns, flags: 0, robot: 0, life: life as u32 };
        // SAFETY: one element, of the size that the topic was opened with.
        let sample = unsafe { self.publisher.loan_custom_payload(1) };
        let mut sample = sample.map_err(|e| failed(&self.name, "sending", e))?;
        let into = sample.payload_mut();
        debug_assert_eq!(into.len(), payload.len());
        // SAFETY: the payload is so many bytes long, and the header was opened as a `Header`.
        let sample = unsafe {
            into.as_mut_ptr().cast::<u8>().copy_from_nonoverlapping(payload.as_ptr(), payload.len());
            core::ptr::from_mut(sample.user_header_mut()).cast::<Header>().write(header);
            sample.assume_init()
        };
        sample.send().map_err(|e| failed(&self.name, "sending", e))?;
        self.sequence = sequence;
        self.bell.notify().map(drop).map_err(|e| failed(&self.name, "notifying", e))
    }
}

/// A declared topic to read from.
#[derive(Debug)]
pub struct DeclaredInput {
    name: String,
    subscriber: Subscriber<ipc::Service, [CustomPayloadMarker], Header>,
    bell: Listener<ipc::Service>,
}

impl DeclaredInput {
    /// Opens the topic of this name for reading.
    ///
    /// # Errors
    /// The launcher made no such topic, or shared memory refuses.
    pub fn open(participant: &Participant, name: &str, topic: &DeclaredTopic) -> Result<Self, TopicError> {
        // Before the subscriber, so that no wake-up falls between.
        let bell = participant.bell_of(name)?.listener_builder().create();
        let bell = bell.map_err(|e| failed(name, "creating a listener", e))?;
        let builder = topic.builder(participant.node(), name)?.user_header::<Header>();
        let factory = builder.open_with_attributes(&verifier(&topic.type_name)?);
        let factory = factory.map_err(|e| failed(name, "opening it", e))?;
        let subscriber = factory.subscriber_builder().create();
        let subscriber = subscriber.map_err(|e| failed(name, "creating a subscriber", e))?;
        Ok(Self { name: name.to_owned(), subscriber, bell })
    }

    /// The next message: its header, and its bytes, which nobody has checked.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn receive(&mut self) -> Result<Option<(Header, Vec<u8>)>, TopicError> {
        let sample = self.subscriber.receive().map_err(|e| failed(&self.name, "receiving", e))?;
        Ok(sample.map(|sample| {
            let payload = sample.payload();
            // SAFETY: a marker is a byte.
            let bytes = unsafe { core::slice::from_raw_parts(payload.as_ptr().cast::<u8>(), payload.len()) };
            (*sample.user_header(), bytes.to_vec())
        }))
    }

    /// Takes note of the wake-ups so far. Call before reading until [`DeclaredInput::receive`] gives none.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn hush(&self) -> Result<(), TopicError> {
        self.bell.try_wait(|_| {}).map(|_| ()).map_err(|e| failed(&self.name, "draining its event", e))
    }

    /// The descriptor that is readable when there may be something new.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the listener owns the descriptor and outlives the borrow.
        unsafe { BorrowedFd::borrow_raw(self.bell.file_descriptor().native_handle()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_from_what_is_none() {
        for name in ["goal", "drive/goal", "arm_2/joint-3/pose"] {
            assert!(DeclaredTopic::is_name(name), "{name}");
        }
        let long = "a".repeat(65);
        for name in ["", "/goal", "drive/", "drive//goal", "Drive/goal", "drive goal", "control/mapper", &long] {
            assert!(!DeclaredTopic::is_name(name), "{name}");
        }
        assert!(DeclaredTopic::is_type_name("acme/Goal/1") && !DeclaredTopic::is_type_name("acme Goal"));
        assert!(!DeclaredTopic::is_type_name("") && !DeclaredTopic::is_type_name(&long));
    }
}
