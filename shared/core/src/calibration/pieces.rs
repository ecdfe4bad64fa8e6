//! Trials from a drive: pieces of (nearly) pure translation and of (nearly) pure rotation, where the truth is known.
//!
//! Ways are those along the robot's path, with their signs: every step is the arc that its chord and its turn belong to, and
//! counts along the heading that the robot has then, so that neither a bend nor noise across the way makes it longer. Turns
//! add up and are never wrapped. Which pieces are taken depends on what was *measured* alone: to look at the truth, too, would
//! leave out the trials with the largest errors.

use super::{Calibration, CalibrationError, Trial};
use crate::odometry::Increment;
use crate::pose::Pose2;

/// What makes a piece of a drive a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// A translation is at least so long, metres.
    pub straight_min_m: f64,
    /// A translation is at most so long, metres: then the next begins.
    pub straight_max_m: f64,
    /// Meanwhile the robot's heading stays within a range of less than this, radians.
    pub straight_turn_rad: f64,
    /// A rotation is at least so far, radians.
    pub turn_min_rad: f64,
    /// A rotation is at most so far, radians: then the next begins.
    pub turn_max_rad: f64,
    /// Meanwhile the robot stays within a range of less than this along its way, metres.
    pub turn_travel_m: f64,
    /// Farther than this from one pose to the next, or while the truth is not known, and the drive is cut there, metres.
    pub jump_m: f64,
    /// Where it turns more than this from one pose to the next the drive is cut, radians; well below π, beyond which nobody can tell the way.
    pub jump_rad: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            straight_min_m: 0.3,
            straight_max_m: 2.0,
            straight_turn_rad: 0.1,
            turn_min_rad: 0.3,
            turn_max_rad: 1.0,
            turn_travel_m: 0.1,
            jump_m: 2.0,
            jump_rad: 2.0,
        }
    }
}

/// A drive whose truth is known, at least now and then.
///
/// ```
/// use echogrid_core::calibration::{Drive, Limits};
/// use echogrid_core::Pose2;
/// let mut drive = Drive::new(Limits::default());
/// for step in 0..=100 {
///     let x = 0.01 * f64::from(step);
///     drive.push(Pose2::new(x, 0.0, 0.0), Some(Pose2::new(0.9 * x, 0.0, 0.0)));
/// }
/// let (translations, rotations) = drive.trials();
/// assert_eq!((translations.len(), rotations.len()), (1, 0));
/// assert!((translations[0].lin_error_m() / translations[0].measured_m - 0.1).abs() < 1e-9);
/// ```
#[derive(Debug, Clone)]
pub struct Drive {
    limits: Limits,
    /// Without a jump in them; since the start of each, at every pose whose truth is known.
    stretches: Vec<Vec<Trial>>,
    last: Option<Pose2>,
    last_true: Option<Pose2>,
    /// Measured since the last truth, and how far that was without its signs.
    since: Trial,
    since_m: f64,
    since_rad: f64,
}

