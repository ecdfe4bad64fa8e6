//! `[recorder]`: what is recorded, and where.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// The recording's name where none is given.
pub const FILE: &str = "recording.mcap";

/// The `[recorder]` section: what is recorded, and where.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct RecorderConfig {
    /// The recording; empty: `recording.mcap` in the folder of the maps.
    pub file: PathBuf,
    /// Whether Foxglove's well-known messages are recorded beside echogrid's own.
    pub foxglove: bool,
}

impl Default for RecorderConfig {
    fn default() -> Self {
        Self { file: PathBuf::new(), foxglove: true }
    }
}

impl RecorderConfig {
    /// The recording of a run whose maps are saved in `out`.
    #[must_use]
    pub fn path(&self, out: &std::path::Path) -> PathBuf {
        if self.file.as_os_str().is_empty() { out.join(FILE) } else { self.file.clone() }
    }
}
