//! Files of earlier runs in the folder that a map was saved to: they would be taken for this run's.

use std::path::PathBuf;

use anyhow::{Context, Result};
use echogrid_formats::map::MapFiles;
use echogrid_formats::map::readings::READINGS_FILE;
use echogrid_publisher::SONARS_FILE;
use echogrid_slam_service::{CLOSURES_FILE, FILES};

use crate::config::Config;

/// Removes the companions of a map that a run which has `written` these files did not make, and names maps in formats that it does not write.
/// What, in words.
///
/// # Errors
/// One can't be removed.
pub(super) fn clear(config: &Config, written: &[PathBuf]) -> Result<Vec<String>> {
    let out = &config.run.out;
    let is_there = |name: &String| out.join(name).is_file();
    let every = MapFiles::every_name();
    let is_layer = |name: &String| ["doubt.", "facing."].iter().any(|layer| name.starts_with(layer));
    let (layers, maps): (Vec<String>, Vec<String>) = every.into_iter().partition(is_layer);
    // Without closures the others may be somebody else's.
    let slam = if is_there(&CLOSURES_FILE.to_owned()) { &FILES[..] } else { &[] };
    let companions = [SONARS_FILE, READINGS_FILE].iter().chain(slam).map(|name| (*name).to_owned()).chain(layers);
    let is_read = |name: &String| {
        let file = out.join(name).canonicalize().ok();
        config.localizer.files().into_iter().any(|(_, read)| read.canonicalize().ok() == file)
    };
    let is_made = |name: &String| written.contains(&out.join(name));
    let stale: Vec<String> = companions.filter(|name| !is_made(name) && is_there(name) && !is_read(name)).collect();
    for name in &stale {
        let path = out.join(name);
        std::fs::remove_file(&path).with_context(|| format!("removing {}, of an earlier run", path.display()))?;
    }
    let made = MapFiles::names(&config.publisher.map_files());
    let others: Vec<String> = maps.into_iter().filter(|name| !made.contains(name) && is_there(name)).collect();
    let told = |what: &str, names: &[String]| {
        (!names.is_empty()).then(|| format!("{}: {what}: {}", out.display(), names.join(", ")))
    };
    let told = [told("removed, as an earlier run had saved them", &stale), told("not of this run", &others)];
    Ok(told.into_iter().flatten().collect())
}
