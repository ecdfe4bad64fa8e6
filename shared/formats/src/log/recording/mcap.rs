//! MCAP files, as ROS 2 and others write them: chunks of messages, in the order in which they were recorded.
//!
//! Source: <https://mcap.dev/spec>. The summary at the end is not needed: a file that was never closed, or is cut, is read as far as it
//! goes, and what is missing is told. (The `mcap` crate unpacks Zstandard by a C library only.)

use std::collections::BTreeMap;
use std::io::{self, Read};

use super::container::{Bytes, Channel, Channels, Container, Encoding, Entry, Packing, RECORD_BYTES_MAX, Stored, Take};
use crate::log::fault::{FaultKind, Refusal};
use crate::log::source::Stamp;

/// How such files begin, and end.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The kinds of records.
pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 1;
    pub(in super::super) const FOOTER: u8 = 2;
    pub(in super::super) const SCHEMA: u8 = 3;
    pub(in super::super) const CHANNEL: u8 = 4;
    pub(in super::super) const MESSAGE: u8 = 5;
    pub(in super::super) const CHUNK: u8 = 6;
    pub(in super::super) const MESSAGE_INDEX: u8 = 7;
    pub(in super::super) const CHUNK_INDEX: u8 = 8;
    pub(in super::super) const STATISTICS: u8 = 11;
    pub(in super::super) const METADATA: u8 = 12;
    pub(in super::super) const METADATA_INDEX: u8 = 13;
    pub(in super::super) const DATA_END: u8 = 15;
}

/// Reads an MCAP file.
pub(crate) struct Mcap<R: Read> {
    stored: Stored<R>,
    streams: Streams,
    has_begun: bool,
    has_ended: bool,
    data: Vec<u8>,
    unpacked: Vec<u8>,
}

/// What has been said of types and streams.
#[derive(Default)]
struct Streams {
    schemas: BTreeMap<u16, String>,
    channels: Channels,
}

impl<R: Read> Mcap<R> {
    pub(crate) fn new(stored: R) -> io::Result<Self> {
        Ok(Self {
            stored: Stored::new(stored)?,
            streams: Streams::default(),
            has_begun: false,
            has_ended: false,
            data: Vec::new(),
            unpacked: Vec::new(),
        })
    }

    fn end(&mut self, what: Option<Refusal>, take: &mut Take<'_>) -> bool {
        self.has_ended = true;
        what.into_iter().for_each(|what| take(Entry::Damage(what)));
        false
    }

    /// The records of the chunk that has been read, as far as they go.
    fn chunk(&mut self, whole: bool, take: &mut Take<'_>) {
        let mut damage = |what: &str| take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, what)));
        let mut fields = Bytes(&self.data);
        let head = (|| {
            let (_first_ns, _last_ns) = (fields.u64()?, fields.u64()?);
            let (size, crc) = (fields.u64()?, fields.u32()?);
            let packing = fields.counted()?;
            Some((size, crc, packing, fields.u64()?))
        })();
        let Some((size, crc, packing, length)) = head else {
            if whole {
                damage("it ends within its header");
            }
            return;
        };
        let Some(packing) = Packing::of(packing) else {
            return damage(&format!("packed by \"{}\"; expected lz4 or zstd", String::from_utf8_lossy(packing)));
        };
        if size > RECORD_BYTES_MAX {
            return damage(&format!("{size} bytes unpacked; expected at most {RECORD_BYTES_MAX}"));
        }
        let packed = fields.0.get(..usize::try_from(length).unwrap_or(usize::MAX)).unwrap_or(fields.0);
        let outcome = packing.unpack(packed, size, &mut self.unpacked);
        if whole {
            if let Err(why) = &outcome {
                damage(why);
            } else if crc != 0 && crc32fast::hash(&self.unpacked) != crc {
                return damage("its bytes do not go with its checksum, and are not used");
            }
        }
        let mut records = Bytes(&self.unpacked);
        while !records.0.is_empty() {
            let record = (|| {
                let (kind, length) = (records.u8()?, records.u64()?);
                Some((kind, records.take(usize::try_from(length).ok()?)?))
            })();
            let Some((kind, content)) = record else {
                if whole && outcome.is_ok() {
                    take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, "it ends within a record")));
                }
                return;
            };
            self.streams.record(kind, content, take);
        }
    }
}

