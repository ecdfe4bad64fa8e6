//! What a process stores of itself, so that another can go on in its place: whole or not at all, whenever it is killed.
//!
//! A snapshot is a state together with how far each stream had been read and written then. What can't be read once more
//! (an order of the user, a fix) goes into a journal before it takes effect, with the place that it took effect at.

mod file;
mod packed;
mod shelf;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use echogrid_core::{Reading, Robot};
use echogrid_topics::{Command, LocalizationFix, Message, RawOdometry, TruePose};
use serde::{Deserialize, Serialize};
pub use shelf::{Change, Shelf, Table};

use crate::mutants::Mutant;

/// Messages between two looks at what of a spool is stored downstream.
const TRIM_EVERY: u64 = 256;

/// Of a number in a key.
const GENERATION_BYTES: usize = 8;
/// Parts as they were, by name; none: there was none.
type Undone = BTreeMap<Vec<u8>, Option<Vec<u8>>>;
/// Under what a sensor notes that it has begun.
const BEGUN: &[u8] = b"begun";

/// A state by its parts.
pub type State = BTreeMap<String, Vec<u8>>;
/// Parts that changed; none: the part is gone.
pub type Changes = BTreeMap<String, Option<Vec<u8>>>;

/// How far a lossless input was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Read {
    /// Code of the topic.
    pub topic: u32,
    /// Last sequence taken in.
    pub sequence: u64,
    /// The stamp of the last message taken in, nanoseconds.
    pub stamp_ns: u64,
    /// Messages lost on the way.
    pub lost: u64,
    /// Whether it was the last.
    pub ended: bool,
}

/// A moment in the life of a service, over all its processes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Moment {
    /// How far each lossless input was read, in the order of the inputs.
    pub read: Vec<Read>,
    /// Last sequence of each lossless output, by the code of its topic.
    pub written: Vec<(u32, u64)>,
    /// Entries of the journal that had taken effect.
    pub journal: u64,
    /// Messages taken in (of a sensor: given out).
    pub progress: u64,
    /// Stamp of the latest message handled, nanoseconds.
    pub stamp_ns: u64,
    /// Stamp of the first message of a stream.
    pub first_stamp_ns: Option<u64>,
    /// The number of messages refused.
    pub faults: u64,
    /// Numbers of the latest orders that had been carried out.
    pub orders: Vec<u64>,
}

impl Moment {
    /// Whether all that had been written by then is stored by whoever reads it.
    pub(crate) fn is_behind(&self, acknowledged: impl Fn(u32) -> u64) -> bool {
        self.written.iter().all(|(topic, sequence)| *sequence <= acknowledged(*topic))
    }
}

/// What can't be read once more.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Unrepeatable {
    /// The robot's description, of a topic that keeps only the latest.
    Robot(Robot),
    /// A fix, of a topic that keeps only the latest.
    Fix(LocalizationFix),
    /// An order of the user, and its number: whoever did not hear the answer gives it again.
    Command(u64, Command),
    /// A sensor's streams end here: there was no more, or the user ended the run.
    End,
}

/// Something unrepeatable, and when it took effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Entry {
    /// Last sequence of each lossless input at that moment, in the order of the inputs (of a sensor: its progress).
    pub at: Vec<u64>,
    /// Stamp of the message, nanoseconds.
    pub stamp_ns: u64,
    /// What it was.
    pub what: Unrepeatable,
}

/// A message of a sensor.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Spooled {
    /// Code of its topic.
    pub topic: u32,
    /// The sequence number of the message in its topic.
    pub sequence: u64,
    /// The stamp of the message, nanoseconds.
    pub stamp_ns: u64,
    /// What it says.
    pub message: Measured,
}

/// What a sensor says.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Measured {
    /// What it is.
    Robot(Robot),
    /// Where its drive believes to be.
    Odometry(RawOdometry),
    /// What it heard.
    Scan(Vec<Reading>),
    /// Where it really is.
    TruePose(TruePose),
}

