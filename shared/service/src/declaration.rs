//! What a service declares of itself, so that a graph can be put together of services that nobody knows.

use echogrid_topics::Topic;

/// What a service reads, writes and understands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Declaration {
    /// Topics whose producers wait for the service.
    pub reads: &'static [Topic],
    /// Topics that it takes what comes of; nobody waits for it there.
    pub looks_on: &'static [Topic],
    /// Topics that it writes.
    pub writes: &'static [Topic],
    /// Orders that it carries out, by their words.
    pub orders: &'static [&'static str],
}
