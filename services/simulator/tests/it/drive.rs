//! Where the robot drives, and where it does not.

use echogrid_core::world::WorldParts;
use echogrid_core::{Person, Pose2, World};
use echogrid_service::Sensor as _;
use echogrid_simulator::{Motion, Route, Simulator, SimulatorConfig, Waypoint};
use echogrid_topics::Message;

use crate::support::{exact, line, named, pioneer, pioneer_config, sonars};

/// Half the diagonal of a Pioneer 3-AT.
const RADIUS_M: f64 = 0.402;

#[test]
fn the_tour_of_the_office_touches_nothing_and_goes_everywhere() {
    let world = named("office");
    let mut simulator = Simulator::new(&pioneer_config("office"), world.clone(), pioneer()).unwrap();
    let mut nearest_m = [f64::INFINITY; 16];
    let goals = &world.parts().places.goals;
    let mut last_ns = 0;
    while let Some((stamp_ns, _)) = simulator.next().unwrap() {
        let pose = simulator.true_pose();
        assert!(world.clearance_m([pose.x, pose.y], 1.0) > RADIUS_M, "{pose:?}");
        for (nearest, goal) in nearest_m.iter_mut().zip(goals) {
            *nearest = nearest.min(pose.distance_m(goal.pose));
        }
        last_ns = stamp_ns;
    }
    assert!(goals.len() >= 6 && nearest_m[..goals.len()].iter().all(|nearest| *nearest < 0.05), "{nearest_m:?}");
    assert!((120.0..300.0).contains(&(last_ns as f64 * 1e-9)), "{last_ns}");
    assert!(simulator.given_up().is_empty());
}

#[test]
fn on_the_roughest_floor_it_touches_nothing_and_comes_to_an_end() {
    let world = named("office");
    for seed in 1..4 {
        let config =
            SimulatorConfig { seed, bumps_per_m: 4.0, bump_rad: 0.4, margin_m: 0.0, ..pioneer_config("office") };
        let mut simulator = Simulator::new(&config, world.clone(), pioneer()).unwrap();
        let mut messages = 0;
        while simulator.next().unwrap().is_some() {
            let pose = simulator.true_pose();
            assert!(world.clearance_m([pose.x, pose.y], 1.0) >= RADIUS_M, "{pose:?}");
            messages += 1;
            assert!(messages < 100_000, "it never ends");
        }
    }
}

/// A corridor of 3 × 12 m with somebody in it.
fn corridor(path: Vec<[f64; 2]>, speed_mps: f64) -> World {
    let walls = vec![line(0.0, 0.0, 12.0, 0.0), line(0.0, 3.0, 12.0, 3.0), line(0.0, 0.0, 0.0, 3.0)];
    let people = vec![Person { path, speed_mps, radius_m: 0.3 }];
    World::new(WorldParts { walls, people, ..WorldParts::default() }).unwrap()
}

fn from_left(route: &[[f64; 2]]) -> SimulatorConfig {
    let route = Route::Places(route.iter().map(|place| Waypoint::Point(*place)).collect());
    SimulatorConfig { start: vec![1.0, 1.5, 0.0], route, ..pioneer_config("corridor") }
}

/// Plays a drive to its end: how long it took, and how near anybody came.
fn drive(simulator: &mut Simulator) -> (f64, f64) {
    let (mut last_ns, mut nearest_m) = (0, f64::INFINITY);
    while let Some((stamp_ns, _)) = simulator.next().unwrap() {
        let pose = simulator.true_pose();
        for (centre, radius_m) in simulator.people() {
            nearest_m = nearest_m.min(pose.distance_m(Pose2::new(centre[0], centre[1], 0.0)) - radius_m - RADIUS_M);
        }
        last_ns = stamp_ns;
    }
    (last_ns as f64 * 1e-9, nearest_m)
}

