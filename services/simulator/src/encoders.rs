//! Wheel encoders, and the dead reckoning that a robot's firmware does with them.

use echogrid_core::{Increment, Pose2, move_by};

use crate::slip::Wheels;

/// Counts ticks, and adds them up to a pose.
#[derive(Debug, Clone)]
pub(crate) struct Encoders {
    ticks_per_m: f64,
    axle_m: f64,
    /// Way of both sides since the start; never rounded.
    way: Wheels,
    /// Ticks already in the pose: whole numbers.
    counted: Wheels,
    odom_from_base: Pose2,
    /// Δl and Δθ since the start, both with their signs.
    pub(crate) ahead_m: f64,
    pub(crate) turned_rad: f64,
}

impl Encoders {
    pub(crate) fn new(ticks_per_m: f64, axle_m: f64, odom_from_base: Pose2) -> Self {
        let (way, counted) = (Wheels::default(), Wheels::default());
        Self { ticks_per_m, axle_m, way, counted, odom_from_base, ahead_m: 0.0, turned_rad: 0.0 }
    }

    /// The wheels go on.
    pub(crate) fn turn(&mut self, wheels: Wheels) {
        self.way.left_m += wheels.left_m;
        self.way.right_m += wheels.right_m;
    }

    /// Adds the ticks since the last time to the pose; gives it.
    pub(crate) fn count(&mut self) -> Pose2 {
        // Ticks come where the way passes a whole number of them.
        let ticks = Wheels {
            left_m: (self.way.left_m * self.ticks_per_m).floor(),
            right_m: (self.way.right_m * self.ticks_per_m).floor(),
        };
        let left_m = (ticks.left_m - self.counted.left_m) / self.ticks_per_m;
        let right_m = (ticks.right_m - self.counted.right_m) / self.ticks_per_m;
        self.counted = ticks;
        let forward_m = 0.5 * (left_m + right_m);
        let turn_rad = (right_m - left_m) / self.axle_m;
        self.ahead_m += forward_m;
        self.turned_rad += turn_rad;
        self.odom_from_base = move_by(self.odom_from_base, Increment { forward_m, lateral_m: 0.0, turn_rad });
        self.odom_from_base
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_counted_in_whole_ticks() {
        let mut encoders = Encoders::new(100.0, 0.5, Pose2::IDENTITY);
        let mut seen = Vec::new();
        for _ in 0..10 {
            encoders.turn(Wheels { left_m: 0.004, right_m: 0.004 });
            seen.push(encoders.count().x);
        }
        // 4 mm a step, 10 mm a tick: a pose that stands still, then jumps, and loses nothing.
        let ticks = [0, 0, 1, 1, 2, 2, 2, 3, 3, 4];
        for (x, ticks) in seen.iter().zip(ticks) {
            assert!((x - 0.01 * f64::from(ticks)).abs() < 1e-12, "{seen:?}");
        }
    }

    #[test]
    fn one_tick_more_on_the_right_turns_to_the_left() {
        let mut encoders = Encoders::new(100.0, 0.5, Pose2::new(1.0, 2.0, 0.0));
        encoders.turn(Wheels { left_m: 0.0, right_m: 0.0105 });
        let pose = encoders.count();
        assert!(
            (pose.theta - 0.02).abs() < 1e-15 && (pose.distance_m(Pose2::new(1.0, 2.0, 0.0)) - 0.005).abs() < 1e-15
        );
        encoders.turn(Wheels { left_m: -0.0205, right_m: -0.031 });
        encoders.count();
        // Backwards, a tick comes as soon as the way passes it.
        assert!((encoders.turned_rad - (-0.03 + 0.03) / 0.5).abs() < 1e-12, "{}", encoders.turned_rad);
        assert!((encoders.ahead_m + 0.03).abs() < 1e-12, "{}", encoders.ahead_m);
    }
}
