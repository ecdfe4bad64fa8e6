//! Files that are written whole or not at all.

use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// How a file in the making is called.
const PREFIX: &str = ".echogrid-";
const SUFFIX: &str = ".part";

/// Why a file could not be written. What stood at its path before still stands there.
#[derive(Debug, thiserror::Error)]
#[error("{}: can't be written ({doing}): {source}", path.display())]
pub struct WriteError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// The step that failed.
    pub doing: &'static str,
    /// What the system said.
    pub source: io::Error,
}

/// A file in the making: written beside its path, put in place by [`WholeFile::commit`], and
/// removed without a trace if dropped before that.
pub(crate) struct WholeFile {
    path: PathBuf,
    temporary: BufWriter<NamedTempFile>,
}

impl WholeFile {
    pub(crate) fn create(path: &Path) -> Result<Self, WriteError> {
        let fail = |source| WriteError { path: path.to_path_buf(), doing: "creating a file beside it", source };
        if path.is_dir() {
            let source = io::Error::new(
                io::ErrorKind::IsADirectory,
                "a folder of this name stands there; expected a file or nothing",
            );
            return Err(WriteError { path: path.to_path_buf(), doing: "looking at it", source });
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // The umask takes away what it takes from any new file.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let temporary = builder.tempfile_in(folder(path)).map_err(fail)?;
        // Tells that somebody is at it; where the file system knows no locks, nobody is told.
        let _ = temporary.as_file().try_lock();
        Ok(Self { path: path.to_path_buf(), temporary: BufWriter::with_capacity(1 << 16, temporary) })
    }

    /// An error of writing to it.
    pub(crate) fn failed(&self, source: io::Error) -> WriteError {
        WriteError { path: self.path.clone(), doing: "writing", source }
    }

    /// Puts it in place: from now on the path holds all of it, whatever happens to the machine.
    pub(crate) fn commit(self) -> Result<(), WriteError> {
        self.store()?.put_in_place()
    }

    /// Brings all of it to the disk, still beside its path.
    fn store(self) -> Result<Stored, WriteError> {
        let Self { path, temporary } = self;
        let fail = |doing, source| WriteError { path: path.clone(), doing, source };
        let temporary = temporary.into_inner().map_err(|error| fail("writing", error.into_error()))?;
        temporary.as_file().sync_all().map_err(|error| fail("storing", error))?;
        Ok(Stored { path, temporary })
    }
}

/// A file that is complete, and not yet at its place.
struct Stored {
    path: PathBuf,
    temporary: NamedTempFile,
}

impl Stored {
    fn put_in_place(self) -> Result<(), WriteError> {
        let Self { path, temporary } = self;
        let fail = |doing, source| WriteError { path: path.clone(), doing, source };
        temporary.persist(&path).map_err(|error| fail("putting in place", error.error))?;
        sync_folder(folder(&path)).map_err(|error| fail("storing its folder", error))
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.flush()
    }
}

/// Writes bytes to a file, whole or not at all.
///
/// # Errors
/// When it can't be written; what stood there stands there still.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    let mut file = WholeFile::create(path)?;
    file.write_all(bytes).map_err(|source| file.failed(source))?;
    file.commit()
}

/// Removes the files in the making that lie in a folder, and that nobody is at any more: their processes were killed. How many.
///
/// # Errors
/// The folder can't be read, or one of them can't be removed.
pub fn sweep_unfinished(folder: &Path) -> io::Result<usize> {
    let mut swept = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX) && entry.file_type()?.is_file()) {
            continue;
        }
        let is_held = matches!(File::open(entry.path()).map(|file| file.try_lock()), Ok(Err(TryLockError::WouldBlock)));
        if !is_held {
            match std::fs::remove_file(entry.path()) {
                // Another sweeps here, too.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                outcome => outcome.map(|()| swept += 1)?,
            }
        }
    }
    Ok(swept)
}

/// Whether a file can be written, as far as it can be known before: for whoever works long for what it will hold.
/// Nothing is changed.
///
/// # Errors
/// When it can't.
pub fn probe_file(path: &Path) -> Result<(), WriteError> {
    WholeFile::create(path).map(drop)
}

/// Writes files that tell of each other: none is put in place before all are stored, as a full disk would part them.
///
/// # Errors
/// When one can't be written.
pub(crate) fn write_together(files: &[(PathBuf, Vec<u8>)]) -> Result<(), WriteError> {
    let store = |(path, bytes): &(PathBuf, Vec<u8>)| {
        let mut file = WholeFile::create(path)?;
        file.write_all(bytes).map_err(|source| file.failed(source))?;
        file.store()
    };
    let stored: Vec<Stored> = files.iter().map(store).collect::<Result<_, _>>()?;
    stored.into_iter().try_for_each(Stored::put_in_place)
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder)?.sync_all() {
        // Some file systems have no such thing.
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        outcome => outcome,
    }
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map");
        write_whole(&path, b"old").unwrap();
        let mut file = WholeFile::create(&path).unwrap();
        file.write_all(b"new").unwrap();
        drop(file);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_in_its_place_is_said_at_once() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("map.png")).unwrap();
        let error = probe_file(&folder.path().join("map.png")).unwrap_err().to_string();
        assert!(error.contains("map.png") && error.contains("a folder of this name"), "{error}");
        probe_file(&folder.path().join("map.pgm")).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_process_had_begun_is_swept_and_what_a_living_one_writes_is_not() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(".echogrid-Ab12.part"), "half").unwrap();
        std::fs::write(folder.path().join("mine.part"), "not ours").unwrap();
        let mut file = WholeFile::create(&folder.path().join("map")).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(sweep_unfinished(folder.path()).unwrap(), 1);
        file.commit().unwrap();
        assert_eq!(std::fs::read(folder.path().join("map")).unwrap(), b"new");
        assert_eq!(sweep_unfinished(folder.path()).unwrap(), 0);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn committed_replaces_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map");
        write_whole(&path, b"old").unwrap();
        write_whole(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn files_that_belong_together_are_not_parted() {
        let folder = tempfile::tempdir().unwrap();
        let (image, yaml) = (folder.path().join("map.pgm"), folder.path().join("map.yaml"));
        let files = |text: &[u8]| vec![(image.clone(), text.to_vec()), (yaml.clone(), text.to_vec())];
        write_together(&files(b"old")).unwrap();
        let mut parted = files(b"new");
        parted[1].0 = folder.path().join("nowhere/map.yaml");
        let error = write_together(&parted).unwrap_err();
        assert!(error.to_string().contains("nowhere/map.yaml"), "{error}");
        assert_eq!(
            (std::fs::read(&image).unwrap(), std::fs::read_dir(folder.path()).unwrap().count()),
            (b"old".to_vec(), 2)
        );
        write_together(&files(b"new")).unwrap();
        assert_eq!((std::fs::read(&image).unwrap(), std::fs::read(&yaml).unwrap()), (b"new".to_vec(), b"new".to_vec()));
    }

    #[test]
    fn the_error_names_the_path() {
        let error = write_whole(Path::new("/nowhere/at/all/map.png"), b"").unwrap_err();
        assert!(error.to_string().contains("/nowhere/at/all/map.png"));
    }
}
