//! Writes MCAP files, in chunks, so that whoever reads one that ends anywhere has every chunk before.
//!
//! Source: <https://mcap.dev/spec>. Types and streams are written where they are first told of, outside the chunks; a chunk and its
//! index go to the file in one piece. A file that was never finished can be gone on with ([`McapWriter::resume`]).

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::container::Bytes;
use super::mcap::{MAGIC, op};
use super::run::{RUN, RunWords};

/// A chunk is written when it holds so much, bytes before packing.
const CHUNK_BYTES: usize = 1 << 20;
/// Before every record: its kind, and how long it is.
const HEAD_BYTES: u64 = 9;

/// A stream of messages that is recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct McapChannel {
    /// The topic of the stream.
    pub topic: String,
    /// How its messages are encoded, as `protobuf`, `json`.
    pub encoding: String,
    /// The name of their type.
    pub schema_name: String,
    /// How the type is described, as `protobuf`, `jsonschema`.
    pub schema_encoding: String,
    /// What describes it.
    pub schema: Vec<u8>,
}

/// Where a chunk is, and what is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Chunk {
    first_ns: u64,
    last_ns: u64,
    at: u64,
    bytes: u64,
    packing: &'static str,
    packed: u64,
    unpacked: u64,
    /// Where the index of each stream is.
    indexes: BTreeMap<u16, u64>,
    index_bytes: u64,
}

/// Times and places of the messages of a stream in the open chunk.
type Index = Vec<(u64, u64)>;

/// Writes an MCAP file.
#[derive(Debug)]
pub struct McapWriter {
    file: File,
    /// Bytes of the file.
    length: u64,
    /// Records of types and streams, which the end repeats.
    told: Vec<u8>,
    channels: Vec<String>,
    /// Messages by stream.
    counts: BTreeMap<u16, u64>,
    chunks: Vec<Chunk>,
    /// Records of the open chunk.
    open: Vec<u8>,
    index: BTreeMap<u16, Index>,
    metadata: Vec<Metadata>,
}

/// Where words about the file are.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Metadata {
    name: String,
    at: u64,
    bytes: u64,
}

