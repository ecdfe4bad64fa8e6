//! What the map of a drive is worth that goes round and round.

use std::collections::VecDeque;

use echogrid_core::{Estimate, GridMapper, MapperConfig, Pose2, Reading};
use echogrid_judge::Quality;
use echogrid_judge::quality::Truth;
use echogrid_service::Sensor as _;
use echogrid_simulator::{Place, Route, Simulator, SimulatorConfig};
use echogrid_topics::Message;

use crate::support::{named, pioneer, pioneer_config};

/// Where the robot really was, by stamps in nanoseconds.
#[derive(Default)]
struct Poses(Vec<(u64, Pose2)>);

impl Poses {
    fn at(&self, stamp_ns: u64) -> Estimate {
        let next = self.0.partition_point(|(stamp, _)| *stamp < stamp_ns).clamp(1, self.0.len() - 1);
        let ((from_ns, from), (to_ns, to)) = (self.0[next - 1], self.0[next]);
        let share = (stamp_ns as f64 - from_ns as f64) / (to_ns - from_ns) as f64;
        Estimate::certain(from.interpolate(to, share.clamp(0.0, 1.0)))
    }
}

/// Bits of the maps that come of so many laps of a floor with exact poses, after each lap, of each mapper.
fn bits_of_laps(world_name: &str, laps: usize, mappers: &[MapperConfig]) -> Vec<Vec<f64>> {
    let world = named(world_name);
    let goals = &world.parts().places.goals;
    let route = (0..laps).flat_map(|_| goals.iter().map(|goal| Place::Goal(goal.name.clone()))).collect();
    let config = SimulatorConfig { route: Route::Places(route), ..pioneer_config(world_name) };
    let home = goals.last().unwrap().pose;
    let mapper_of = |config: &MapperConfig| GridMapper::with_defaults_of_odometry(config, pioneer()).unwrap();
    let mut mappers: Vec<GridMapper> = mappers.iter().map(mapper_of).collect();
    let mut simulator = Simulator::new(&config, world.clone(), pioneer()).unwrap();
    let (mut poses, mut scans) = (Poses::default(), VecDeque::<(u64, Vec<Reading>)>::new());
    let (mut sequence, mut is_away, mut bits) = (0, false, vec![Vec::new(); mappers.len()]);
    while let Some((stamp_ns, message)) = simulator.next().unwrap() {
        match message {
            Message::TruePose(pose) => poses.0.extend(pose.map_from_base.map(|pose| (stamp_ns, pose))),
            Message::Scan(readings) => scans.push_back((stamp_ns, readings)),
            _ => {}
        }
        // Half a second later it is known where the robot was.
        while scans.front().is_some_and(|(stamp, _)| *stamp + 500_000_000 < stamp_ns) {
            let Some((stamp_ns, readings)) = scans.pop_front() else { break };
            let located = |reading: Reading| {
                let at_ns = stamp_ns.saturating_add_signed(i64::from(reading.offset_ns));
                (reading, Some(poses.at(at_ns)))
            };
            let scan: Vec<_> = readings.into_iter().map(located).collect();
            sequence += 1;
            mappers.iter_mut().for_each(|mapper| _ = mapper.integrate_scan(sequence, &scan));
        }
        let home_m = simulator.true_pose().distance_m(home);
        is_away |= home_m > 2.0;
        if is_away && home_m < 0.03 {
            is_away = false;
            let path: Vec<Pose2> = poses.0.iter().map(|(_, pose)| *pose).collect();
            for (mapper, bits) in mappers.iter().zip(&mut bits) {
                let truth = Truth::of(&world, &path, mapper.grid()).unwrap();
                bits.push(Quality::against(mapper.grid(), &truth).unwrap().bits);
            }
        }
    }
    assert!(bits.iter().all(|bits| bits.len() == laps), "{bits:?}");
    bits
}

/// Walls that are met obliquely are not taken for air lap by lap.
#[test]
fn laps_make_no_map_worse() {
    let as_it_comes = MapperConfig::default();
    let all_counts = MapperConfig { oriented_looks: 0.0, oriented_place_m: 0.0, ..MapperConfig::default() };
    let bits = bits_of_laps("floor-101", 5, &[as_it_comes, all_counts]);
    assert!(bits[0].iter().all(|lap| *lap <= bits[0][0]), "{bits:?}");
    // It is what is heard again that makes a map worse.
    assert!(bits[1][4] > bits[1][0] + 0.01, "{bits:?}");
}
