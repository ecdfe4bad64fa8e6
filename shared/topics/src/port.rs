//! Ports: where a process writes a topic ([`Output`]) or reads it ([`Input`]).
//!
//! What a port knows of its stream (numbers, windows, lives) is here; what carries the messages is behind [`Carrier`] and
//! [`Mailbox`]: shared memory, or the memory of one process ([`crate::memory`]).

use std::os::fd::BorrowedFd;

use crate::content::Content;
use crate::contract::{Ack, Fault, Health, Message};
use crate::participant::{Participant, TopicError};
use crate::read_position::{ReadPosition, Step};
use crate::shared_memory;
use crate::topic::Topic;
use crate::window::Window;
use crate::wire::{END, Header, TOLD};

/// What carries the messages of an output to whoever reads them.
pub trait Carrier<M = Message>: core::fmt::Debug {
    /// Sends a message, without waking anyone; none: one that says no more than its header does.
    ///
    /// # Errors
    /// Shared memory refuses, the message belongs to another topic, or a scan is too long.
    fn put(&mut self, header: Header, message: Option<&M>) -> Result<(), TopicError>;

    /// Hands the latest messages to consumers that came late.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn connect(&mut self) -> Result<(), TopicError>;

    /// Wakes the consumers.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn notify(&mut self) -> Result<(), TopicError>;
}

/// Where the messages of an input arrive.
pub trait Mailbox<M = Message>: core::fmt::Debug {
    /// The next message of any producer.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn get(&mut self) -> Result<Option<Received<M>>, TopicError>;

    /// Takes note of the wake-ups so far.
    ///
    /// # Errors
    /// Shared memory refuses.
    fn hush(&self) -> Result<(), TopicError>;

    /// Readable when there may be something new; none where nobody could wait for it.
    fn fd(&self) -> Option<BorrowedFd<'_>>;
}

/// A topic to write to.
#[derive(Debug)]
pub struct Output<M = Message> {
    topic: Topic,
    carrier: Box<dyn Carrier<M>>,
    epoch: u64,
    life: u32,
    sequence: u64,
    /// Stamp of the newest message, nanoseconds.
    stamp_ns: u64,
    /// What every consumer has stored is not sent again.
    stored: u64,
    /// Some consumer may have got all up to here from an earlier life.
    heard: u64,
    window: Window,
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
        let carrier = (topic.row().carrier)(participant, max_readings)?;
        let window = topic.qos(max_readings).window;
        Ok(Self::over(carrier, topic, window, (epoch, new_epoch()), consumers))
    }
}

impl<T: Content> Output<T> {
    /// Opens an output as [`Output::open`] does, of a topic that is known when the program is written.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn typed(
        participant: &Participant,
        max_readings: usize,
        epoch: u64,
        consumers: &[String],
    ) -> Result<Self, TopicError> {
        let carrier = Box::new(shared_memory::Writer::<T>::open(participant, max_readings)?);
        let window = T::TOPIC.qos(max_readings).window;
        Ok(Self::over(carrier, T::TOPIC, window, (epoch, new_epoch()), consumers))
    }
}

impl<M> Output<M> {
    /// An output over something that carries messages, of the run and the life of these numbers.
    #[must_use]
    pub fn over(
        carrier: Box<dyn Carrier<M>>,
        topic: Topic,
        window: u64,
        (run, life): (u64, u64),
        consumers: &[String],
    ) -> Self {
        let consumers = if topic.delivery().is_stream() { consumers } else { &[] };
        let epoch = if topic.resumes() { run } else { life };
        let window = Window::new(topic, epoch, window, consumers);
        Self {
            topic,
            carrier,
            epoch,
            life: life as u32,
            sequence: 0,
            stamp_ns: 0,
            stored: 0,
            heard: 0,
            window,
            unrung: false,
        }
    }

    /// The topic that is written.
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

    /// An earlier life sent more than what every consumer has stored by now: nobody knows how much, but no more than their
    /// windows let it.
    pub fn assume_heard(&mut self) {
        if self.topic.resumes() {
            self.heard = self.window.furthest();
        }
    }

    /// Whether no consumer has more than was sent so far. Who has would not take an end here for the end.
    #[must_use]
    pub fn may_end(&self) -> bool {
        self.sequence >= self.heard
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
    pub fn send(&mut self, stamp_ns: u64, message: &M) -> Result<(), TopicError> {
        self.put(self.next_header(stamp_ns, 0), Some(message))
    }

    /// Says that the stream ends here, at `stamp_ns` or with its newest message, whichever is later.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn end(&mut self, stamp_ns: u64) -> Result<(), TopicError> {
        self.put(self.next_header(stamp_ns.max(self.stamp_ns), END), None)
    }

