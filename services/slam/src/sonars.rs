//! The drive of a robot that has sonars alone: all that was heard waits until it is over.

use std::collections::{BTreeMap, VecDeque};

use anyhow::{Result, bail};
use echogrid_core::parts::{Parts, Saved, SavedError};
use echogrid_core::{
    Chunks, DrivePose, Estimate, Leap, Leaps, MapperConfig, NominalSensor, Odometry, OdometryConfig, Pose2, Reading,
    Robot, SensorKind,
};
use echogrid_formats::localization::Covariance;
use echogrid_slam::SlamConfig;
use echogrid_slam::report::Report;
use echogrid_slam::sonar::{self, Heard, Ring, SonarSlam};
use serde::{Deserialize, Serialize};

use crate::history::Stretch;
use crate::{DOUBTS, files};

/// Under what it is stored; the lists by so many.
const PART: &str = "sonars";
const DRIVEN: (&str, u64) = ("driven/", 512);
const RINGS: (&str, u64) = ("rings/", 64);
/// Where the robot may be at most after a leap is two standard deviations away.
const REACH_SIGMAS: f64 = 2.0;

/// What of a drive waits for its end.
#[derive(Debug)]
pub(crate) struct Sonars {
    slam: SlamConfig,
    odometry: OdometryConfig,
    mapper: MapperConfig,
    state: State,
    /// Known to be: then nothing is kept.
    are_none: bool,
}

/// What the messages so far have come to.
#[derive(Debug, Default)]
struct State {
    /// All poses of the odometry as they came.
    driven: Stretch<DrivePose>,
    drive: sonar::Drive,
    /// What of the rings is stored, and how many were forgotten.
    rings: Option<Chunks>,
    rings_gone: u64,
    /// What leaps have left open so far: variances, m² and rad².
    left_open: [f64; 2],
}

/// What is stored besides lists.
#[derive(Debug, Serialize, Deserialize)]
struct Stored {
    driven: [u64; 2],
    rings: [u64; 2],
    kept: BTreeMap<u16, Pose2>,
    left_open: [f64; 2],
}

/// What came of a drive.
#[derive(Debug)]
pub(crate) struct Found {
    pub(crate) estimates: Vec<(u64, Estimate)>,
    pub(crate) graph: String,
    pub(crate) report: Report,
}

impl Found {
    /// Of some poses.
    pub(crate) fn covariances(&self) -> Vec<(u64, Covariance)> {
        let some = self.estimates.iter().step_by(self.estimates.len() / DOUBTS + 1);
        some.map(|(stamp_ns, estimate)| {
            let covariance = estimate.pose_covariance();
            (*stamp_ns, core::array::from_fn(|row| core::array::from_fn(|column| covariance[(row, column)])))
        })
        .collect()
    }

    pub(crate) fn path(&self) -> Vec<(u64, Pose2)> {
        self.estimates.iter().map(|(stamp_ns, estimate)| (*stamp_ns, estimate.pose)).collect()
    }
}

impl Sonars {
    pub(crate) fn new(slam: &SlamConfig, odometry: &OdometryConfig, mapper: &MapperConfig) -> Self {
        let (slam, odometry, mapper) = (slam.clone(), odometry.clone(), mapper.clone());
        Self { slam, odometry, mapper, state: State::default(), are_none: false }
    }

    pub(crate) fn moved(&mut self, pose: DrivePose) {
        if !self.are_none {
            self.state.driven.list.push_back(pose);
        }
    }

    pub(crate) fn leapt(&mut self, leap: &Leap) {
        for (open, reach) in self.state.left_open.iter_mut().zip([leap.reach_m, leap.reach_rad]) {
            *open += reach * reach / (REACH_SIGMAS * REACH_SIGMAS);
        }
    }

