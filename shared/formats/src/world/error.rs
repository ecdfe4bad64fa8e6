//! Why a world could not be read.

use std::path::{Path, PathBuf};

use echogrid_core::world::WorldError;

use crate::map::MapError;
use crate::text::TextFileError;

/// Why a world could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldFileError {
    /// The file could not be read, or its text is wrong.
    #[error(transparent)]
    File(#[from] TextFileError),
    /// An ending that says nothing.
    #[error(
        "{}: not known as a world; expected {} (which come along), floor-1, floor-2 ... (drawn by lot), .map (MobileSim), .toml (echogrid's own) or .yaml (map_server){}",
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
}
