//! Readings and pose estimates in, occupancy grid out (paper section 3.2, Algorithm 1).
//!
//! The mapper needs the pose at the stamp of each reading: it waits until estimates bracket it and
//! interpolates. So the map depends on the data only, never on which process ran first.

mod going_on;
mod readings;
mod saving;
mod trajectory;
mod unplaced;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use echogrid_core::kept::KeptReadings;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{
    Chunks, GridMapper, GridSummary, Incidents, MapperConfig, OdometryConfig, Plane, Reading, Remapped, Robot,
    SensorKind, TILE_CELLS, TileIndex, Verdict, VerdictCounts,
};
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, process};
use echogrid_topics::contract::MAX_SENSORS;
use echogrid_topics::{Command, Layer, MapInfo, Message, TileUpdate, Topic};
use readings::ReadingsFile;
use serde::{Deserialize, Serialize};
use trajectory::{Rectified, Trajectory};

/// The topics that the mapper reads.
pub const INPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryEstimate, Topic::RangeScan];
/// The topics that the mapper writes.
pub const OUTPUTS: &[Topic] = &[Topic::MapTiles, Topic::MapInfo, Topic::RangeVerdict];
/// What it declares of itself.
pub const DECLARATION: Declaration =
    Declaration { reads: INPUTS, looks_on: &[], writes: OUTPUTS, orders: &["save", "pause", "resume", "tell tiles"] };

/// Where a log is played as fast as it goes, changed tiles go out this often, by the sensor's clock.
const TILES_EVERY_NS: u64 = 500_000_000;
/// Numbers of the whole map go out this often, by the sensor's clock.
const INFO_EVERY_NS: u64 = 2_000_000_000;

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Scan {
    sequence: u64,
    stamp_ns: u64,
    readings: Vec<Reading>,
}

impl Scan {
    /// When its last reading was taken.
    fn end_ns(&self) -> u64 {
        let latest = self.readings.iter().map(|reading| reading.offset_ns).max().unwrap_or(0);
        self.stamp_ns.saturating_add_signed(i64::from(latest))
    }
}

/// The part of `[run]` that the mapper needs.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
    #[serde(default)]
    r#continue: PathBuf,
}

/// The mapper service.
#[derive(Debug)]
pub struct MapperService {
    config: MapperConfig,
    odometry: OdometryConfig,
    robot: Option<Robot>,
    /// Whether the robot is among what was saved.
    robot_saved: bool,
    /// None until the robot is known.
    mapper: Option<GridMapper>,
    trajectory: Trajectory,
    /// Scans whose poses are not known yet.
    waiting: VecDeque<Scan>,
    /// How many have waited, and what of them is saved.
    waited: u64,
    waiting_saved: Chunks,
    /// By the last verdict of each reading: a fix may change one.
    counts: VerdictCounts,
    /// Readings fused again after a fix, and readings that no fix can change any more though one came.
    remapped: (u64, u64),
    /// Of each sonar, by its number.
    sonar_counts: Vec<VerdictCounts>,
    /// The map of an earlier drive that is yet to be gone on with, and the number of its last scan once it was.
    earlier: Option<PathBuf>,
    scans_before: u64,
    /// When it became known where the map lies, until all scans before that have come.
    placed_ns: Option<u64>,
    /// None unless readings are kept, and somebody said where.
    readings_file: Option<ReadingsFile>,
    /// By the user.
    paused: bool,
    scans: u64,
    revision: u64,
    stamp_ns: u64,
    /// How often changed tiles go out, by the sensor's clock: what is sent depends on the data alone.
    tiles_every_ns: u64,
    tiles_due_ns: u64,
    info_due_ns: u64,
    finished: bool,
}

