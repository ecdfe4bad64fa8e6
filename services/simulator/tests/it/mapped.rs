//! Drives with exact poses, and what maps of them are worth.

use std::collections::VecDeque;

use echogrid_core::{Estimate, GridMapper, Pose2, Reading, Robot, World};
use echogrid_judge::Quality;
use echogrid_judge::quality::Truth;
use echogrid_service::Sensor as _;
use echogrid_simulator::{Simulator, SimulatorConfig};
use echogrid_topics::Message;

/// A whole drive.
pub(crate) struct Drive {
    pub(crate) robot: Robot,
    pub(crate) world: World,
    /// The readings of each scan, and where the robot really was.
    pub(crate) scans: Vec<Vec<(Reading, Option<Estimate>)>>,
    path: Vec<Pose2>,
    /// Where each lap ends: so many scans and poses.
    pub(crate) laps: Vec<[usize; 2]>,
}

/// Where the robot really was, by stamps in nanoseconds.
fn at(poses: &[(u64, Pose2)], stamp_ns: u64) -> Estimate {
    let next = poses.partition_point(|(stamp, _)| *stamp < stamp_ns).clamp(1, poses.len() - 1);
    let ((from_ns, from), (to_ns, to)) = (poses[next - 1], poses[next]);
    let share = (stamp_ns as f64 - from_ns as f64) / (to_ns - from_ns) as f64;
    Estimate::certain(from.interpolate(to, share.clamp(0.0, 1.0)))
}

impl Drive {
    /// A drive to its end; a lap ends where the robot comes back to `home`.
    pub(crate) fn of(config: &SimulatorConfig, world: &World, robot: Robot, home: Pose2) -> Self {
        let mut simulator = Simulator::new(config, world.clone(), robot.clone()).unwrap();
        let (mut poses, mut waiting) = (Vec::new(), VecDeque::<(u64, Vec<Reading>)>::new());
        let (mut scans, mut laps, mut is_away) = (Vec::new(), Vec::new(), false);
        while let Some((stamp_ns, message)) = simulator.next().unwrap() {
            match message {
                Message::TruePose(pose) => poses.extend(pose.map_from_base.map(|pose| (stamp_ns, pose))),
                Message::Scan(readings) => waiting.push_back((stamp_ns, readings)),
                _ => {}
            }
            // Half a second later it is known where the robot was.
            while waiting.front().is_some_and(|(stamp, _)| *stamp + 500_000_000 < stamp_ns) {
                let Some((stamp_ns, readings)) = waiting.pop_front() else { break };
                let located = |reading: Reading| {
                    let at_ns = stamp_ns.saturating_add_signed(i64::from(reading.offset_ns));
                    (reading, Some(at(&poses, at_ns)))
                };
                scans.push(readings.into_iter().map(located).collect());
            }
            let home_m = simulator.true_pose().distance_m(home);
            is_away |= home_m > 2.0;
            if is_away && home_m < 0.03 {
                is_away = false;
                laps.push([scans.len(), poses.len()]);
            }
        }
        let path = poses.into_iter().map(|(_, pose)| pose).collect();
        Self { robot, world: world.clone(), scans, path, laps }
    }

    /// Where all of it ends.
    pub(crate) fn whole(&self) -> [usize; 2] {
        [self.scans.len(), self.path.len()]
    }

    /// How good the map of the drive up to the end of a lap is.
    pub(crate) fn judge(&self, mapper: &GridMapper, [_, poses]: [usize; 2]) -> Quality {
        let grid = mapper.shown();
        let truth = Truth::of(&self.world, &self.path[..poses], &grid).unwrap();
        Quality::against(&grid, &truth).unwrap()
    }
}
