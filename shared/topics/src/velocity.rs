//! `drive/command`: how fast the robot is to drive, by whoever plans where.

use crate::declared::{DeclaredDelivery, DeclaredTopic};

/// The topic's name. It is there if a service of the graph file reads or writes it.
pub const DRIVE_COMMAND: &str = "drive/command";

/// A speed to drive at, until the next is told or the sensor's dead-man time is over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s, counter-clockwise.
    pub w_radps: f64,
}

impl Velocity {
    /// Bytes of a message.
    pub const BYTES: usize = 16;

    /// What the topic is.
    #[must_use]
    pub fn topic() -> DeclaredTopic {
        let type_name = "echogrid/Velocity/1".to_owned();
        DeclaredTopic { type_name, bytes: Self::BYTES, delivery: DeclaredDelivery::Latest }
    }

    /// The velocity as it is sent: forward speed and turn rate, two `f64` of the machine.
    #[must_use]
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..8].copy_from_slice(&self.v_mps.to_ne_bytes());
        bytes[8..].copy_from_slice(&self.w_radps.to_ne_bytes());
        bytes
    }

    /// What was sent; none: other than so many bytes, or no finite numbers.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let (v, w) = bytes.split_first_chunk()?;
        let of = |bytes: [u8; 8]| Some(f64::from_ne_bytes(bytes)).filter(|value| value.is_finite());
        Some(Self { v_mps: of(*v)?, w_radps: of(w.try_into().ok()?)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_is_what_is_heard() {
        let velocity = Velocity { v_mps: 0.25, w_radps: -0.5 };
        assert_eq!(Velocity::of(&velocity.to_bytes()), Some(velocity));
        assert_eq!(Velocity::of(&velocity.to_bytes()[1..]), None);
        assert_eq!(Velocity::of(&Velocity { w_radps: f64::NAN, ..velocity }.to_bytes()), None);
    }
}