impl McapWriter {
    /// Begins a file that is empty, with what it says of its run.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn new(mut file: File, library: &str, run: &RunWords) -> io::Result<Self> {
        let mut head = MAGIC.to_vec();
        record(&mut head, op::HEADER, |content| {
            text(content, "");
            text(content, library);
        });
        let at = head.len() as u64;
        words(&mut head, RUN, run);
        // At once: whoever is killed here leaves all of it, or nothing.
        file.write_all(&head)?;
        let mut writer = Self::at(file, head.len() as u64);
        writer.metadata.push(Metadata { name: RUN.to_owned(), at, bytes: head.len() as u64 - at });
        Ok(writer)
    }

    /// Whether the file of this path was ended by [`McapWriter::finish`].
    ///
    /// # Errors
    /// The file can't be read.
    pub fn is_finished(path: &Path) -> io::Result<bool> {
        let mut file = File::open(path)?;
        let magic_bytes = MAGIC.len() as u64;
        if file.metadata()?.len() < 2 * magic_bytes {
            return Ok(false);
        }
        let mut end = [0; MAGIC.len()];
        file.seek(SeekFrom::End(-magic_bytes.cast_signed()))?;
        file.read_exact(&mut end)?;
        Ok(end == MAGIC)
    }

    fn at(file: File, length: u64) -> Self {
        Self {
            file,
            length,
            told: Vec::new(),
            channels: Vec::new(),
            counts: BTreeMap::new(),
            chunks: Vec::new(),
            open: Vec::new(),
            index: BTreeMap::new(),
            metadata: Vec::new(),
        }
    }

    /// Goes on with a file of which at most the first `length` bytes count: behind the last whole record among them. The rest is
    /// cut off.
    ///
    /// # Errors
    /// The file can't be read or written, or is none that this has begun.
    pub fn resume(file: File, length: u64) -> io::Result<Self> {
        let not_ours = |what: String| io::Error::new(io::ErrorKind::InvalidData, what);
        let mut source = BufReader::new(&file);
        let length = length.min(source.get_ref().metadata()?.len());
        let mut magic = [0; MAGIC.len()];
        source.seek(SeekFrom::Start(0))?;
        source.read_exact(&mut magic).map_err(|_| not_ours(format!("{length} bytes, too few to go on with")))?;
        if magic != MAGIC {
            return Err(not_ours("no MCAP file, which was to be gone on with".to_owned()));
        }
        let mut scan = Scan::default();
        let mut at = MAGIC.len() as u64;
        while let Some(bytes) = scan.record(&mut source, at, length)? {
            at += bytes;
        }
        drop(source);
        file.set_len(at)?;
        let mut writer = Self::at(file, at);
        writer.file.seek(SeekFrom::Start(at))?;
        let Scan { told, channels, counts, chunks, metadata } = scan;
        (writer.told, writer.channels, writer.counts, writer.chunks) = (told, channels, counts, chunks);
        writer.metadata = metadata;
        Ok(writer)
    }

    /// The number of a stream, which is told of in the file when it is new.
    ///
    /// # Errors
    /// The file can't be written, or there are more streams than can be numbered.
    pub fn channel(&mut self, channel: &McapChannel) -> io::Result<u16> {
        let place = self.channels.iter().position(|topic| *topic == channel.topic);
        // Type and stream go in pairs, so that they have one number; 0 stands for no type.
        let id = u16::try_from(place.unwrap_or(self.channels.len()) + 1)
            .map_err(|_| io::Error::other("more than 65535 streams"))?;
        if place.is_some() {
            return Ok(id);
        }
        let mut records = Vec::new();
        record(&mut records, op::SCHEMA, |content| {
            content.extend(id.to_le_bytes());
            text(content, &channel.schema_name);
            text(content, &channel.schema_encoding);
            counted(content, &channel.schema);
        });
        record(&mut records, op::CHANNEL, |content| {
            content.extend([id.to_le_bytes(), id.to_le_bytes()].concat());
            text(content, &channel.topic);
            text(content, &channel.encoding);
            counted(content, &[]);
        });
        self.put(&records)?;
        self.told.extend(records);
        self.channels.push(channel.topic.clone());
        Ok(id)
    }

    /// Adds a message to the open chunk; one that is full goes to the file.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn message(&mut self, channel: u16, sequence: u64, stamp_ns: u64, data: &[u8]) -> io::Result<()> {
        self.index.entry(channel).or_default().push((stamp_ns, self.open.len() as u64));
        record(&mut self.open, op::MESSAGE, |content| {
            content.extend(channel.to_le_bytes());
            content.extend((sequence as u32).to_le_bytes());
            content.extend(stamp_ns.to_le_bytes());
            content.extend(stamp_ns.to_le_bytes());
            content.extend(data);
        });
        *self.counts.entry(channel).or_insert(0) += 1;
        if self.open.len() >= CHUNK_BYTES { self.flush().map(drop) } else { Ok(()) }
    }

    /// Writes the open chunk to the file, if there is anything in it; how long the file is then, bytes.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn flush(&mut self) -> io::Result<u64> {
        if self.open.is_empty() {
            return Ok(self.length);
        }
        let packed = pack(&self.open)?;
        let packing = if packed.len() < self.open.len() { "lz4" } else { "" };
        let stored = if packing.is_empty() { &self.open } else { &packed };
        let stamps = || self.index.values().flatten().map(|(stamp_ns, _)| *stamp_ns);
        let (first_ns, last_ns) = (stamps().min().unwrap_or(0), stamps().max().unwrap_or(0));
        let mut records = Vec::with_capacity(stored.len() + 1024);
        record(&mut records, op::CHUNK, |content| {
            content.extend([first_ns, last_ns, self.open.len() as u64].map(u64::to_le_bytes).concat());
            content.extend(crc32fast::hash(&self.open).to_le_bytes());
            text(content, packing);
            content.extend((stored.len() as u64).to_le_bytes());
            content.extend(stored);
        });
        let bytes = records.len() as u64;
        let mut indexes = BTreeMap::new();
        for (channel, index) in &self.index {
            indexes.insert(*channel, self.length + records.len() as u64);
            record(&mut records, op::MESSAGE_INDEX, |content| {
                content.extend(channel.to_le_bytes());
                let entries = index.iter().flat_map(|(stamp_ns, at)| [stamp_ns.to_le_bytes(), at.to_le_bytes()]);
                counted(content, &entries.flatten().collect::<Vec<u8>>());
            });
        }
        self.chunks.push(Chunk {
            first_ns,
            last_ns,
            at: self.length,
            bytes,
            packing,
            packed: stored.len() as u64,
            unpacked: self.open.len() as u64,
            indexes,
            index_bytes: records.len() as u64 - bytes,
        });
        self.put(&records)?;
        self.open.clear();
        self.index.clear();
        Ok(self.length)
    }

    /// What was written survives a power cut.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// Ends the file, with what readers find their way in it by, and a few words about it.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn finish(mut self, name: &str, about: &BTreeMap<String, String>) -> io::Result<()> {
        self.flush()?;
        let mut records = Vec::new();
        words(&mut records, name, about);
        self.metadata.push(Metadata { name: name.to_owned(), at: self.length, bytes: records.len() as u64 });
        record(&mut records, op::DATA_END, |content| content.extend(0_u32.to_le_bytes()));
        self.put(&records)?;
        let summary = self.summary();
        let mut records = summary.clone();
        record(&mut records, op::FOOTER, |content| {
            content.extend(self.length.to_le_bytes());
            content.extend(0_u64.to_le_bytes());
            // No checksum.
            content.extend(0_u32.to_le_bytes());
        });
        records.extend(MAGIC);
        self.put(&records)?;
        self.file.sync_all()
    }

    fn summary(&self) -> Vec<u8> {
        let mut records = self.told.clone();
        for chunk in &self.chunks {
            record(&mut records, op::CHUNK_INDEX, |content| {
                content.extend([chunk.first_ns, chunk.last_ns, chunk.at, chunk.bytes].map(u64::to_le_bytes).concat());
                map(content, chunk.indexes.iter(), |content, (channel, at)| {
                    content.extend(channel.to_le_bytes());
                    content.extend(at.to_le_bytes());
                });
                content.extend(chunk.index_bytes.to_le_bytes());
                text(content, chunk.packing);
                content.extend([chunk.packed, chunk.unpacked].map(u64::to_le_bytes).concat());
            });
        }
        for Metadata { name, at, bytes } in &self.metadata {
            record(&mut records, op::METADATA_INDEX, |content| {
                content.extend([*at, *bytes].map(u64::to_le_bytes).concat());
                text(content, name);
            });
        }
        let streams = self.channels.len();
        record(&mut records, op::STATISTICS, |content| {
            content.extend(self.counts.values().sum::<u64>().to_le_bytes());
            content.extend((streams as u16).to_le_bytes());
            content.extend(
                [streams, 0, self.metadata.len(), self.chunks.len()]
                    .map(|count| count as u32)
                    .map(u32::to_le_bytes)
                    .concat(),
            );
            content.extend(self.chunks.iter().map(|chunk| chunk.first_ns).min().unwrap_or(0).to_le_bytes());
            content.extend(self.chunks.iter().map(|chunk| chunk.last_ns).max().unwrap_or(0).to_le_bytes());
            map(content, self.counts.iter(), |content, (channel, count)| {
                content.extend(channel.to_le_bytes());
                content.extend(count.to_le_bytes());
            });
        });
        records
    }

    fn put(&mut self, records: &[u8]) -> io::Result<()> {
        self.file.write_all(records)?;
        self.length += records.len() as u64;
        Ok(())
    }
}