impl<R: Read + Send> Container for Mcap<R> {
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
        if !self.stored.read(9, &mut self.data)? {
            let what = match (self.data.is_empty(), &self.stored.broken) {
                (true, None) => {
                    Refusal::new(FaultKind::RecordingUnclosed, format!("it ends at byte {}", self.stored.at))
                }
                _ => self.stored.cut("within the length of a record"),
            };
            return Ok(self.end(Some(what), take));
        }
        let mut fields = Bytes(&self.data);
        let (kind, length) = (fields.u8().unwrap_or(0), fields.u64().unwrap_or(0));
        let whole = match kind {
            op::FOOTER => {
                let whole = self.stored.skip(length)? && self.stored.read(MAGIC.len() as u64, &mut self.data)?;
                let mut what = (!whole || self.data != MAGIC).then(|| self.stored.cut("within its last bytes"));
                let end = self.stored.at;
                if what.is_none() && self.stored.read(1, &mut self.data)? {
                    let more = format!("bytes follow its end, at byte {end}: several recordings in one file?");
                    what = Some(Refusal::new(FaultKind::RecordingDamaged, more));
                }
                return Ok(self.end(what, take));
            }
            op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE if length <= RECORD_BYTES_MAX => {
                let whole = self.stored.read(length, &mut self.data)?;
                if kind == op::CHUNK {
                    self.chunk(whole, take);
                } else if whole {
                    self.streams.record(kind, &self.data, take);
                }
                whole
            }
            op::CHUNK | op::MESSAGE => {
                let what = format!("a record of {length} bytes; expected at most {RECORD_BYTES_MAX}");
                take(Entry::Damage(Refusal::new(FaultKind::ChunkDamaged, what)));
                self.stored.skip(length)?
            }
            _ => self.stored.skip(length)?,
        };
        Ok(whole || self.end(Some(self.stored.cut("within a record")), take))
    }

    fn finish(self: Box<Self>) -> io::Result<Stamp> {
        self.stored.finish()
    }
}

impl Streams {
    fn record(&mut self, kind: u8, content: &[u8], take: &mut Take<'_>) {
        let mut fields = Bytes(content);
        let understood = match kind {
            op::SCHEMA => (|| {
                let (id, name) = (fields.u16()?, fields.text()?);
                self.schemas.insert(id, name);
                Some(())
            })(),
            op::CHANNEL => (|| {
                let (id, schema) = (fields.u16()?, fields.u16()?);
                let (topic, encoding) = (fields.text()?, fields.text()?);
                let encoding = match encoding.as_str() {
                    "ros1" => Encoding::Ros1,
                    "cdr" => Encoding::Cdr,
                    _ => Encoding::Other,
                };
                let datatype = self.schemas.get(&schema).map_or("(no type)", String::as_str);
                self.channels.add(id.into(), Channel::new(&topic, datatype, encoding));
                Some(())
            })(),
            op::MESSAGE => (|| {
                let id = fields.u16()?;
                let (_sequence, log_ns, _published_ns) = (fields.u32()?, fields.u64()?, fields.u64()?);
                let channel = self.channels.get(id.into())?;
                take(Entry::Message { channel, log_ns, data: fields.0 });
                Some(())
            })(),
            _ => Some(()),
        };
        if understood.is_none() {
            let what =
                format!("a record of kind {kind} and {} bytes, or a message of an unknown stream", content.len());
            take(Entry::Damage(Refusal::new(FaultKind::MessageDamaged, what)));
        }
    }
}