impl MapperService {
    /// Makes the mapper from the configuration; of `odometry` the noise rule and the seed count.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(config: &MapperConfig, odometry: &OdometryConfig) -> Result<Self> {
        config.validate().context("[mapper]")?;
        Ok(Self {
            config: config.clone(),
            odometry: odometry.clone(),
            robot: None,
            robot_saved: false,
            mapper: None,
            trajectory: Trajectory::default(),
            waiting: VecDeque::new(),
            waited: 0,
            waiting_saved: Chunks::new(saving::WAITING_CHUNK),
            counts: VerdictCounts::default(),
            remapped: (0, 0),
            sonar_counts: Vec::new(),
            earlier: None,
            scans_before: 0,
            placed_ns: None,
            readings_file: None,
            paused: false,
            scans: 0,
            revision: 0,
            stamp_ns: 0,
            tiles_every_ns: TILES_EVERY_NS,
            tiles_due_ns: 0,
            info_due_ns: 0,
            finished: false,
        })
    }

    /// Makes the mapper from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let run: Run = plan.section("run")?;
        let mapper = Self::new(&plan.section("mapper")?, &plan.section("odometry")?)?;
        let mapper = mapper.saving_readings_in(run.out).at_rate(plan.rate);
        Ok(if run.r#continue.as_os_str().is_empty() { mapper } else { mapper.going_on_with(run.r#continue) })
    }

    /// Goes on with the map of an earlier drive, a native one, once it is known where in it the robot is.
    #[must_use]
    pub fn going_on_with(mut self, map: PathBuf) -> Self {
        self.earlier = Some(map);
        self
    }

    /// Tells changed tiles as often as `mapper.tiles_every_s` says, for a sensor that is so many times as fast as real time; none: as
    /// fast as the map can be made, where nobody waits for a single tile.
    #[must_use]
    pub fn at_rate(mut self, rate: Option<f64>) -> Self {
        let every_ns = |rate: f64| (self.config.tiles_every_s * rate * 1e9) as u64;
        self.tiles_every_ns = rate.map_or(TILES_EVERY_NS, every_ns);
        self
    }

    /// Saves the readings that it keeps in this folder, at the end and on demand; if `mapper.keep_readings` is set.
    #[must_use]
    pub fn saving_readings_in(mut self, folder: PathBuf) -> Self {
        self.readings_file = self.config.keep_readings.then(|| ReadingsFile::new(folder));
        self
    }

    /// The robot, and the readings that were kept of it; none unless `mapper.keep_readings` is set and there is a robot.
    #[must_use]
    pub fn kept_readings(&self) -> Option<(&Robot, &KeptReadings)> {
        self.robot.as_ref().zip(self.mapper.as_ref().and_then(GridMapper::kept_readings))
    }

    /// Makes the mapper for a robot.
    fn begin(&mut self, robot: Robot) -> Result<()> {
        let OdometryConfig { noise, seed, .. } = self.odometry;
        let sonars = robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Sonar);
        let sonars: usize = sonars.map(|sensor| usize::from(sensor.transducers)).sum();
        self.sonar_counts = vec![VerdictCounts::default(); sonars.min(MAX_SENSORS)];
        if let Some(file) = &mut self.readings_file {
            file.set_robot(robot.clone());
        }
        self.mapper = Some(GridMapper::new(&self.config, noise, seed, robot.clone()).context("[mapper]")?);
        self.robot = Some(robot);
        Ok(())
    }

    /// Takes in what is left, and tells and saves the map as it is in the end.
    fn finish(&mut self, out: &mut Outbox) -> Result<()> {
        self.hold_those_without_room(out);
        // What is still not bracketed never will be: those readings have no pose.
        while self.mapper.is_some() && !self.waiting.is_empty() {
            self.integrate_oldest(out);
        }
        self.rectify(u64::MAX, self.revision.saturating_add(1));
        self.publish_tiles(out);
        self.send_states(out);
        self.finished = true;
        self.publish_info(out);
        self.save_readings()?;
        Ok(())
    }

    /// The file; none unless readings are kept, or when there is no robot yet.
    fn save_readings(&self) -> Result<Option<PathBuf>> {
        let kept = self.mapper.as_ref().and_then(GridMapper::kept_readings);
        let Some((file, kept)) = self.readings_file.as_ref().zip(kept) else { return Ok(None) };
        file.write(&self.config, kept).map(Some)
    }

    /// Integrates every waiting scan whose poses are known by now.
    fn integrate_bracketed(&mut self, out: &mut Outbox) {
        if self.waits_for_the_place_of_the_map(out) {
            return;
        }
        while self.waiting.front().is_some_and(|scan| self.trajectory.reaches(scan.end_ns())) {
            self.integrate_oldest(out);
        }
    }

    /// Readings before a fix that came before `stamp_ns` are fused again; tiles get `revision`.
    fn rectify(&mut self, stamp_ns: u64, revision: u64) {
        let Some(mapper) = self.mapper.as_mut() else { return };
        while let Some(Rectified { before, after, .. }) = self.trajectory.fix_before(stamp_ns) {
            let Remapped { readings, left, verdicts } = mapper.rectify(revision, &before, &after);
            for (transducer, before, now) in verdicts {
                self.counts.change(before, now);
                let sonar = mapper.sonar_of(transducer).and_then(|n| self.sonar_counts.get_mut(usize::from(n)));
                sonar.into_iter().for_each(|counts| counts.change(before, now));
            }
            if left > 0 && self.remapped.1 == 0 {
                tracing::warn!(
                    readings = left,
                    "a fix came too late or too far off to rectify readings before it; they stay in the map as they were \
                     (mapper.remap_readings_max are kept)"
                );
            }
            self.remapped = (self.remapped.0 + readings, self.remapped.1 + left);
        }
    }

    fn integrate_oldest(&mut self, out: &mut Outbox) {
        self.take_oldest(false, out);
    }

    /// Integrates the oldest scan that waits, or holds it.
    fn take_oldest(&mut self, is_held: bool, out: &mut Outbox) {
        if let Some(Scan { stamp_ns, sequence, .. }) = self.waiting.front() {
            self.rectify(*stamp_ns, self.scans_before + *sequence);
        }
        if self.mapper.is_none() {
            return;
        }
        let Some(mut scan) = self.waiting.pop_front() else { return };
        scan.sequence += self.scans_before;
        self.waited += 1;
        let verdicts = self.integrate(&scan, is_held);
        self.trajectory.forget_before(scan.stamp_ns);
        self.scans += 1;
        self.revision = scan.sequence;
        self.stamp_ns = scan.stamp_ns;
        out.send(scan.stamp_ns, Message::Verdicts(verdicts));
        if scan.stamp_ns >= self.tiles_due_ns {
            self.tiles_due_ns = scan.stamp_ns.saturating_add(self.tiles_every_ns);
            self.publish_tiles(out);
            // After the tiles: what they changed is what the numbers are about.
            if scan.stamp_ns >= self.info_due_ns {
                self.info_due_ns = scan.stamp_ns.saturating_add(INFO_EVERY_NS);
                self.publish_info(out);
            }
        }
    }

    /// Takes in a scan: the transducer and the verdict of each of its readings, in their order.
    fn integrate(&mut self, scan: &Scan, is_held: bool) -> Vec<(u16, Verdict)> {
        let Some(mapper) = self.mapper.as_mut() else { return Vec::new() };
        if let Some(file) = &mut self.readings_file {
            file.begin_scan(scan.sequence, scan.stamp_ns);
        }
        // What is held is not judged either: where the robot was then is hardly known.
        let (mut held, mut judged) = (Vec::with_capacity(scan.readings.len()), Vec::new());
        for reading in &scan.readings {
            let estimate = self.trajectory.at(scan.stamp_ns.saturating_add_signed(i64::from(reading.offset_ns)));
            let is_held = self.paused || estimate.is_some_and(|(_, hold)| hold || is_held);
            held.push(is_held);
            if !is_held {
                judged.push((*reading, estimate.map(|(estimate, _)| estimate)));
            }
        }
        let mut judged = mapper.integrate_scan(scan.sequence, &judged).into_iter();
        let mut verdicts = Vec::with_capacity(scan.readings.len());
        for (Reading { transducer, .. }, is_held) in scan.readings.iter().zip(held) {
            let verdict = if is_held { Verdict::Held } else { judged.next().unwrap_or(Verdict::Held) };
            self.counts.add(verdict);
            let sonar = mapper.sonar_of(*transducer).and_then(|n| self.sonar_counts.get_mut(usize::from(n)));
            sonar.into_iter().for_each(|counts| counts.add(verdict));
            verdicts.push((*transducer, verdict));
        }
        verdicts
    }

    fn publish_tiles(&mut self, out: &mut Outbox) {
        let Some(mapper) = self.mapper.as_mut() else { return };
        let (tiles, of_sonars) = (mapper.take_changed(), mapper.take_changed_of_sonars());
        self.send_tiles(out, tiles, of_sonars);
    }

    fn send_tiles(
        &self,
        out: &mut Outbox,
        tiles: impl IntoIterator<Item = TileIndex>,
        of_sonars: impl IntoIterator<Item = (u16, TileIndex)>,
    ) {
        let Some(mapper) = self.mapper.as_ref() else { return };
        let mut send = |layer, index, revision, cells: &[f32]| {
            let mut log_odds = Box::new([f32::NAN; TILE_CELLS]);
            log_odds.copy_from_slice(cells);
            let resolution_m = self.config.resolution_m;
            let update = TileUpdate { layer, index, revision, resolution_m, log_odds };
            out.send(self.stamp_ns, Message::Tile(update));
        };
        for index in tiles {
            let Some((tile, shown)) = mapper.grid().tile(index).zip(mapper.shown_tile(index)) else { continue };
            send(Layer::Map, index, shown.revision, shown.log_odds.as_slice());
            for (plane, cells) in tile.planes() {
                if let Some(layer) = layer_of(plane) {
                    send(layer, index, shown.revision, cells);
                }
            }
            if let Some(facings) = self.config.facing.then(|| mapper.facings(index)).flatten() {
                send(Layer::Facing, index, shown.revision, facings.as_slice());
            }
        }
        for (sonar, index) in of_sonars {
            let Some(tile) = mapper.sonar_grid(sonar).and_then(|grid| grid.tile(index)) else { continue };
            send(Layer::Sonar(sonar), index, tile.revision, tile.log_odds.as_slice());
        }
    }

    /// Sends all there is of every layer, and the map in numbers, to a publisher that has nothing. What comes after is as if this
    /// had not been.
    pub fn snapshot(&mut self, out: &mut Outbox) {
        let Some(mapper) = &self.mapper else { return };
        let tiles = mapper.grid().tiles().map(|(index, _)| index);
        let sonars = (0..self.sonar_counts.len()).filter_map(|sonar| u16::try_from(sonar).ok());
        let of_sonar = |sonar| {
            let tiles = mapper.sonar_grid(sonar).into_iter().flat_map(echogrid_core::Grid::tiles);
            tiles.map(move |(index, _)| (sonar, index))
        };
        self.send_tiles(out, tiles, sonars.flat_map(of_sonar));
        if self.finished {
            self.send_states(out);
        }
        if self.scans > 0 {
            let info = self.info(GridSummary::of(&mapper.shown()));
            out.send(self.stamp_ns, Message::Info(info));
        }
    }

    fn publish_info(&mut self, out: &mut Outbox) {
        let summary = self.mapper.as_mut().map(GridMapper::summary).unwrap_or_default();
        let info = self.info(summary);
        out.send(self.stamp_ns, Message::Info(info));
    }

    fn info(&self, summary: GridSummary) -> MapInfo {
        let latest = self.trajectory.latest();
        MapInfo {
            revision: self.revision,
            scans: self.scans,
            cells_known: summary.known,
            cells_occupied: summary.occupied,
            cells_free: summary.free,
            entropy_bits: summary.entropy_bits,
            trust: latest.map_or(1.0, |latest| latest.trust),
            distance_m: latest.map_or(0.0, |latest| latest.distance_m),
            bounds: summary.bounds,
            verdicts: self.counts,
            remapped: self.remapped.0,
            remap_left: self.remapped.1,
            finished: self.finished,
            degraded: latest.is_some_and(|latest| latest.degraded),
            held: self.paused || latest.is_some_and(|latest| latest.hold),
            fixes: latest.map_or(0, |latest| latest.estimate.fixes),
            fixes_refused: latest.map_or(0, |latest| latest.estimate.refused),
            unplaced: self.trajectory.is_unplaced(),
            leaps: latest.map_or_else(Incidents::default, |latest| latest.leaps),
            contradictions: latest.map_or_else(Incidents::default, |latest| latest.contradictions),
            sonars: self.sonar_counts.clone(),
        }
    }
}

