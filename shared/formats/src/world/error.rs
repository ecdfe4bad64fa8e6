//! Why a world could not be read.

use std::io;
use std::path::{Path, PathBuf};

use echogrid_core::world::WorldError;

use crate::map::MapError;

/// What is wrong with the text of a world.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {found}; expected {expected}")]
pub struct TextError {
    /// Counted from 1.
    pub line: usize,
    /// What stands there, shortened.
    pub found: String,
    /// What would have been right.
    pub expected: String,
}

/// Why a world could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldFileError {
    /// There is no such file.
    #[error("{}: no such file{}", path.display(), near.as_deref().map(|near| format!("; did you mean {}?", near.display())).unwrap_or_default())]
    NotFound {
        /// What was asked for.
        path: PathBuf,
        /// A file of nearly that name in the same folder.
        near: Option<PathBuf>,
    },
    /// The file could not be opened or read, or is too long.
    #[error("{}: can't be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// An ending that says nothing.
    #[error(
        "{}: not known as a world; expected {} (which come along), .map (MobileSim), .toml (echogrid's own) or .yaml (map_server){}",
        path.display(),
        super::builtin_worlds().collect::<Vec<_>>().join(", "),
        near.map(|near| format!("; did you mean {near}?")).unwrap_or_default()
    )]
    Ending {
        /// The file.
        path: PathBuf,
        /// A world that comes along, of nearly that name.
        near: Option<&'static str>,
    },
    /// The text is wrong.
    #[error("{}: {source}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: TextError,
    },
    /// A map_server map is wrong.
    #[error(transparent)]
    Map(#[from] MapError),
    /// What the file holds makes no world.
    #[error("{}: {source}", path.display())]
    World {
        /// The file.
        path: PathBuf,
        /// Why it does not.
        source: WorldError,
    },
}

impl WorldFileError {
    pub(super) fn ending(path: &Path) -> Self {
        let near = path.to_str().and_then(|name| crate::near::near_word(name, super::builtin_worlds()));
        Self::Ending { path: path.to_path_buf(), near }
    }

    pub(super) fn read(path: &Path, source: io::Error) -> Self {
        if source.kind() == io::ErrorKind::NotFound {
            Self::NotFound { path: path.to_path_buf(), near: crate::near::near_file(path) }
        } else {
            Self::Read { path: path.to_path_buf(), source }
        }
    }
}
