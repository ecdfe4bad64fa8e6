//! A sonar workload with true poses, as other mappers are measured by: 19 numbers per ring (f32, little endian), the true x, y, θ of
//! the robot, then sixteen ranges; 5.0 is no echo. Beside it the world that it was cast in.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::{Echo, Estimate, GridMapper, Pose2, Reading};
use echogrid_formats::world;
use echogrid_judge::Quality;
use echogrid_judge::quality::Truth;

use echogrid_config::{Config, LoadRequest};

const RINGS: &str = "workload_s.bin";
const WORLD: &str = "building.map";
/// Numbers of a ring.
const FIELDS: usize = 19;
const NO_ECHO_M: f32 = 5.0;

/// The rings of a workload.
pub(super) struct Workload {
    rings: Vec<[f32; FIELDS]>,
    world: echogrid_core::World,
}

impl Workload {
    pub(super) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RINGS);
        let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
        let size = 4 * FIELDS;
        ensure!(
            !bytes.is_empty() && bytes.len().is_multiple_of(size),
            "{}: {} bytes; expected whole rings of {size}",
            path.display(),
            bytes.len()
        );
        let number = |bytes: &[u8]| bytes.try_into().map_or(f32::NAN, f32::from_le_bytes);
        let ring = |bytes: &[u8]| {
            let mut numbers = bytes.chunks_exact(4).map(number);
            std::array::from_fn(|_| numbers.next().unwrap_or(f32::NAN))
        };
        let rings = bytes.chunks_exact(size).map(ring).collect();
        let (world, _) = world::find(&folder.join(WORLD))?.walls_only()?;
        Ok(Self { rings, world })
    }

    /// How good a map of it is that is made so, with the true poses.
    pub(super) fn judge(&self, sets: &[String]) -> Result<Quality> {
        let request =
            LoadRequest { sensor: Some("simulator".to_owned()), sets: sets.to_vec(), ..LoadRequest::default() };
        let config = Config::load(&request)?.into_config();
        let robot = config.robot.context("a workload needs a robot")?;
        let mut mapper = GridMapper::new(&config.mapper, config.odometry.noise, config.odometry.seed, robot)?;
        let mut path = Vec::with_capacity(self.rings.len());
        for (sequence, ring) in self.rings.iter().enumerate() {
            let [x, y, theta, ranges @ ..] = ring;
            let pose = Pose2::new(f64::from(*x), f64::from(*y), f64::from(*theta));
            let estimate = Estimate::certain(pose);
            path.push(pose);
            let reading = |(transducer, range_m): (usize, &f32)| {
                let echo =
                    if *range_m >= NO_ECHO_M { Echo::NoEcho } else { Echo::Hit { range_m: f64::from(*range_m) } };
                (Reading { transducer: transducer as u16, echo, offset_ns: 0 }, Some(estimate))
            };
            let scan: Vec<_> = ranges.iter().enumerate().map(reading).collect();
            mapper.integrate_scan(sequence as u64 + 1, &scan);
        }
        let grid = mapper.shown();
        let truth = Truth::of(&self.world, &path, &grid)?;
        Ok(Quality::against(&grid, &truth)?)
    }
}
