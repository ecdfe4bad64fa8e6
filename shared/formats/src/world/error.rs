//! Why a world could not be read.

use std::path::PathBuf;

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
    #[error("{}: not known as a world; expected .map (MobileSim), .toml (echogrid's own) or .yaml (map_server)", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
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
