//! Packets found in a stream of bytes, some of which are not what was sent.

use crate::packet::{COUNT_MIN, PACKET_MAX};
use crate::{Configuration, HEADER, Packet};

/// A packet, and where it was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// The packet that was found.
    pub packet: Packet,
    /// The place of its first byte in the stream, from 0: whoever knows when that byte came knows when the packet did.
    pub at: u64,
}

/// Finds packets in a stream of bytes.
///
/// Every packet that is in the stream whole is found, whatever is before, between and after: where a header leads to no packet
/// with the right checksum, the search goes on with the byte after it. What was damaged is never given out.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    /// Of the buffer so many bytes are done with.
    done: usize,
    /// The place of the buffer's first byte in the stream.
    at: u64,
    /// Bytes that were part of no packet.
    skipped: u64,
    unchecked: Option<Packet>,
}

impl Decoder {
    /// Takes in what the line gave.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.done > PACKET_MAX {
            self.buffer.drain(..self.done);
            self.at += self.done as u64;
            self.done = 0;
        }
        self.buffer.extend(bytes);
    }

    /// The next packet; none until there are more bytes.
    pub fn next_packet(&mut self) -> Option<Found> {
        self.search(false)
    }

    /// The next packet of a stream that has ended: a header that wants more bytes than there are is none.
    pub fn last_packet(&mut self) -> Option<Found> {
        self.search(true)
    }

    /// Bytes so far that were part of no packet.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Forgets what it holds of an unfinished packet: the line was cut, or changed its speed.
    pub fn clear(&mut self) {
        self.skipped += (self.buffer.len() - self.done) as u64;
        self.done = self.buffer.len();
        self.unchecked = None;
    }

    /// The latest packet of a [`Configuration`] whose checksum is wrong, once: some robots send it so. Whether what it says can
    /// be believed is for its reader to tell; two that are the same are hardly damaged.
    pub fn take_unchecked_configuration(&mut self) -> Option<Packet> {
        self.unchecked.take()
    }

    fn search(&mut self, is_over: bool) -> Option<Found> {
        loop {
            let rest = &self.buffer[self.done..];
            let Some(begin) = rest.iter().position(|byte| *byte == HEADER[0]) else {
                self.skip(rest.len());
                return None;
            };
            self.skip(begin);
            let rest = &self.buffer[self.done..];
            let is_header = match rest {
                [_, second, count, ..] => *second == HEADER[1] && usize::from(*count) >= COUNT_MIN,
                [_, second] => *second == HEADER[1] && !is_over,
                _ => !is_over,
            };
            let framed = Packet::framed(rest);
            match framed {
                None if is_header && !is_over => return None,
                None => self.skip(1),
                Some(framed) => {
                    let (packet, is_right) = Packet::checked(framed);
                    if is_right {
                        let at = self.at + self.done as u64;
                        self.done += packet.bytes().len();
                        return Some(Found { packet, at });
                    }
                    if packet.id() == Configuration::ID && Configuration::read(&packet).is_ok() {
                        self.unchecked = Some(packet);
                    }
                    self.skip(1);
                }
            }
        }
    }

    fn skip(&mut self, bytes: usize) {
        self.done += bytes;
        self.skipped += bytes as u64;
    }
}
