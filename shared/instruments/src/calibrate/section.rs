//! The model as a section of a configuration.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::Calibration;
use echogrid_core::config::{OdometryConfig, Systematic};
use echogrid_formats::write_whole;

use super::report::{Report, shown};
use echogrid_config::parse_graph;

/// Writes it, if it can be loaded again.
pub(super) fn write(file: &Path, report: &Report, fit: &Calibration) -> Result<()> {
    let text = text(report);
    let loaded = parse_graph(&text).with_context(|| format!("{}: what was to be written", file.display()))?;
    let expected = fit.applied_to(&OdometryConfig { systematic: Systematic::Correct, ..OdometryConfig::default() });
    ensure!(loaded.odometry == expected, "{}: what was to be written would mean another model", file.display());
    Ok(write_whole(file, text.as_bytes())?)
}

/// The whole file.
pub(super) fn text(report: &Report) -> String {
    // A comment ends with its line, whatever a file is called.
    let made_of: String = report.made_of().chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut text = format!(
        "# Odometry error model of {made_of}.\n\
         # Made by `echogrid calibrate`; a part of a graph file (`echogrid map LOG --config FILE`) or of a robot file.\n\
         \n\
         [odometry]\n\
         systematic = \"correct\" # taken out of every increment; or \"carry\": as doubt into the sensor model\n"
    );
    for coefficient in &report.coefficients {
        let setting = format!("{} = {:?}", coefficient.key, coefficient.estimate);
        let interval = format!("{} to {}", shown(coefficient.low), shown(coefficient.high));
        let _ = writeln!(text, "{setting:<42} # {}; 95 % confidence: {interval}", coefficient.unit);
    }
    text
}
