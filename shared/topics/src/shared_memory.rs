//! Ports over shared memory: an iceoryx2 publisher or subscriber of each topic's type, and the event that wakes.

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{EventId, FileDescriptorBased, ipc};

use crate::content::{Carried, Content};
use crate::contract::Message;
use crate::participant::{Participant, SENT, TopicError, failed};
use crate::port::{Carrier, Mailbox, Received};
use crate::shape::{Payload, Shape};
use crate::wire::Header;

/// Writes the topic of `T`.
#[derive(Debug)]
pub(crate) struct Writer<T: Content> {
    port: <T::Payload as Shape>::Out,
    bell: Notifier<ipc::Service>,
    max_len: usize,
}

impl<T: Content> Writer<T> {
    pub(crate) fn open(participant: &Participant, max_len: usize) -> Result<Self, TopicError> {
        let port = T::Payload::publisher(participant, T::TOPIC, max_len)?;
        // After the publisher, so that "a notifier appeared" means "a producer is there".
        let bell = participant
            .bell(T::TOPIC)?
            .notifier_builder()
            .default_event_id(EventId::new(SENT))
            .create()
            .map_err(|e| failed(T::TOPIC, "creating a notifier", e))?;
        Ok(Self { port, bell, max_len })
    }
}

impl<T: Content> Carrier<T> for Writer<T> {
    fn put(&mut self, header: Header, content: Option<&T>) -> Result<(), TopicError> {
        match content {
            Some(content) => T::Payload::put(&self.port, T::TOPIC, header, content, self.max_len),
            None => T::Payload::put_nothing(&self.port, T::TOPIC, header),
        }
    }

    fn connect(&mut self) -> Result<(), TopicError> {
        self.port.update_connections().map_err(|e| failed(T::TOPIC, "connecting", e))
    }

    fn notify(&mut self) -> Result<(), TopicError> {
        self.bell.notify().map(drop).map_err(|e| failed(T::TOPIC, "notifying", e))
    }
}

impl<T: Carried> Carrier<Message> for Writer<T> {
    fn put(&mut self, header: Header, message: Option<&Message>) -> Result<(), TopicError> {
        let content = message.map(|message| {
            let other = || format!("a message of {} is not for it", message.topic().name());
            T::find(message).ok_or_else(|| failed(T::TOPIC, "sending", other()))
        });
        Carrier::<T>::put(self, header, content.transpose()?)
    }

    fn connect(&mut self) -> Result<(), TopicError> {
        Carrier::<T>::connect(self)
    }

    fn notify(&mut self) -> Result<(), TopicError> {
        Carrier::<T>::notify(self)
    }
}

/// Reads the topic of `T`.
#[derive(Debug)]
pub(crate) struct Reader<T: Content> {
    port: <T::Payload as Shape>::In,
    bell: Listener<ipc::Service>,
}

impl<T: Content> Reader<T> {
    pub(crate) fn open(participant: &Participant) -> Result<Self, TopicError> {
        // Before the subscriber, so that no wake-up falls between.
        let bell = participant
            .bell(T::TOPIC)?
            .listener_builder()
            .create()
            .map_err(|e| failed(T::TOPIC, "creating a listener", e))?;
        Ok(Self { port: T::Payload::subscriber(participant, T::TOPIC)?, bell })
    }

    fn get_as<M>(&self, wrap: impl FnOnce(T) -> M) -> Result<Option<Received<M>>, TopicError> {
        T::Payload::take(&self.port, T::TOPIC, |header, payload| Received::judge(*header, || payload.read().map(wrap)))
    }
}

impl<T: Content> Mailbox<T> for Reader<T> {
    fn get(&mut self) -> Result<Option<Received<T>>, TopicError> {
        self.get_as(|content| content)
    }

    fn hush(&self) -> Result<(), TopicError> {
        self.bell.try_wait(|_| {}).map(|_| ()).map_err(|e| failed(T::TOPIC, "draining its event", e))
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        // SAFETY: the listener owns the descriptor and outlives the borrow.
        Some(unsafe { BorrowedFd::borrow_raw(self.bell.file_descriptor().native_handle()) })
    }
}

impl<T: Carried> Mailbox<Message> for Reader<T> {
    fn get(&mut self) -> Result<Option<Received>, TopicError> {
        self.get_as(T::wrap)
    }

    fn hush(&self) -> Result<(), TopicError> {
        Mailbox::<T>::hush(self)
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        Mailbox::<T>::fd(self)
    }
}
