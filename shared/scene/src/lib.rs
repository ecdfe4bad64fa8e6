//! What a graph says, in Foxglove's well-known messages: for a server, and for recordings.
//!
//! A [`Show`] takes the messages of the topics as they come, and puts what they say into [`Channel`]s, as bytes that a [`Sink`] takes.

mod channel;
mod convert;
mod show;

pub use channel::{Channel, Sink};
pub use show::Show;