impl Measured {
    /// What a sensor says by this message; none where no robot can measure what it says.
    #[must_use]
    pub fn of(message: &Message) -> Option<Self> {
        Some(match message {
            Message::Robot(robot) => Self::Robot(robot.clone()),
            Message::Odometry(raw) => Self::Odometry(*raw),
            Message::Scan(readings) => Self::Scan(readings.clone()),
            Message::TruePose(pose) => Self::TruePose(*pose),
            _ => return None,
        })
    }
}

impl From<Measured> for Message {
    fn from(measured: Measured) -> Self {
        match measured {
            Measured::Robot(robot) => Self::Robot(robot),
            Measured::Odometry(raw) => Self::Odometry(raw),
            Measured::Scan(readings) => Self::Scan(readings),
            Measured::TruePose(pose) => Self::TruePose(pose),
        }
    }
}

/// The store of one service.
#[derive(Debug)]
pub struct Store {
    file: PathBuf,
    shelf: Box<dyn Shelf>,
    next_generation: u64,
    next_entry: u64,
    /// Whether an earlier state may have to be gone back to: then it is stored what changed parts were before.
    keeps_generations: bool,
}

impl Store {
    /// Opens the store of the run `run` in `file`, or makes it. Where `synced`, what is stored outlives the machine, too.
    ///
    /// # Errors
    /// The file can't be made or read, is no store, a damaged one, or one of another run.
    pub fn open(file: &Path, run: u64, synced: bool, keeps_generations: bool) -> Result<Self> {
        let opened = file::open(file, run, synced);
        let store = opened.and_then(|shelf| Self::over(shelf, file, run, keeps_generations));
        store.with_context(|| format!("{}: the stored state of this service", file.display()))
    }

    /// Whether `file` is a whole store of the run `run`; nothing is changed.
    ///
    /// # Errors
    /// It is not.
    pub fn check(file: &Path, run: u64) -> Result<()> {
        let store = Self::open(file, run, true, true)?;
        let broken = || format!("{}: a damaged store", file.display());
        store.moments().with_context(broken)?;
        store.journal(0).with_context(broken)?;
        store.spooled().map(drop).with_context(broken)
    }

    /// The store of the run `run` on a shelf, which errors call `file`.
    ///
    /// # Errors
    /// What is there is damaged, or of another run.
    pub fn over(shelf: Box<dyn Shelf>, file: &Path, run: u64, keeps_generations: bool) -> Result<Self> {
        let of = shelf.get(Table::Run, &[])?.and_then(|run| number(&run).ok());
        anyhow::ensure!(
            of == Some(run) || Mutant::StaleStores.lives(),
            "what is stored there is of another run; remove it, or begin in another folder"
        );
        let mut store = Self { file: file.into(), shelf, next_generation: 0, next_entry: 0, keeps_generations };
        let next = |table| store.shelf.last(table)?.map_or(Ok(0), |key| after(&key));
        let (generation, entry) = (next(Table::Snapshots)?, next(Table::Journal)?);
        // An empty journal may have been longer: what snapshots count goes on from there.
        let entries = store.moments()?.into_values().map(|moment| moment.journal).max().unwrap_or(0);
        (store.next_generation, store.next_entry) = (generation, entry.max(entries));
        Ok(store)
    }

    /// The moments that there are snapshots of, by generation.
    ///
    /// # Errors
    /// The store is broken.
    pub fn moments(&self) -> Result<BTreeMap<u64, Moment>> {
        let snapshots = self.shelf.range(Table::Snapshots, &[])?;
        snapshots.into_iter().map(|(key, bytes)| Ok((number(&key)?, decode(&bytes)?))).collect()
    }

