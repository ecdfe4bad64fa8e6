//! The launcher's part in a domain.

use std::collections::BTreeMap;
use std::path::PathBuf;

use iceoryx2::node::Node;
use iceoryx2::prelude::{EventId, ipc};

use crate::control;
use crate::declared::DeclaredTopic;
use crate::domain::{Claim, Domain, check_memory, files_needed};
use crate::participant::{Bell, MAX_NODES, Participant, TopicError, failed, service_name};
use crate::topic::{Topic, memory_budget_bytes};

/// A producer appeared, left, died.
const PRODUCER_EVENTS: [usize; 3] = [1, 2, 3];
const MAX_LISTENERS: usize = 16;
/// Files in shared memory that a topic of a graph file can come to need, tools included.
const FILES_PER_DECLARED: u64 = 32;

/// What a launcher makes in its domain.
#[derive(Debug, Clone, Copy)]
pub struct Needs<'a> {
    /// Readings in the largest scan.
    pub max_readings: usize,
    /// The names of the services.
    pub services: &'a [&'a str],
    /// The topics that the graph file declares, by name.
    pub declared: &'a BTreeMap<String, DeclaredTopic>,
}

/// The launcher's part: it alone creates topics, so that no worker's death can leave one half made.
#[derive(Debug)]
pub struct Owner {
    // Topics before the node, the node before the claim that wipes the domain.
    topics: Vec<Box<dyn core::fmt::Debug>>,
    participant: Participant,
    claim: Claim,
}

impl Owner {
    /// Claims a domain and creates every topic in it.
    ///
    /// # Errors
    /// The domain is in use, or /dev/shm is too small or refuses.
    pub fn create(domain: Domain, needs: Needs<'_>) -> Result<Self, TopicError> {
        let claim = domain.claim()?;
        let count = needs.services.len() as u64;
        let declared: u64 = needs.declared.values().map(|topic| topic.qos().segment_bytes()).sum();
        let files = files_needed(count) + FILES_PER_DECLARED * needs.declared.len() as u64;
        check_memory(memory_budget_bytes(needs.max_readings, count) + declared, files)?;
        let participant = Participant::join(claim.domain(), "launcher")?;
        let topics = topics(&participant, needs)?;
        claim.make_private()?;
        Ok(Self { topics, participant, claim })
    }

    /// Makes all of it anew, in the same domain. No other process may be in it, and no port of it may be used any more.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn renew(&mut self, needs: Needs<'_>) -> Result<(), TopicError> {
        self.claim.renew()?;
        let participant = Participant::join(self.claim.domain(), "launcher")?;
        let topics = topics(&participant, needs)?;
        // To close what is wedged could hang; its memory has no name any more.
        core::mem::forget(core::mem::replace(&mut self.topics, topics));
        core::mem::forget(core::mem::replace(&mut self.participant, participant));
        self.claim.make_private()?;
        Ok(())
    }

    /// A folder, made now, in which services store their states, of at most `kept_bytes` besides maps. It outlives what is made anew.
    ///
    /// # Errors
    /// The system refuses.
    pub fn state_dir(&self, kept_bytes: u64) -> Result<PathBuf, TopicError> {
        Ok(self.claim.state_dir(kept_bytes)?)
    }

    /// The launcher as a process of its own domain.
    #[must_use]
    pub fn participant(&self) -> &Participant {
        &self.participant
    }

    /// The domain whose topics are owned.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        self.claim.domain()
    }
}

/// Creates every topic, and the orders to each service.
fn topics(participant: &Participant, needs: Needs<'_>) -> Result<Vec<Box<dyn core::fmt::Debug>>, TopicError> {
    let (mut topics, node): (Vec<Box<dyn core::fmt::Debug>>, _) = (Vec::new(), participant.node());
    for topic in Topic::ALL {
        topics.push((topic.row().create)(node, topic, &topic.qos(needs.max_readings))?);
        topics.push(Box::new(create_bell(node, topic.name())?));
    }
    for (name, topic) in needs.declared {
        topics.push(topic.create(node, name)?);
        topics.push(Box::new(create_bell(node, name)?));
    }
    for service in needs.services {
        topics.extend(control::create(node, service)?);
    }
    Ok(topics)
}

fn create_bell(node: &Node<ipc::Service>, topic: &str) -> Result<Bell, TopicError> {
    node.service_builder(&service_name(topic)?)
        .event()
        .max_nodes(MAX_NODES)
        .max_notifiers(MAX_LISTENERS)
        .max_listeners(MAX_LISTENERS)
        .event_id_max_value(15)
        .notifier_created_event(EventId::new(PRODUCER_EVENTS[0]))
        .notifier_dropped_event(EventId::new(PRODUCER_EVENTS[1]))
        .notifier_dead_event(EventId::new(PRODUCER_EVENTS[2]))
        .create()
        .map_err(|e| failed(topic, "creating its event", e))
}
