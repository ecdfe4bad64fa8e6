//! What was heard on a drive, as a mapper has it.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::config::Fusion;
use echogrid_core::foretell::foretell;
use echogrid_core::kept::KeptReading;
use echogrid_core::{Echo, MapperConfig, Robot, SensorKind, Verdict};
use echogrid_mapper::MapperService;
use echogrid_service::{Input, Outbox, Service};
use echogrid_topics::Topic;

use crate::calibrate::CalibrateSensor;
use crate::in_process;
use echogrid_config::{Config, LoadRequest};

/// A new map is begun after so much of the way: what the odometry drifts by meanwhile is little, and the doubt of that is carried.
const PIECE_M: f64 = 30.0;
/// What lies within so much of the way has to do with each other, metres.
const BLOCK_M: f64 = 2.0;
/// What moves less stands still, metres.
const STEP_M: f64 = 0.1;
/// So many echoes are asked about, at most.
const ASKED_MAX: usize = 4000;
/// Fewer tell nothing, and so do fewer blocks.
const ECHOES_MIN: usize = 200;
const BLOCKS_MIN: usize = 8;

/// The sonars of a drive.
pub(super) struct Heard {
    pub(super) mapper: MapperConfig,
    pub(super) robot: Robot,
    readings: Vec<KeptReading>,
    /// Where a new map begins, and in which block each reading is.
    begins: Vec<usize>,
    block_of: Vec<usize>,
    pub(super) blocks: usize,
    pub(super) way_m: f64,
    pub(super) echoes: usize,
    every: usize,
}

impl Heard {
    pub(super) fn of(request: &CalibrateSensor) -> Result<Self> {
        let log = &request.log;
        let config = Config::load(&load_request(request, log))?.into_config();
        let rule = config.mapper.fusion.of(SensorKind::Sonar);
        ensure!(
            rule == Fusion::Oriented,
            "mapper.fusion = {}: expected \"auto\" or \"oriented\", whose parameters are learnt",
            format!("{rule:?}").to_lowercase()
        );
        let mut mapper = MapperService::new(&config.mapper, &config.resolved_odometry())?;
        in_process::run_through(&config, &mut mapper, &mut Nobody)?;
        let name = log.display();
        let (robot, kept) = mapper.kept_readings().with_context(|| format!("{name}: no reading in it"))?;
        let sonars = robot.sensors.iter().any(|sensor| sensor.kind == SensorKind::Sonar);
        ensure!(sonars, "{name}: its robot has no sonar; what a lidar is like is not learnt");
        let readings: Vec<KeptReading> = kept.iter().copied().collect();
        let heard = Self::new(&config.mapper, robot.clone(), readings);
        ensure!(
            heard.echoes >= ECHOES_MIN && heard.blocks >= BLOCKS_MIN,
            "{name}: {} sonar echoes that can be mapped, on {:.1} m of way; expected {ECHOES_MIN} or more, on {} m or more",
            heard.echoes,
            heard.way_m,
            BLOCK_M * BLOCKS_MIN as f64
        );
        Ok(heard)
    }

    fn new(mapper: &MapperConfig, robot: Robot, readings: Vec<KeptReading>) -> Self {
        let (mut begins, mut block_of, mut way_m, mut last) = (Vec::new(), Vec::new(), 0.0, None);
        for (place, kept) in readings.iter().enumerate() {
            let piece = (way_m / PIECE_M) as usize;
            // Within a scan readings may come in any order of their times: to and fro is no way.
            let moved_m = kept.pose.distance_m(*last.get_or_insert(kept.pose));
            if moved_m >= STEP_M {
                (way_m, last) = (way_m + moved_m, Some(kept.pose));
            }
            if (way_m / PIECE_M) as usize > piece {
                begins.push(place);
            }
            block_of.push((way_m / BLOCK_M) as usize);
        }
        let is_sonar = |transducer| robot.transducer(transducer).is_some_and(|found| found.kind == SensorKind::Sonar);
        let is_asked = |kept: &&KeptReading| {
            kept.verdict == Verdict::Accepted
                && matches!(kept.reading.echo, Echo::Hit { .. })
                && is_sonar(kept.reading.transducer)
        };
        let echoes = readings.iter().filter(is_asked).count();
        let blocks = block_of.last().map_or(0, |last| last + 1);
        let every = echoes.div_ceil(ASKED_MAX).max(1);
        Self { mapper: mapper.clone(), robot, readings, begins, block_of, blocks, way_m, echoes, every }
    }

    /// How many echoes are asked about.
    pub(super) fn asked(&self) -> usize {
        self.echoes / self.every
    }

    /// Σ ln p of each block, nat, with other parameters.
    pub(super) fn likelihoods(&self, mapper: &MapperConfig, robot: &Robot) -> Result<Vec<f64>> {
        let mut sums = vec![0.0; self.blocks];
        let mapper = MapperConfig { oriented_prior: PRIOR, ..mapper.clone() };
        for asked in foretell(&mapper, [&self.robot, robot], &self.readings, &self.begins, self.every)? {
            sums[self.block_of[asked.place]] += asked.news * asked.ln_density;
        }
        Ok(sums)
    }
}

/// How much of what nobody has seen is taken for occupied. A map is shown with more, which it is the better for, but by that something near
/// answers in every wide cone, and what is far tells nothing of how walls answer.
const PRIOR: f64 = 0.005;

/// What is asked of the configuration: every reading is kept.
fn load_request(request: &CalibrateSensor, log: &Path) -> LoadRequest {
    let keep = ["mapper.keep_readings=true", "mapper.keep_readings_max=10000000"].map(str::to_owned);
    LoadRequest {
        log: Some(log.to_string_lossy().into_owned()),
        robot: request.robot.clone(),
        fix: request.fix.clone(),
        fix_every: request.fix_every,
        poses: request.poses.clone(),
        sets: keep.into_iter().chain(request.sets.iter().cloned()).collect(),
        ..LoadRequest::default()
    }
}

/// In the place of a publisher.
struct Nobody;

impl Service for Nobody {
    fn inputs(&self) -> &'static [Topic] {
        &[]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    fn save(&mut self, _parts: &mut echogrid_core::parts::Parts) {}

    fn restore(&mut self, _saved: &echogrid_core::parts::Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, _input: Input, _out: &mut Outbox) -> Result<()> {
        Ok(())
    }
}