#[test]
fn it_waits_for_people_and_goes_on_when_they_are_gone() {
    // Somebody crosses the corridor slowly, again and again.
    let crossing = corridor(vec![[5.0, 0.3], [5.0, 2.7]], 0.4);
    let config = SimulatorConfig { patience_s: 60.0, ..from_left(&[[10.0, 1.5]]) };
    let mut simulator = Simulator::new(&config, crossing, pioneer()).unwrap();
    let (seconds, nearest_m) = drive(&mut simulator);
    assert!(simulator.true_pose().distance_m(Pose2::new(10.0, 1.5, 0.0)) < 0.05 && simulator.given_up().is_empty());
    assert!(nearest_m > 0.0, "{nearest_m}");
    let alone = corridor(vec![[11.5, 0.1], [11.6, 0.1]], 0.0);
    let (undisturbed, _) = drive(&mut Simulator::new(&config, alone, pioneer()).unwrap());
    assert!(seconds > undisturbed, "{seconds} {undisturbed}: it never had to wait");
}

#[test]
fn it_gives_up_a_place_that_somebody_stands_before() {
    let config = SimulatorConfig { patience_s: 3.0, ..from_left(&[[10.0, 1.5], [1.0, 1.5]]) };
    let standing = corridor(vec![[6.0, 1.5], [6.0, 1.6]], 0.0);
    let mut simulator = Simulator::new(&config, standing, pioneer()).unwrap();
    let (_, nearest_m) = drive(&mut simulator);
    assert_eq!(simulator.given_up(), ["place [10, 1.5]"]);
    assert!(nearest_m > 0.1, "{nearest_m}");
    assert!(simulator.true_pose().distance_m(Pose2::new(1.0, 1.5, 0.0)) < 0.05, "it went on to the next place");
}

#[test]
fn told_to_drive_it_stands_before_a_wall() {
    let config = SimulatorConfig { route: Route::Commands, duration_s: 20.0, ..pioneer_config("room") };
    let world = named("room");
    let mut simulator = Simulator::new(&config, world.clone(), pioneer()).unwrap();
    simulator.set_velocity(2.0, 0.0);
    let mut fastest = 0.0_f64;
    while let Some((_, message)) = simulator.next().unwrap() {
        let pose = simulator.true_pose();
        assert!(world.clearance_m([pose.x, pose.y], 1.0) >= RADIUS_M - 1e-9);
        if let Message::Odometry(odometry) = message {
            fastest = fastest.max(odometry.v_mps);
        }
    }
    let x = simulator.true_pose().x;
    assert!((x - (6.0 - RADIUS_M)).abs() < 0.05, "{x}");
    assert!(fastest > 1.0, "as told, not as the route's speed: {fastest}");
}

#[test]
fn told_to_turn_it_turns() {
    let config = SimulatorConfig { route: Route::Commands, duration_s: 10.0, ..exact() };
    let mut simulator = Simulator::new(&config, named("room"), sonars(&[0.0])).unwrap();
    simulator.set_velocity(0.0, 0.1);
    while simulator.next().unwrap().is_some() {}
    let turned = simulator.true_pose().theta;
    assert!((turned - 1.0).abs() < 0.05, "{turned}");
}

#[test]
fn a_script_is_carried_out_to_its_letter() {
    let motions = [Motion::Straight { metres: 1.5 }, Motion::Turn { radians: 1.0 }, Motion::Straight { metres: -0.5 }];
    let mut simulator = Simulator::scripted(&exact(), named("room"), sonars(&[0.0]), motions).unwrap();
    let mut truth = Pose2::IDENTITY;
    while simulator.next().unwrap().is_some() {
        truth = simulator.true_pose();
    }
    let expected = Pose2::new(1.0, 1.0, 0.0) * Pose2::new(1.5, 0.0, 1.0) * Pose2::new(-0.5, 0.0, 0.0);
    assert!(truth.distance_m(expected) < 1e-6, "{truth:?}");
}
