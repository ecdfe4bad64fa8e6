//! Whether scans come from the clock of the odometry: they carry a pose, and the odometry says when the robot was there.

use std::collections::BTreeMap;

use echogrid_core::Pose2;

use super::message::ScanKind;

/// Poses nearer than this are one pose, metres; a robot that moved went farther.
const SAME_M: f64 = 1e-6;
/// A lag of fewer periods of the odometry is the time between a pose and the next.
const PERIODS: f64 = 1.5;
/// So many scans must tell it.
const ENOUGH: u64 = 10;

/// Compares the stamps of scans with those of the poses that they carry.
#[derive(Debug, Default)]
pub(super) struct Lags {
    /// The last two odometry lines with a stamp: pose and stamp.
    last: Option<(Pose2, u64)>,
    before: Option<(Pose2, u64)>,
    /// Time between odometry lines, seconds, and their number.
    flown_s: f64,
    steps: u64,
    kinds: BTreeMap<ScanKind, Lag>,
}

#[derive(Debug, Default)]
struct Lag {
    scans: u64,
    sum_s: f64,
    /// Scans that lag, or lead, by more than can be.
    odd: u64,
}

impl Lags {
    /// An odometry line.
    pub(super) fn odometry(&mut self, pose: Pose2, stamp_ns: Option<u64>) {
        let Some(stamp_ns) = stamp_ns.filter(|stamp_ns| *stamp_ns != 0) else { return };
        if let Some((_, last_ns)) = self.last {
            let step_s = (stamp_ns as f64 - last_ns as f64) * 1e-9;
            if (0.0..2.0).contains(&step_s) {
                self.flown_s += step_s;
                self.steps += 1;
            }
        }
        self.before = self.last.replace((pose, stamp_ns));
    }

    /// A scan that carries the pose of the odometry line before it, of a robot that moves.
    pub(super) fn scan(&mut self, kind: ScanKind, carried: Option<Pose2>, stamp_ns: Option<u64>) {
        let (Some(carried), Some(stamp_ns)) = (carried, stamp_ns.filter(|stamp_ns| *stamp_ns != 0)) else { return };
        let (Some((pose, pose_ns)), Some((before, _))) = (self.last, self.before) else { return };
        if carried.distance_m(pose) > SAME_M || pose.distance_m(before) <= SAME_M {
            return;
        }
        let lag_s = (stamp_ns as f64 - pose_ns as f64) * 1e-9;
        let period_s = self.flown_s / self.steps.max(1) as f64;
        let lag = self.kinds.entry(kind).or_default();
        lag.scans += 1;
        lag.sum_s += lag_s;
        lag.odd += u64::from(lag_s > PERIODS * period_s || lag_s < -0.5 * period_s);
    }

    /// What is to be said of them.
    pub(super) fn remarks(&self) -> Vec<String> {
        let odd = self.kinds.iter().filter(|(_, lag)| lag.odd >= ENOUGH && 2 * lag.odd > lag.scans);
        odd.map(|(kind, lag)| {
            let mean_s = lag.sum_s / lag.scans as f64;
            let way = if mean_s < 0.0 { "behind" } else { "ahead of" };
            format!(
                "{}: its clock does not go with that of ODOM: stamps are {:.2} s {way} those of the poses they carry, on average of {} \
                 scans; the map may be smeared",
                kind.name(),
                mean_s.abs(),
                lag.scans
            )
        })
        .collect()
    }
}
