//! ROS 1 bags, version 2.0: chunks of messages, in the order in which they were recorded.
//!
//! Source: <http://wiki.ros.org/Bags/Format/2.0>. The index at the end is not needed: a bag that was never closed, or is cut, is read
//! as far as it goes, and what is missing is told.

use std::io::{self, Read};

use super::container::{Bytes, Channel, Channels, Container, Encoding, Entry, Packing, RECORD_BYTES_MAX, Stored, Take};
use crate::log::fault::{FaultKind, Refusal};
use crate::log::source::Stamp;

/// How bags begin.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Longest header of a record, bytes: it names a topic, a type, numbers.
const HEADER_BYTES_MAX: u32 = 1 << 20;

/// The kinds of records that are read.
mod op {
    pub(super) const MESSAGE: u8 = 2;
    pub(super) const BAG: u8 = 3;
    pub(super) const CHUNK: u8 = 5;
    pub(super) const CHUNK_INFO: u8 = 6;
    pub(super) const CONNECTION: u8 = 7;
}

/// Reads a bag.
pub(crate) struct Bag<R: Read> {
    stored: Stored<R>,
    channels: Channels,
    /// Where the index begins, and of how many chunks it tells; none: the bag has no header.
    index: Option<(u64, u32)>,
    chunk_infos: u32,
    has_begun: bool,
    has_ended: bool,
    header: Vec<u8>,
    data: Vec<u8>,
    unpacked: Vec<u8>,
}

impl<R: Read> Bag<R> {
    pub(crate) fn new(stored: R) -> io::Result<Self> {
        Ok(Self {
            stored: Stored::new(stored)?,
            channels: Channels::default(),
            index: None,
            chunk_infos: 0,
            has_begun: false,
            has_ended: false,
            header: Vec::new(),
            data: Vec::new(),
            unpacked: Vec::new(),
        })
    }

    fn end(&mut self, what: Option<Refusal>, take: &mut Take<'_>) -> bool {
        self.has_ended = true;
        what.into_iter().for_each(|what| take(Entry::Damage(what)));
        false
    }

    /// What the index says is missing at the end of the file.
    fn missing(&self) -> Option<Refusal> {
        let at = self.stored.at;
        match self.index {
            _ if self.stored.broken.is_some() => Some(self.stored.cut("")),
            None => Some(self.stored.cut("before its header")),
            Some((0, _)) => Some(Refusal::new(FaultKind::RecordingUnclosed, format!("it ends at byte {at}"))),
            Some((begins, _)) if at < begins => Some(self.stored.cut(&format!("before its index at byte {begins}"))),
            Some((_, chunks)) if self.chunk_infos < chunks => {
                Some(self.stored.cut(&format!("within its index: {} chunks of {chunks}", self.chunk_infos)))
            }
            Some(_) => None,
        }
    }

    /// One record, of which the header has been read.
    fn record(&mut self, length: u32, take: &mut Take<'_>) -> io::Result<bool> {
        let header = Header::of(&self.header);
        let whole = match header.op {
            Some(op::CHUNK) if u64::from(length) <= RECORD_BYTES_MAX => {
                let packing = header.field(b"compression").and_then(Packing::of);
                let size = header.u32(b"size").unwrap_or(length);
                let whole = self.stored.read(length.into(), &mut self.data)?;
                self.chunk(packing, size, whole, take);
                whole
            }
            Some(op::CHUNK) => {
                let what = format!("a chunk of {length} bytes; expected at most {RECORD_BYTES_MAX}");
                take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, what)));
                self.stored.skip(length.into())?
            }
            Some(op::BAG) => {
                let position = header.field(b"index_pos").and_then(|bytes| Bytes(bytes).u64());
                self.index = Some((position.unwrap_or(0), header.u32(b"chunk_count").unwrap_or(0)));
                self.stored.skip(length.into())?
            }
            Some(op::CONNECTION | op::MESSAGE) if u64::from(length) <= RECORD_BYTES_MAX => {
                let whole = self.stored.read(length.into(), &mut self.data)?;
                if whole {
                    inner(&header, &self.data, &mut self.channels, take);
                }
                whole
            }
            kind => {
                let whole = self.stored.skip(length.into())?;
                self.chunk_infos += u32::from(kind == Some(op::CHUNK_INFO) && whole);
                whole
            }
        };
        Ok(whole || self.end(Some(self.stored.cut("within a record")), take))
    }

    /// The records of the chunk that has been read, as far as they go.
    fn chunk(&mut self, packing: Option<Packing>, size: u32, whole: bool, take: &mut Take<'_>) {
        let mut damage = |what: String| take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, what)));
        let Some(packing) = packing else { return damage("packed in a way that bags do not know".to_owned()) };
        let mut is_told = !whole;
        if let Err(why) = packing.unpack(&self.data, size.into(), &mut self.unpacked)
            && !is_told
        {
            damage(why);
            is_told = true;
        }
        let mut records = Bytes(&self.unpacked);
        while !records.0.is_empty() {
            let record = records.counted().and_then(|header| Some((header, records.counted()?)));
            let Some((header, data)) = record else {
                if !is_told {
                    take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, "it ends within a record")));
                }
                return;
            };
            inner(&Header::of(header), data, &mut self.channels, take);
        }
    }
}

