//! What recordings of all kinds have in common: streams of messages, each with a topic and a type.

use std::io::{self, Read};

use crate::log::fault::{FaultKind, Refusal};
use crate::log::source::{Source, Stamp, is_damage};

/// Longest record, packed or unpacked, bytes.
pub(crate) const RECORD_BYTES_MAX: u64 = 256 << 20;
/// Streams that are told apart.
const CHANNELS_MAX: usize = 1 << 16;

/// How the fields of a message stand in its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Encoding {
    /// ROS 1: one after the other.
    Ros1,
    /// ROS 2: CDR, aligned.
    Cdr,
    /// Any other.
    Other,
}

/// A stream of messages of one type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    /// As `sensor_msgs/LaserScan`, of ROS 1 and 2 alike.
    pub(crate) datatype: String,
    pub(crate) encoding: Encoding,
}

impl Channel {
    pub(crate) fn new(topic: &str, datatype: &str, encoding: Encoding) -> Self {
        Self { topic: topic.to_owned(), datatype: datatype.replacen("/msg/", "/", 1), encoding }
    }
}

/// What a recording holds, in its order.
pub(crate) enum Entry<'a> {
    /// A message, and when it was recorded.
    Message { channel: &'a Channel, log_ns: u64, data: &'a [u8] },
    /// What is lost here.
    Damage(Refusal),
}

/// Takes what a recording holds.
pub(crate) type Take<'a> = dyn FnMut(Entry<'_>) + 'a;

/// A recording that is read once, from its beginning.
pub(crate) trait Container: Send {
    /// Reads on, a record or a chunk; false at the end.
    fn advance(&mut self, take: &mut Take<'_>) -> io::Result<bool>;

    /// Hash and number of all stored bytes.
    fn finish(self: Box<Self>) -> io::Result<Stamp>;
}

/// The streams of a recording, by the numbers that it gives them.
#[derive(Debug, Default)]
pub(crate) struct Channels(std::collections::BTreeMap<u32, Channel>);

impl Channels {
    pub(crate) fn add(&mut self, id: u32, channel: Channel) {
        if self.0.len() < CHANNELS_MAX || self.0.contains_key(&id) {
            self.0.insert(id, channel);
        }
    }

    pub(crate) fn get(&self, id: u32) -> Option<&Channel> {
        self.0.get(&id)
    }
}

/// Bytes of a recording, and where in it they are.
pub(crate) struct Stored<R: Read> {
    source: Source<R>,
    /// Of what is unpacked.
    pub(crate) at: u64,
    /// What is wrong with the stream that packed it.
    pub(crate) broken: Option<String>,
}

impl<R: Read> Stored<R> {
    pub(crate) fn new(stored: R) -> io::Result<Self> {
        Ok(Self { source: Source::new(stored)?, at: 0, broken: None })
    }

    /// The next `wanted` bytes into `buffer`, or as many as there are.
    pub(crate) fn read(&mut self, wanted: u64, buffer: &mut Vec<u8>) -> io::Result<bool> {
        buffer.clear();
        self.pass(wanted, buffer)
    }

    /// Passes over bytes.
    pub(crate) fn skip(&mut self, wanted: u64) -> io::Result<bool> {
        self.pass(wanted, &mut io::sink())
    }

    fn pass(&mut self, wanted: u64, to: &mut dyn io::Write) -> io::Result<bool> {
        if self.broken.is_some() {
            return Ok(wanted == 0);
        }
        let mut counted = Counted { to, bytes: 0 };
        let outcome = io::copy(&mut (&mut self.source).take(wanted), &mut counted);
        let passed = counted.bytes;
        self.at += passed;
        match outcome {
            Ok(_) => {}
            Err(error) if self.source.is_compressed() && is_damage(&error) => self.broken = Some(error.to_string()),
            Err(error) => return Err(error),
        }
        Ok(passed == wanted)
    }

    /// What is missing from here on, in words.
    pub(crate) fn cut(&self, what: &str) -> Refusal {
        match &self.broken {
            Some(why) => Refusal::new(FaultKind::GzipDamaged, why),
            None => Refusal::new(FaultKind::RecordingCut, format!("{what}, at byte {}", self.at)),
        }
    }

    pub(crate) fn finish(self) -> io::Result<Stamp> {
        self.source.finish()
    }
}

/// Counts what passes.
struct Counted<'a> {
    to: &'a mut dyn io::Write,
    bytes: u64,
}

impl io::Write for Counted<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let length = self.to.write(bytes)?;
        self.bytes += length as u64;
        Ok(length)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// How a chunk is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    None,
    Bzip2,
    Lz4,
    Zstandard,
}

impl Packing {
    pub(crate) fn of(name: &[u8]) -> Option<Self> {
        match name {
            b"" | b"none" => Some(Self::None),
            b"bz2" => Some(Self::Bzip2),
            b"lz4" => Some(Self::Lz4),
            b"zstd" => Some(Self::Zstandard),
            _ => None,
        }
    }

    /// Unpacks a chunk of that size as far as it goes; what is wrong with the rest, if anything is.
    pub(crate) fn unpack(self, packed: &[u8], size: u64, into: &mut Vec<u8>) -> Result<(), String> {
        into.clear();
        // One more than there should be, so that a stream which holds more is noticed.
        let limit = size.min(RECORD_BYTES_MAX).saturating_add(1);
        let outcome = match self {
            Self::None => {
                into.extend_from_slice(packed);
                return Ok(());
            }
            Self::Bzip2 => bzip2::read::BzDecoder::new(packed).take(limit).read_to_end(into),
            Self::Lz4 => lz4_flex::frame::FrameDecoder::new(packed).take(limit).read_to_end(into),
            Self::Zstandard => crate::log::zstandard::Zstandard::new(packed).take(limit).read_to_end(into),
        };
        match outcome {
            Ok(_) if into.len() as u64 == size => Ok(()),
            Ok(_) => Err(format!("{} bytes in place of {size}", into.len())),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// Little-endian values one after the other; none where they end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bytes<'a>(pub(crate) &'a [u8]);

impl<'a> Bytes<'a> {
    pub(crate) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.take(1).and_then(|bytes| bytes.first().copied())
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take(2)?.try_into().ok()?))
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    /// Bytes behind their number.
    pub(crate) fn counted(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()?;
        self.take(usize::try_from(count).ok()?)
    }

    /// A text behind its number of bytes.
    pub(crate) fn text(&mut self) -> Option<String> {
        Some(String::from_utf8_lossy(self.counted()?).into_owned())
    }
}
