//! `echogrid` without a command: the drive that comes with it.

use anyhow::{Context, Result};

use crate::cli::View;
use crate::config::LoadRequest;

/// A simulated Pioneer 3-AT in an office floor; made by the project's own tests.
const DRIVE: &[u8] = include_bytes!("../demo/office.log.gz");

/// Its robot is calibrated: the odometry of that drive reads 1 % too far and turns 0.8 % too much.
const CALIBRATION: [&str; 3] =
    ["odometry.systematic=correct", "odometry.lin_scale=0.0099", "odometry.ang_scale=0.0079"];

/// Maps it, as `echogrid map` would.
pub(super) fn run() -> Result<()> {
    let folder = tempfile::tempdir().context("making a folder for the drive")?;
    let log = folder.path().join("office.log.gz");
    std::fs::write(&log, DRIVE).with_context(|| format!("writing {}", log.display()))?;
    let request = LoadRequest {
        log: Some(log.to_string_lossy().into_owned()),
        sets: CALIBRATION.map(str::to_owned).into(),
        ..LoadRequest::default()
    };
    super::graph::run(&request, &View::default())
}
