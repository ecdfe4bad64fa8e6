//! A whole graph in one thread, without shared memory: for tests, and for programs that want a map
//! and no processes. The services are the same, the bytes of the map too.

use std::collections::{BTreeMap, VecDeque};

use anyhow::Result;
use echogrid_topics::{Message, Topic};

use crate::{Input, Outbox, Sensor, Service};

/// Runs `sensor` to its end through `services`, each given the messages of its input topics in the
/// order in which they come; then tells each, in order, to finish. `services` must be ordered
/// from upstream to downstream.
///
/// # Errors
/// The first error of the sensor or a service.
pub fn run(sensor: &mut dyn Sensor, services: &mut [&mut dyn Service]) -> Result<()> {
    let inboxes = services.iter().map(|_| VecDeque::new()).collect();
    let mut graph = Graph { services, sequences: BTreeMap::new(), inboxes };
    loop {
        if !sensor.is_ready()? {
            continue;
        }
        let Some((stamp_ns, message)) = sensor.next()? else { break };
        graph.send(stamp_ns, message);
        graph.settle()?;
    }
    for topic in sensor.outputs() {
        graph.end(*topic);
        graph.settle()?;
    }
    for index in 0..graph.services.len() {
        let mut out = Outbox::default();
        graph.services[index].step(Input::Finish, &mut out)?;
        graph.collect(out);
        graph.settle()?;
    }
    Ok(())
}

struct Graph<'a, 'b> {
    services: &'a mut [&'b mut dyn Service],
    sequences: BTreeMap<Topic, u64>,
    /// What each service has been sent and not taken yet: sequence, stamp, message.
    inboxes: Vec<VecDeque<(u64, u64, Message)>>,
}

impl Graph<'_, '_> {
    fn send(&mut self, stamp_ns: u64, message: Message) {
        let sequence = self.sequences.entry(message.topic()).or_insert(0);
        *sequence += 1;
        for (service, inbox) in self.services.iter().zip(&mut self.inboxes) {
            if service.inputs().contains(&message.topic()) {
                inbox.push_back((*sequence, stamp_ns, message.clone()));
            }
        }
    }

    /// Tells those who read a topic of the sensor that nothing more comes of it.
    fn end(&mut self, topic: Topic) {
        for index in 0..self.services.len() {
            let mut out = Outbox::default();
            if self.services[index].inputs().contains(&topic) {
                self.services[index].ended(topic, &mut out);
            }
            self.collect(out);
        }
    }

    fn collect(&mut self, mut out: Outbox) {
        while let Some((stamp_ns, message)) = out.pop() {
            self.send(stamp_ns, message);
        }
    }

    /// Steps the services until none takes anything more.
    fn settle(&mut self) -> Result<()> {
        let mut stepped = true;
        while stepped {
            stepped = false;
            for index in 0..self.services.len() {
                stepped |= self.step(index)?;
            }
        }
        Ok(())
    }

    /// Gives a service the oldest message that is welcome, if there is one.
    fn step(&mut self, index: usize) -> Result<bool> {
        let (service, inbox) = (&mut self.services[index], &mut self.inboxes[index]);
        let welcome = inbox.iter().position(|(_, _, message)| service.is_ready_for(message.topic()));
        let Some((sequence, stamp_ns, message)) = welcome.and_then(|place| inbox.remove(place)) else {
            return Ok(false);
        };
        let mut out = Outbox::default();
        service.step(Input::Message { sequence, stamp_ns, message }, &mut out)?;
        self.collect(out);
        Ok(true)
    }
}
