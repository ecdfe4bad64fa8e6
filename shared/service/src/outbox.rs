//! Messages on their way out of a step.

use std::collections::VecDeque;

use echogrid_topics::Message;

/// Where a step puts its outputs; the loop sends them as the consumers keep up.
#[derive(Debug, Default)]
pub struct Outbox {
    messages: VecDeque<(u64, Message)>,
}

impl Outbox {
    /// Sends `message`, true at `stamp_ns`.
    pub fn send(&mut self, stamp_ns: u64, message: Message) {
        self.messages.push_back((stamp_ns, message));
    }

    /// Whether everything is on its way.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// The oldest message.
    #[must_use]
    pub fn front(&self) -> Option<&(u64, Message)> {
        self.messages.front()
    }

    /// Takes the oldest message.
    pub fn pop(&mut self) -> Option<(u64, Message)> {
        self.messages.pop_front()
    }
}