    /// Says on a relayed topic that the process `pid`, which came anew, has been told all that counts.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn told(&mut self, pid: u32) -> Result<(), TopicError> {
        self.put(self.next_header(u64::from(pid), TOLD), None)
    }

    /// What every consumer has is counted and not sent.
    fn put(&mut self, header: Header, message: Option<&M>) -> Result<(), TopicError> {
        if !self.is_known() {
            self.carrier.put(header, message)?;
            self.unrung = true;
        }
        self.sequence = header.sequence;
        if header.flags & TOLD == 0 {
            self.stamp_ns = self.stamp_ns.max(header.stamp_ns);
        }
        Ok(())
    }

    /// Hands the latest messages to consumers that came late.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn welcome(&mut self) -> Result<(), TopicError> {
        self.carrier.connect()?;
        self.unrung = true;
        self.ring()
    }

    /// Wakes the consumers if there is something new.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn ring(&mut self) -> Result<(), TopicError> {
        if self.unrung {
            self.carrier.notify()?;
            self.unrung = false;
        }
        Ok(())
    }

    fn next_header(&self, stamp_ns: u64, flags: u16) -> Header {
        Header { sequence: self.sequence + 1, epoch: self.epoch, stamp_ns, flags, robot: 0, life: self.life }
    }
}

/// What came in.
#[derive(Debug)]
pub enum Received<M = Message> {
    /// A message.
    Message(Header, M),
    /// The stream ended.
    End(Header),
    /// All that counts was told to this process.
    Told(Header, u32),
    /// A message that broke its contract; it was dropped.
    Faulty(Header, Fault),
}

impl<M> Received<M> {
    /// What a message of this header is, whose content `decode` tells.
    pub(crate) fn judge(header: Header, decode: impl FnOnce() -> Result<M, Fault>) -> Self {
        if header.robot != 0 {
            let value = header.robot.to_string();
            return Self::Faulty(header, Fault { field: "robot", value, expected: "0, the only robot of the graph" });
        }
        if header.flags & END != 0 {
            return Self::End(header);
        }
        if header.flags & TOLD != 0 {
            return Self::Told(header, u32::try_from(header.stamp_ns).unwrap_or(0));
        }
        match decode() {
            Ok(message) => Self::Message(header, message),
            Err(fault) => Self::Faulty(header, fault),
        }
    }
}

/// A topic to read from.
#[derive(Debug)]
pub struct Input<M = Message> {
    topic: Topic,
    mailbox: Box<dyn Mailbox<M>>,
    place: ReadPosition,
}

impl Input {
    /// Opens `topic` for reading, from the oldest message its producer still holds.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn open(participant: &Participant, topic: Topic) -> Result<Self, TopicError> {
        Ok(Self::over((topic.row().mailbox)(participant)?, topic))
    }
}

impl<T: Content> Input<T> {
    /// Opens an input as [`Input::open`] does, of a topic that is known when the program is written.
    ///
    /// # Errors
    /// The topic can't be opened.
    pub fn typed(participant: &Participant) -> Result<Self, TopicError> {
        Ok(Self::over(Box::new(shared_memory::Reader::<T>::open(participant)?), T::TOPIC))
    }
}

impl<M> Input<M> {
    /// An input over something that messages arrive in.
    #[must_use]
    pub fn over(mailbox: Box<dyn Mailbox<M>>, topic: Topic) -> Self {
        Self { topic, mailbox, place: ReadPosition::default() }
    }

    /// The topic that is read.
    #[must_use]
    pub fn topic(&self) -> Topic {
        self.topic
    }

    /// Goes on after message `sequence` of the run `epoch`, whose stamp was `stamp_ns`: nothing before is new, and another
    /// run's is a fault.
    pub fn resume(&mut self, epoch: u64, sequence: u64, stamp_ns: u64) {
        self.place = ReadPosition::after(epoch, sequence, stamp_ns);
    }

    /// Readable when there may be something new; none where nobody could wait for it.
    #[must_use]
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.mailbox.fd()
    }

    /// Takes note of the wake-ups so far. Call before reading until [`Input::receive`] gives none.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn hush(&self) -> Result<(), TopicError> {
        self.mailbox.hush()
    }

    /// The next message that was not here before.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn receive(&mut self) -> Result<Option<Received<M>>, TopicError> {
        while let Some(received) = self.mailbox.get()? {
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

/// Differs between any two lives of any producers on this machine.
pub(crate) fn new_epoch() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which means "no message yet".
    (since.as_nanos() as u64) | 1
}
