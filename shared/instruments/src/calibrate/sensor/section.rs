//! What was learnt as a section of a configuration.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::MapperConfig;
use echogrid_formats::write_whole;

use super::report::{Learnt, Report};
use super::search::{ALL, Tried};
use echogrid_config::parse_graph;

/// Writes it, if it can be loaded again.
pub(super) fn write(file: &Path, report: &Report, given: &MapperConfig) -> Result<()> {
    let name = file.display();
    ensure!(
        report.told().any(|learnt| !learnt.is_of_robot()),
        "{name}: nothing to write; this drive tells no key of [mapper]"
    );
    let text = text(report);
    let loaded = parse_graph(&text).with_context(|| format!("{name}: what was to be written"))?;
    let mut expected = Tried { mapper: given.clone(), range_error_ratio: 0.0 };
    let mut found = Tried { mapper: loaded.mapper, range_error_ratio: 0.0 };
    for parameter in &ALL {
        if let Some(learnt) = report.told().find(|learnt| learnt.key == parameter.key && !learnt.is_of_robot()) {
            *(parameter.at)(&mut expected) = learnt.for_maps();
            ensure!(
                *(parameter.at)(&mut found) == learnt.for_maps(),
                "{name}: what was to be written would mean another {}",
                parameter.key
            );
        }
    }
    expected.mapper.validate().with_context(|| format!("{name}: what was learnt"))?;
    Ok(write_whole(file, text.as_bytes())?)
}

/// The whole file.
pub(super) fn text(report: &Report) -> String {
    // A comment ends with its line, whatever a file is called.
    let made_of: String = report.made_of().chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut text = format!(
        "# Sensor model of the sonars of {made_of}.\n\
         # Made by `echogrid calibrate sensor`; a part of a graph file (`echogrid map LOG --config FILE`).\n\n[mapper]\n"
    );
    for learnt in &report.parameters {
        let Learnt { key, unit, estimate, low, high, told, bound, .. } = learnt;
        let bound = bound.map(|bound| format!(" {bound}")).unwrap_or_default();
        let setting = format!("{key} = {:?}", learnt.for_maps());
        let _ = match (told, learnt.is_of_robot()) {
            (true, false) => {
                writeln!(text, "{setting:<36} # {unit}; best {estimate}{bound}, 95 % confidence: {low} to {high}")
            }
            (true, true) => writeln!(text, "# In [sonars] of the robot's file: {setting} ({low} to {high})"),
            (false, _) => writeln!(text, "# {key}: can't be told from this drive"),
        };
    }
    text
}
