//! How far a producer may be ahead of its consumers.

use crate::contract::{Health, ServiceState};
use crate::topic::Topic;

/// A consumer that a producer waits for.
#[derive(Debug, Clone)]
struct Consumer {
    name: String,
    /// The process that was heard of last; 0: none yet.
    pid: u32,
    /// None until it has said that it is there.
    acknowledged: Option<u64>,
}

/// The consumers of a stream, as far as a producer waits for them.
#[derive(Debug)]
pub(crate) struct Window {
    topic: Topic,
    epoch: u64,
    /// Messages that the producer may be ahead.
    size: u64,
    consumers: Vec<Consumer>,
}

impl Window {
    pub(crate) fn new(topic: Topic, epoch: u64, size: u64, consumers: &[String]) -> Self {
        let consumers = consumers.iter().map(|name| Consumer { name: name.clone(), pid: 0, acknowledged: None });
        Self { topic, epoch, size, consumers: consumers.collect() }
    }

    /// How many more messages fit after `sequence`.
    pub(crate) fn room(&self, sequence: u64) -> u64 {
        self.acknowledged().map_or(0, |acknowledged| {
            acknowledged.map_or(u64::MAX, |least| least.saturating_add(self.size).saturating_sub(sequence))
        })
    }

    /// What every consumer will not need again: none while one has not been heard of; none in it where there is no consumer.
    pub(crate) fn acknowledged(&self) -> Option<Option<u64>> {
        let all: Option<Vec<u64>> = self.consumers.iter().map(|consumer| consumer.acknowledged).collect();
        all.map(|all| all.into_iter().min())
    }

    /// The last sequence that some consumer may have, whoever sent it: what is stored, or on its way within the window.
    pub(crate) fn furthest(&self) -> u64 {
        let acknowledged = self.consumers.iter().filter_map(|consumer| consumer.acknowledged);
        let on_its_way = acknowledged.clone().min().map_or(0, |least| least.saturating_add(self.size));
        acknowledged.max().unwrap_or(0).max(on_its_way)
    }

    /// Whether every consumer is done with all up to `sequence`.
    pub(crate) fn is_drained(&self, sequence: u64) -> bool {
        self.consumers.iter().all(|consumer| consumer.acknowledged >= Some(sequence))
    }

    /// The consumers that are not.
    pub(crate) fn lagging(&self, sequence: u64) -> Vec<&str> {
        let behind = |consumer: &&Consumer| consumer.acknowledged < Some(sequence);
        self.consumers.iter().filter(behind).map(|consumer| consumer.name.as_str()).collect()
    }

    /// Takes note of what a consumer says, when `sequence` has been sent; whether it is one that was not there before.
    pub(crate) fn note(&mut self, health: &Health, sequence: u64) -> bool {
        if health.state == ServiceState::Gone {
            self.consumers.retain(|consumer| consumer.name != health.service);
            return false;
        }
        // What it took in, which may not be stored: should nobody else have heard that it is done, another comes in its place.
        if health.state == ServiceState::Finished {
            return false;
        }
        let Some(consumer) = self.consumers.iter_mut().find(|consumer| consumer.name == health.service) else {
            return false;
        };
        if health.state == ServiceState::Starting {
            return false;
        }
        let Some(ack) = health.acks.iter().find(|ack| ack.topic == self.topic) else { return false };
        let is_new = consumer.pid != health.pid;
        consumer.pid = health.pid;
        let mine = (ack.epoch == self.epoch).then_some(ack.sequence.min(sequence));
        // Nothing is on its way to one that came just now; what it stored in an earlier life counts.
        let told = mine.unwrap_or(if is_new && !self.topic.resumes() { sequence } else { 0 });
        consumer.acknowledged = Some(consumer.acknowledged.unwrap_or(0).max(told));
        is_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::Ack;

    fn health(pid: u32, topic: Topic, epoch: u64, sequence: u64) -> Health {
        Health { acks: vec![Ack { topic, epoch, sequence }], ..Health::new("mapper", pid, ServiceState::Running) }
    }

    #[test]
    fn a_producer_waits_for_what_is_stored() {
        let mut window = Window::new(Topic::RangeScan, 7, 10, &["mapper".into()]);
        assert_eq!((window.room(0), window.acknowledged()), (0, None));
        assert!(window.note(&health(1, Topic::RangeScan, 0, 0), 0));
        assert_eq!(window.room(4), 6);
        assert!(!window.note(&health(1, Topic::RangeScan, 7, 3), 4));
        assert_eq!((window.room(4), window.is_drained(4)), (9, false));
        // Another process in its place says where it begins.
        assert!(window.note(&health(2, Topic::RangeScan, 7, 3), 4));
        assert_eq!(window.lagging(4), ["mapper"]);
        // More than was sent can't be stored.
        window.note(&health(2, Topic::RangeScan, 7, 99), 4);
        assert!(window.is_drained(4) && window.room(4) == 10);
    }

    #[test]
    fn what_an_earlier_producer_sent_is_stored_or_within_the_window() {
        let mut window = Window::new(Topic::RangeScan, 7, 10, &["mapper".into(), "slam".into()]);
        assert_eq!(window.furthest(), 0);
        window.note(&health(1, Topic::RangeScan, 7, 3), 99);
        window.note(&Health { service: "slam".into(), ..health(2, Topic::RangeScan, 7, 5) }, 99);
        assert_eq!(window.furthest(), 13);
        window.note(&Health { service: "slam".into(), ..health(2, Topic::RangeScan, 7, 40) }, 99);
        assert_eq!(window.furthest(), 40);
    }

    #[test]
    fn who_comes_anew_to_a_relayed_stream_owes_nothing() {
        let mut window = Window::new(Topic::MapTiles, 7, 10, &["mapper".into()]);
        window.note(&health(1, Topic::MapTiles, 7, 3), 8);
        assert_eq!(window.room(8), 5);
        assert!(window.note(&health(2, Topic::MapTiles, 0, 0), 8));
        assert!(window.is_drained(8));
    }

    #[test]
    fn who_is_gone_for_good_is_not_waited_for() {
        let mut window = Window::new(Topic::MapTiles, 7, 10, &["mapper".into()]);
        // What it says of itself is not enough.
        window.note(&Health { state: ServiceState::Finished, ..health(1, Topic::MapTiles, 7, 0) }, 0);
        assert_eq!(window.acknowledged(), None);
        window.note(&Health { state: ServiceState::Gone, ..health(1, Topic::MapTiles, 0, 0) }, 0);
        assert_eq!((window.room(99), window.is_drained(99)), (u64::MAX, true));
    }
}
