//! A sensor of your own, in Rust: a make-believe robot that wanders about a square room.
//!
//! ```sh
//! cargo build --example random_walk
//! cargo run -- up launch/graphs/map.toml --sensor target/debug/examples/random_walk
//! ```
//!
//! Its odometry is exact, but nobody told echogrid, which takes it for a mediocre robot's: the walls
//! come out thick. `--set odometry.k_ll=0`, likewise `k_lt`, `k_tt` and `k_tl`, makes them thinner.
//!
//! To echogrid it is as good as a real one: a process of its own that says what the robot looks
//! like, where its wheels believe it is, and what its sonars hear. For a robot of yours, replace
//! what `RandomWalk` makes up by what your hardware tells; `main` stays as it is.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_4, FRAC_PI_6, TAU};
use std::process::ExitCode;

use anyhow::Result;
use echogrid_core::{Echo, Footprint, Pose2, Reading, Robot, Sensor as Sonar, SensorKind, wrap_angle};
use echogrid_service::{Sensor, process};
use echogrid_topics::{Message, RawOdometry, Topic};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The room's side, metres; its corner is the origin of the odometry frame, and so of the map.
const ROOM_M: f64 = 6.0;
const STEPS: u64 = 2000;
const STEP_NS: u64 = 100_000_000;
const STEP_M: f64 = 0.04;
const STEP_RAD: f64 = 0.15;

/// The topics of every sensor. The launcher has made them before it starts anyone.
pub(crate) const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];

/// The robot, and what it has still to say.
#[derive(Debug)]
pub(crate) struct RandomWalk {
    robot: Robot,
    pose: Pose2,
    /// Where it is heading for.
    goal: [f64; 2],
    /// Seeded: the same walk each time, and so the same map, byte for byte.
    random: ChaCha8Rng,
    step: u64,
    outbox: VecDeque<(u64, Message)>,
}

impl RandomWalk {
    pub(crate) fn new() -> Self {
        let robot = robot();
        // The robot comes first: without its sensors' places nobody could use a reading.
        let outbox = VecDeque::from([(0, Message::Robot(robot.clone()))]);
        let pose = Pose2::new(ROOM_M / 2.0, ROOM_M / 2.0, 0.0);
        Self { robot, pose, goal: [pose.x, pose.y], random: ChaCha8Rng::seed_from_u64(1), step: 0, outbox }
    }

    /// Drives a step towards the goal, or turns on the spot until it lies ahead.
    fn drive(&mut self) {
        let [dx, dy] = [self.goal[0] - self.pose.x, self.goal[1] - self.pose.y];
        if dx.hypot(dy) < STEP_M {
            // Somewhere else, a metre away from the walls.
            self.goal = [(); 2].map(|()| 1.0 + (ROOM_M - 2.0) * self.random.next_u32() as f64 / u32::MAX as f64);
            return;
        }
        let turn = wrap_angle(dy.atan2(dx) - self.pose.theta);
        let forward = if turn.abs() > STEP_RAD { 0.0 } else { STEP_M };
        self.pose = self.pose * Pose2::new(0.0, 0.0, turn.clamp(-STEP_RAD, STEP_RAD)) * Pose2::new(forward, 0.0, 0.0);
    }

    /// What sonar `number` hears: the first echo from anywhere in its cone.
    fn listen(&self, number: u16) -> Reading {
        let sonar = self.robot.transducer(number).map(|transducer| self.pose * transducer.base_from_transducer);
        let ray = |bearing_rad| sonar.map_or(f64::INFINITY, |sonar| to_the_wall(sonar, bearing_rad));
        let nearest_m = (-5..=5).map(|i| ray(f64::from(i) / 10.0 * FRAC_PI_6)).fold(f64::INFINITY, f64::min);
        // Hearing nothing is something else than a fault, and neither is a magic range.
        let echo = if nearest_m < 5.0 { Echo::Hit { range_m: nearest_m } } else { Echo::NoEcho };
        Reading { transducer: number, echo, offset_ns: 0 }
    }
}

/// This is all that echogrid wants of a sensor.
impl Sensor for RandomWalk {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        if self.outbox.is_empty() && self.step < STEPS {
            self.step += 1;
            // Stamps are the sensor's own clock. echogrid looks at no other.
            let stamp_ns = self.step * STEP_NS;
            let before = self.pose;
            self.drive();
            let v_mps = before.distance_m(self.pose) / (STEP_NS as f64 * 1e-9);
            let w_radps = wrap_angle(self.pose.theta - before.theta) / (STEP_NS as f64 * 1e-9);
            let odometry = RawOdometry { odom_from_base: self.pose, v_mps, w_radps };
            let readings = (0..8).map(|number| self.listen(number)).collect();
            // At equal stamps the pose goes first: readings wait for it.
            self.outbox.push_back((stamp_ns, Message::Odometry(odometry)));
            self.outbox.push_back((stamp_ns, Message::Scan(readings)));
        }
        // None ends the streams: the others finish, the map is saved.
        Ok(self.outbox.pop_front())
    }
}

/// Eight sonars in a ring, as a Pioneer's, each 30° wide.
fn robot() -> Robot {
    let sonar = |number: u16| Sonar {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.0, f64::from(number) * FRAC_PI_4) * Pose2::new(0.2, 0.0, 0.0),
        first_transducer: number,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: FRAC_PI_6,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    let footprint = Footprint { length_m: 0.5, width_m: 0.5 };
    Robot { name: "random walk".into(), footprint, sensors: (0..8).map(sonar).collect() }
}

/// Metres from a place in the room to its wall.
fn to_the_wall(from: Pose2, bearing_rad: f64) -> f64 {
    let (sin, cos) = ((from.theta + bearing_rad) % TAU).sin_cos();
    let along = |at: f64, towards: f64| if towards > 0.0 { ROOM_M - at } else { at } / towards.abs();
    along(from.x, cos).min(along(from.y, sin))
}

/// Enters the graph that the launcher names in the environment, plays at its rate, never ahead of
/// the slowest consumer, and leaves when all has been taken in.
fn main() -> ExitCode {
    process::run_sensor("random-walk", OUTPUTS, |_plan| Ok(RandomWalk::new()))
}