    /// The state of a generation.
    ///
    /// # Errors
    /// The store is broken.
    pub fn state(&self, generation: u64) -> Result<State> {
        let mut parts: BTreeMap<Vec<u8>, Vec<u8>> = self.shelf.range(Table::Parts, &[])?.into_iter().collect();
        for (name, before) in self.undone(generation)?.1 {
            match before {
                Some(bytes) => parts.insert(name, bytes),
                None => parts.remove(&name),
            };
        }
        parts.into_iter().map(|(name, bytes)| Ok((String::from_utf8(name)?, packed::unpack(&bytes)?))).collect()
    }

    /// The keys of what undoes the generations after this one, and what parts were then that are others now.
    fn undone(&self, generation: u64) -> Result<(Vec<Vec<u8>>, Undone)> {
        let (mut keys, mut parts) = (Vec::new(), BTreeMap::new());
        // The latest first: what the oldest says is what counts.
        for (key, before) in self.shelf.range(Table::Undo, &key(generation.saturating_add(1)))?.into_iter().rev() {
            parts.insert(key.get(GENERATION_BYTES..).context("a key of another version")?.to_vec(), decode(&before)?);
            keys.push(key);
        }
        Ok((keys, parts))
    }

    /// Goes back to a generation: those after it are gone. Its state.
    ///
    /// # Errors
    /// The disk is full, or the store is broken.
    pub fn go_back(&mut self, generation: u64) -> Result<State> {
        let (keys, parts) = self.undone(generation)?;
        let part = |(name, value)| Change { table: Table::Parts, key: name, value };
        let mut all: Vec<Change> = parts.into_iter().map(part).collect();
        all.extend(keys.into_iter().map(|key| Change::remove(Table::Undo, key)));
        let later = self.moments()?.into_keys().filter(|known| *known > generation);
        all.extend(later.map(|known| Change::remove(Table::Snapshots, key(known))));
        if !all.is_empty() {
            self.shelf.commit(all)?;
        }
        self.state(generation)
    }

    /// Stores a snapshot, and lets go of generations before `oldest`; its generation.
    ///
    /// # Errors
    /// The disk is full, or the store is broken: what was stored before is intact.
    pub fn store(&mut self, moment: &Moment, changes: Changes, oldest: u64) -> Result<u64> {
        let generation = self.next_generation;
        let oldest = if self.keeps_generations { oldest } else { generation };
        let mut all = Vec::new();
        for (name, bytes) in changes {
            if oldest < generation {
                let before = self.shelf.get(Table::Parts, name.as_bytes())?;
                let undo = [key(generation).as_slice(), name.as_bytes()].concat();
                all.push(Change::put(Table::Undo, undo, postcard::to_allocvec(&before)?));
            }
            let value = bytes.map(|bytes| packed::pack(&bytes));
            all.push(Change { table: Table::Parts, key: name.into_bytes(), value });
        }
        for (undo, _) in self.shelf.range(Table::Undo, &[])? {
            if number(undo.get(..GENERATION_BYTES).context("a key of another version")?)? <= oldest {
                all.push(Change::remove(Table::Undo, undo));
            }
        }
        // What no snapshot that stays needs is let go of.
        let mut needed = moment.journal;
        for (known, moment) in self.moments()? {
            if known < oldest {
                all.push(Change::remove(Table::Snapshots, key(known)));
            } else {
                needed = needed.min(moment.journal);
            }
        }
        for (entry, _) in self.shelf.range(Table::Journal, &[])? {
            if number(&entry)? < needed {
                all.push(Change::remove(Table::Journal, entry));
            }
        }
        all.push(Change::put(Table::Snapshots, key(generation), postcard::to_allocvec(moment)?));
        self.shelf.commit(all)?;
        self.next_generation += 1;
        Ok(generation)
    }

    /// A life begins; whether there was an earlier one, which may have sent something.
    ///
    /// # Errors
    /// The disk is full, or the store is broken.
    pub fn begin_life(&mut self) -> Result<bool> {
        let was_begun = self.shelf.get(Table::Run, BEGUN)?.is_some();
        if !was_begun {
            self.shelf.commit(vec![Change::put(Table::Run, BEGUN.to_vec(), Vec::new())])?;
        }
        Ok(was_begun)
    }

