//! What the map of a drive is worth that goes round and round.

use echogrid_core::{GridMapper, MapperConfig};
use echogrid_simulator::{Route, SimulatorConfig, Waypoint};

use crate::mapped::Drive;
use crate::support::{named, pioneer, pioneer_config};

/// Bits of the maps that come of so many laps of a floor with exact poses, after each lap, of each mapper.
fn bits_of_laps(world_name: &str, laps: usize, mappers: &[MapperConfig]) -> Vec<Vec<f64>> {
    let world = named(world_name);
    let goals = &world.parts().places.goals;
    let route = (0..laps).flat_map(|_| goals.iter().map(|goal| Waypoint::Goal(goal.name.clone()))).collect();
    let config = SimulatorConfig { route: Route::Places(route), ..pioneer_config(world_name) };
    let drive = Drive::of(&config, &world, pioneer(), goals.last().unwrap().pose);
    assert_eq!(drive.laps.len(), laps);
    let bits_of = |config: &MapperConfig| {
        let mut mapper = GridMapper::with_defaults_of_odometry(config, pioneer()).unwrap();
        let mut scans = (1..).zip(&drive.scans);
        let mut done = 0;
        let after = |lap: &[usize; 2]| {
            for (sequence, scan) in scans.by_ref().take(lap[0] - done) {
                mapper.integrate_scan(sequence, scan);
            }
            done = lap[0];
            drive.judge(&mapper, *lap).bits
        };
        drive.laps.iter().map(after).collect()
    };
    mappers.iter().map(bits_of).collect()
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
