//! What is mapped: drives whose truth is known.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::{Grid, Pose2, World};
use echogrid_formats::{log, world};
use echogrid_judge::Quality;
use echogrid_judge::quality::Truth;

use crate::align::{Align, best};
use crate::in_process;
use crate::observer::{Observer, Seen};
use echogrid_config::{Config, LoadRequest};

/// Most floors of a range.
const FLOORS_MAX: u64 = 10_000;
/// The systematic error of the simulated robot: less than the paper's 9 %, which no calibrated robot has.
const SIMULATED: [&str; 3] = ["simulator.left_scale=0.03", "simulator.right_scale=0.0303", "simulator.axle_scale=0.01"];
/// What a log's robot is taken to be wrong by, where its file does not say.
const LOGGED: [&str; 3] = ["odometry.systematic=carry", "odometry.lin_scale=0.03", "odometry.ang_scale=0.03"];

/// A drive.
#[derive(Debug, Clone)]
pub(super) enum Drive {
    /// A simulated robot in a world.
    Simulated { world: String, seed: u64 },
    /// A log that knows where the robot really was.
    Logged { log: PathBuf, world: PathBuf, align: Align },
}

/// The drives of these worlds, with so many seeds each.
pub(super) fn simulated(worlds: &[String], seeds: u64) -> Result<Vec<Drive>> {
    let mut drives = Vec::new();
    for name in worlds {
        for world in floors(name)?.unwrap_or_else(|| vec![name.clone()]) {
            world::find(Path::new(&world))?;
            drives.extend((1..=seeds).map(|seed| Drive::Simulated { world: world.clone(), seed }));
        }
    }
    Ok(drives)
}

/// The floors of a range, as in `floor-101..110`, the last one included.
fn floors(name: &str) -> Result<Option<Vec<String>>> {
    let Some((first, last)) = name.strip_prefix("floor-").and_then(|range| range.split_once("..")) else {
        return Ok(None);
    };
    let (Ok(first), Ok(last)) = (first.parse::<u64>(), last.parse::<u64>()) else {
        bail!("{name}: expected a range of floors as in floor-101..110");
    };
    ensure!(
        first <= last && last - first < FLOORS_MAX,
        "{name}: expected up to {FLOORS_MAX} floors, the lower number first"
    );
    Ok(Some((first..=last).map(|number| format!("floor-{number}")).collect()))
}

/// A log and its world, as in `LOG=WORLD`.
pub(super) fn logged(named: &str, align: Align) -> Result<Drive> {
    let Some((log, world)) = named.split_once('=') else {
        bail!(
            "--log {named}: expected LOG=WORLD, a log that knows where the robot really was and the world that it drove in"
        );
    };
    // What can't be read is said now, not after what takes minutes.
    let survey = log::survey(Path::new(log)).with_context(|| format!("--log {named}"))?;
    ensure!(survey.true_pose_count > 0, "--log {named}: no true pose in {log}; expected lines TRUEPOS");
    world::find(Path::new(world)).with_context(|| format!("--log {named}"))?;
    Ok(Drive::Logged { log: log.into(), world: world.into(), align })
}

/// A drive, and what a map of it should show.
pub(super) struct Lesson {
    drive: Drive,
    truth: Truth,
    /// Where in the world the log begins, if its map is to be laid there.
    start: Option<Pose2>,
}

impl Lesson {
    /// Drives it once to see what can be seen: that does not depend on who maps. `sets` are those of all runs.
    pub(super) fn of(drive: &Drive, sets: &[String]) -> Result<Self> {
        let seen = drive.map(sets)?;
        let world = drive.world()?;
        let mut extent = Grid::new(seen.grid.resolution_m());
        let [low, high] = world.bounds_m();
        for cell in [extent.cell_at(low[0], low[1]), extent.cell_at(high[0], high[1])] {
            extent.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 0.0;
        }
        let truth = Truth::of(&world, &seen.true_path, &extent)?;
        let start = match (drive, seen.pairs.first()) {
            (Drive::Logged { align: Align::Start | Align::Best, .. }, Some((pose, true_pose))) => {
                Some(*true_pose * pose.inverse() * seen.first)
            }
            _ => None,
        };
        Ok(Self { drive: drive.clone(), truth, start })
    }

