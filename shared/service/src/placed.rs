//! Readings where they were heard, with what became of them: for who draws them.

use std::collections::VecDeque;

use echogrid_core::{Echo, Pose2, Reading, Robot, Verdict};

/// Scans whose verdicts may still come, and poses at which they may have been heard.
const SCANS_KEPT: usize = 64;
const POSES_KEPT: usize = 512;

/// A reading where it was heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// The transducer in the map frame; it looks along x.
    pub map_from_transducer: Pose2,
    /// The full angle of its cone, radians.
    pub aperture_rad: f64,
    /// What it heard, metres; without an echo how far it can hear.
    pub range_m: f64,
    /// The reading itself.
    pub reading: Reading,
    /// What became of it.
    pub verdict: Verdict,
}

/// Puts scans, poses and verdicts together as they come.
#[derive(Debug, Default)]
pub struct Placer {
    scans: VecDeque<(u64, Vec<Reading>)>,
    poses: VecDeque<(u64, Pose2)>,
}

impl Placer {
    /// The robot was at `map_from_base` at this stamp.
    pub fn take_pose(&mut self, stamp_ns: u64, map_from_base: Pose2) {
        self.poses.push_back((stamp_ns, map_from_base));
        if self.poses.len() > POSES_KEPT {
            self.poses.pop_front();
        }
    }

    /// Takes in a scan: these readings were heard.
    pub fn take_scan(&mut self, stamp_ns: u64, readings: Vec<Reading>) {
        self.scans.push_back((stamp_ns, readings));
        if self.scans.len() > SCANS_KEPT {
            self.scans.pop_front();
        }
    }

    /// The readings of the scan of this stamp, now that it is known what became of them; none where the scan was missed.
    pub fn judge(&mut self, robot: &Robot, stamp_ns: u64, verdicts: &[(u16, Verdict)]) -> Option<Vec<Placed>> {
        while self.scans.front().is_some_and(|(stamp, _)| *stamp < stamp_ns) {
            self.scans.pop_front();
        }
        let (_, readings) = self.scans.front().filter(|(stamp, _)| *stamp == stamp_ns)?;
        let judged = readings.iter().zip(verdicts);
        Some(judged.filter_map(|(reading, (_, verdict))| self.place(robot, stamp_ns, *reading, *verdict)).collect())
    }

    fn place(&self, robot: &Robot, stamp_ns: u64, reading: Reading, verdict: Verdict) -> Option<Placed> {
        let transducer = robot.transducer(reading.transducer)?;
        let map_from_base = self.pose_at(stamp_ns.saturating_add_signed(reading.offset_ns.into()))?;
        let range_m = match reading.echo {
            Echo::Hit { range_m } => range_m,
            Echo::NoEcho => transducer.range_max_m,
            Echo::Invalid => 0.0,
        };
        Some(Placed {
            map_from_transducer: map_from_base * transducer.base_from_transducer,
            aperture_rad: transducer.aperture_rad,
            range_m,
            reading,
            verdict,
        })
    }

    /// Where the robot was believed to be: between the poses before and after, or at the only one of them.
    fn pose_at(&self, at_ns: u64) -> Option<Pose2> {
        let after = self.poses.partition_point(|(stamp_ns, _)| *stamp_ns < at_ns);
        let before = after.checked_sub(1).and_then(|before| self.poses.get(before));
        match (before, self.poses.get(after)) {
            (Some((from_ns, from)), Some((to_ns, to))) => {
                let fraction = (at_ns - from_ns) as f64 / (to_ns - from_ns).max(1) as f64;
                Some(from.interpolate(*to, fraction))
            }
            (one, other) => one.or(other).map(|(_, pose)| *pose),
        }
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Footprint, Sensor, SensorKind};

    use super::*;

    fn robot() -> Robot {
        let sensor = Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(0.5, 0.0, 0.0),
            first_transducer: 0,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        Robot { name: "one".into(), footprint: Footprint::default(), sensors: vec![sensor] }
    }

    #[test]
    fn a_reading_is_where_the_robot_was_between_two_poses_and_waits_for_its_verdict() {
        let mut placer = Placer::default();
        placer.take_pose(0, Pose2::new(0.0, 0.0, 0.0));
        placer.take_pose(1000, Pose2::new(1.0, 0.0, 0.0));
        let reading = |offset_ns| Reading { offset_ns, transducer: 0, echo: Echo::NoEcho };
        placer.take_scan(300, vec![reading(0)]);
        placer.take_scan(500, vec![reading(0), reading(-250), Reading { transducer: 7, ..reading(0) }]);
        let verdicts = [(0, Verdict::NoEcho), (0, Verdict::NoEcho), (7, Verdict::Invalid)];
        let placed = placer.judge(&robot(), 500, &verdicts).unwrap();
        let x: Vec<f64> = placed.iter().map(|placed| placed.map_from_transducer.x).collect();
        assert_eq!((x, placed[0].range_m), (vec![1.0, 0.75], 5.0));
        // One whose scan was missed, and one that was before it.
        assert!(placer.judge(&robot(), 501, &verdicts).is_none());
        assert!(placer.judge(&robot(), 300, &verdicts).is_none());
    }
}
