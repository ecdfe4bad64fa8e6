//! What a message of a topic says.

use serde_json::Value;

use crate::contract::Message;
use crate::shape::Payload;
use crate::topic::{Qos, Topic};

/// What a message of one topic says, and how that lies in shared memory. [`crate::contract`] holds all there are.
pub trait Content: core::fmt::Debug + Clone + Sized + 'static {
    /// The topic that it belongs to.
    const TOPIC: Topic;
    /// How it lies in shared memory: a wire type, or a slice of one.
    type Payload: Payload<Self> + ?Sized;

    /// The room that the topic reserves, where scans hold at most `max_readings` readings.
    ///
    /// Histories outlast the longest outage that is to be survived (20 s of odometry at 100 Hz); for large scans they are
    /// limited by memory instead.
    fn qos(max_readings: usize) -> Qos;

    /// All that it says, as JSON.
    fn json(&self) -> Value;

    /// What of it fits a line, as JSON.
    fn brief(&self) -> Value {
        self.json()
    }
}

/// A content that [`Message`] has a variant for.
pub trait Carried: Content {
    /// The content as a message.
    fn wrap(self) -> Message;
    /// What a message says, if it is one of this topic.
    fn find(message: &Message) -> Option<&Self>;
}