impl Drive {
    /// A drive of which nothing is known yet.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            stretches: Vec::new(),
            last: None,
            last_true: None,
            since: Trial::default(),
            since_m: 0.0,
            since_rad: 0.0,
        }
    }

    /// The next pose of the odometry, and where the robot was then, if that is known.
    pub fn push(&mut self, odom_from_base: Pose2, map_from_base: Option<Pose2>) {
        if !odom_from_base.is_finite() {
            return;
        }
        if let Some(last) = self.last {
            let step = Increment::between(last, odom_from_base);
            self.since.measured_m += arc_m(step);
            self.since.measured_rad += step.turn_rad;
            self.since_m += step.length_m();
            self.since_rad += step.turn_rad.abs();
        }
        self.last = Some(odom_from_base);
        if let Some(truth) = map_from_base.filter(|pose| pose.is_finite()) {
            self.know(truth);
        }
    }

    fn know(&mut self, truth: Pose2) {
        let before = self.stretches.last().and_then(|stretch| stretch.last()).copied();
        let step = self.last_true.map(|last| Increment::between(last, truth));
        let near = |way_m: f64, turn_rad: f64| way_m <= self.limits.jump_m && turn_rad.abs() <= self.limits.jump_rad;
        match (before, step) {
            (Some(before), Some(step))
                if near(self.since_m, self.since_rad) && near(step.length_m(), step.turn_rad) =>
            {
                let now = Trial {
                    measured_m: before.measured_m + self.since.measured_m,
                    measured_rad: before.measured_rad + self.since.measured_rad,
                    true_m: before.true_m + arc_m(step),
                    true_rad: before.true_rad + step.turn_rad,
                };
                if let Some(stretch) = self.stretches.last_mut() {
                    stretch.push(now);
                }
            }
            _ => self.stretches.push(vec![Trial::default()]),
        }
        self.last_true = Some(truth);
        (self.since, self.since_m, self.since_rad) = (Trial::default(), 0.0, 0.0);
    }

    /// How many poses there are whose truth is known.
    #[must_use]
    pub fn known(&self) -> usize {
        self.stretches.iter().map(Vec::len).sum()
    }

    /// The pieces that are trials: translations and rotations, each in the order of the drive.
    #[must_use]
    pub fn trials(&self) -> (Vec<Trial>, Vec<Trial>) {
        let (mut translations, mut rotations) = (Vec::new(), Vec::new());
        let Limits { straight_min_m, straight_max_m, straight_turn_rad, .. } = self.limits;
        let Limits { turn_min_rad, turn_max_rad, turn_travel_m, .. } = self.limits;
        let straight = Axis {
            own: |at| at.measured_m,
            other: |at| at.measured_rad,
            least: straight_min_m,
            most: straight_max_m,
            other_max: straight_turn_rad,
        };
        let spin = Axis {
            own: |at| at.measured_rad,
            other: |at| at.measured_m,
            least: turn_min_rad,
            most: turn_max_rad,
            other_max: turn_travel_m,
        };
        for stretch in &self.stretches {
            let mut from = 0;
            while from + 1 < stretch.len() {
                let tries = [straight.grow(&stretch[from..]), spin.grow(&stretch[from..])];
                let found = tries.iter().position(|grown| grown.piece.is_some());
                let trials = if found == Some(0) { &mut translations } else { &mut rotations };
                from += match found.and_then(|axis| tries[axis].piece) {
                    Some((start, end)) => {
                        trials.push(difference(&stretch[from + start], &stretch[from + end]));
                        end
                    }
                    // Not one by one: what is looked at again and again would take forever.
                    None => (tries[0].looked_at.max(tries[1].looked_at) / 8).max(1),
                };
            }
        }
        (translations, rotations)
    }
}

/// Takes out of the trials of a drive what the little turn of a translation, and the little way of a rotation, erred by in
/// their proportion: the slopes of the other phase tell how much. What is left is what eqs 5–8 ask for.
///
/// # Errors
/// As [`Calibration::fit`].
pub fn separate(translations: &mut [Trial], rotations: &mut [Trial]) -> Result<(), CalibrationError> {
    let Calibration { lin_scale, ang_scale, .. } = Calibration::fit(translations, rotations)?;
    for trial in translations {
        trial.measured_rad *= 1.0 - ang_scale;
    }
    for trial in rotations {
        trial.measured_m *= 1.0 - lin_scale;
    }
    Ok(())
}

/// Way along the arc that a step's chord belongs to, metres.
fn arc_m(step: Increment) -> f64 {
    let half = 0.5 * step.turn_rad;
    // sin h ≈ h − h³/6
    let longer = if half.abs() < 1e-4 { 1.0 + half * half / 6.0 } else { half / libm::sin(half) };
    step.forward_m * longer
}

fn difference(from: &Trial, to: &Trial) -> Trial {
    Trial {
        measured_m: to.measured_m - from.measured_m,
        measured_rad: to.measured_rad - from.measured_rad,
        true_m: to.true_m - from.true_m,
        true_rad: to.true_rad - from.true_rad,
    }
}

/// One of the two ways to move, and how far.
struct Axis {
    own: fn(&Trial) -> f64,
    other: fn(&Trial) -> f64,
    least: f64,
    most: f64,
    other_max: f64,
}

/// What came of looking for a piece.
struct Grown {
    /// Its first and its last place, if it is long enough.
    piece: Option<(usize, usize)>,
    looked_at: usize,
}

