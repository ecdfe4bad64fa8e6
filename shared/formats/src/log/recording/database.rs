//! `.db3` files of rosbag2: a table of topics, and one of messages.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use super::container::{Channel, Container, Encoding, Entry, Take};
use super::sqlite::{MAGIC, Rows, Step, Storage, Tables, Value, values};
use crate::log::fault::{FaultKind, Refusal};
use crate::log::source::{Source, Stamp};
use crate::open_regular;

/// A file that is packed as a whole is unpacked into memory, up to so many bytes.
const UNPACKED_BYTES_MAX: u64 = 1 << 30;

/// Reads such a file.
pub(crate) struct Database {
    /// For its hash.
    stored: File,
    /// Of its log of writes, which is not read.
    unwritten_bytes: u64,
    tables: Option<Tables>,
    messages: Option<Messages>,
    has_begun: bool,
}

/// The table of messages.
struct Messages {
    rows: Rows,
    channels: BTreeMap<i64, Channel>,
    /// Columns of number of the topic, time, content.
    columns: [usize; 3],
}

impl Database {
    pub(crate) fn new(path: &Path, stored: File) -> io::Result<Self> {
        let mut magic = [0; 16];
        let is_plain = (&stored).read_exact(&mut magic).is_ok() && magic == *MAGIC;
        let stored_again = open_regular(path)?;
        let storage = if is_plain {
            Storage::File(stored)
        } else {
            let mut bytes = Vec::new();
            let file = open_regular(path)?;
            // What is damaged is read as far as it goes.
            let _ = Source::new(file)?.take(UNPACKED_BYTES_MAX).read_to_end(&mut bytes);
            Storage::Memory(bytes)
        };
        let mut beside = path.as_os_str().to_owned();
        beside.push("-wal");
        let unwritten_bytes = Path::new(&beside).metadata().map_or(0, |metadata| metadata.len());
        Ok(Self {
            stored: stored_again,
            unwritten_bytes,
            tables: Tables::new(storage),
            messages: None,
            has_begun: false,
        })
    }

    fn begin(&mut self, take: &mut Take<'_>) {
        let mut damage = |kind, what: String| take(Entry::Damage(Refusal::new(kind, what)));
        if self.unwritten_bytes > 0 {
            let what =
                format!("{} bytes beside it; sqlite3 FILE 'PRAGMA wal_checkpoint' adds them", self.unwritten_bytes);
            damage(FaultKind::RecordingUnclosed, what);
        }
        let Some(tables) = &self.tables else {
            return damage(FaultKind::RecordingCut, "within its first page".to_owned());
        };
        let (found, damages) = tables.tables();
        damages.into_iter().for_each(|what| damage(FaultKind::RecordingCut, what));
        let columns = |name: &str, wanted: &[&str]| {
            let table = found.get(name)?;
            let places = wanted.iter().map(|wanted| table.columns.iter().position(|column| column == wanted));
            Some((table.root, places.collect::<Option<Vec<usize>>>()?))
        };
        let topics = columns("topics", &["id", "name", "type", "serialization_format"]);
        let messages = columns("messages", &["topic_id", "timestamp", "data"]);
        let (Some((topics, topic)), Some((messages, message))) = (topics, messages) else {
            return damage(FaultKind::RecordingDamaged, "no tables of topics and messages of rosbag2 in it".to_owned());
        };
        let mut channels = BTreeMap::new();
        let mut rows = Rows::new(topics);
        loop {
            match rows.next(tables) {
                Step::Row(number, record) => {
                    let values = values(&record);
                    let of = |at: usize| topic.get(at).and_then(|column| values.get(*column));
                    let text = |at: usize| of(at).and_then(Value::text).unwrap_or_default();
                    // The number of a row stands in no column of it.
                    let id = of(0).and_then(Value::integer).unwrap_or(number);
                    let encoding = if text(3) == "cdr" { Encoding::Cdr } else { Encoding::Other };
                    channels.insert(id, Channel::new(text(1), text(2), encoding));
                }
                Step::Damage(what) => damage(FaultKind::RecordingCut, what),
                Step::End => break,
            }
        }
        if let [topic, time, data] = message[..] {
            self.messages = Some(Messages { rows: Rows::new(messages), channels, columns: [topic, time, data] });
        }
    }
}

impl Container for Database {
    fn advance(&mut self, take: &mut Take<'_>) -> io::Result<bool> {
        if !self.has_begun {
            self.has_begun = true;
            self.begin(take);
            return Ok(true);
        }
        let (Some(tables), Some(messages)) = (&self.tables, &mut self.messages) else { return Ok(false) };
        match messages.rows.next(tables) {
            Step::Row(number, record) => {
                let values = values(&record);
                let [topic, time, data] = messages.columns.map(|column| values.get(column));
                let channel = topic.and_then(Value::integer).and_then(|id| messages.channels.get(&id));
                let log_ns = time.and_then(Value::integer).and_then(|ns| u64::try_from(ns).ok());
                match (channel, log_ns, data) {
                    (Some(channel), Some(log_ns), Some(Value::Bytes(data))) => {
                        take(Entry::Message { channel, log_ns, data });
                    }
                    _ => {
                        let what = format!("row {number}: of no topic, or without time or content");
                        take(Entry::Damage(Refusal::new(FaultKind::MessageDamaged, what)));
                    }
                }
            }
            Step::Damage(what) => take(Entry::Damage(Refusal::new(FaultKind::RecordingCut, what))),
            Step::End => return Ok(false),
        }
        Ok(true)
    }

    fn finish(self: Box<Self>) -> io::Result<Stamp> {
        Source::new(&self.stored)?.finish()
    }
}
