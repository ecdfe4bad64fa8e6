//! Small works that are always the same, for counting their instructions: `.ci/instructions` runs each under callgrind.
//!
//! `WORK COUNT` does the work with so many scans (or poses) of a robot that drives round in rooms; with 0 only what leads up to it is done.

#![allow(clippy::expect_used, clippy::print_stderr, reason = "a benchmark")]

#[allow(dead_code, reason = "the other benchmarks take the rest")]
mod drive;

use std::process::ExitCode;

use drive::{lidar, pioneer};
use echogrid_core::config::{Fusion, Noise};
use echogrid_core::{
    Echo, Estimate, GridMapper, MapperConfig, Odometry, OdometryConfig, Pose2, Reading, Robot, Segment, World,
    WorldParts,
};

const BEAMS: u16 = 180;
/// Scans that are made up, whatever is done with them.
const SCANS: usize = 400;

/// A room of 6 m by 4 m with a pillar.
fn room() -> World {
    let corners = |[x, y]: [f64; 2], [w, h]: [f64; 2]| [[x, y], [x + w, y], [x + w, y + h], [x, y + h]];
    let walls = [corners([-3.0, -2.0], [6.0, 4.0]), corners([-0.3, -0.3], [0.6, 0.6])]
        .into_iter()
        .flat_map(|corners| (0..4).map(move |k| Segment { from: corners[k], to: corners[(k + 1) % 4] }));
    World::new(WorldParts { walls: walls.collect(), ..WorldParts::default() }).expect("walls")
}

/// Where the robot is: on an ellipse round the pillar.
fn pose(step: usize) -> Pose2 {
    let turned = 0.03 * step as f64;
    Pose2::new(1.8 * libm::cos(turned), 1.2 * libm::sin(turned), turned + 1.6)
}

fn scan(world: &World, robot: &Robot, step: usize) -> Vec<(Reading, Option<Estimate>)> {
    let estimate = Estimate::certain(pose(step));
    let reading = |transducer: u16| {
        let from = pose(step) * robot.transducer(transducer).expect("the robot's").base_from_transducer;
        let hit = world.cast([from.x, from.y], from.theta, 20.0);
        let echo = hit.map_or(Echo::NoEcho, |hit| Echo::Hit { range_m: hit.distance_m });
        (Reading { transducer, echo, offset_ns: 0 }, Some(estimate))
    };
    (0..robot.transducer_count() as u16).map(reading).collect()
}

fn map(robot: Robot, fusion: Fusion, count: usize) {
    let world = room();
    let scans: Vec<_> = (0..SCANS).map(|step| scan(&world, &robot, step)).collect();
    let config = MapperConfig { fusion, ..MapperConfig::default() };
    let mut mapper = GridMapper::new(&config, Noise::OneSigma, 1, robot).expect("valid");
    for (sequence, scan) in (1..).zip(scans.iter().cycle().take(count)) {
        std::hint::black_box(mapper.integrate_scan(sequence, scan));
    }
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let work = |words: &[String]| Some((words.first()?.clone(), words.get(1)?.parse::<usize>().ok()?));
    let Some((work, count)) = work(&words) else {
        eprintln!("expected WORK COUNT");
        return ExitCode::FAILURE;
    };
    match work.as_str() {
        "paper" => map(pioneer(), Fusion::Paper, count),
        "first_echo" => map(pioneer(), Fusion::FirstEcho, count),
        "oriented" => map(pioneer(), Fusion::Oriented, count),
        "laser" => map(lidar(BEAMS, core::f64::consts::PI), Fusion::Auto, count),
        "odometry" => {
            let mut odometry = Odometry::new(&OdometryConfig::default());
            for step in 0..count {
                std::hint::black_box(odometry.step(pose(step)));
            }
        }
        _ => {
            eprintln!("no work is called {work}");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