impl Axis {
    /// The piece that begins at the first place or soon after it.
    fn grow(&self, places: &[Trial]) -> Grown {
        /// Of the least length: so much back is a change of direction.
        const BACK: f64 = 0.1;
        /// Of the length of a piece: what lies before or behind it is standing, or another motion.
        const ENDS: f64 = 0.01;
        let origin = places[0];
        let own = |place: &Trial| (self.own)(place) - (self.own)(&origin);
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        let (mut farthest, mut total) = (0, 0.0_f64);
        let mut looked_at = places.len();
        for (index, place) in places.iter().enumerate() {
            let other = (self.other)(place) - (self.other)(&origin);
            (low, high) = (low.min(other), high.max(other));
            let way = own(place);
            if high - low >= self.other_max || way.abs() < total.abs() - BACK * self.least {
                looked_at = index;
                break;
            }
            if way.abs() > total.abs() {
                (farthest, total) = (index, way);
            }
            if way.abs() >= self.most {
                looked_at = index + 1;
                break;
            }
        }
        let reached = |place: &Trial| own(place) * total.signum() >= (1.0 - ENDS) * total.abs();
        let end = places[..=farthest].iter().position(reached).unwrap_or(farthest);
        let begun = |place: &Trial| own(place) * total.signum() > ENDS * total.abs();
        let start = places[..=end].iter().rposition(|place| !begun(place)).unwrap_or(0);
        let length = (own(&places[end]) - own(&places[start])).abs();
        Grown { piece: (length >= self.least && end > start).then_some((start, end)), looked_at }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;
    use crate::odometry::move_by;

    /// A robot that measures 10 % too much way and 5 % too much turn, and begins anywhere.
    struct Robot {
        drive: Drive,
        odom: Pose2,
        truth: Pose2,
    }

    impl Robot {
        fn new() -> Self {
            let (odom, truth) = (Pose2::new(3.0, -1.0, 2.0), Pose2::new(-7.0, 2.0, -3.0));
            let mut drive = Drive::new(Limits::default());
            drive.push(odom, Some(truth));
            Self { drive, odom, truth }
        }

        /// So far in steps of 2 cm or 0.02 rad at most; every `know` steps the truth is known.
        fn go(&mut self, forward_m: f64, turn_rad: f64, know: usize) -> &mut Self {
            let steps = ((forward_m.abs().max(turn_rad.abs()) / 0.02).ceil() as usize).max(1);
            for step in 1..=steps {
                let (forward_m, turn_rad) = (forward_m / steps as f64, turn_rad / steps as f64);
                let measured = Increment { forward_m: 1.1 * forward_m, lateral_m: 0.0, turn_rad: 1.05 * turn_rad };
                self.odom = move_by(self.odom, measured);
                self.truth = move_by(self.truth, Increment { forward_m, lateral_m: 0.0, turn_rad });
                let known = step % know == 0 || step == steps;
                self.drive.push(self.odom, known.then_some(self.truth));
            }
            self
        }
    }

    fn check(trials: &[Trial], scale: f64, own: fn(&Trial) -> (f64, f64), measured: &[f64]) {
        assert_eq!(trials.len(), measured.len(), "{trials:?}");
        for (trial, expected) in trials.iter().zip(measured) {
            let (measured, truth) = own(trial);
            // The ends of a piece are trimmed by a hundredth and a step.
            assert!((measured - expected).abs() < 0.02 * expected.abs() + 0.05, "{trial:?}, expected {expected}");
            assert!((measured / truth - scale).abs() < 1e-4, "{trial:?}");
        }
    }

    const WAY: fn(&Trial) -> (f64, f64) = |trial| (trial.measured_m, trial.true_m);
    const TURN: fn(&Trial) -> (f64, f64) = |trial| (trial.measured_rad, trial.true_rad);

    #[test]
    fn straight_ways_and_turns_forwards_and_backwards() {
        let mut robot = Robot::new();
        robot.go(1.0, 0.0, 1).go(0.0, 1.5, 1).go(-0.8, 0.0, 1).go(0.0, -1.0, 1).go(0.2, 0.0, 1).go(0.0, 0.2, 1);
        let (translations, rotations) = robot.drive.trials();
        check(&translations, 1.1, WAY, &[1.1, -0.88]);
        check(&rotations, 1.05, TURN, &[1.0, 0.575, -1.05]);
        // Nothing of the turn is in the way, nor the other way round.
        assert!(translations.iter().all(|trial| trial.measured_rad.abs() < 0.02), "{translations:?}");
        assert!(rotations.iter().all(|trial| trial.measured_m.abs() < 0.01), "{rotations:?}");
    }

    #[test]
    fn back_and_forth_are_two_trials() {
        let mut robot = Robot::new();
        robot.go(0.7, 0.0, 1).go(-0.7, 0.0, 1).go(0.0, 0.9, 1).go(0.0, -0.9, 1);
        let (translations, rotations) = robot.drive.trials();
        check(&translations, 1.1, WAY, &[0.77, -0.77]);
        check(&rotations, 1.05, TURN, &[0.945, -0.945]);
    }

    #[test]
    fn long_ones_are_cut_and_turns_are_not_wrapped() {
        let mut robot = Robot::new();
        robot.go(5.0, 0.0, 1).go(0.0, 4.0 * PI, 1);
        let (translations, rotations) = robot.drive.trials();
        let whole = |trials: &[Trial], own: fn(&Trial) -> (f64, f64)| trials.iter().map(|t| own(t).0).sum::<f64>();
        assert_eq!((translations.len(), rotations.len()), (3, 13));
        assert!((whole(&translations, WAY) - 5.5).abs() < 0.1, "{translations:?}");
        assert!((whole(&rotations, TURN) - 4.2 * PI).abs() < 0.3, "{rotations:?}");
    }

    /// A bend of less than 0.1 rad, with the truth known at its ends alone: chords would be too short.
    #[test]
    fn a_bend_is_as_long_as_its_arc() {
        let mut robot = Robot::new();
        robot.go(1.0, 0.09, 1000);
        let (translations, _) = robot.drive.trials();
        assert_eq!(translations.len(), 1);
        let Trial { measured_m, measured_rad, true_m, true_rad } = translations[0];
        assert!((true_m - 1.0).abs() < 1e-6 && (measured_m - 1.1).abs() < 1e-6, "{measured_m} {true_m}");
        assert!((true_rad - 0.09).abs() < 1e-9 && (measured_rad - 0.0945).abs() < 1e-9);
    }

    #[test]
    fn circles_and_standing_are_no_trials() {
        let mut robot = Robot::new();
        robot.go(3.0, 3.0, 1).go(0.0, 0.0, 1).go(-3.0, 2.0, 1);
        assert_eq!(robot.drive.trials(), (vec![], vec![]));
        // As many as may be, and in no time.
        for _ in 0..200_000 {
            robot.go(0.0, 0.0, 1);
        }
        robot.go(0.0, 1.0, 1);
        check(&robot.drive.trials().1, 1.05, TURN, &[1.05]);
    }

    #[test]
    fn jumps_and_long_gaps_cut_the_drive() {
        let mut robot = Robot::new();
        robot.go(0.5, 0.0, 1);
        // Somebody carries the robot; then the odometry is set anew; then the truth is lost for long.
        robot.truth = Pose2::new(50.0, 0.0, 0.0);
        robot.go(0.5, 0.0, 1);
        robot.odom = Pose2::new(-90.0, 3.0, 0.0);
        robot.go(0.6, 0.0, 1).go(2.5, 0.0, 1000).go(0.7, 0.0, 1);
        let (translations, _) = robot.drive.trials();
        check(&translations, 1.1, WAY, &[0.52, 0.52, 0.64, 0.77]);
        assert!(translations.iter().all(|trial| trial.lin_error_m().abs() < 0.1), "{translations:?}");
    }

    #[test]
    fn the_other_axis_is_taken_out_by_its_slope() {
        let (a_l, a_t) = (1.0 - 1.0 / 1.1, 1.0 - 1.0 / 1.05);
        let mut translations = [Trial { measured_m: 1.1, measured_rad: 0.105, true_m: 1.0, true_rad: 0.1 }; 2];
        let mut rotations = [Trial { measured_m: 0.11, measured_rad: 1.05, true_m: 0.1, true_rad: 1.0 }; 2];
        let plain = Calibration::fit(&translations, &rotations).unwrap();
        assert!(plain.ang_offset_rad > 0.004 && plain.lin_offset_m > 0.009, "{plain:?}");
        separate(&mut translations, &mut rotations).unwrap();
        let fit = Calibration::fit(&translations, &rotations).unwrap();
        assert!(fit.ang_offset_rad.abs() < 1e-12 && fit.lin_offset_m.abs() < 1e-12, "{fit:?}");
        assert!((fit.lin_scale - a_l).abs() < 1e-12 && (fit.ang_scale - a_t).abs() < 1e-12, "{fit:?}");
        assert!(separate(&mut [], &mut rotations).is_err());
    }

    proptest! {
        #[test]
        fn any_drive_is_survived(
            steps in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -4.0..4.0f64, 0..4u8), 0..80),
        ) {
            let limits = Limits::default();
            let mut drive = Drive::new(limits);
            let mut pose = Pose2::IDENTITY;
            for (forward, side, turn, kind) in steps {
                let small = if kind < 2 { 0.1 } else { 1.0 };
                pose = pose * Pose2::new(small * forward, small * 0.1 * side, small * turn);
                let truth = (kind != 1).then_some(if kind == 3 { Pose2::new(f64::NAN, 0.0, 0.0) } else { pose });
                drive.push(pose, truth);
            }
            let (translations, rotations) = drive.trials();
            prop_assert!(translations.iter().all(|trial| trial.measured_m.abs() >= limits.straight_min_m));
            prop_assert!(rotations.iter().all(|trial| trial.measured_rad.abs() >= limits.turn_min_rad));
            prop_assert!(translations.iter().all(|trial| trial.measured_rad.abs() < limits.straight_turn_rad));
        }
    }
}
