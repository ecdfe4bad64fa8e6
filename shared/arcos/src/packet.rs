//! A packet: header, count, id, arguments, checksum.

use core::fmt;

/// Every packet begins with these.
pub const HEADER: [u8; 2] = [0xFA, 0xFB];
/// The most bytes of a packet, header and checksum included: the count is a byte.
pub const PACKET_MAX: usize = 3 + COUNT_MAX;
/// Id and checksum.
pub(crate) const COUNT_MIN: usize = 3;
pub(crate) const COUNT_MAX: usize = u8::MAX as usize;

/// The checksum of id and arguments: the sum of big-endian pairs, and what is left over in its lower half.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u16 {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let sum = pairs.iter().fold(0_u16, |sum, pair| sum.wrapping_add(u16::from_be_bytes(*pair)));
    rest.iter().fold(sum, |sum, byte| sum ^ u16::from(*byte))
}

/// A packet with a checksum that is right.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Packet {
    /// As it goes over the line.
    bytes: Vec<u8>,
}

impl Packet {
    /// A packet of an id and its arguments; none if they are too long for one. (Nobody finds one of id 0 whose arguments are
    /// zeros: its checksum proves nothing.)
    #[must_use]
    pub fn new(id: u8, arguments: &[u8]) -> Option<Self> {
        let count = u8::try_from(arguments.len() + COUNT_MIN).ok()?;
        let mut bytes = Vec::with_capacity(arguments.len() + 6);
        bytes.extend(HEADER);
        bytes.extend([count, id]);
        bytes.extend(arguments);
        let sum = checksum(&bytes[3..]);
        bytes.extend(sum.to_be_bytes());
        Some(Self { bytes })
    }

    /// The packet that these bytes begin with: header, count and all that it counts, whatever the checksum. None if it is none,
    /// or not all of it.
    pub(crate) fn framed(bytes: &[u8]) -> Option<&[u8]> {
        let count = usize::from(*bytes.strip_prefix(&HEADER)?.first()?);
        if count < COUNT_MIN { None } else { bytes.get(..3 + count) }
    }

    /// What was framed, and whether its checksum is right. That of zeros is zero, which proves nothing: packets are full of
    /// zeros, and the one packet that is nothing else is [`crate::Command::sync`] of 0, without arguments.
    pub(crate) fn checked(framed: &[u8]) -> (Self, bool) {
        let is_right = match framed.get(3..).and_then(<[u8]>::split_last_chunk::<2>) {
            Some((covered, _)) if covered.len() > 1 && covered.iter().all(|byte| *byte == 0) => false,
            Some((covered, sum)) => checksum(covered) == u16::from_be_bytes(*sum),
            None => false,
        };
        (Self { bytes: framed.to_vec() }, is_right)
    }

    /// The id, which tells what the packet is.
    #[must_use]
    pub fn id(&self) -> u8 {
        self.bytes.get(3).copied().unwrap_or_default()
    }

    /// What follows the id, without the checksum.
    #[must_use]
    pub fn arguments(&self) -> &[u8] {
        self.bytes.get(4..self.bytes.len().saturating_sub(2)).unwrap_or_default()
    }

    /// The packet as it goes over the line.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl fmt::Debug for Packet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Packet({:02x?})", self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_added_and_the_rest_is_mixed_in() {
        assert_eq!(checksum(&[]), 0);
        assert_eq!(checksum(&[1]), 1);
        assert_eq!(checksum(&[0x1C, 0x3B, 0x01, 0x00]), 0x1D3B);
        assert_eq!(checksum(&[0xFF, 0xFF, 0x00, 0x02, 0x03]), 0x0001 ^ 3);
    }

    #[test]
    fn what_is_too_long_makes_no_packet() {
        assert_eq!(Packet::new(1, &[0; 252]).unwrap().bytes().len(), PACKET_MAX);
        assert_eq!(Packet::new(1, &[0; 253]), None);
    }
}
