//! A world that changes while the robot is not looking.

use echogrid_core::{GridMapper, MapperConfig, Pose2, Segment};
use echogrid_simulator::{Route, SimulatorConfig, Waypoint};

use crate::mapped::Drive;
use crate::support::{line, pioneer, pioneer_config, world};

/// A room of 8 × 5 m; without the wall in its middle, or with it.
fn room(has_wall: bool) -> Vec<Segment> {
    let mut walls =
        vec![line(0.0, 0.0, 8.0, 0.0), line(8.0, 0.0, 8.0, 5.0), line(8.0, 5.0, 0.0, 5.0), line(0.0, 5.0, 0.0, 0.0)];
    if has_wall {
        walls.push(line(3.0, 2.5, 5.0, 2.5));
    }
    walls
}

/// Shares of the cells of the wall in the middle that a map calls occupied, beside them included, lap by lap: the room is with or
/// without it for so many laps each.
fn found(config: &MapperConfig, stays: &[(bool, usize)]) -> Vec<f64> {
    let mut mapper = GridMapper::with_defaults_of_odometry(config, pioneer()).unwrap();
    let (mut sequence, mut found) = (0, Vec::new());
    for (has_wall, laps) in stays {
        let world = world(&room(*has_wall));
        let around = [[1.0, 1.0], [7.0, 1.0], [7.0, 4.0], [1.0, 4.0]];
        let route = (0..*laps).flat_map(|_| around).chain([around[0]]).map(Waypoint::Point).collect();
        let start = vec![1.0, 1.0, 0.0];
        let config = SimulatorConfig { route: Route::Places(route), start, ..pioneer_config("room") };
        let drive = Drive::of(&config, &world, pioneer(), Pose2::new(1.0, 1.0, 0.0));
        assert_eq!(drive.laps.len(), *laps);
        let mut done = 0;
        for [end, _] in &drive.laps {
            for scan in &drive.scans[done..*end] {
                sequence += 1;
                mapper.integrate_scan(sequence, scan);
            }
            done = *end;
            found.push(share_found(&mapper));
        }
    }
    found
}

fn share_found(mapper: &GridMapper) -> f64 {
    let grid = mapper.shown();
    let is_found = |cell: usize| {
        let x = 3.05 + 0.05 * cell as f64;
        let beside = [2.425, 2.475, 2.525, 2.575].map(|y| grid.log_odds(grid.cell_at(x, y)));
        beside.into_iter().flatten().any(|log_odds| log_odds > 0.62)
    };
    (0..38).filter(|cell| is_found(*cell)).count() as f64 / 38.0
}

/// Both change when every place has been visited often enough for what is heard there to say little that is new.
#[test]
fn what_changed_is_learnt() {
    let config = MapperConfig::default();
    let gone = found(&config, &[(true, 5), (false, 4)]);
    assert!(gone[..5].iter().all(|share| *share > 0.95), "{gone:?}");
    assert!(gone[8] < 0.1, "a wall that is gone is unlearnt in four laps: {gone:?}");
    let new = found(&config, &[(false, 5), (true, 5)]);
    assert!(new[..5].iter().all(|share| *share < 0.05), "{new:?}");
    // On a map that knows nothing all of it is found in one lap.
    assert!(new[9] > 0.4, "of a new wall much is found in five laps: {new:?}");
}