/// The layer of `map/tiles` that a plane is published as, if it is.
fn layer_of(plane: Plane) -> Option<Layer> {
    match plane {
        Plane::Doubt => Some(Layer::Doubt),
        Plane::DoubtWeight | Plane::LogOddsBefore => None,
    }
}

impl Service for MapperService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { message: Message::Robot(robot), .. } => {
                if self.mapper.is_none() {
                    self.begin(robot)?;
                    self.go_on()?;
                }
            }
            Input::Message { stamp_ns, message: Message::Estimate(estimate), .. } => {
                self.follow(stamp_ns, estimate);
                self.go_on()?;
                self.integrate_bracketed(out);
            }
            Input::Message { sequence, stamp_ns, message: Message::Scan(readings) } => {
                self.waiting.push_back(Scan { sequence, stamp_ns, readings });
                self.integrate_bracketed(out);
            }
            Input::Message { .. } => {}
            Input::Finish => self.finish(out)?,
        }
        Ok(())
    }

    fn save(&mut self, parts: &mut Parts) {
        // The inherent one.
        Self::save(self, parts);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        Self::restore(self, saved)
    }

    fn welcome(&mut self, topic: Topic, out: &mut Outbox) {
        if topic == Topic::MapTiles {
            self.snapshot(out);
        }
    }

    fn command(&mut self, command: Command, out: &mut Outbox) -> Result<String> {
        let (paused, done, already) = match command {
            Command::Pause => (true, "mapping pauses", "mapping was paused already"),
            Command::Save => {
                let saved =
                    self.save_readings()?.context("there are no readings to save (mapper.keep_readings keeps them)")?;
                return Ok(format!("saved {}", saved.display()));
            }
            Command::Tiles => {
                self.snapshot(out);
                return Ok("every tile is told once more".to_owned());
            }
            Command::Resume => (false, "mapping goes on", "mapping was not paused"),
            _ => bail!("this service has nothing to {}", command.word()),
        };
        let changed = std::mem::replace(&mut self.paused, paused) != paused;
        tracing::info!(stamp_ns = self.stamp_ns, changed, "{done}, as the user says");
        Ok(if changed { done } else { already }.to_owned())
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("mapper", INPUTS, OUTPUTS, MapperService::from_plan)
}
