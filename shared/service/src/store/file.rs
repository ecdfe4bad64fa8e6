//! A shelf in a file, whole or not at all, whenever its process is killed.

use std::cell::Cell;
use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Once;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use redb::backends::FileBackend;
use redb::{Database, DatabaseError, ReadableDatabase, ReadableTable, StorageBackend, TableDefinition};
use sha2::{Digest, Sha256};

use super::beginning;
use super::shelf::{Change, Shelf, Table};

/// Everything is written soon after it is read for the last time.
const CACHE_BYTES: usize = 4 << 20;
/// What the next launcher in a domain gives to orphans, too.
const ORPHANS_LEAVE_WITHIN: Duration = Duration::from_secs(5);
const LOOK_EVERY: Duration = Duration::from_millis(20);

fn definition(table: Table) -> TableDefinition<'static, &'static [u8], &'static [u8]> {
    TableDefinition::new(table.name())
}

/// None only while it is dropped.
#[derive(Debug)]
struct File(Option<Database>);

impl File {
    fn database(&self) -> Result<&Database> {
        self.0.as_ref().context("it is closed")
    }
}

impl File {
    /// All that is in it, as a digest.
    fn entries(&self) -> Result<[u8; 32]> {
        let mut digest = Sha256::new();
        for table in Table::ALL {
            for (key, value) in self.range(table, &[])? {
                for bytes in [&key, &value] {
                    digest.update((bytes.len() as u64).to_le_bytes());
                    digest.update(bytes);
                }
            }
        }
        Ok(digest.finalize().into())
    }
}

impl Drop for File {
    fn drop(&mut self) {
        // It tidies up, and trips over damage like all else; an error has been told by then.
        let _ = unpanicked(|| {
            drop(self.0.take());
            Ok(())
        });
    }
}

/// Opens the shelf of the run `run` in `file`, or makes it.
pub(super) fn open(file: &Path, run: u64, synced: bool) -> Result<Box<dyn Shelf>> {
    if file.exists() {
        let mut shelf = File(Some(unpanicked(|| database(file, synced))?));
        // Nothing else than what was synced can have been cut by whatever happened to the machine.
        if synced {
            // A store that was not closed is tidied up by this, too: what tells damage is that entries change.
            let found = shelf.entries()?;
            let is_whole = unpanicked(|| Ok(shelf.0.as_mut().context("it is closed")?.check_integrity()?))?;
            ensure!(is_whole || shelf.entries()? == found, "it is damaged");
        }
        return Ok(Box::new(shelf));
    }
    sweep_unfinished(file);
    // Killed while it is made, it would be no store.
    let new = file.with_extension(format!("new-{}", std::process::id()));
    let mut shelf = File(Some(database(&new, synced)?));
    shelf.commit(vec![beginning(run)])?;
    std::fs::rename(&new, file)?;
    if let Some(folder) = file.parent().filter(|_| synced) {
        std::fs::File::open(folder).and_then(|folder| folder.sync_all()).context("storing its folder")?;
    }
    Ok(Box::new(shelf))
}

impl Shelf for File {
    fn get(&self, table: Table, key: &[u8]) -> Result<Option<Vec<u8>>> {
        unpanicked(|| {
            let read = self.database()?.begin_read()?;
            Ok(read.open_table(definition(table))?.get(key)?.map(|value| value.value().to_vec()))
        })
    }

    fn range(&self, table: Table, from: &[u8]) -> Result<Vec<(Vec<u8>, Vec<u8>)>> {
        unpanicked(|| {
            let read = self.database()?.begin_read()?;
            let table = read.open_table(definition(table))?;
            let entries = table.range(from..)?;
            let entries = entries.map(|entry| entry.map(|(key, value)| (key.value().to_vec(), value.value().to_vec())));
            Ok(entries.collect::<Result<_, _>>()?)
        })
    }

    fn last(&self, table: Table) -> Result<Option<Vec<u8>>> {
        unpanicked(|| {
            let read = self.database()?.begin_read()?;
            Ok(read.open_table(definition(table))?.last()?.map(|(key, _)| key.value().to_vec()))
        })
    }

    fn commit(&mut self, changes: Vec<Change>) -> Result<()> {
        unpanicked(|| {
            let write = self.database()?.begin_write()?;
            for table in Table::ALL {
                let mut open = write.open_table(definition(table))?;
                for Change { key, value, .. } in changes.iter().filter(|change| change.table == table) {
                    match value {
                        Some(value) => drop(open.insert(key.as_slice(), value.as_slice())?),
                        None => drop(open.remove(key.as_slice())?),
                    }
                }
            }
            Ok(write.commit()?)
        })
    }
}

thread_local! {
    /// Whether a panic of this thread is caught, and told as an error.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}
static QUIET: Once = Once::new();

/// What redb panics at is a damaged file; whoever asked knows which.
fn unpanicked<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    QUIET.call_once(|| {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !IS_CAUGHT.get() {
                hook(panic);
            }
        }));
    });
    IS_CAUGHT.set(true);
    let done = catch_unwind(AssertUnwindSafe(work));
    IS_CAUGHT.set(false);
    done.unwrap_or_else(|panic| {
        let why = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        Err(anyhow!("it is damaged ({})", why.unwrap_or("no reason given")))
    })
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

fn database(file: &Path, synced: bool) -> Result<Database> {
    let backend = backend(file)?;
    let mut builder = Database::builder();
    builder.set_cache_size(CACHE_BYTES);
    Ok(if synced { builder.create_with_backend(backend)? } else { builder.create_with_backend(Unsynced(backend))? })
}

/// The file, once nobody else holds it: the processes of a launcher that was killed may, until they have left.
fn backend(file: &Path) -> Result<FileBackend> {
    let deadline = Instant::now() + ORPHANS_LEAVE_WITHIN;
    loop {
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(file)?;
        match FileBackend::new(open) {
            // redb offers nothing to wait on.
            Err(DatabaseError::DatabaseAlreadyOpen) if Instant::now() < deadline => std::thread::sleep(LOOK_EVERY),
            backend => return Ok(backend?),
        }
    }
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

    #[test]
    fn who_still_holds_the_file_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mapper.redb");
        drop(open(&file, 7, false).unwrap());
        let held = FileBackend::new(std::fs::File::options().read(true).write(true).open(&file).unwrap()).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(10 * LOOK_EVERY);
                drop(held);
            });
            assert!(open(&file, 7, false).is_ok());
        });
    }
}