    /// The file that the store is in.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Entries that were written down so far.
    #[must_use]
    pub fn entries(&self) -> u64 {
        self.next_entry
    }

    /// Writes down what can't be read once more, before it takes effect.
    ///
    /// # Errors
    /// The disk is full, or the store is broken.
    pub fn write_down(&mut self, entry: &Entry) -> Result<()> {
        let bytes = postcard::to_allocvec(entry)?;
        self.shelf.commit(vec![Change::put(Table::Journal, key(self.next_entry), bytes)])?;
        self.next_entry += 1;
        Ok(())
    }

    /// Keeps a message that can't be given again, as the one of this number; and lets go of those that `is_stored`
    /// downstream, from time to time.
    ///
    /// # Errors
    /// The disk is full, or the store is broken.
    pub fn spool(&mut self, number: u64, message: &Spooled, is_stored: impl Fn(u32, u64) -> bool) -> Result<()> {
        let mut changes = vec![Change::put(Table::Spool, key(number), postcard::to_allocvec(message)?)];
        if number.is_multiple_of(TRIM_EVERY) {
            let mut trimmed = BTreeMap::new();
            for (key, bytes) in self.shelf.range(Table::Spool, &[])? {
                let (topic, sequence) = decode::<(u32, u64)>(&bytes)?;
                if is_stored(topic, sequence) {
                    trimmed.insert(topic, sequence);
                    changes.push(Change::remove(Table::Spool, key));
                }
            }
            let last = |(topic, sequence): (u32, u64)| {
                Change::put(Table::Trimmed, topic.to_be_bytes().to_vec(), sequence.to_be_bytes().to_vec())
            };
            changes.extend(trimmed.into_iter().map(last));
        }
        self.shelf.commit(changes)
    }

    /// The messages that were spooled and not let go of, with the number of the next one; and, by the code of each topic,
    /// the last that was.
    ///
    /// # Errors
    /// The store is broken.
    pub fn spooled(&self) -> Result<(Vec<Spooled>, u64, BTreeMap<u32, u64>)> {
        let spool = self.shelf.range(Table::Spool, &[])?;
        let next = spool.last().map_or(Ok(0), |(key, _)| after(key))?;
        let messages = spool.iter().map(|(_, bytes)| decode(bytes)).collect::<Result<_>>()?;
        let topic = |key: &[u8]| key.try_into().map(u32::from_be_bytes).context("no code of a topic");
        let trimmed = self.shelf.range(Table::Trimmed, &[])?;
        let trimmed = trimmed.iter().map(|(key, sequence)| Ok((topic(key)?, number(sequence)?)));
        Ok((messages, next, trimmed.collect::<Result<_>>()?))
    }

    /// The entries of the journal from `first` on.
    ///
    /// # Errors
    /// The store is broken.
    pub fn journal(&self, first: u64) -> Result<Vec<Entry>> {
        self.shelf.range(Table::Journal, &key(first))?.iter().map(|(_, bytes)| decode(bytes)).collect()
    }
}

/// What a shelf begins with: which run it is of.
#[must_use]
pub fn beginning(run: u64) -> Change {
    Change::put(Table::Run, Vec::new(), key(run))
}

/// A number as a key: in order.
fn key(number: u64) -> Vec<u8> {
    number.to_be_bytes().to_vec()
}

fn number(key: &[u8]) -> Result<u64> {
    Ok(u64::from_be_bytes(key.try_into().context("a key of another version")?))
}

/// The number that comes after that of a key.
fn after(key: &[u8]) -> Result<u64> {
    number(key)?.checked_add(1).context("a key that no store comes to: it is damaged")
}

/// What comes after it in `bytes` is left.
fn decode<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    postcard::take_from_bytes(bytes).map(|(value, _)| value).context("a stored state is of another version, or damaged")
}
