//! Whether the poses of a drive go with the speeds that its lines say: else the poses are in other units, mirrored, or stand still.

use echogrid_core::{Pose2, wrap_angle};

/// A longer time between two lines tells nothing, nanoseconds.
const GAP_NS: u64 = 2_000_000_000;
/// Shorter pieces of the way, metres and radians, tell nothing: poses may be rounded to millimetres and whole degrees.
const PIECE: f64 = 0.05;
/// So far off is no noise, and no slip.
const FACTOR: f64 = 5.0;
/// So many pieces, and so great a share of all, are no accident.
const ENOUGH: u64 = 30;
const SHARE: f64 = 0.25;

/// Pieces of the way, or of the turns, against what the speeds make of them.
#[derive(Debug, Default)]
struct Steps {
    /// Since the last piece, as the poses say and as the speeds say.
    step: f64,
    said: f64,
    moving: u64,
    faster: u64,
    slower: u64,
    opposite: u64,
}

impl Steps {
    fn add(&mut self, step: f64, said: f64) {
        self.step += step;
        self.said += said;
        // As good as it: sums of tenths are not exact.
        if self.said.abs() < 0.999 * PIECE {
            return;
        }
        self.moving += 1;
        let ratio = core::mem::take(&mut self.step) / core::mem::take(&mut self.said);
        if ratio.abs() > FACTOR {
            self.faster += 1;
        } else if ratio.abs() < 1.0 / FACTOR {
            self.slower += 1;
        } else if ratio < 0.0 {
            self.opposite += 1;
        }
    }

    fn are_many(&self, odd: u64) -> bool {
        odd >= ENOUGH && odd as f64 > SHARE * self.moving as f64
    }
}

/// Compares the steps from pose to pose with the speeds that the lines say.
#[derive(Debug, Default)]
pub(super) struct Speeds {
    last: Option<(Pose2, u64)>,
    ways: Steps,
    turns: Steps,
}

impl Speeds {
    /// An odometry line with its speed, m/s, and rate of turn, rad/s.
    pub(super) fn add(&mut self, pose: Pose2, v_mps: f64, w_radps: f64, stamp_ns: Option<u64>) {
        let Some(stamp_ns) = stamp_ns.filter(|stamp_ns| *stamp_ns != 0) else { return };
        if self.last.is_some_and(|(_, before_ns)| before_ns == stamp_ns) {
            // Of a clock that counts whole seconds: the way until it moves is what its time is for.
            return;
        }
        if let Some((before, before_ns)) = self.last
            && stamp_ns > before_ns
            && stamp_ns - before_ns <= GAP_NS
        {
            let seconds = (stamp_ns - before_ns) as f64 * 1e-9;
            self.ways.add(before.distance_m(pose), v_mps.abs() * seconds);
            self.turns.add(wrap_angle(pose.theta - before.theta), w_radps * seconds);
        }
        self.last = Some((pose, stamp_ns));
    }

    /// What is to be said of them.
    pub(super) fn remarks(&self) -> Vec<String> {
        let Self { ways, turns, .. } = self;
        let share =
            |odd: u64, of: &Steps| format!("{:.0} % of the steps", 100.0 * odd as f64 / of.moving.max(1) as f64);
        let told = [
            (ways, ways.faster, "go more than 5 times as far as the speeds of their lines say: are they in metres?"),
            (
                ways,
                ways.slower,
                "stand still, or nearly, while their lines say a speed: does the odometry hang, is it in metres?",
            ),
            (
                turns,
                turns.faster,
                "turn more than 5 times as far as the rates of their lines say: are headings in radians?",
            ),
            (
                turns,
                turns.slower,
                "keep their heading, or nearly, while their lines say a rate of turn: are headings in radians?",
            ),
            (turns, turns.opposite, "turn the other way than the rates of their lines say: are they mirrored?"),
        ];
        let odd = told.into_iter().filter(|(steps, odd, _)| steps.are_many(*odd));
        odd.map(|(steps, odd, what)| format!("its poses, in {}, {what}", share(odd, steps))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a drive on a circle at 0.5 m/s and 0.25 rad/s whose poses are changed.
    fn remarks(change: impl Fn(u32, Pose2) -> Pose2) -> Vec<String> {
        let mut speeds = Speeds::default();
        for tenth in 0..400 {
            let angle = f64::from(tenth) * 0.025;
            let pose = Pose2::new(2.0 * angle.sin(), 2.0 - 2.0 * angle.cos(), angle);
            speeds.add(change(tenth, pose), 0.5, 0.25, Some(1_000_000_000 + u64::from(tenth) * 100_000_000));
        }
        speeds.remarks()
    }

    #[test]
    fn poses_that_do_not_go_with_their_speeds_are_told() {
        let said = |change: &dyn Fn(u32, Pose2) -> Pose2, what: &str| {
            let remarks = remarks(change);
            assert!(remarks.iter().any(|remark| remark.contains(what)), "{what}: {remarks:?}");
        };
        assert_eq!(remarks(|_, pose| pose), [""; 0]);
        assert_eq!(remarks(|_, pose| Pose2::new(1.05 * pose.x, 1.05 * pose.y, pose.theta)), [""; 0]);
        said(&|_, pose| Pose2::new(100.0 * pose.x, 100.0 * pose.y, pose.theta), "are they in metres?");
        said(&|_, pose| Pose2::new(0.001 * pose.x, 0.001 * pose.y, pose.theta), "is it in metres?");
        said(&|_, pose| Pose2::new(pose.x, pose.y, pose.theta.to_degrees()), "are headings in radians?");
        said(&|_, pose| Pose2::new(pose.x, -pose.y, -pose.theta), "are they mirrored?");
        said(&|tenth, pose| if tenth < 200 { pose } else { Pose2::new(1.0, 1.0, 1.0) }, "does the odometry hang");
    }

    #[test]
    fn headings_in_whole_degrees_turn_all_the_same() {
        assert_eq!(
            remarks(|_, pose| Pose2::new(pose.x, pose.y, pose.theta.to_degrees().round().to_radians())),
            [""; 0]
        );
    }

    #[test]
    fn a_clock_of_whole_seconds_is_no_fault_of_the_poses() {
        let mut speeds = Speeds::default();
        for tenth in 0..800_u32 {
            let pose = Pose2::new(0.05 * f64::from(tenth), 0.0, 0.0);
            speeds.add(pose, 0.5, 0.0, Some(u64::from(1 + tenth / 10) * 1_000_000_000));
        }
        assert_eq!(speeds.remarks(), [""; 0]);
    }

    #[test]
    fn lines_without_speeds_tell_nothing() {
        let mut speeds = Speeds::default();
        for tenth in 0..400_u32 {
            speeds.add(Pose2::new(f64::from(tenth), 0.0, 0.0), 0.0, 0.0, Some(1 + u64::from(tenth) * 100_000_000));
        }
        assert_eq!(speeds.remarks(), [""; 0]);
    }
}
