//! `[replay]`: which log is played.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// `[replay]`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ReplayConfig {
    /// The log; empty where none was given.
    pub log: PathBuf,
}
