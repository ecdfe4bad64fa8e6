//! The grid for people and other programs: picture and map files, saved at the end of the run.

pub mod config;
mod path;
mod sonars;

use std::collections::BTreeMap;
use std::path::{Path as FilePath, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use config::PublisherConfig;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::shares::Shares;
use echogrid_core::{Grid, GridSummary, Tile, TileIndex};
use echogrid_formats::map::{
    Drawable, MapDocument, MapError, MapFileOptions, MapFiles, MapFormat, PathPoint, Provenance, native,
};
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, process};
use echogrid_topics::{Command, Layer, Message, PoseEstimate, TileUpdate, Topic};
use serde::Deserialize;

use crate::path::Path;
pub use crate::sonars::SONARS_FILE;
use crate::sonars::SonarSheet;

/// The topics that the publisher reads.
pub const INPUTS: &[Topic] = &[Topic::OdometryEstimate, Topic::MapTiles];
/// What it writes: nothing that a process could read.
pub const OUTPUTS: &[Topic] = &[];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: INPUTS, looks_on: &[], writes: OUTPUTS, orders: &["save"] };

/// The part of `[run]` that the publisher needs.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
    #[serde(default)]
    r#continue: PathBuf,
}

/// Where a map is saved.
pub trait Saver: core::fmt::Debug {
    /// Saves a map into a folder; the paths written.
    ///
    /// # Errors
    /// A file can't be written: what stood there stands there still.
    fn save(&mut self, folder: &FilePath, map: &MapDocument, files: &MapFileOptions) -> Result<Vec<PathBuf>, MapError>;
}

/// The disk.
#[derive(Debug)]
struct Disk;

impl Saver for Disk {
    fn save(&mut self, folder: &FilePath, map: &MapDocument, files: &MapFileOptions) -> Result<Vec<PathBuf>, MapError> {
        MapFiles::write_all(folder, map, files)
    }
}

/// The publisher service.
#[derive(Debug)]
pub struct PublisherService {
    config: PublisherConfig,
    out: PathBuf,
    saver: Box<dyn Saver>,
    provenance: Provenance,
    /// None until the first tile tells the resolution.
    grid: Option<Grid>,
    /// None unless the mapper keeps it; metres in the cells.
    doubt: Option<Grid>,
    /// None unless the mapper tells it; angles of normals in the cells.
    facing: Option<Grid>,
    /// Empty unless the mapper keeps a map of each sonar.
    sonars: SonarSheet,
    /// Of tiles of the map: told when it is finished, or not at all.
    states: BTreeMap<TileIndex, Shares>,
    /// The path of the drives before this one.
    earlier: Vec<PathPoint>,
    path: Path,
    written: Vec<PathBuf>,
    /// What the files that were written last lack of the map, in words; empty: nothing.
    lacking: String,
    /// When the map is saved next, by the sensor's clock; none before the first pose.
    next_save_ns: Option<u64>,
}

