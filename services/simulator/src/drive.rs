//! The drive: how a robot really moves when it is told to, and what its odometry makes of it.

use echogrid_core::{Increment, Pose2, Trial, move_by};

use crate::config::SimulatorConfig;
use crate::encoders::Encoders;
use crate::slip::Slip;

/// A step of the motion is no longer than this, seconds.
pub const STEP_S: f64 = 0.02;

/// A motion of a script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Straight ahead; backwards if negative.
    Straight {
        /// How far, metres.
        metres: f64,
    },
    /// On the spot, counter-clockwise; clockwise if negative.
    Turn {
        /// How far, radians.
        radians: f64,
    },
    /// Nothing for a while.
    Wait {
        /// How long, seconds.
        seconds: f64,
    },
}

/// What the drive is told to do next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Command {
    /// Speed to come to, m/s.
    pub(crate) v_mps: f64,
    /// Turn rate to come to, rad/s.
    pub(crate) w_radps: f64,
    /// Never farther than this, metres either way; none: without end.
    pub(crate) at_most_m: Option<f64>,
    /// The same of the turn, radians.
    pub(crate) at_most_rad: Option<f64>,
}

/// A robot's drive without a world: it can be driven anywhere, for trials of its odometry.
///
/// ```
/// use echogrid_simulator::{Drive, Motion, SimulatorConfig};
/// # use echogrid_core::Pose2;
/// let mut drive = Drive::new(&SimulatorConfig { right_scale: 0.01, ..SimulatorConfig::default() }, Pose2::IDENTITY);
/// let trial = drive.run(Motion::Straight { metres: 2.0 });
/// assert!((trial.true_m - 2.0).abs() < 1e-9 && trial.measured_rad > 0.0);
/// ```
#[derive(Debug, Clone)]
pub struct Drive {
    accel_mps2: f64,
    decel_mps2: f64,
    turn_accel_radps2: f64,
    speed_mps: f64,
    turn_radps: f64,
    map_from_base: Pose2,
    v_mps: f64,
    w_radps: f64,
    /// Δl and Δθ since the start, with their signs.
    ahead_m: f64,
    turned_rad: f64,
    slip: Slip,
    encoders: Encoders,
}

impl Drive {
    /// A drive at rest at `start`, which the odometry knows.
    #[must_use]
    pub fn new(config: &SimulatorConfig, start: Pose2) -> Self {
        Self {
            accel_mps2: config.accel_mps2,
            decel_mps2: config.decel_mps2,
            turn_accel_radps2: config.turn_accel_radps2,
            speed_mps: config.speed_mps,
            turn_radps: config.turn_radps,
            map_from_base: start,
            v_mps: 0.0,
            w_radps: 0.0,
            ahead_m: 0.0,
            turned_rad: 0.0,
            slip: Slip::new(config),
            encoders: Encoders::new(config.ticks_per_m, config.axle_m, start),
        }
    }

    /// Where the robot really is, map frame.
    #[must_use]
    pub fn true_pose(&self) -> Pose2 {
        self.map_from_base
    }

    /// Where its odometry believes that it is, by the ticks that have come so far.
    pub fn odometry_pose(&mut self) -> Pose2 {
        self.encoders.count()
    }

    /// Carries out a motion to its end: what was measured of it, and what it was.
    pub fn run(&mut self, motion: Motion) -> Trial {
        let before = self.trial();
        let mut script = Script::new(motion, self);
        while let Some(command) = script.next(self, STEP_S) {
            self.step(command, STEP_S);
            self.encoders.count();
        }
        (self.v_mps, self.w_radps) = (0.0, 0.0);
        let after = self.trial();
        Trial {
            measured_m: after.measured_m - before.measured_m,
            measured_rad: after.measured_rad - before.measured_rad,
            true_m: after.true_m - before.true_m,
            true_rad: after.true_rad - before.true_rad,
        }
    }

    /// Since the start.
    fn trial(&mut self) -> Trial {
        self.encoders.count();
        Trial {
            measured_m: self.encoders.ahead_m,
            measured_rad: self.encoders.turned_rad,
            true_m: self.ahead_m,
            true_rad: self.turned_rad,
        }
    }

    pub(crate) fn v_mps(&self) -> f64 {
        self.v_mps
    }

    pub(crate) fn w_radps(&self) -> f64 {
        self.w_radps
    }

    /// Speed from which the robot can come to a halt within `left_m`; never more than it may drive.
    pub(crate) fn speed_to_stop_in(&self, left_m: f64) -> f64 {
        (2.0 * self.decel_mps2 * left_m.max(0.0)).sqrt().min(self.speed_mps)
    }