impl<R: Read + Send> Container for Bag<R> {
    fn advance(&mut self, take: &mut Take<'_>) -> io::Result<bool> {
        if self.has_ended {
            return Ok(false);
        }
        if !self.has_begun {
            self.has_begun = true;
            if !self.stored.read(MAGIC.len() as u64, &mut self.data)? {
                return Ok(self.end(Some(self.stored.cut("within its first line")), take));
            }
        }
        if !self.stored.read(4, &mut self.data)? {
            let missing = self.missing();
            let cut = (!self.data.is_empty()).then(|| self.stored.cut("within the length of a record"));
            return Ok(self.end(missing.or(cut), take));
        }
        let at = self.stored.at;
        let length = Bytes(&self.data).u32().unwrap_or(0);
        if length > HEADER_BYTES_MAX {
            let what = format!("at byte {at}: the header of a record is said to be {length} bytes long");
            return Ok(self.end(Some(Refusal::new(FaultKind::RecordingDamaged, what)), take));
        }
        let has_header = self.stored.read(length.into(), &mut self.header)?;
        if !has_header || !self.stored.read(4, &mut self.data)? {
            return Ok(self.end(Some(self.stored.cut("within a record")), take));
        }
        let length = Bytes(&self.data).u32().unwrap_or(0);
        self.record(length, take)
    }

    fn finish(self: Box<Self>) -> io::Result<Stamp> {
        self.stored.finish()
    }
}

/// A connection or a message.
fn inner(header: &Header<'_>, data: &[u8], channels: &mut Channels, take: &mut Take<'_>) {
    let Some(id) = header.u32(b"conn") else { return };
    match header.op {
        Some(op::CONNECTION) => {
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            let connection = Header::of(data);
            let topic = header.field(b"topic").or(connection.field(b"topic")).map(text).unwrap_or_default();
            let datatype = connection.field(b"type").map(text).unwrap_or_default();
            channels.add(id, Channel::new(&topic, &datatype, Encoding::Ros1));
        }
        Some(op::MESSAGE) => {
            let time = header.field(b"time").and_then(|bytes| {
                let mut bytes = Bytes(bytes);
                Some(u64::from(bytes.u32()?) * 1_000_000_000 + u64::from(bytes.u32()?))
            });
            match (channels.get(id), time) {
                (Some(channel), Some(log_ns)) => take(Entry::Message { channel, log_ns, data }),
                _ => {
                    let what = format!("a message of connection {id}, of which nothing is said, or without a time");
                    take(Entry::Damage(Refusal::new(FaultKind::MessageDamaged, what)));
                }
            }
        }
        _ => {}
    }
}

/// The fields of a record's header, `name=value` each behind its length.
struct Header<'a> {
    bytes: &'a [u8],
    op: Option<u8>,
}

impl<'a> Header<'a> {
    fn of(bytes: &'a [u8]) -> Self {
        let mut header = Self { bytes, op: None };
        header.op = header.field(b"op").and_then(|value| value.first().copied());
        header
    }

    fn field(&self, name: &[u8]) -> Option<&'a [u8]> {
        let mut rest = Bytes(self.bytes);
        while let Some(field) = rest.counted() {
            if let Some(value) = field.strip_prefix(name).and_then(|rest| rest.strip_prefix(b"=")) {
                return Some(value);
            }
        }
        None
    }

    fn u32(&self, name: &[u8]) -> Option<u32> {
        Bytes(self.field(name)?).u32()
    }
}
