//! The contract between echogrid's processes: message types and their layouts, topics and their
//! quality of service, domains. No other crate names iceoryx2.

pub mod control;
pub mod domain;
pub mod janitor;
pub mod memory;
pub mod message;
pub mod owner;
pub mod participant;
mod place;
pub mod port;
mod shared_memory;
pub mod topic;
mod window;
pub mod wire;

pub use control::{Command, ControlServer};
pub use domain::{Claim, Domain, DomainError};
pub use message::{
    Ack, Health, Layer, LocalizationFix, LocalizationRequest, MapInfo, Message, PoseEstimate, RawOdometry,
    ServiceState, TileUpdate, TruePose, TrueWorld,
};
pub use owner::Owner;
pub use participant::{Participant, TopicError};
pub use port::{Carrier, Input, Mailbox, Output, Received};
pub use topic::{Delivery, Topic};
pub use wire::Header;
