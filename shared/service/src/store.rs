//! What a process stores of itself, so that another can go on in its place: whole or not at all, whenever it is killed.
//!
//! A snapshot is a state together with how far each stream had been read and written then. What can't be read once more
//! (an order of the user, a fix) goes into a journal before it takes effect, with the place that it took effect at.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use echogrid_core::{Reading, Robot};
use echogrid_topics::{Command, LocalizationFix, Message, RawOdometry, TruePose};
use redb::backends::FileBackend;
use redb::{Database, ReadableDatabase, ReadableTable, StorageBackend, TableDefinition};
use serde::{Deserialize, Serialize};

/// Generation → its [`Snapshot`].
const SNAPSHOTS: TableDefinition<'_, u64, &[u8]> = TableDefinition::new("snapshots");
/// Number → its [`Entry`].
const JOURNAL: TableDefinition<'_, u64, &[u8]> = TableDefinition::new("journal");
/// The parts of the only state, where older ones are never gone back to.
const PARTS: TableDefinition<'_, &str, &[u8]> = TableDefinition::new("parts");
/// Number → a [`Spooled`] message of a sensor that can't give it again.
const SPOOL: TableDefinition<'_, u64, &[u8]> = TableDefinition::new("spool");
/// Code of a topic → the last of its messages that is not in the spool any more.
const TRIMMED: TableDefinition<'_, u32, u64> = TableDefinition::new("trimmed");
/// One entry: the run that the store is of.
const RUN: TableDefinition<'_, (), u64> = TableDefinition::new("run");
/// Everything is written soon after it is read for the last time.
const CACHE_BYTES: usize = 4 << 20;

/// Messages between two looks at what of a spool is stored downstream.
const TRIM_EVERY: u64 = 256;

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
    /// Its stamp, nanoseconds.
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
    /// Messages refused.
    pub faults: u64,
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
    /// A message of a topic that keeps only the latest.
    Robot(Robot),
    /// Likewise.
    Fix(LocalizationFix),
    /// An order of the user.
    Command(Command),
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
    /// Its number there.
    pub sequence: u64,
    /// Its stamp, nanoseconds.
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
    /// None of what no robot can measure.
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

/// A state, and the moment that it is of.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Snapshot {
    moment: Moment,
    state: State,
}

/// The store of one service.
#[derive(Debug)]
pub struct Store {
    file: PathBuf,
    database: Database,
    next_generation: u64,
    next_entry: u64,
    /// Whether an earlier state may have to be gone back to: then each is stored whole, else only what changes.
    keeps_generations: bool,
}

impl Store {
    /// Opens the store of the run `run` in `file`, or makes it. Where `synced`, what is stored outlives the machine, too.
    ///
    /// # Errors
    /// The file can't be made or read, is no store, or one of another run.
    pub fn open(file: &Path, run: u64, synced: bool, keeps_generations: bool) -> Result<Self> {
        let context = || format!("{}: the stored state of this service", file.display());
        let database = if file.exists() {
            database(file, synced).with_context(context)?
        } else {
            sweep_unfinished(file);
            // Killed while it is made, it would be no store.
            let new = file.with_extension(format!("new-{}", std::process::id()));
            let database = database(&new, synced).with_context(context)?;
            let write = database.begin_write()?;
            write.open_table(RUN)?.insert((), run)?;
            write.open_table(SNAPSHOTS)?;
            write.open_table(JOURNAL)?;
            write.open_table(PARTS)?;
            write.open_table(SPOOL)?;
            write.open_table(TRIMMED)?;
            write.commit()?;
            std::fs::rename(&new, file).with_context(context)?;
            database
        };
        let read = database.begin_read()?;
        let of = read.open_table(RUN).ok().and_then(|table| table.get(()).ok().flatten().map(|run| run.value()));
        anyhow::ensure!(
            of == Some(run),
            "{}: what is stored there is of another run; remove it, or begin in another folder",
            file.display()
        );
        let last = |table: TableDefinition<'static, u64, &'static [u8]>| -> Result<u64> {
            Ok(read.open_table(table)?.last()?.map_or(0, |(key, _)| key.value() + 1))
        };
        // An empty journal may have been longer: what snapshots count goes on from there.
        let entries = moments(&read)?.into_values().map(|moment| moment.journal).max().unwrap_or(0);
        let (next_generation, next_entry) = (last(SNAPSHOTS)?, last(JOURNAL)?.max(entries));
        drop(read);
        Ok(Self { file: file.into(), database, next_generation, next_entry, keeps_generations })
    }

    /// The moments that there are snapshots of, by generation.
    ///
    /// # Errors
    /// The store is broken.
    pub fn moments(&self) -> Result<BTreeMap<u64, Moment>> {
        moments(&self.database.begin_read()?)
    }

