//! What a topic promises, and the room that it gets. The topics themselves stand in [`crate::contract`].

use serde::{Serialize, Serializer};

pub use crate::contract::Topic;
use crate::wire::Layout;

/// What a topic promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Nothing lost, in order, over the lives of producers and consumers: producers stay within a window of what their
    /// slowest consumer has stored, and a restarted one goes on with the numbering.
    Lossless,
    /// Nothing lost, in order, to who is there: producers stay within a window of what was taken in. Who comes anew gets
    /// what counts once more.
    Relayed,
    /// The latest value counts; a late joiner gets it.
    Latest,
    /// May be dropped when nobody keeps up.
    Droppable,
}

impl Delivery {
    /// Whether producers wait for their consumers, and say that the stream ends.
    #[must_use]
    pub fn is_stream(self) -> bool {
        matches!(self, Self::Lossless | Self::Relayed)
    }

    /// The delivery as people say it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Lossless => "lossless",
            Self::Relayed => "relayed",
            Self::Latest => "latest",
            Self::Droppable => "droppable",
        }
    }
}

/// Room that a topic reserves in shared memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Messages a producer keeps for late or restarted consumers.
    pub history: usize,
    /// Messages that queue in front of one consumer.
    pub buffer: usize,
    /// Messages a producer may be ahead of what its slowest consumer has acknowledged.
    pub window: u64,
    /// Consumers, with room for tools and a leaked one.
    pub subscribers: usize,
    /// Producers, with room for a leaked one.
    pub publishers: usize,
    /// Largest slice in a message; 1 where the payload is one struct.
    pub slice_len: usize,
    /// Size of one payload element, bytes.
    pub element_size: usize,
}

impl Topic {
    /// The topic's name among the services of a domain.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The topic's number on the wire.
    #[must_use]
    pub fn code(self) -> u32 {
        self as u32
    }

    /// The topic with this number on the wire.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.code() == code)
    }

    /// What it promises.
    #[must_use]
    pub fn delivery(self) -> Delivery {
        self.row().delivery
    }

    /// Whether its numbering goes on over the lives of its producers.
    #[must_use]
    pub fn resumes(self) -> bool {
        self.delivery() == Delivery::Lossless
    }

    /// Name, version and layout of its messages, or of what they are a slice of.
    #[must_use]
    pub fn layout(self) -> &'static Layout {
        self.row().layout
    }

    /// Whether a message is a slice of what [`Topic::layout`] says.
    #[must_use]
    pub fn is_slice(self) -> bool {
        self.row().is_slice
    }

    /// Quality of service where scans hold at most `max_readings` readings.
    #[must_use]
    pub fn qos(self, max_readings: usize) -> Qos {
        (self.row().qos)(max_readings)
    }
}

impl AsRef<str> for Topic {
    fn as_ref(&self) -> &str {
        self.name()
    }
}

impl Serialize for Topic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl Qos {
    /// Of a stream that nothing of may be lost.
    pub(crate) const STREAM: Self = Self {
        history: 2048,
        // What a late consumer is handed, and a window of what is sent until it has taken that.
        buffer: 3072,
        window: 1024,
        // A map's, its publisher, a recorder, a live page, Foxglove, a tool, and one that was left behind.
        subscribers: 7,
        publishers: 2,
        slice_len: 1,
        element_size: 0,
    };
    /// Of what only the latest value counts of.
    pub(crate) const LATEST: Self = Self { history: 1, buffer: 1, window: u64::MAX, subscribers: 8, ..Self::STREAM };

    /// Bytes that one producer reserves for its messages (header 32 B, iceoryx2's own 64 B at most).
    #[must_use]
    pub fn segment_bytes(&self) -> u64 {
        let chunks = self.subscribers * (self.buffer + 3) + self.history + 2;
        (chunks * (self.slice_len * self.element_size + 96)) as u64
    }
}

/// Shared memory that a whole graph can come to need at most, bytes.
#[must_use]
pub fn memory_budget_bytes(max_readings: usize, services: u64) -> u64 {
    let streams: u64 = Topic::ALL
        .into_iter()
        .map(|topic| {
            let producers = if topic == Topic::Health { services } else { 1 };
            producers * topic.qos(max_readings).segment_bytes()
        })
        .sum();
    // Connections, service tables, node files.
    streams + (8 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_graph_fits_the_64_mib_that_containers_get() {
        for max_readings in [8, 16, 181, 361] {
            let bytes = memory_budget_bytes(max_readings, 4);
            assert!(bytes < 64 << 20, "{max_readings} readings: {} MiB", bytes >> 20);
        }
    }

    #[test]
    fn windows_fit_the_buffers_so_that_overflow_never_happens_under_back_pressure() {
        for topic in Topic::ALL {
            let qos = topic.qos(181);
            if topic.delivery().is_stream() {
                assert!(qos.window as usize <= qos.buffer / 2, "{topic:?} {qos:?}");
            }
        }
    }

    #[test]
    fn codes_find_their_topics() {
        for topic in Topic::ALL {
            assert_eq!(Topic::from_code(topic as u32), Some(topic));
        }
        assert_eq!(Topic::from_code(0), None);
    }
}
