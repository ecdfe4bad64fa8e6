//! The grid for people and other programs: picture and map files, saved at the end of the run.

pub mod config;
mod sonars;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use config::PublisherConfig;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Grid, Pose2, Tile, wrap_angle};
use echogrid_formats::map::{MapDocument, MapFiles, MapFormat, PathPoint, Provenance};
use echogrid_service::{Input, Outbox, Plan, Service, process};
use echogrid_topics::{Command, Layer, Message, PoseEstimate, TileUpdate, Topic};
use serde::Deserialize;

pub use crate::sonars::SONARS_FILE;
use crate::sonars::SonarSheet;

/// What it reads.
pub const INPUTS: &[Topic] = &[Topic::OdometryEstimate, Topic::MapTiles];
/// What it writes: nothing that a process could read.
pub const OUTPUTS: &[Topic] = &[];

/// A point joins the path when the robot has moved this far …
const PATH_STEP_M: f64 = 0.05;
/// … or turned this far since the one before.
const PATH_STEP_RAD: f64 = 0.1;

/// Points of the path that are saved as one part.
const PATH_PART: usize = 1024;

/// A point of the path, saved: stamp, pose, trust.
type Point = (u64, Pose2, f64);

/// The part of `[run]` that the publisher needs.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
}

/// The publisher service.
#[derive(Debug)]
pub struct PublisherService {
    config: PublisherConfig,
    out: PathBuf,
    provenance: Provenance,
    /// None until the first tile tells the resolution.
    grid: Option<Grid>,
    /// None unless the mapper keeps it; metres in the cells.
    doubt: Option<Grid>,
    /// Empty unless the mapper keeps a map of each sonar.
    sonars: SonarSheet,
    path: Vec<PathPoint>,
    /// The latest pose, if it is not on the path yet.
    latest: Option<PathPoint>,
    written: Vec<PathBuf>,
    /// Parts of the path that are saved and will not change.
    saved_parts: usize,
}

impl PublisherService {
    /// Saves into the folder `out` what the configuration says.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(config: PublisherConfig, out: PathBuf, provenance: Provenance) -> Result<Self> {
        config.validate().context("[publisher]")?;
        let sonars = SonarSheet::default();
        Ok(Self {
            config,
            out,
            provenance,
            grid: None,
            doubt: None,
            sonars,
            path: Vec::new(),
            latest: None,
            written: Vec::new(),
            saved_parts: 0,
        })
    }

    /// From the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let run: Run = plan.section("run")?;
        Self::new(plan.section("publisher")?, run.out, plan.section("provenance")?)
    }

    /// The files written so far.
    #[must_use]
    pub fn written(&self) -> &[PathBuf] {
        &self.written
    }

    fn follow(&mut self, stamp_ns: u64, PoseEstimate { estimate, trust, .. }: PoseEstimate) {
        let point = PathPoint { stamp_ns, pose: estimate.pose, trust };
        if self.path.last().is_none_or(|last| is_step(last.pose, point.pose)) {
            self.path.push(point);
            self.latest = None;
        } else {
            self.latest = Some(point);
        }
    }

    fn save(&mut self) -> Result<()> {
        let Some(grid) = &self.grid else {
            tracing::warn!("no reading reached the map: nothing to save");
            return Ok(());
        };
        let mut path = self.path.clone();
        path.extend(self.latest);
        let document =
            MapDocument { grid: grid.clone(), doubt: self.doubt.clone(), path, provenance: self.provenance.clone() };
        self.written = MapFiles::write_all(&self.out, &document, &self.config.map_files())?;
        if self.config.formats.contains(&MapFormat::Png) {
            self.written.extend(self.sonars.write(&self.out)?);
        }
        Ok(())
    }
}

fn is_step(from: Pose2, to: Pose2) -> bool {
    from.distance_m(to) >= PATH_STEP_M || wrap_angle(to.theta - from.theta).abs() >= PATH_STEP_RAD
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
                let tile = Tile { revision, log_odds };
                match layer {
                    Layer::Map => *self.grid.get_or_insert_with(|| Grid::new(resolution_m)).tile_mut(index) = tile,
                    Layer::Doubt => *self.doubt.get_or_insert_with(|| Grid::new(resolution_m)).tile_mut(index) = tile,
                    Layer::Sonar(sonar) => self.sonars.take(sonar, index, tile, resolution_m),
                }
            }
            Input::Message { stamp_ns, message: Message::Estimate(estimate), .. } => self.follow(stamp_ns, estimate),
            Input::Message { .. } => {}
            Input::Finish => self.save()?,
        }
        Ok(())
    }

    /// The path. The map is the mapper's to tell anew.
    fn save(&mut self, parts: &mut Parts) {
        let whole = self.path.len() / PATH_PART;
        for part in self.saved_parts..=whole {
            let points = &self.path[part * PATH_PART..self.path.len().min((part + 1) * PATH_PART)];
            let points: Vec<Point> = points.iter().map(|point| (point.stamp_ns, point.pose, point.trust)).collect();
            parts.put_value(format!("path/{part}"), &points);
        }
        self.saved_parts = whole;
        parts.put_value("latest", &self.latest.map(|point| (point.stamp_ns, point.pose, point.trust)));
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        let point = |(stamp_ns, pose, trust): Point| PathPoint { stamp_ns, pose, trust };
        self.path.clear();
        while saved.get(&format!("path/{}", self.path.len() / PATH_PART)).is_some() {
            let points: Vec<Point> = saved.value(&format!("path/{}", self.path.len() / PATH_PART))?;
            let is_last = points.len() < PATH_PART;
            self.path.extend(points.into_iter().map(point));
            if is_last {
                break;
            }
        }
        self.saved_parts = self.path.len() / PATH_PART;
        self.latest = saved.value::<Option<Point>>("latest")?.map(point);
        Ok(())
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
