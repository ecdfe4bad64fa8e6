//! The contract between echogrid's processes: message types and their layouts, topics and their
//! quality of service, domains. No other crate names iceoryx2.

mod content;
pub mod contract;
pub mod control;
pub mod declared;
pub mod domain;
pub mod janitor;
pub mod languages;
pub mod memory;
pub mod owner;
pub mod participant;
pub mod port;
mod read_position;
mod shape;
mod shared_memory;
mod table;
pub mod topic;
pub mod velocity;
mod window;
pub mod wire;

pub use content::{Carried, Content};
pub use contract::{
    Ack, Health, Layer, LocalizationFix, LocalizationRequest, MapInfo, Message, PoseEstimate, RawOdometry,
    ServiceState, TileUpdate, Topic, TruePose, TrueWorld,
};
pub use control::{Command, ControlServer};
pub use declared::{DeclaredDelivery, DeclaredInput, DeclaredOutput, DeclaredTopic};
pub use domain::{Claim, Domain, DomainError};
pub use owner::Owner;
pub use participant::{Participant, TopicError};
pub use port::{Carrier, Input, Mailbox, Output, Received};
pub use topic::Delivery;
pub use wire::Header;
