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
    let mut graph = Graph { services, sequences: BTreeMap::new(), queue: VecDeque::new() };
    while let Some((stamp_ns, message)) = sensor.next()? {
        graph.send(stamp_ns, message);
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
    queue: VecDeque<(u64, u64, Message)>,
}

impl Graph<'_, '_> {
    fn send(&mut self, stamp_ns: u64, message: Message) {
        let sequence = self.sequences.entry(message.topic()).or_insert(0);
        *sequence += 1;
        self.queue.push_back((*sequence, stamp_ns, message));
    }

    fn collect(&mut self, mut out: Outbox) {
        while let Some((stamp_ns, message)) = out.pop() {
            self.send(stamp_ns, message);
        }
    }

    fn settle(&mut self) -> Result<()> {
        while let Some((sequence, stamp_ns, message)) = self.queue.pop_front() {
            for index in 0..self.services.len() {
                if self.services[index].inputs().contains(&message.topic()) {
                    let mut out = Outbox::default();
                    let input = Input::Message { sequence, stamp_ns, message: message.clone() };
                    self.services[index].step(input, &mut out)?;
                    self.collect(out);
                }
            }
        }
        Ok(())
    }
}
