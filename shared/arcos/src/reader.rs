//! Little-endian fields, one after the other.

use crate::{Malformed, Packet};

/// Reads the arguments of a packet.
pub(crate) struct Reader<'a> {
    id: u8,
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(packet: &'a Packet) -> Self {
        Self { id: packet.id(), rest: packet.arguments() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    fn take<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], Malformed> {
        let (head, rest) = self.rest.split_first_chunk().ok_or(Malformed { id: self.id, field })?;
        self.rest = rest;
        Ok(*head)
    }

    pub(crate) fn u8(&mut self, field: &'static str) -> Result<u8, Malformed> {
        self.take(field).map(u8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self, field: &'static str) -> Result<u16, Malformed> {
        self.take(field).map(u16::from_le_bytes)
    }

    pub(crate) fn i16(&mut self, field: &'static str) -> Result<i16, Malformed> {
        self.take(field).map(i16::from_le_bytes)
    }

    /// A field that older firmware does not send.
    pub(crate) fn later<T>(
        &mut self,
        field: &'static str,
        read: impl FnOnce(&mut Self, &'static str) -> Result<T, Malformed>,
    ) -> Result<Option<T>, Malformed> {
        if self.is_empty() { Ok(None) } else { read(self, field).map(Some) }
    }

    /// Text up to a zero byte, or to the end; bytes that are not UTF-8 are replaced.
    pub(crate) fn text(&mut self, field: &'static str) -> Result<String, Malformed> {
        if self.is_empty() {
            return Err(Malformed { id: self.id, field });
        }
        let end = self.rest.iter().position(|byte| *byte == 0);
        let text = String::from_utf8_lossy(&self.rest[..end.unwrap_or(self.rest.len())]).into_owned();
        self.rest = end.map_or(&[], |end| &self.rest[end + 1..]);
        Ok(text)
    }
}