    /// Takes what the sonars said at a stamp; `at` says where the robot was so many nanoseconds later.
    pub(crate) fn heard(
        &mut self,
        robot: &Robot,
        stamp_ns: u64,
        odom_from_base: Pose2,
        readings: &[Reading],
        at: impl Fn(i32) -> Option<Pose2>,
    ) {
        let of = |reading: &Reading| {
            let is_sonar = robot.transducer(reading.transducer)?.kind == SensorKind::Sonar;
            let odom_from_base = at(reading.offset_ns).filter(|_| is_sonar)?;
            Some(Heard { reading: *reading, odom_from_base })
        };
        if self.are_none {
            return;
        }
        let heard = readings.iter().filter_map(of).collect();
        self.state.drive.add(Ring { stamp_ns, odom_from_base, left_open: self.state.left_open, heard });
    }

    /// The drive, corrected by what was heard again; `odom` are the stamps of which poses are told. Where nothing was recognised, the
    /// estimates are those of the odometry, as it tells them without SLAM.
    ///
    /// # Errors
    /// A closure is forbidden or required that was not found.
    pub(crate) fn solved(&self, robot: &Robot, odom: &[(u64, Pose2)]) -> Result<Found> {
        let mut slam = SonarSlam::new(&self.slam, &self.mapper, &self.odometry, robot, &self.state.drive);
        slam.finish();
        if let Some(unknown) = slam.unknown_by_hand() {
            bail!(unknown);
        }
        let estimates = if slam.is_corrected() { slam.estimates(odom) } else { self.as_driven() };
        let way_m = estimates.windows(2).map(|pair| pair[0].1.pose.distance_m(pair[1].1.pose)).sum();
        let graph = slam.graph();
        Ok(Found { estimates, graph: files::g2o(graph, &graph.edges), report: slam.report(way_m) })
    }

    /// How far a pose can be trusted, as the odometry tells it.
    pub(crate) fn trust(&self, robot: &Robot, estimate: &Estimate) -> f64 {
        NominalSensor::of(robot).trust(&estimate.errors, self.mapper.resolution_m)
    }

    /// There are none, or they are not needed.
    pub(crate) fn forget(&mut self) {
        self.are_none = true;
        self.state.driven.clear();
        self.state.rings_gone += self.state.drive.rings.len() as u64;
        self.state.drive.rings.clear();
    }

    fn as_driven(&self) -> Vec<(u64, Estimate)> {
        let (mut odometry, mut leaps) = (Odometry::new(&self.odometry), Leaps::default());
        let step = |pose: &DrivePose| {
            let estimate = match leaps.next(*pose) {
                Some(leap) => odometry.leapt(pose.odom_from_base, &leap),
                None => odometry.step(pose.odom_from_base),
            };
            (pose.stamp_ns, estimate)
        };
        self.state.driven.list.iter().map(step).collect()
    }

    pub(crate) fn save(&mut self, parts: &mut Parts) {
        let State { driven, drive, rings, rings_gone, left_open } = &mut self.state;
        let driven = driven.save(parts, DRIVEN);
        // Neither way copies anything.
        let entries = VecDeque::from(std::mem::take(&mut drive.rings));
        rings.get_or_insert_with(|| Chunks::new(RINGS.1)).save(parts, RINGS.0, *rings_gone, &entries);
        drive.rings = Vec::from(entries);
        let count = [*rings_gone, *rings_gone + drive.rings.len() as u64];
        let stored = Stored { driven, rings: count, kept: drive.kept.clone(), left_open: *left_open };
        parts.put_value(PART, &stored);
    }

    pub(crate) fn restore(&mut self, saved: &Saved) -> Result<(), SavedError> {
        let Stored { driven, rings: [gone, end], kept, left_open } = saved.value(PART)?;
        let (chunks, rings) = Chunks::restore(RINGS.1, saved, RINGS.0, gone, end)?;
        self.state = State {
            driven: Stretch::restore(saved, DRIVEN, driven)?,
            drive: sonar::Drive { rings: Vec::from(rings), kept },
            rings: Some(chunks),
            rings_gone: gone,
            left_open,
        };
        Ok(())
    }
}
