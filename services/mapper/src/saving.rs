//! The mapper's state, saved so that a restarted one goes on where the last was: with the parts of [`GridMapper`] and its own.
//!
//! | part | what |
//! |---|---|
//! | `service` | counts, what is due when, what waits |
//! | `robot` | its description |
//! | `waiting/n` | scans whose poses are not known yet, the n-th 64 |
//! | `trajectory/n` | estimates that scans still need, the n-th 256 |
//! | `scans/n` | numbers and stamps of the scans of the kept readings, the n-th 1024 |

use anyhow::{Result, bail};
use echogrid_core::{Chunks, GridMapper, OdometryConfig, Parts, Robot, Saved, SavedError, VerdictCounts};
use serde::{Deserialize, Serialize};

use crate::MapperService;
use crate::trajectory::{Trajectory, TrajectoryState};

const STATE: &str = "service";
const ROBOT: &str = "robot";
const WAITING: &str = "waiting/";
/// Scans that are saved as one part while they wait.
pub(crate) const WAITING_CHUNK: u64 = 64;

#[derive(Debug, Serialize, Deserialize)]
struct State {
    has_robot: bool,
    trajectory: TrajectoryState,
    /// Scans that have waited, and those that have come.
    waited: (u64, u64),
    counts: VerdictCounts,
    remapped: (u64, u64),
    sonar_counts: Vec<VerdictCounts>,
    /// Whether the map of an earlier drive is yet to be gone on with, and the number of its last scan once it was.
    is_yet_to_go_on: bool,
    scans_before: u64,
    placed_ns: Option<u64>,
    /// Of the kept readings.
    scans_kept: Option<u64>,
    paused: bool,
    scans: u64,
    revision: u64,
    stamp_ns: u64,
    tiles_due_ns: u64,
    info_due_ns: u64,
    finished: bool,
}

impl MapperService {
    /// Puts what changed since this was called last into `parts`; at first all there is.
    pub fn save(&mut self, parts: &mut Parts) {
        if let Some(mapper) = &mut self.mapper {
            mapper.save(parts);
        }
        if let Some(robot) = self.robot.as_ref().filter(|_| !self.robot_saved) {
            parts.put_value(ROBOT, robot);
            self.robot_saved = true;
        }
        let waited = (self.waited, self.waited + self.waiting.len() as u64);
        self.waiting_saved.save(parts, WAITING, self.waited, &self.waiting);
        let state = State {
            has_robot: self.robot.is_some(),
            trajectory: self.trajectory.save(parts),
            waited,
            counts: self.counts,
            remapped: self.remapped,
            sonar_counts: self.sonar_counts.clone(),
            is_yet_to_go_on: self.earlier.is_some(),
            scans_before: self.scans_before,
            placed_ns: self.placed_ns,
            scans_kept: self.readings_file.as_mut().map(|file| file.save(parts)),
            paused: self.paused,
            scans: self.scans,
            revision: self.revision,
            stamp_ns: self.stamp_ns,
            tiles_due_ns: self.tiles_due_ns,
            info_due_ns: self.info_due_ns,
            finished: self.finished,
        };
        parts.put_value(STATE, &state);
    }

    /// Goes on where the one was that was saved; this one is new and of the same configuration.
    ///
    /// # Errors
    /// A part is missing, damaged, or of another configuration; then this one is as it was.
    pub fn restore(&mut self, saved: &Saved) -> Result<()> {
        let state: State = saved.value(STATE)?;
        let robot: Option<Robot> = state.has_robot.then(|| saved.value(ROBOT)).transpose()?;
        let OdometryConfig { noise, seed, .. } = self.odometry;
        let mapper =
            robot.clone().map(|robot| GridMapper::restore(&self.config, noise, seed, robot, saved)).transpose()?;
        let trajectory = Trajectory::restore(saved, state.trajectory)?;
        let (waited, come) = state.waited;
        let (waiting_saved, waiting) = Chunks::restore(WAITING_CHUNK, saved, WAITING, waited, come)?;
        match (&mut self.readings_file, state.scans_kept) {
            (Some(file), Some(scans)) => {
                file.restore(saved, scans)?;
                robot.iter().for_each(|robot| file.set_robot(robot.clone()));
            }
            (None, None) => {}
            _ => bail!(SavedError::new(STATE, "readings are kept now and were not then, or the other way round")),
        }
        *self = Self {
            robot_saved: robot.is_some(),
            robot,
            mapper,
            trajectory,
            waiting,
            waited,
            waiting_saved,
            counts: state.counts,
            remapped: state.remapped,
            sonar_counts: state.sonar_counts,
            earlier: self.earlier.take().filter(|_| state.is_yet_to_go_on),
            scans_before: state.scans_before,
            placed_ns: state.placed_ns,
            paused: state.paused,
            scans: state.scans,
            revision: state.revision,
            stamp_ns: state.stamp_ns,
            tiles_every_ns: self.tiles_every_ns,
            tiles_due_ns: state.tiles_due_ns,
            info_due_ns: state.info_due_ns,
            finished: state.finished,
            config: self.config.clone(),
            odometry: self.odometry.clone(),
            readings_file: self.readings_file.take(),
        };
        Ok(())
    }
}
