//! The topics that a service reads and writes: what it may take next, what still waits, who must be told what.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use echogrid_topics::Header;
use echogrid_topics::{Delivery, Health, Input as Port, Message, Output, Received, Topic};

use crate::mutants::Mutant;
use crate::outbox::Outbox;

/// Whether the end of a stream, said in the life `epoch` of its producer, is meant for a process that was last told all that
/// counts by the life `told`.
fn is_meant_for_us(delivery: Delivery, told: u64, epoch: u64) -> bool {
    delivery != Delivery::Relayed || told == epoch || Mutant::EndOvertakes.lives()
}

/// An input.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) port: Port,
    /// Messages that its producer may be ahead of what is stored here.
    pub(crate) window: u64,
    pub(crate) ended: bool,
    pub(crate) seen: bool,
    /// The life of the producer of a relayed stream that has told this process all that counts; the end of another is not
    /// meant for it: it was said to an earlier process, or before this one was met.
    told: u64,
    /// Of what was lost, that which an earlier life of the service missed.
    pub(crate) lost_before: u64,
    /// The last sequence that was acknowledged.
    pub(crate) published: u64,
}

impl Source {
    /// Whether its numbering goes on over the lives of its producers.
    pub(crate) fn resumes(&self) -> bool {
        self.port.topic().resumes()
    }

    /// Messages that never arrived, in any life of the service.
    pub(crate) fn lost(&self) -> u64 {
        self.lost_before + self.port.lost()
    }
}

/// An output.
#[derive(Debug)]
pub(crate) struct Sink {
    pub(crate) port: Output,
    /// Whether its end was said, to everyone who is there.
    ended: bool,
    /// Somebody came who needs to be told all that counts.
    newcomer: bool,
    /// The latest process of each service that is being told, and does not know yet that it was.
    untold: BTreeMap<String, u32>,
}

/// What came of looking at an input.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
pub(crate) enum Found {
    /// A message that is to be taken in.
    Message(Header, Message),
    /// The stream has ended.
    End,
    /// A message that broke its contract.
    Faulty(Header, echogrid_topics::contract::Fault),
    /// Something that changes nothing.
    Nothing,
}

/// Every topic that a service reads or writes.
#[derive(Debug)]
pub(crate) struct Ports {
    pub(crate) sources: Vec<Source>,
    pub(crate) sinks: Vec<Sink>,
}

impl Ports {
    /// Of these inputs, each with the window of its producer, and these outputs.
    pub(crate) fn new(inputs: Vec<(Port, u64)>, outputs: Vec<Output>) -> Self {
        let source =
            |(port, window)| Source { port, window, ended: false, seen: false, told: 0, lost_before: 0, published: 0 };
        let sink = |port| Sink { port, ended: false, newcomer: false, untold: BTreeMap::new() };
        Self { sources: inputs.into_iter().map(source).collect(), sinks: outputs.into_iter().map(sink).collect() }
    }

    /// Looks at an input, as the process `pid`; none: it is empty.
    pub(crate) fn look(&mut self, index: usize, pid: u32) -> Result<Option<Found>> {
        let source = &mut self.sources[index];
        let Some(received) = source.port.receive()? else { return Ok(None) };
        Ok(Some(match received {
            // A restarted sensor describes its robot once more.
            Received::Message(_, Message::Robot(_)) if source.seen => Found::Nothing,
            Received::Message(header, message) => {
                source.seen = true;
                Found::Message(header, message)
            }
            Received::Told(header, told) => {
                if told == pid {
                    source.told = header.epoch;
                }
                Found::Nothing
            }
            Received::End(header) if !is_meant_for_us(source.port.topic().delivery(), source.told, header.epoch) => {
                tracing::debug!(topic = source.port.topic().name(), "an end that was said to somebody else");
                Found::Nothing
            }
            Received::End(_) => {
                source.ended = true;
                Found::End
            }
            Received::Faulty(header, fault) => Found::Faulty(header, fault),
        }))
    }

    /// Whether an input keeps all others waiting: without a robot description nothing else is read.
    pub(crate) fn is_first(&self, index: usize) -> bool {
        let source = &self.sources[index];
        source.port.topic() == Topic::RobotDescription && !source.seen
    }

    /// The input whose next message the service can't go on without, when it has taken all that is `welcome`.
    pub(crate) fn awaited_input(&self, welcome: impl Fn(Topic) -> bool) -> Option<Topic> {
        let topics = || self.sources.iter().map(|source| (source.port.topic(), source));
        let open = || topics().filter(|(topic, source)| topic.delivery().is_stream() && !source.ended);
        let robot = topics().find(|(topic, source)| *topic == Topic::RobotDescription && !source.seen);
        // A stream is left where it is until an answer has come.
        let answer = || topics().find(|(topic, _)| !topic.delivery().is_stream() && *topic != Topic::RobotDescription);
        let holds = open().any(|(topic, _)| !welcome(topic));
        robot.or_else(|| answer().filter(|_| holds)).or_else(|| open().next()).map(|(topic, _)| topic)
    }

    /// The first output that some consumer is not done with.
    pub(crate) fn awaited_output(&self) -> Option<Topic> {
        let open = |sink: &&Sink| !sink.port.is_met() || !sink.port.is_drained();
        self.sinks.iter().find(open).map(|sink| sink.port.topic())
    }