    /// How good a map of it is that is made so.
    pub(super) fn judge(&self, sets: &[String]) -> Result<Quality> {
        let Some(start) = self.start else { return Ok(Quality::against(&self.drive.map(sets)?.grid, &self.truth)?) };
        let from = |start: Pose2| {
            let Pose2 { x, y, theta } = start;
            let begin = format!("odometry.start=[{x:?}, {y:?}, {theta:?}]");
            self.drive.map(&std::iter::once(begin).chain(sets.iter().cloned()).collect::<Vec<_>>())
        };
        let mut seen = from(start)?;
        if matches!(self.drive, Drive::Logged { align: Align::Best, .. }) {
            seen = from(best(&seen.pairs).inverse() * start)?;
        }
        Ok(Quality::against(&seen.grid, &self.truth)?)
    }
}

impl Drive {
    fn map(&self, sets: &[String]) -> Result<Seen> {
        let config = self.config(sets)?;
        let mut observer = Observer::new(config.mapper.resolution_m, None, Vec::new());
        in_process::run(&config, &mut observer)?;
        observer.into_seen()
    }

    fn world(&self) -> Result<World> {
        let world = match self {
            Self::Simulated { world, .. } => world::find(Path::new(world))?,
            Self::Logged { world, .. } => world::find(world)?,
        };
        Ok(world.walls_only()?.0)
    }

    fn config(&self, sets: &[String]) -> Result<Config> {
        let owned = |sets: &[&str]| sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>();
        match self {
            Self::Simulated { world, seed } => {
                let drive = [format!("simulator.world={world}"), format!("simulator.seed={seed}")];
                let base: Vec<String> = owned(&SIMULATED).into_iter().chain(drive).collect();
                let calibrated = calibration(&base)?;
                let sets = base.into_iter().chain(calibrated).chain(sets.iter().cloned()).collect();
                load(LoadRequest { sensor: Some("simulator".to_owned()), sets, ..LoadRequest::default() })
            }
            Self::Logged { log, .. } => {
                let sets = owned(&LOGGED).into_iter().chain(sets.iter().cloned()).collect();
                load(LoadRequest { log: Some(log.to_string_lossy().into_owned()), sets, ..LoadRequest::default() })
            }
        }
    }
}

fn load(request: LoadRequest) -> Result<Config> {
    Ok(Config::load(&request)?.into_config())
}

/// What a calibration of the simulated robot would have found, carried as doubt.
fn calibration(base: &[String]) -> Result<[String; 7]> {
    let request = LoadRequest { sensor: Some("simulator".to_owned()), sets: base.to_vec(), ..LoadRequest::default() };
    let config = load(request).context("the simulated robot")?;
    let model = config.simulator.expected_error_model().per_way;
    Ok([
        "odometry.systematic=carry".to_owned(),
        format!("odometry.lin_scale={:e}", model.lin_scale),
        format!("odometry.ang_scale={:e}", model.ang_scale),
        format!("odometry.k_ll={:e}", model.k_ll),
        format!("odometry.k_lt={:e}", model.k_lt),
        format!("odometry.k_tt={:e}", model.k_tt),
        format!("odometry.k_tl={:e}", model.k_tl),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_floors() {
        let names = |name: &str| simulated(&[name.to_owned()], 2).map(|drives| drives.len()).map_err(|e| e.to_string());
        assert_eq!(names("floor-3..5"), Ok(6));
        assert_eq!(names("office"), Ok(2));
        assert!(names("floor-5..3").unwrap_err().contains("the lower number first"));
        assert!(names("floor-a..3").unwrap_err().contains("as in floor-101..110"));
        assert!(names("ofice").unwrap_err().contains("did you mean office"));
        assert!(logged("a.log", Align::Start).unwrap_err().to_string().contains("LOG=WORLD"));
    }
}
