//! `echogrid` without a command: the drive that comes with it.

use anyhow::{Context, Result};

use crate::cli::View;
use crate::config::LoadRequest;

/// A simulated Pioneer 3-AT in an office floor; made by the project's own tests.
const DRIVE: &[u8] = include_bytes!("../demo/office.log.gz");

/// Maps it, as `echogrid map` would.
pub(super) fn run() -> Result<()> {
    let folder = tempfile::tempdir().context("making a folder for the drive")?;
    let log = folder.path().join("office.log.gz");
    std::fs::write(&log, DRIVE).with_context(|| format!("writing {}", log.display()))?;
    let request = LoadRequest { log: Some(log.to_string_lossy().into_owned()), ..LoadRequest::default() };
    super::graph::run(&request, &View::default())
}
