//! Why a map could not be written or read.

use std::io;
use std::path::{Path, PathBuf};

use super::map_server::YamlError;
use super::native::NativeError;
use crate::WriteError;

/// Why a map could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// There is no such file.
    #[error("{}: no such file{}", path.display(), near.as_deref().map(|near| format!("; did you mean {}?", near.display())).unwrap_or_default())]
    NotFound {
        /// What was asked for.
        path: PathBuf,
        /// A file of nearly that name in the same folder.
        near: Option<PathBuf>,
    },
    /// The file could not be opened or read.
    #[error("{}: can't be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A native map is damaged, or none.
    #[error("{}: {source}", path.display())]
    Native {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: NativeError,
    },
    /// A map_server YAML is wrong.
    #[error("{}: {source}", path.display())]
    Yaml {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: YamlError,
    },
    /// The image of a map is wrong.
    #[error("{}: not an image of a map: {what}; expected PGM, PPM or PNG, at most {} pixels on a side", path.display(), super::map_server::SIDE_MAX)]
    Image {
        /// The image.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The known cells lie so far apart that no picture can hold them.
    #[error(
        "the known cells span {width_m:.0} m x {height_m:.0} m at {resolution_m} m per cell, which is more than a \
         picture can hold; some cell is probably far off the rest (the native map, map.echogrid, holds them all)"
    )]
    TooLarge {
        /// Extent along x, metres.
        width_m: f64,
        /// Extent along y, metres.
        height_m: f64,
        /// Side of a cell, metres.
        resolution_m: f64,
    },
}

impl MapError {
    pub(crate) fn read(path: &Path, source: io::Error) -> Self {
        if source.kind() == io::ErrorKind::NotFound {
            Self::NotFound { path: path.to_path_buf(), near: crate::near::near_file(path) }
        } else {
            Self::Read { path: path.to_path_buf(), source }
        }
    }
}