    /// The state of a generation.
    ///
    /// # Errors
    /// The store is broken.
    pub fn state(&self, generation: u64) -> Result<State> {
        let read = self.database.begin_read()?;
        if self.keeps_generations {
            let snapshots = read.open_table(SNAPSHOTS)?;
            let bytes = snapshots.get(generation)?.context("a snapshot is missing")?;
            return Ok(decode::<Snapshot>(bytes.value())?.state);
        }
        let parts = read.open_table(PARTS)?;
        parts
            .iter()?
            .map(|part| part.map(|(name, bytes)| (name.value().to_owned(), bytes.value().to_vec())))
            .collect::<Result<_, _>>()
            .map_err(Into::into)
    }

    /// Stores a snapshot, and lets go of generations before `oldest`; its generation.
    ///
    /// # Errors
    /// The disk is full, or the store is broken: what was stored before is intact.
    pub fn store(&mut self, moment: &Moment, changes: Changes, oldest: u64) -> Result<u64> {
        let generation = self.next_generation;
        let write = self.database.begin_write()?;
        {
            let mut state = State::new();
            let mut parts = write.open_table(PARTS)?;
            for (name, bytes) in changes {
                match (self.keeps_generations, bytes) {
                    (true, Some(bytes)) => drop(state.insert(name, bytes)),
                    (true, None) => {}
                    (false, Some(bytes)) => drop(parts.insert(name.as_str(), bytes.as_slice())?),
                    (false, None) => drop(parts.remove(name.as_str())?),
                }
            }
            let mut snapshots = write.open_table(SNAPSHOTS)?;
            let oldest = if self.keeps_generations { oldest } else { generation };
            snapshots.retain(|known, _| known >= oldest)?;
            let snapshot = Snapshot { moment: moment.clone(), state };
            snapshots.insert(generation, postcard::to_allocvec(&snapshot)?.as_slice())?;
            let needed = snapshots
                .first()?
                .map_or(Ok(0), |(_, bytes)| decode::<Moment>(bytes.value()).map(|moment| moment.journal))?;
            write.open_table(JOURNAL)?.retain(|number, _| number >= needed)?;
        }
        write.commit()?;
        self.next_generation += 1;
        Ok(generation)
    }

    /// Its file.
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
        let write = self.database.begin_write()?;
        write.open_table(JOURNAL)?.insert(self.next_entry, postcard::to_allocvec(entry)?.as_slice())?;
        write.commit()?;
        self.next_entry += 1;
        Ok(())
    }

    /// Keeps a message that can't be given again, as the one of this number; and lets go of those that `is_stored`
    /// downstream, from time to time.
    ///
    /// # Errors
    /// The disk is full, or the store is broken.
    pub fn spool(&mut self, number: u64, message: &Spooled, is_stored: impl Fn(u32, u64) -> bool) -> Result<()> {
        let write = self.database.begin_write()?;
        {
            let mut spool = write.open_table(SPOOL)?;
            spool.insert(number, postcard::to_allocvec(message)?.as_slice())?;
            if number.is_multiple_of(TRIM_EVERY) {
                let mut trimmed = write.open_table(TRIMMED)?;
                let mut failed = None;
                spool.retain(|_, bytes| match decode::<(u32, u64)>(bytes) {
                    Ok((topic, sequence)) if is_stored(topic, sequence) => {
                        failed = trimmed.insert(topic, sequence).err().or(failed.take());
                        false
                    }
                    _ => true,
                })?;
                failed.map_or(Ok(()), Err)?;
            }
        }
        Ok(write.commit()?)
    }

    /// The messages that were spooled and not let go of, with the number of the next one; and, by the code of each topic,
    /// the last that was.
    ///
    /// # Errors
    /// The store is broken.
    pub fn spooled(&self) -> Result<(Vec<Spooled>, u64, BTreeMap<u32, u64>)> {
        let read = self.database.begin_read()?;
        let spool = read.open_table(SPOOL)?;
        let next = spool.last()?.map_or(0, |(number, _)| number.value() + 1);
        let messages = spool.iter()?.map(|entry| decode(entry?.1.value())).collect::<Result<_>>()?;
        let trimmed = read.open_table(TRIMMED)?;
        let trimmed = trimmed.iter()?.map(|entry| entry.map(|(topic, sequence)| (topic.value(), sequence.value())));
        Ok((messages, next, trimmed.collect::<Result<_, _>>()?))
    }

    /// The entries of the journal from `first` on.
    ///
    /// # Errors
    /// The store is broken.
    pub fn journal(&self, first: u64) -> Result<Vec<Entry>> {
        let read = self.database.begin_read()?;
        let journal = read.open_table(JOURNAL)?;
        journal.range(first..)?.map(|entry| decode(entry?.1.value())).collect()
    }
}

