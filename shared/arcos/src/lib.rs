//! The ARCOS protocol (P2OS before it) that Pioneer robots speak over a serial line, as bytes in and values out.
//!
//! The robot and its client exchange [`Packet`]s: a header, a length, an id, arguments, a checksum. The client opens a session
//! ([`Command`], [`Identity`]); the robot then tells ten times a second how it is ([`Sip`]), and on demand how it is set up
//! ([`Configuration`]). [`Decoder`] finds packets in a stream that lost, changed or gained bytes. [`Parameters`] are what ARIA's
//! `.p` files say of a model: what a count of each field means, and where the sonars sit.
//!
//! Nothing here opens a port, reads a clock or starts a thread; both sides of the line are here, so a robot can be emulated.
//!
//! ```
//! use echogrid_arcos::{Command, Decoder};
//!
//! let mut line = b"noise".to_vec();
//! line.extend(Command::Sonar.with(1).bytes());
//! let mut decoder = Decoder::default();
//! decoder.push(&line);
//! let found = decoder.next_packet().unwrap();
//! assert_eq!((found.packet.id(), found.at), (Command::Sonar as u8, 5));
//! ```

mod command;
mod configuration;
mod decoder;
mod identity;
mod packet;
mod parameters;
mod position;
mod reader;
mod sip;

pub use command::{Argument, Baud, Command};
pub use configuration::Configuration;
pub use decoder::{Decoder, Found};
pub use identity::Identity;
pub use packet::{HEADER, PACKET_MAX, Packet, checksum};
pub use parameters::{ParameterError, Parameters, SonarPlace};
pub use position::Counter;
pub use sip::{Sip, SonarRange};

/// A packet whose arguments are not what its id promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a packet of id {id:#04x} ends within its {field}")]
pub struct Malformed {
    /// The packet's id.
    pub id: u8,
    /// What was cut short.
    pub field: &'static str,
}
