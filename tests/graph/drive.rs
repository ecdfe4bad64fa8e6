//! A drive that the project makes itself: a Pioneer 3-AT with drifting odometry through an office
//! floor of a corridor and rooms. Tests need no data of anyone else, and the program ships it as the
//! drive that it maps when told nothing.

use std::fmt::Write as _;
use std::path::Path;

use echogrid_core::{Pose2, Robot, wrap_angle};
use echogrid_formats::world;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Poses come this often, seconds.
const PERIOD_S: f64 = 0.1;
/// Every so many poses the ring is heard.
const POSES_PER_RING: usize = 3;
const SPEED_MPS: f64 = 0.4;
const TURN_RATE_RADPS: f64 = 0.6;
/// A surface answers only if the sound meets it steeply enough.
const SPECULAR_LIMIT_RAD: f64 = 0.6;
const NO_ECHO_M: f64 = 5.0;

/// The office floor.
pub(crate) const OFFICE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/worlds/office.toml");

/// A wall between two points, metres.
type Wall = [f64; 4];

/// Walls of the floor: 22 × 12 m, a corridor of 2 m along its middle, rooms with doors on both sides.
fn office() -> Vec<Wall> {
    let world = world::read(Path::new(OFFICE)).unwrap();
    world.parts().walls.iter().map(|wall| [wall.from[0], wall.from[1], wall.to[0], wall.to[1]]).collect()
}

/// Where the robot drives: corridor, and into the rooms.
const WAY: &[[f64; 2]] = &[
    [1.0, 6.0],
    [3.0, 6.0],
    [3.0, 3.5],
    [4.5, 1.5],
    [2.0, 2.0],
    [3.0, 3.8],
    [3.0, 6.0],
    [10.0, 6.0],
    [10.0, 3.5],
    [12.5, 1.5],
    [7.5, 1.5],
    [10.0, 3.5],
    [10.0, 6.0],
    [11.5, 6.0],
    [11.5, 9.0],
    [11.5, 6.0],
    [18.5, 6.0],
    [18.5, 8.5],
    [20.5, 10.5],
    [18.5, 8.5],
    [18.5, 6.0],
    [20.5, 6.0],
];

/// The drive as the text of a CARMEN log with ODOM, SONAR and TRUEPOS lines. `metres` ends it
/// early; the same `seed` gives the same text on every machine.
pub(crate) fn carmen_log(robot: &Robot, seed: u64, metres: f64) -> String {
    let walls = office();
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    let mut log = String::from("# A simulated Pioneer 3-AT in an office floor; made by echogrid's own tests.\n");
    let mut truth = Pose2::new(WAY[0][0], WAY[0][1], 0.0);
    let mut odometry = truth;
    let (mut step, mut driven) = (0_usize, 0.0);
    for target in &WAY[1..] {
        loop {
            let stamp = step as f64 * PERIOD_S;
            let Pose2 { x, y, theta } = odometry;
            let _ = writeln!(log, "ODOM {x:.6} {y:.6} {theta:.6} {SPEED_MPS} 0 0 {stamp:.3} sim {stamp:.3}");
            if step % POSES_PER_RING == 0 {
                let Pose2 { x: true_x, y: true_y, theta: true_theta } = truth;
                let _ = writeln!(
                    log,
                    "TRUEPOS {true_x:.6} {true_y:.6} {true_theta:.6} {x:.6} {y:.6} {theta:.6} {stamp:.3} sim {stamp:.3}"
                );
                let _ = writeln!(
                    log,
                    "{} {x:.6} {y:.6} {theta:.6} {stamp:.3} sim {stamp:.3}",
                    sonar(robot, truth, &walls, &mut normal)
                );
            }
            step += 1;
            let (dx, dy) = (target[0] - truth.x, target[1] - truth.y);
            let turn = wrap_angle(libm::atan2(dy, dx) - truth.theta);
            let distance = libm::hypot(dx, dy);
            if distance < 0.02 || driven >= metres {
                break;
            }
            let turn = turn.clamp(-TURN_RATE_RADPS * PERIOD_S, TURN_RATE_RADPS * PERIOD_S);
            let ahead = if turn.abs() < 0.05 { distance.min(SPEED_MPS * PERIOD_S) } else { 0.0 };
            truth = advance(truth, ahead, turn);
            driven += ahead;
            // Wheels a little too small, an axle a little too short, and some slip.
            let measured_ahead = ahead * (1.01 + 0.03 * normal());
            let measured_turn = turn * (1.008 + 0.03 * normal()) + 0.001 * ahead * normal();
            odometry = advance(odometry, measured_ahead, measured_turn);
        }
    }
    log
}

fn advance(pose: Pose2, ahead: f64, turn: f64) -> Pose2 {
    let (sin, cos) = libm::sincos(pose.theta + turn / 2.0);
    Pose2::new(pose.x + ahead * cos, pose.y + ahead * sin, pose.theta + turn)
}

/// A SONAR line up to the robot's pose.
fn sonar(robot: &Robot, truth: Pose2, walls: &[Wall], normal: &mut impl FnMut() -> f64) -> String {
    let mut line = format!("SONAR 0.523599 {}", robot.sensors.len());
    for sensor in &robot.sensors {
        let mount = truth * sensor.base_from_sensor;
        let rays = (-7..=7).map(|i| mount.theta + f64::from(i) * sensor.aperture_rad / 15.0);
        let heard = rays.filter_map(|bearing| echo([mount.x, mount.y], bearing, walls)).fold(NO_ECHO_M, f64::min);
        let range = if heard < NO_ECHO_M { (heard * (1.0 + 0.01 * normal())).min(NO_ECHO_M) } else { NO_ECHO_M };
        let _ = write!(line, " {range:.3}");
    }
    for sensor in &robot.sensors {
        let Pose2 { x, y, theta } = sensor.base_from_sensor;
        let _ = write!(line, " {x:.3} {y:.3} {theta:.6}");
    }
    line
}

/// Distance to the nearest wall along a ray; none if it is too far or mirrors the sound away.
fn echo([x, y]: [f64; 2], bearing: f64, walls: &[Wall]) -> Option<f64> {
    let (sin, cos) = libm::sincos(bearing);
    let mut nearest: Option<(f64, f64)> = None;
    for [x1, y1, x2, y2] in walls {
        let (along_x, along_y) = (x2 - x1, y2 - y1);
        let across = cos * along_y - sin * along_x;
        if across.abs() < 1e-9 {
            continue;
        }
        let distance = ((x1 - x) * along_y - (y1 - y) * along_x) / across;
        let part = ((x1 - x) * sin - (y1 - y) * cos) / across;
        if distance > 0.0 && (0.0..=1.0).contains(&part) && nearest.is_none_or(|(near, _)| distance < near) {
            let incidence = libm::acos((across.abs() / libm::hypot(along_x, along_y)).min(1.0));
            nearest = Some((distance, incidence));
        }
    }
    nearest.filter(|(distance, incidence)| *distance < NO_ECHO_M && *incidence < SPECULAR_LIMIT_RAD).map(|(d, _)| d)
}