impl PublisherService {
    /// Saves into the folder `out` what the configuration says.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(config: PublisherConfig, out: PathBuf, provenance: Provenance) -> Result<Self> {
        config.validate().context("[publisher]")?;
        let (sonars, path) = (SonarSheet::default(), Path::new(config.path_points_max));
        let saver = Box::new(Disk);
        Ok(Self {
            config,
            out,
            saver,
            provenance,
            grid: None,
            doubt: None,
            facing: None,
            sonars,
            states: BTreeMap::new(),
            earlier: Vec::new(),
            path,
            written: Vec::new(),
            lacking: String::new(),
            next_save_ns: None,
        })
    }

    /// Makes the publisher from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let run: Run = plan.section("run")?;
        let publisher = Self::new(plan.section("publisher")?, run.out, plan.section("provenance")?)?;
        let earlier = &run.r#continue;
        if earlier.as_os_str().is_empty() {
            return Ok(publisher);
        }
        Ok(publisher.after(native::read_path(earlier).context("run.continue")?))
    }

    /// The path of the drives that this one goes on with.
    #[must_use]
    pub fn after(mut self, earlier: Vec<PathPoint>) -> Self {
        self.earlier = earlier;
        self
    }

    /// Saves elsewhere than on the disk.
    #[must_use]
    pub fn saving_by(mut self, saver: Box<dyn Saver>) -> Self {
        self.saver = saver;
        self
    }

    /// The files written so far.
    #[must_use]
    pub fn written(&self) -> &[PathBuf] {
        &self.written
    }

    /// Saves the map as it grows, where that was asked for. What can't be written now may be later.
    fn save_in_time(&mut self, stamp_ns: u64) {
        if self.config.save_every_s <= 0.0 {
            return;
        }
        let every_ns = (self.config.save_every_s * 1e9) as u64;
        let next_ns = *self.next_save_ns.get_or_insert(stamp_ns.saturating_add(every_ns));
        if stamp_ns < next_ns {
            return;
        }
        self.next_save_ns = Some(stamp_ns.saturating_add(every_ns));
        if self.grid.is_some()
            && let Err(error) = self.save()
        {
            tracing::warn!(%error, "the map so far is not saved");
        }
    }

    fn save(&mut self) -> Result<()> {
        // Not a copy: the map may be half of what memory there is.
        let Some(grid) = self.grid.take() else {
            tracing::warn!("no reading reached the map: nothing to save");
            return Ok(());
        };
        let path = [self.earlier.as_slice(), self.path.points().as_slice()].concat();
        let (doubt, facing) = (self.doubt.take(), self.facing.take());
        let document = MapDocument { grid, doubt, facing, path, provenance: self.provenance.clone() };
        let saved = self.write(&document);
        (self.grid, self.doubt, self.facing) = (Some(document.grid), document.doubt, document.facing);
        saved
    }

    fn write(&mut self, document: &MapDocument) -> Result<()> {
        // For the log alone.
        let begun = Instant::now();
        self.written = self.saver.save(&self.out, document, &self.config.map_files())?;
        self.lacking = match Drawable::missing_of(document) {
            Ok(None) => String::new(),
            Ok(Some(missing)) => format!("all files but map.echogrid lack {missing}"),
            Err(error) => format!("only map.echogrid can hold the map: {error}"),
        };
        if !self.lacking.is_empty() {
            tracing::warn!("{}", self.lacking);
        }
        if self.config.formats.contains(&MapFormat::Png) {
            self.written.extend(self.sonars.write(&self.out)?);
        }
        let cells = GridSummary::of(&document.grid).known;
        let (files, seconds) = (self.written.len(), begun.elapsed().as_secs_f64());
        tracing::info!(files, cells, seconds, folder = %self.out.display(), "saved");
        Ok(())
    }
}

impl Service for PublisherService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { message: Message::Tile(tile), .. } => {
                let TileUpdate { layer, index, revision, resolution_m, log_odds } = tile;
                let tile = Tile::new(revision, log_odds);
                let grid = match layer {
                    Layer::Map => &mut self.grid,
                    Layer::Doubt => &mut self.doubt,
                    Layer::Facing => &mut self.facing,
                    Layer::Sonar(sonar) => {
                        self.sonars.take(sonar, index, tile, resolution_m);
                        return Ok(());
                    }
                    Layer::State(state) => {
                        self.states.entry(index).or_default().set_state(usize::from(state), &tile.log_odds);
                        return Ok(());
                    }
                };
                *grid.get_or_insert_with(|| Grid::new(resolution_m)).tile_mut(index) = tile;
            }
            Input::Message { stamp_ns, message: Message::Estimate(estimate), .. } if !estimate.unplaced => {
                let PoseEstimate { estimate, trust, .. } = estimate;
                self.path.follow(PathPoint { stamp_ns, pose: estimate.pose, trust });
                self.save_in_time(stamp_ns);
            }
            Input::Message { .. } => {}
            Input::Finish => {
                // Before, some are told and some are not, and none would be of the map as it is then.
                if let Some(grid) = &mut self.grid {
                    let states = core::mem::take(&mut self.states);
                    states.into_iter().for_each(|(index, states)| grid.tile_mut(index).shares = Some(states));
                }
                self.save()?;
            }
        }
        Ok(())
    }

    /// The path. The map is the mapper's to tell anew.
    fn save(&mut self, parts: &mut Parts) {
        self.path.save(parts);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.path.restore(saved)
    }

    fn note(&self) -> String {
        self.lacking.clone()
    }

    fn command(&mut self, command: Command, _out: &mut Outbox) -> Result<String> {
        let Command::Save = command else { bail!("this service has nothing to {}", command.word()) };
        ensure!(self.grid.is_some(), "there is no map yet");
        self.save()?;
        Ok(format!("saved in {}", self.out.display()))
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("publisher", INPUTS, OUTPUTS, PublisherService::from_plan)
}