    /// Whether every input stream that `counts` has ended.
    pub(crate) fn inputs_ended(&self, counts: impl Fn(Topic) -> bool) -> bool {
        let mut topics = self.sources.iter().map(|source| (source.port.topic(), source.ended));
        topics.all(|(topic, ended)| ended || !topic.delivery().is_stream() || !counts(topic))
    }

    /// Whether there is an input stream that `counts`: the end of what has none is said by the launcher.
    pub(crate) fn has_streams(&self, counts: impl Fn(Topic) -> bool) -> bool {
        self.sources.iter().map(|source| source.port.topic()).any(|topic| topic.delivery().is_stream() && counts(topic))
    }

    /// Last sequence taken of each lossless input, in their order.
    pub(crate) fn position(&self) -> Vec<u64> {
        self.sources.iter().filter(|source| source.resumes()).map(|source| source.port.taken().sequence).collect()
    }

    /// Messages that never arrived.
    pub(crate) fn lost(&self) -> u64 {
        self.sources.iter().map(Source::lost).sum()
    }

    /// The output of a topic; none: it is not one of this service.
    pub(crate) fn sink(&self, topic: Topic) -> Option<&Sink> {
        self.sinks.iter().find(|sink| sink.port.topic() == topic)
    }

    /// Sends what the windows of the consumers have room for, and wakes them. `name`: whose outputs these are.
    pub(crate) fn flush(&mut self, outbox: &mut Outbox, name: &str) -> Result<()> {
        while let Some((stamp_ns, message)) = outbox.front() {
            if !self.send(*stamp_ns, message, name)? {
                break;
            }
            outbox.pop();
        }
        if outbox.is_empty() {
            self.say_what_was_told()?;
        }
        self.ring()
    }

    /// Sends a message if there is room for it.
    pub(crate) fn send(&mut self, stamp_ns: u64, message: &Message, name: &str) -> Result<bool> {
        let topic = message.topic();
        let sink = self.sinks.iter_mut().find(|sink| sink.port.topic() == topic);
        let sink = sink.with_context(|| format!("{name} wrote to {}, which is not among its outputs", topic.name()))?;
        if sink.port.room() == 0 {
            return Ok(false);
        }
        sink.port.send(stamp_ns, message)?;
        Ok(true)
    }

    /// All that the service had to say is on its way: whoever came anew has been told.
    fn say_what_was_told(&mut self) -> Result<()> {
        for sink in self.sinks.iter_mut().filter(|sink| !sink.newcomer) {
            for pid in std::mem::take(&mut sink.untold).into_values() {
                sink.port.told(pid)?;
            }
        }
        Ok(())
    }

    /// Wakes the consumers of what was sent.
    pub(crate) fn ring(&mut self) -> Result<()> {
        Ok(self.sinks.iter_mut().try_for_each(|sink| sink.port.ring())?)
    }

    /// Takes note of the wake-ups so far.
    pub(crate) fn hush(&self) -> Result<()> {
        Ok(self.sources.iter().try_for_each(|source| source.port.hush())?)
    }

    /// Takes note of what somebody says of itself.
    pub(crate) fn note(&mut self, health: &Health) {
        for sink in &mut self.sinks {
            let is_new = sink.port.note(health);
            if is_new && sink.port.topic().delivery() == Delivery::Relayed {
                sink.newcomer = true;
                sink.untold.insert(health.service.clone(), health.pid);
            }
        }
    }

    /// Hands whoever came late the latest of what was sent before.
    pub(crate) fn welcome(&mut self) -> Result<()> {
        Ok(self.sinks.iter_mut().try_for_each(|sink| sink.port.welcome())?)
    }

    /// The output that somebody came to who was not there when it was written; each is told once.
    pub(crate) fn take_newcomer(&mut self) -> Option<Topic> {
        let sink = self.sinks.iter_mut().find(|sink| sink.newcomer)?;
        sink.newcomer = false;
        // The newcomer has not heard of it.
        sink.ended &= sink.port.topic().resumes();
        Some(sink.port.topic())
    }

    /// Says on every output stream that it ends here, to whoever has not heard it.
    pub(crate) fn end(&mut self, stamp_ns: u64) -> Result<()> {
        // Who was not met yet has heard nothing that could end.
        let may_end = |sink: &&mut Sink| {
            let is_relayed = sink.port.topic().delivery() == Delivery::Relayed;
            !sink.ended
                && (!is_relayed
                    || Mutant::EndOvertakes.lives()
                    || (sink.port.is_met() && !sink.newcomer && sink.untold.is_empty()))
        };
        for sink in self.sinks.iter_mut().filter(may_end) {
            if sink.port.topic().delivery().is_stream() {
                sink.port.end(stamp_ns)?;
            }
            sink.ended = true;
            sink.port.ring()?;
        }
        Ok(())
    }

    /// Whether every consumer has integrated all that was sent.
    pub(crate) fn is_drained(&self) -> bool {
        self.sinks.iter().all(|sink| sink.port.is_drained() && !sink.newcomer && sink.untold.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_before_all_was_told_is_meant_for_somebody_else() {
        // Nobody has told us anything; another life of the producer has; this one has.
        let relayed = [0, 6, 7].map(|told| is_meant_for_us(Delivery::Relayed, told, 7));
        assert_eq!(relayed, [false, false, true]);
        // What is numbered through the whole run is for everybody.
        assert!(is_meant_for_us(Delivery::Lossless, 0, 7));
    }
}