/// What is in a file that is gone on with.
#[derive(Default)]
struct Scan {
    told: Vec<u8>,
    channels: Vec<String>,
    counts: BTreeMap<u16, u64>,
    chunks: Vec<Chunk>,
    metadata: Vec<Metadata>,
}

impl Scan {
    /// The record at that place; how long it is, or none where it does not end before `length`, or the data do.
    fn record(&mut self, source: &mut BufReader<&File>, at: u64, length: u64) -> io::Result<Option<u64>> {
        if at + HEAD_BYTES > length {
            return Ok(None);
        }
        let mut head = [0; HEAD_BYTES as usize];
        source.read_exact(&mut head)?;
        let mut fields = Bytes(&head);
        let (kind, bytes) = (fields.u8().unwrap_or(0), fields.u64().unwrap_or(u64::MAX));
        let Some(end) = at.checked_add(HEAD_BYTES).and_then(|at| at.checked_add(bytes)).filter(|end| *end <= length)
        else {
            return Ok(None);
        };
        // Of a chunk its head tells enough.
        let wanted = if kind == op::CHUNK { bytes.min(64) } else { bytes };
        let mut content = vec![0; wanted as usize];
        source.read_exact(&mut content)?;
        source.seek_relative((bytes - wanted).cast_signed())?;
        let whole = end - at;
        let mut fields = Bytes(&content);
        let understood = match kind {
            // It was finished once, and is not any more.
            op::DATA_END => return Ok(None),
            op::SCHEMA | op::CHANNEL => {
                self.told.extend([&head[..], &content].concat());
                if kind == op::CHANNEL { self.channel(fields) } else { Some(()) }
            }
            op::CHUNK => self.chunk(fields, at, whole),
            op::MESSAGE_INDEX => (|| {
                let (channel, entries) = (fields.u16()?, fields.counted()?);
                let chunk = self.chunks.last_mut()?;
                chunk.indexes.insert(channel, at);
                chunk.index_bytes += whole;
                *self.counts.entry(channel).or_insert(0) += entries.len() as u64 / 16;
                Some(())
            })(),
            op::METADATA => (|| {
                self.metadata.push(Metadata { name: fields.text()?, at, bytes: whole });
                Some(())
            })(),
            _ => Some(()),
        };
        Ok(understood.map(|()| whole))
    }