fn moments(read: &redb::ReadTransaction) -> Result<BTreeMap<u64, Moment>> {
    let snapshots = read.open_table(SNAPSHOTS)?;
    // The moment comes first in a snapshot.
    snapshots
        .iter()?
        .map(|entry| {
            entry.map_err(Into::into).and_then(|(generation, bytes)| Ok((generation.value(), decode(bytes.value())?)))
        })
        .collect()
}

/// Removes what processes left that were killed while they made this store.
fn sweep_unfinished(file: &Path) {
    let Some((folder, stem)) = file.parent().zip(file.file_stem()) else { return };
    let prefix = format!("{}.new-", stem.to_string_lossy());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            // Gone already is as good.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// What comes after it in `bytes` is left.
fn decode<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    postcard::take_from_bytes(bytes).map(|(value, _)| value).context("a stored state is of another version")
}

fn database(file: &Path, synced: bool) -> Result<Database> {
    let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(file)?;
    let mut builder = Database::builder();
    builder.set_cache_size(CACHE_BYTES);
    Ok(if synced {
        builder.create_with_backend(FileBackend::new(open)?)?
    } else {
        builder.create_with_backend(Unsynced(FileBackend::new(open)?))?
    })
}

/// A file that outlives its process, and need not outlive the machine.
#[derive(Debug)]
struct Unsynced(FileBackend);

impl StorageBackend for Unsynced {
    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.0.read(offset, out)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.0.set_len(len)
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.0.write(offset, data)
    }

    fn close(&self) -> io::Result<()> {
        self.0.close()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(written: u64, journal: u64) -> Moment {
        Moment { written: vec![(4, written)], journal, ..Moment::default() }
    }

    fn changes(parts: &[(&str, Option<&[u8]>)]) -> Changes {
        parts.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.map(<[u8]>::to_vec))).collect()
    }

    fn entry(at: u64) -> Entry {
        Entry { at: vec![at], stamp_ns: 0, what: Unrepeatable::Command(Command::Pause) }
    }

    #[test]
    fn generations_are_kept_until_they_are_let_go() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("odometry.redb");
        let mut store = Store::open(&file, 7, false, true).unwrap();
        for generation in 0..3 {
            store.write_down(&entry(generation)).unwrap();
            let changes = changes(&[("state", Some(&[generation as u8]))]);
            assert_eq!(store.store(&moment(10 * generation, generation + 1), changes, 0).unwrap(), generation);
        }
        store.store(&moment(30, 3), changes(&[("state", Some(&[3]))]), 1).unwrap();
        drop(store);
        let mut store = Store::open(&file, 7, false, true).unwrap();
        assert_eq!(store.moments().unwrap().keys().copied().collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(store.state(2).unwrap()["state"], [2]);
        // The entry that every snapshot knows of is gone.
        assert_eq!(store.journal(0).unwrap().len(), 1);
        assert_eq!(store.journal(3).unwrap().len(), 0);
        store.write_down(&entry(9)).unwrap();
        assert_eq!(store.journal(3).unwrap()[0].at, [9]);
    }

    #[test]
    fn parts_are_stored_as_they_change() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mapper.redb");
        let mut store = Store::open(&file, 7, false, false).unwrap();
        store.store(&moment(0, 0), changes(&[("a", Some(b"1")), ("b", Some(b"2"))]), 0).unwrap();
        store.store(&moment(1, 0), changes(&[("b", None), ("c", Some(b"3"))]), 0).unwrap();
        drop(store);
        let store = Store::open(&file, 7, false, false).unwrap();
        let (generation, last) = store.moments().unwrap().pop_last().unwrap();
        assert_eq!(last, moment(1, 0));
        let names: Vec<String> = store.state(generation).unwrap().into_keys().collect();
        assert_eq!(names, ["a", "c"]);
    }

    #[test]
    fn a_spool_keeps_what_is_not_stored_downstream() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sensor.redb");
        let mut store = Store::open(&file, 7, false, true).unwrap();
        for number in 0..=TRIM_EVERY {
            let message = Measured::TruePose(TruePose { map_from_base: None });
            let spooled = Spooled { topic: 9, sequence: number + 1, stamp_ns: number, message };
            store.spool(number, &spooled, |topic, sequence| topic == 9 && sequence <= 200).unwrap();
        }
        drop(store);
        let (messages, next, trimmed) = Store::open(&file, 7, false, true).unwrap().spooled().unwrap();
        assert_eq!((messages.len() as u64, next), (TRIM_EVERY + 1 - 200, TRIM_EVERY + 1));
        assert_eq!((messages[0].sequence, trimmed[&9]), (201, 200));
    }

    #[test]
    fn what_is_no_store_is_told_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mapper.redb");
        std::fs::write(&file, "something else").unwrap();
        let error = format!("{:#}", Store::open(&file, 7, false, false).unwrap_err());
        assert!(error.contains("mapper.redb"), "{error}");
    }
}
