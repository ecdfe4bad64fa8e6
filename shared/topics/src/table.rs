//! How the table of topics in [`crate::contract`] becomes types: [`Topic`], [`Message`](crate::Message), a row of facts each.

use iceoryx2::node::Node;
use iceoryx2::prelude::ipc;

use crate::content::Carried;
use crate::participant::{Participant, TopicError};
use crate::port::{Carrier, Mailbox};
use crate::shape::Shape;
use crate::shared_memory::{Reader, Writer};
use crate::topic::{Delivery, Qos, Topic};
use crate::wire::{Layout, Wire};

type Opened<T> = Result<Box<T>, TopicError>;

/// What is known of a topic.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) delivery: Delivery,
    /// Of one element of its payload.
    pub(crate) layout: &'static Layout,
    pub(crate) is_slice: bool,
    pub(crate) qos: fn(usize) -> Qos,
    pub(crate) create: fn(&Node<ipc::Service>, Topic, &Qos) -> Opened<dyn core::fmt::Debug>,
    pub(crate) carrier: fn(&Participant, usize) -> Opened<dyn Carrier>,
    pub(crate) mailbox: fn(&Participant) -> Opened<dyn Mailbox>,
}

impl Row {
    pub(crate) const fn of<T: Carried>(name: &'static str, delivery: Delivery) -> Self {
        Self {
            name,
            delivery,
            layout: <<T::Payload as Shape>::Element as Wire>::LAYOUT,
            is_slice: <T::Payload as Shape>::IS_SLICE,
            qos: |max_readings| {
                let element_size = size_of::<<T::Payload as Shape>::Element>();
                Qos { element_size, ..T::qos(max_readings) }
            },
            create: <T::Payload as Shape>::create,
            carrier: |participant, max_len| Ok(Box::new(Writer::<T>::open(participant, max_len)?)),
            mailbox: |participant| Ok(Box::new(Reader::<T>::open(participant)?)),
        }
    }
}

/// A table of topics: number, topic, name, delivery, message.
macro_rules! topics {
    ($($(#[$doc:meta])* $number:literal $topic:ident $name:literal $delivery:ident $message:ident($content:ty);)*) => {
        /// A stream of messages between processes.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u32)]
        pub enum Topic { $($(#[$doc])* $topic = $number,)* }

        impl Topic {
            /// Every topic, in the order of the table.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$topic),*];

            // In this crate alone: else each that asks for a topic's name is compiled with the ports of all of them.
            #[inline(never)]
            pub(crate) fn row(self) -> &'static crate::table::Row {
                use crate::table::Row;
                use crate::topic::Delivery;
                match self { $(Self::$topic => const { &Row::of::<$content>($name, Delivery::$delivery) },)* }
            }
        }

        /// Content of a message of any topic.
        #[derive(Debug, Clone)]
        pub enum Message { $(#[doc = concat!("[`Topic::", stringify!($topic), "`].")] $message($content),)* }

        impl Message {
            /// The topic that it belongs to.
            #[must_use]
            pub fn topic(&self) -> Topic {
                match self { $(Self::$message(_) => Topic::$topic,)* }
            }

            /// All that it says, as JSON.
            #[must_use]
            pub fn json(&self) -> serde_json::Value {
                match self { $(Self::$message(content) => crate::content::Content::json(content),)* }
            }

            /// The bytes of the message as they would lie in shared memory.
            #[must_use]
            pub fn bytes(&self) -> Vec<u8> {
                use crate::content::Content;
                use crate::shape::Payload;
                let mut bytes = Vec::new();
                match self {
                    $(Self::$message(content) => <$content as Content>::Payload::put_bytes(content, &mut bytes),)*
                }
                bytes
            }

            /// What of it fits a line, as JSON.
            #[must_use]
            pub fn brief(&self) -> serde_json::Value {
                match self { $(Self::$message(content) => crate::content::Content::brief(content),)* }
            }
        }

        $(impl crate::content::Carried for $content {
            fn wrap(self) -> Message { Message::$message(self) }
            fn find(message: &Message) -> Option<&Self> {
                if let Message::$message(content) = message { Some(content) } else { None }
            }
        }
        const _: () = assert!(<$content as crate::content::Content>::TOPIC as u32 == $number);)*
    };
}
pub(crate) use topics;
