//! Who the robot is: its answer to the last step of synchronisation.

use crate::reader::Reader;
use crate::{Malformed, Packet};

/// Name and model of a robot, as it gives them when a session is opened.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identity {
    /// What its owner called it.
    pub name: String,
    /// The class of the robot, such as `Pioneer`.
    pub class: String,
    /// The model of the robot, such as `p3at-sh`: the name of its parameter file.
    pub subclass: String,
}

impl Identity {
    /// The id of the packet that carries it.
    pub const ID: u8 = 2;

    /// Reads name and model from the packet that carries them.
    ///
    /// # Errors
    /// One of the three texts is missing.
    pub fn read(packet: &Packet) -> Result<Self, Malformed> {
        let mut reader = Reader::new(packet);
        Ok(Self { name: reader.text("name")?, class: reader.text("class")?, subclass: reader.text("subclass")? })
    }

    /// The packet by which a robot sends it; none if the texts are too long for one.
    #[must_use]
    pub fn packet(&self) -> Option<Packet> {
        let texts = [&self.name, &self.class, &self.subclass];
        let bytes: Vec<u8> = texts.into_iter().flat_map(|text| text.bytes().chain([0])).collect();
        Packet::new(Self::ID, &bytes)
    }
}
