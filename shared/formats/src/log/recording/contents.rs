//! What is in a recording, for people and programs.

use serde::Serialize;

use super::inventory::Inventory;

/// One topic of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicContents {
    /// The name of the topic.
    pub topic: String,
    /// The type of the topic's messages, as `sensor_msgs/LaserScan`.
    pub datatype: String,
    /// The number of messages.
    pub count: u64,
    /// Messages per second.
    pub rate_hz: f64,
    /// Messages that are not what their type says.
    pub damaged: u64,
    /// The frames that its messages are in; of types that are read only.
    pub frames: Vec<String>,
}

/// What is in a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingContents {
    /// Messages in all.
    pub messages: u64,
    /// The time at which the first message was recorded, nanoseconds.
    pub first_ns: u64,
    /// The time at which the last message was recorded, nanoseconds.
    pub last_ns: u64,
    /// The topics of the recording.
    pub topics: Vec<TopicContents>,
}

impl RecordingContents {
    pub(crate) fn of(inventory: &Inventory) -> Self {
        let topics = || inventory.topics.values();
        Self {
            messages: inventory.messages,
            first_ns: topics().map(|topic| topic.first_ns).min().unwrap_or(0),
            last_ns: topics().map(|topic| topic.last_ns).max().unwrap_or(0),
            topics: inventory
                .topics
                .iter()
                .map(|(name, topic)| {
                    let mut frames: Vec<String> = topic.frames.keys().map(|(frame, _)| frame.clone()).collect();
                    frames.dedup();
                    TopicContents {
                        topic: name.clone(),
                        datatype: topic.datatype.clone(),
                        count: topic.count,
                        rate_hz: topic.rate_hz(),
                        damaged: topic.damaged,
                        frames,
                    }
                })
                .collect(),
        }
    }
}