    fn channel(&mut self, mut fields: Bytes<'_>) -> Option<()> {
        let (_id, _schema) = (fields.u16()?, fields.u16()?);
        self.channels.push(fields.text()?);
        Some(())
    }

    fn chunk(&mut self, mut fields: Bytes<'_>, at: u64, bytes: u64) -> Option<()> {
        let (first_ns, last_ns, unpacked) = (fields.u64()?, fields.u64()?, fields.u64()?);
        let (_crc, packing) = (fields.u32()?, fields.counted()?);
        let packing = if packing == b"lz4" { "lz4" } else { "" };
        let (packed, indexes) = (fields.u64()?, BTreeMap::new());
        self.chunks.push(Chunk { first_ns, last_ns, at, bytes, packing, packed, unpacked, indexes, index_bytes: 0 });
        Some(())
    }
}

fn pack(content: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(content)?;
    encoder.finish().map_err(io::Error::from)
}

/// A record of what `fill` writes.
fn record(records: &mut Vec<u8>, kind: u8, fill: impl FnOnce(&mut Vec<u8>)) {
    records.push(kind);
    let at = records.len();
    records.extend([0; 8]);
    fill(records);
    let length = (records.len() - at - 8) as u64;
    records[at..at + 8].copy_from_slice(&length.to_le_bytes());
}

/// A record of words about the file.
fn words(records: &mut Vec<u8>, name: &str, about: &BTreeMap<String, String>) {
    record(records, op::METADATA, |content| {
        text(content, name);
        map(content, about.iter(), |content, (key, value)| {
            text(content, key);
            text(content, value);
        });
    });
}

fn counted(content: &mut Vec<u8>, bytes: &[u8]) {
    content.extend((bytes.len() as u32).to_le_bytes());
    content.extend(bytes);
}

fn text(content: &mut Vec<u8>, text: &str) {
    counted(content, text.as_bytes());
}

/// Entries behind the number of their bytes.
fn map<T>(content: &mut Vec<u8>, entries: impl Iterator<Item = T>, mut put: impl FnMut(&mut Vec<u8>, T)) {
    let mut bytes = Vec::new();
    entries.for_each(|entry| put(&mut bytes, entry));
    counted(content, &bytes);
}

#[cfg(test)]
mod tests;