    /// The same of a turn.
    pub(crate) fn turn_to_stop_in(&self, left_rad: f64) -> f64 {
        (2.0 * self.turn_accel_radps2 * left_rad.max(0.0)).sqrt().min(self.turn_radps)
    }

    /// Way that it takes to come to a halt, metres.
    pub(crate) fn way_to_stop_m(&self) -> f64 {
        0.5 * self.v_mps * self.v_mps / self.decel_mps2
    }

    /// What the next step would lead to: way ahead and turn.
    pub(crate) fn next_step(&self, command: Command, dt_s: f64) -> (f64, f64) {
        let speeding = command.v_mps.abs() > self.v_mps.abs() && command.v_mps * self.v_mps >= 0.0;
        let rate = if speeding { self.accel_mps2 } else { self.decel_mps2 };
        let v = towards(self.v_mps, command.v_mps, rate * dt_s);
        let w = towards(self.w_radps, command.w_radps, self.turn_accel_radps2 * dt_s);
        let bounded = |way: f64, most: Option<f64>| most.map_or(way, |most| way.clamp(-most, most));
        (bounded(v * dt_s, command.at_most_m), bounded(w * dt_s, command.at_most_rad))
    }

    /// Drives on for a moment.
    pub(crate) fn step(&mut self, command: Command, dt_s: f64) {
        let (ahead_m, turn_rad) = self.next_step(command, dt_s);
        (self.v_mps, self.w_radps) = (ahead_m / dt_s, turn_rad / dt_s);
        self.encoders.turn(self.slip.measured(ahead_m, turn_rad));
        let bump_rad = self.slip.bumps(ahead_m);
        let step = Increment { forward_m: ahead_m, lateral_m: 0.0, turn_rad };
        let Pose2 { x, y, theta } = move_by(self.map_from_base, step);
        self.map_from_base = Pose2::new(x, y, theta + bump_rad);
        self.ahead_m += ahead_m;
        self.turned_rad += turn_rad + bump_rad;
    }

    /// It stands, and its wheels with it.
    pub(crate) fn halt(&mut self) {
        (self.v_mps, self.w_radps) = (0.0, 0.0);
    }
}

/// `value`, by `step` at most nearer to `target`.
fn towards(value: f64, target: f64, step: f64) -> f64 {
    value + (target - value).clamp(-step, step)
}

/// A motion under way.
#[derive(Debug, Clone)]
pub(crate) struct Script {
    motion: Motion,
    /// Where the drive stood as it began.
    ahead_m: f64,
    turned_rad: f64,
    waited_s: f64,
}

impl Script {
    pub(crate) fn new(motion: Motion, drive: &Drive) -> Self {
        Self { motion, ahead_m: drive.ahead_m, turned_rad: drive.turned_rad, waited_s: 0.0 }
    }

