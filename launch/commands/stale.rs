//! Files of earlier runs in the folder that a map was saved to: they would be taken for this run's.

use anyhow::{Context, Result};
use echogrid_formats::map::MapFiles;
use echogrid_formats::map::readings::READINGS_FILE;
use echogrid_publisher::SONARS_FILE;
use echogrid_slam_service::{CLOSURES_FILE, FILES};

use crate::config::Config;

/// Removes the companions of a map that a run with this configuration does not make, and names maps in formats that it does not write.
/// What, in words.
///
/// # Errors
/// One can't be removed.
pub(super) fn clear(config: &Config) -> Result<Vec<String>> {
    let out = &config.run.out;
    let is_there = |name: &String| out.join(name).is_file();
    let every = MapFiles::every_name();
    let (doubts, others): (Vec<String>, Vec<String>) = every.into_iter().partition(|name| name.starts_with("doubt."));
    let (facings, maps): (Vec<String>, Vec<String>) = others.into_iter().partition(|name| name.starts_with("facing."));
    // Without closures the others may be somebody else's.
    let slam = if is_there(&CLOSURES_FILE.to_owned()) { &FILES[..] } else { &[] };
    let mapper = &config.mapper;
    let companions = [
        (mapper.doubt, doubts),
        (mapper.facing, facings),
        (mapper.sonar_maps, vec![SONARS_FILE.to_owned()]),
        (mapper.keep_readings, vec![READINGS_FILE.to_owned()]),
        (config.does_slam(), slam.iter().map(|name| (*name).to_owned()).collect()),
    ];
    let is_read = |name: &String| {
        let file = out.join(name).canonicalize().ok();
        config.localizer.files().into_iter().any(|(_, read)| read.canonicalize().ok() == file)
    };
    let stale = companions.into_iter().filter(|(is_made, _)| !is_made).flat_map(|(_, names)| names);
    let stale: Vec<String> = stale.filter(|name| is_there(name) && !is_read(name)).collect();
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
