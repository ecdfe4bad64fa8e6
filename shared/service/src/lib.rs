//! What every process of echogrid shares.
//!
//! A service is a value with a `step`: one input in, any outputs out, no clock, no thread, no port.
//! [`process::run`] puts it into a process of the graph, whose life is told in [`life`]; [`local::run`] runs a whole graph of them in
//! one thread, with the same bytes as a result.

pub mod conformance;
mod declaration;
mod driven;
pub mod host;
pub mod life;
pub mod lifeline;
pub mod live_clock;
pub mod local;
pub mod logging;
pub mod mutants;
pub mod onlooker;
pub mod outbox;
pub mod pace;
pub mod placed;
pub mod plan;
pub mod play;
pub mod process;
pub mod runtime;
pub mod signals;
pub mod store;

use anyhow::Result;
use echogrid_core::parts::{Parts, Saved};
use echogrid_topics::{Command, Message, Topic};

pub use declaration::Declaration;
pub use outbox::Outbox;
pub use plan::Plan;

/// What a service is given.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
pub enum Input {
    /// A message of one of its input topics.
    Message {
        /// The sequence number of the message, from 1 on: through the run on a lossless topic, else through the producer's life.
        sequence: u64,
        /// When its content was true, sensor's clock, nanoseconds.
        stamp_ns: u64,
        /// Content.
        message: Message,
    },
    /// Every input stream has ended, or the graph is being stopped: finish what you have.
    Finish,
}

/// A service that turns inputs into outputs: odometry, mapper, publisher.
pub trait Service {
    /// Topics it reads, in the order in which they are looked at. A robot description among them
    /// is always the first message that the service sees.
    fn inputs(&self) -> &'static [Topic];

    /// Topics it writes.
    fn outputs(&self) -> &'static [Topic];

    /// Takes one input. Outputs must depend on nothing but the inputs of each topic in their order:
    /// how inputs of different topics interleave is up to the schedule.
    ///
    /// # Errors
    /// The service can't go on; the graph is stopped with this error.
    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()>;

    /// An input stream has ended: nothing more of this topic comes, in whatever order it ends among others.
    fn ended(&mut self, topic: Topic, out: &mut Outbox) {
        let _ = (topic, out);
    }

    /// Whether a message of this topic is welcome now. One that is not waits where it is, and its producer with it, until
    /// the service has taken a message of another topic and thinks otherwise: so an answer can be waited for.
    fn is_ready_for(&self, topic: Topic) -> bool {
        let _ = topic;
        true
    }

    /// Whether the service goes on until this stream has ended.
    fn outlives(&self, topic: Topic) -> bool {
        let _ = topic;
        true
    }

    /// Saves all that the steps so far have made of the service: what changed since it was saved last. Where the service
    /// writes a lossless topic: all of it.
    fn save(&mut self, parts: &mut Parts);

    /// Becomes, as it was just made, what was saved.
    ///
    /// # Errors
    /// What was saved is broken, or of another version.
    fn restore(&mut self, saved: &Saved) -> Result<()>;

    /// Somebody came to an output of relayed delivery: tells all of it that still counts.
    fn welcome(&mut self, topic: Topic, out: &mut Outbox) {
        let _ = (topic, out);
    }

    /// What is odd but usable of what it does, for people; empty: nothing to say.
    fn note(&self) -> String {
        String::new()
    }

    /// Carries out an order of the user: what was done, in words.
    ///
    /// # Errors
    /// Why not, in words. The service goes on.
    fn command(&mut self, command: Command, out: &mut Outbox) -> Result<String> {
        let _ = out;
        anyhow::bail!("this service has nothing to {}", command.word())
    }
}

/// A sensor: outputs only. All sources (a log, a simulator, a robot) are interchangeable.
pub trait Sensor {
    /// Topics it writes; the robot description comes first.
    fn outputs(&self) -> &'static [Topic];

    /// The next message in order of stamps, or none at the end. Of equal stamps the true pose comes before the odometry
    /// (see [`echogrid_topics::TruePose`]) and that before the readings.
    ///
    /// # Errors
    /// The source is broken; what came before is kept.
    fn next(&mut self) -> Result<Option<(u64, Message)>>;

    /// Whether it measures what is now, so that nobody can make it give the same again. What it gave is then kept until it is
    /// stored downstream; any other is made anew when it died, and gives the same.
    fn is_live(&self) -> bool {
        false
    }

    /// Whether there is a next message, or the end, by now. One that has nothing yet may wait for it, but no longer than a tenth
    /// of a second: heartbeats go out and orders are taken in between.
    ///
    /// # Errors
    /// As [`Sensor::next`].
    fn is_ready(&mut self) -> Result<bool> {
        Ok(true)
    }

    /// Nothing more will be asked of it: what it holds of the world (motors, a port) it lets go.
    fn close(&mut self) {}

    /// How what it measures with is doing, for people (a battery, a bumper, a line that was cut); empty: nothing to say.
    fn note(&self) -> String {
        String::new()
    }

    /// How many messages there will be in all, if known.
    fn total(&self) -> Option<u64> {
        None
    }

    /// Carries out an order of the user: what was done, in words.
    ///
    /// # Errors
    /// Why not, in words. The sensor goes on.
    fn command(&mut self, command: Command) -> Result<String> {
        anyhow::bail!("this sensor has nothing to {}", command.word())
    }
}

/// An error with its causes in one line; a cause that the line holds already is not said twice.
#[must_use]
pub fn in_words(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |line, cause| match cause.to_string() {
        cause if line.contains(&cause) => line,
        cause if line.is_empty() => cause,
        cause => format!("{line}: {cause}"),
    })
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    #[test]
    fn causes_are_said_once() {
        let error = anyhow!("disk full").context("map.png: disk full").context("saving");
        assert_eq!(super::in_words(&error), "saving: map.png: disk full");
    }
}
