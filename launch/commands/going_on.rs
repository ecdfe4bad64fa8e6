//! What is looked at before a drive goes on with the map of an earlier one.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::config::{Fusion, MapperConfig};
use echogrid_core::{Robot, SensorKind};
use echogrid_formats::map::{MapDocument, native};
use serde::Deserialize;
use toml::Table;

use crate::config::{Config, MAP_FILE};
use crate::summary::Incident;

/// Settings of the mapper that may be others: what is told and kept besides, and which readings are taken.
const MAY_DIFFER: [&str; 19] = [
    "tiles_every_s",
    "remap",
    "remap_readings_max",
    "sonar_maps",
    "doubt",
    "facing",
    "keep_readings",
    "keep_readings_max",
    "filters",
    "filter_rings",
    "bubble_rings",
    "stuck_after_m",
    "lone_tolerance_m",
    "bubble_tolerance_m",
    "sonars",
    "min_range_m",
    "max_range_m",
    "min_trust",
    "footprint_m",
];

/// The part of what a map says of its making that matters here.
#[derive(Debug, Deserialize)]
struct Made {
    mapper: MapperConfig,
    #[serde(default)]
    robot: Option<Robot>,
}

/// Of each drive that this one goes on with what its map is made of; none where it goes on with none.
///
/// # Errors
/// The map can't be read, or can't be gone on with.
pub(super) fn check(config: &Config) -> Result<Vec<String>> {
    let file = &config.run.r#continue;
    if file.as_os_str().is_empty() {
        return Ok(Vec::new());
    }
    let map = native::read(file).context("--continue (run.continue)")?;
    fits(&map, &config.mapper).with_context(|| format!("{}: can't be gone on with (--continue)", file.display()))?;
    let out = config.run.out.join(MAP_FILE);
    ensure!(
        !is_same(&out, file),
        "{}: is what this run would save its own map as; name another folder with --out",
        file.display()
    );
    let provenance = map.provenance;
    Ok(provenance.earlier.into_iter().chain([provenance.log_sha256.unwrap_or_else(|| "live".to_owned())]).collect())
}

/// Whoever goes on with a map must not take for the map of both what was told to be where the odometry says that it is not.
///
/// # Errors
/// It was.
pub(super) fn check_places(earlier: Option<&Path>, contradictions: Option<&Incident>) -> Result<()> {
    let (Some(file), Some(contradicted)) = (earlier, contradictions) else { return Ok(()) };
    let (file, count) = (file.display(), contradicted.count);
    bail!(
        "{file}: {count} times the robot was found in it where the odometry says that it is not ({}): places there look alike, it is \
         another building, or the odometry is worse than it is said to be (docs/calibration.md). The map of both that was saved is not to be trusted; the earlier one is as it was",
        contradicted.words()
    )
}

fn is_same(a: &Path, b: &Path) -> bool {
    a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// What is added must mean what is there.
fn fits(map: &MapDocument, mapper: &MapperConfig) -> Result<()> {
    let made: Made = toml::from_str(&map.provenance.config_toml)
        .context("it does not say with which settings it was made; expected a map of `echogrid map`")?;
    let (then, now) = (Table::try_from(&made.mapper)?, Table::try_from(mapper)?);
    let others = now.iter().filter(|(key, value)| !MAY_DIFFER.contains(&key.as_str()) && then.get(*key) != Some(value));
    let others: Vec<String> = others
        .filter_map(|(key, value)| Some(format!("mapper.{key} is {value} now and was {}", then.get(key)?)))
        .collect();
    ensure!(others.is_empty(), "{}; expected the settings that it was made with", others.join(", "));
    let is_oriented = made.mapper.fusion.of(SensorKind::Sonar) == Fusion::Oriented;
    let has_sonars = |robot: &Robot| robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Sonar);
    let needs_states = is_oriented && made.robot.as_ref().is_some_and(has_sonars);
    if needs_states && !map.grid.tiles().any(|(_, tile)| tile.shares.is_some()) {
        bail!(
            "it lacks the states of its cells, which mapper.fusion = \"oriented\" goes on with: it was saved while its drive went on, or \
             by an earlier version; map that drive again"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use echogrid_core::shares::Shares;
    use echogrid_core::{Grid, TileIndex};
    use echogrid_formats::map::Provenance;

    use super::*;
    use crate::config::known_robots;

    fn map(config_toml: String) -> MapDocument {
        let provenance = Provenance { config_toml, ..Provenance::default() };
        let mut grid = Grid::new(0.05);
        grid.tile_mut(TileIndex { x: 0, y: 0 }).log_odds[0] = 1.0;
        MapDocument { grid, doubt: None, facing: None, path: Vec::new(), provenance }
    }

    /// What a map says that was made with the defaults on such a robot.
    fn made(robot: &str) -> String {
        let (mapper, robot) = (MapperConfig::default(), known_robots().remove(robot).unwrap());
        let table = [("mapper", Table::try_from(mapper).unwrap()), ("robot", Table::try_from(robot).unwrap())];
        toml::to_string(&std::collections::BTreeMap::from(table)).unwrap()
    }

    #[test]
    fn a_drive_that_was_found_in_wrong_places_is_no_success() {
        let wrong = Incident { count: 10, first_s: 95.1, first_ns: 0, largest_m: 34.8, largest_rad: 0.17 };
        let first = Some(Path::new("first"));
        let error = check_places(first, Some(&wrong)).unwrap_err().to_string();
        assert!(error.contains("first: 10 times") && error.contains("34.8"), "{error}");
        assert!(check_places(first, None).is_ok() && check_places(None, Some(&wrong)).is_ok());
    }

    #[test]
    fn what_would_mean_something_else_is_refused() {
        let refused = |map: &MapDocument, change: fn(&mut MapperConfig)| {
            let mut mapper = MapperConfig::default();
            change(&mut mapper);
            fits(map, &mapper).err().map(|error| error.to_string()).unwrap_or_default()
        };
        let lidars = map(made("laser"));
        assert_eq!(refused(&lidars, |_| {}), "");
        assert_eq!(refused(&lidars, |mapper| mapper.min_trust = 0.1), "");
        let other = refused(&lidars, |mapper| (mapper.resolution_m, mapper.p_free) = (0.1, 0.4));
        assert!(
            other.contains("mapper.p_free is 0.4 now and was 0.3, mapper.resolution_m is 0.1 now and was 0.05"),
            "{other}"
        );
        assert!(refused(&map(String::new()), |_| {}).contains("does not say with which settings"));
        let mut sonars = map(made("pioneer3at"));
        assert!(refused(&sonars, |_| {}).contains("it lacks the states of its cells"));
        sonars.grid.tile_mut(TileIndex { x: 0, y: 0 }).shares = Some(Shares::default());
        assert_eq!(refused(&sonars, |_| {}), "");
    }
}