    /// What to do next; none: it is done.
    pub(crate) fn next(&mut self, drive: &Drive, dt_s: f64) -> Option<Command> {
        // Nearer than this is there: a rounding error of a long way.
        const THERE: f64 = 1e-9;
        match self.motion {
            Motion::Straight { metres } => {
                let left_m = metres - (drive.ahead_m - self.ahead_m);
                let v_mps = drive.speed_to_stop_in(left_m.abs()).copysign(left_m);
                let command =
                    Command { v_mps, at_most_m: Some(left_m.abs()), at_most_rad: Some(0.0), ..Command::default() };
                (left_m.abs() > THERE).then_some(command)
            }
            Motion::Turn { radians } => {
                let left_rad = radians - (drive.turned_rad - self.turned_rad);
                let w_radps = drive.turn_to_stop_in(left_rad.abs()).copysign(left_rad);
                let command =
                    Command { w_radps, at_most_rad: Some(left_rad.abs()), at_most_m: Some(0.0), ..Command::default() };
                (left_rad.abs() > THERE).then_some(command)
            }
            Motion::Wait { seconds } => {
                self.waited_s += dt_s;
                let still = Command { at_most_m: Some(0.0), at_most_rad: Some(0.0), ..Command::default() };
                (self.waited_s < seconds + dt_s).then_some(still)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact() -> SimulatorConfig {
        SimulatorConfig {
            slip_m2_per_m: 0.0,
            scrub_rad2_per_rad: 0.0,
            scrub_m2_per_rad: 0.0,
            bumps_per_m: 0.0,
            ticks_per_m: 1e9,
            ..SimulatorConfig::default()
        }
    }

    #[test]
    fn without_errors_the_odometry_is_right() {
        let mut drive = Drive::new(&exact(), Pose2::new(1.0, 2.0, 0.5));
        for motion in [
            Motion::Straight { metres: 1.5 },
            Motion::Turn { radians: -2.0 },
            Motion::Wait { seconds: 0.5 },
            Motion::Straight { metres: -0.7 },
        ] {
            let trial = drive.run(motion);
            assert!((trial.measured_m - trial.true_m).abs() < 1e-6, "{trial:?}");
            assert!((trial.measured_rad - trial.true_rad).abs() < 1e-6, "{trial:?}");
        }
        let expected = Pose2::new(1.0, 2.0, 0.5) * Pose2::new(1.5, 0.0, -2.0) * Pose2::new(-0.7, 0.0, 0.0);
        assert!(drive.true_pose().distance_m(expected) < 1e-9, "{:?}", drive.true_pose());
        assert!(drive.odometry_pose().distance_m(expected) < 1e-5);
    }

    #[test]
    fn speed_and_acceleration_stay_within_limits() {
        let config = SimulatorConfig { speed_mps: 0.4, accel_mps2: 0.2, decel_mps2: 0.8, ..exact() };
        let mut drive = Drive::new(&config, Pose2::IDENTITY);
        let mut script = Script::new(Motion::Straight { metres: 2.0 }, &drive);
        let (mut fastest, mut steps) = (0.0_f64, 0);
        while let Some(command) = script.next(&drive, STEP_S) {
            let before = drive.v_mps();
            drive.step(command, STEP_S);
            let change = (drive.v_mps() - before) / STEP_S;
            // The last step ends where the way does.
            let last = drive.ahead_m > 2.0 - 1e-9;
            assert!(change < 0.2 + 1e-9 && (change > -0.8 - 1e-9 || last), "{change}");
            fastest = fastest.max(drive.v_mps());
            steps += 1;
        }
        assert!((fastest - 0.4).abs() < 1e-12);
        // 2 s to get up to speed, 0.5 s to stop, 1.5 m at full speed between the two.
        let seconds = f64::from(steps) * STEP_S;
        assert!((seconds - (2.0 + 0.5 + 1.5 / 0.4)).abs() < 0.2, "{seconds}");
    }

    #[test]
    fn each_cause_does_what_it_should() {
        let straight = Motion::Straight { metres: 10.0 };
        let turn = Motion::Turn { radians: 10.0 };
        let run = |config: &SimulatorConfig, motion| Drive::new(config, Pose2::IDENTITY).run(motion);
        // A larger left wheel: measures too far, and a turn to the right.
        let trial = run(&SimulatorConfig { left_scale: 0.02, ..exact() }, straight);
        assert!((trial.measured_m - 10.1).abs() < 1e-6 && (trial.measured_rad + 0.2 / 0.4).abs() < 1e-6, "{trial:?}");
        // A longer axle: wheels travel farther in a turn than believed.
        let trial = run(&SimulatorConfig { axle_scale: 0.05, ..exact() }, turn);
        assert!((trial.measured_rad - 10.5).abs() < 1e-6 && trial.measured_m.abs() < 1e-6, "{trial:?}");
        assert!((run(&SimulatorConfig { axle_scale: 0.05, ..exact() }, straight).measured_m - 10.0).abs() < 1e-6);
        // A bump turns the robot, and the wheels know nothing of it.
        let trial = run(&SimulatorConfig { bumps_per_m: 1.0, bump_rad: 0.1, ..exact() }, straight);
        assert!(trial.true_rad.abs() > 0.01 && trial.measured_rad.abs() < 1e-6, "{trial:?}");
        // Scrub comes of turning only.
        let scrub = SimulatorConfig { scrub_rad2_per_rad: 1e-2, scrub_m2_per_rad: 1e-4, ..exact() };
        let trial = run(&scrub, straight);
        assert!((trial.measured_m - 10.0).abs() < 1e-6 && trial.measured_rad.abs() < 1e-6, "{trial:?}");
        let trial = run(&scrub, turn);
        assert!((trial.measured_rad - 10.0).abs() > 1e-3 && trial.measured_m.abs() > 1e-4, "{trial:?}");
    }

    #[test]
    fn coarse_encoders_are_seen_in_the_pose() {
        let mut drive = Drive::new(&SimulatorConfig { ticks_per_m: 50.0, ..exact() }, Pose2::IDENTITY);
        drive.run(Motion::Straight { metres: 0.7300 });
        let x = drive.odometry_pose().x;
        assert!((x - 0.72).abs() < 1e-12, "{x}: 2 cm a tick");
    }
}
