//! What sonars hear of walls, corners, mirrors, people and each other.

use echogrid_core::world::WorldParts;
use echogrid_core::{Echo, Person, Segment, World};
use echogrid_simulator::{Cause, Heard, SimulatorConfig};

use crate::support::{exact, line, pioneer, pioneer_config, sonars, standing, world};

const DEGREE: f64 = core::f64::consts::PI / 180.0;
/// Five standard deviations of the range noise of 1 %.
const NOISE: f64 = 0.05;

/// What one sonar at the origin hears that looks along x.
fn heard(walls: &[Segment]) -> Heard {
    standing(&exact(), world(walls), sonars(&[0.0]), [0.0, 0.0, 0.0], 0.1)[0][0]
}

fn range_m(heard: &Heard) -> f64 {
    let Echo::Hit { range_m } = heard.echo else { panic!("no echo: {heard:?}") };
    range_m
}

/// A wall of 40 m at `distance_m` from the origin, its normal `angle_deg` off the x axis.
fn wall(distance_m: f64, angle_deg: f64) -> Segment {
    let (sin, cos) = libm::sincos(angle_deg * DEGREE);
    let at = |along: f64| [distance_m * cos - along * sin, distance_m * sin + along * cos];
    Segment { from: at(-20.0), to: at(20.0) }
}

#[test]
fn a_wall_ahead_is_heard_within_the_noise() {
    let scans = standing(&exact(), world(&[wall(2.0, 0.0)]), sonars(&[0.0]), [0.0, 0.0, 0.0], 80.0);
    let errors: Vec<f64> = scans.iter().map(|scan| range_m(&scan[0]) / 2.0 - 1.0).collect();
    assert!(scans.iter().all(|scan| scan[0].cause == Cause::Direct && scan[0].ahead_m == Some(2.0)));
    let n = errors.len() as f64;
    assert!(n >= 2000.0);
    let mean = errors.iter().sum::<f64>() / n;
    let deviation = (errors.iter().map(|error| (error - mean) * (error - mean)).sum::<f64>() / (n - 1.0)).sqrt();
    // Five standard errors each.
    assert!(mean.abs() < 5.0 * 0.01 / n.sqrt(), "{mean}");
    assert!((deviation / 0.01 - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{deviation}");
}

#[test]
fn a_wall_answers_up_to_the_critical_incidence_and_mirrors_beyond() {
    // The cone reaches 15° to both sides, the critical incidence is 20°.
    for angle_deg in [0.0, 10.0, 20.0, 30.0, 34.0] {
        let heard = heard(&[wall(2.0, angle_deg)]);
        assert_eq!(heard.cause, Cause::Direct, "{angle_deg}°");
        assert!((heard.incidence_rad - angle_deg * DEGREE).abs() < 1e-9);
        // The nearest place that answers: straight at the wall, or at the rim of the cone.
        let nearest_m = 2.0 / libm::cos((angle_deg - 15.0).max(0.0) * DEGREE);
        assert!((range_m(&heard) / nearest_m - 1.0).abs() < NOISE, "{angle_deg}°: {heard:?}");
    }
    for angle_deg in [36.0, 45.0, 60.0, 75.0] {
        let heard = heard(&[wall(2.0, angle_deg)]);
        assert_eq!((heard.echo, heard.cause), (Echo::NoEcho, Cause::Nothing), "{angle_deg}°");
        assert!(angle_deg > 60.0 || heard.ahead_m.is_some(), "light would have met it");
    }
    // With a rough wall nothing is lost.
    let rough = SimulatorConfig { critical_incidence_deg: 90.0, ..exact() };
    let heard = standing(&rough, world(&[wall(2.0, 45.0)]), sonars(&[0.0]), [0.0; 3], 0.1)[0][0];
    assert_eq!(heard.cause, Cause::Direct);
}

#[test]
fn a_corner_answers_where_its_walls_do_not() {
    // Both walls at 45° to the axis.
    let heard_it = heard(&[line(3.0, 0.0, 0.5, 2.5), line(3.0, 0.0, 0.5, -2.5)]);
    assert_eq!(heard_it.cause, Cause::Corner);
    assert!((range_m(&heard_it) / 3.0 - 1.0).abs() < NOISE, "{heard_it:?}");
    // One of them alone does not, but for its end.
    assert_eq!(heard(&[line(5.4, -2.4, 0.5, 2.5)]).cause, Cause::Nothing);
    // From behind it is an edge.
    let behind = heard(&[line(3.0, 0.0, 5.5, 2.5), line(3.0, 0.0, 5.5, -2.5)]);
    assert_eq!(behind.cause, Cause::Edge);
    assert!((range_m(&behind) / 3.0 - 1.0).abs() < NOISE);
}

#[test]
fn an_edge_is_heard_on_the_axis_and_not_at_the_rim() {
    // The end of a wall that mirrors everything else away.
    let end = |angle_deg: f64| {
        let (sin, cos) = libm::sincos(angle_deg * DEGREE);
        let tip = [4.0 * cos, 4.0 * sin];
        heard(&[Segment { from: tip, to: [tip[0] + 6.0 * cos, tip[1] + 6.0 * sin] }])
    };
    assert_eq!(end(0.0).cause, Cause::Edge);
    assert_eq!(end(13.0).cause, Cause::Nothing);
    // What stands before it hides it, and is heard itself.
    let hidden = heard(&[line(4.0, 0.0, 9.0, 0.0), wall(3.0, 0.0)]);
    assert_eq!(hidden.cause, Cause::Direct);
}

#[test]
fn a_mirror_makes_what_it_shows_seem_behind_it() {
    // A wall at 45° turns the sound to the left, where a second wall is met head-on.
    let mirror = Segment { from: [1.0, -1.0], to: [4.0, 2.0] };
    let heard_it = heard(&[mirror, line(0.0, 1.5, 4.0, 1.5)]);
    assert_eq!(heard_it.cause, Cause::Multipath);
    // 2 m to the mirror and 1.5 m from there: farther than what is ahead. Rays aside of the axis come back a little sooner.
    assert_eq!(heard_it.ahead_m.map(f64::round), Some(2.0));
    let range = range_m(&heard_it);
    assert!(range > 3.0 && range < 3.5 * (1.0 + NOISE), "{range}");
    // Told to follow no mirror, it hears nothing.
    let blind = SimulatorConfig { bounces: 0, ..exact() };
    let walls = [mirror, line(0.0, 1.5, 4.0, 1.5)];
    assert_eq!(standing(&blind, world(&walls), sonars(&[0.0]), [0.0; 3], 0.1)[0][0].cause, Cause::Nothing);
}

#[test]
fn too_near_is_invalid_and_too_far_is_no_echo() {
    let at = |distance_m: f64| heard(&[wall(distance_m, 0.0)]).echo;
    assert_eq!(at(0.05), Echo::Invalid);
    assert!(matches!(at(0.2), Echo::Hit { .. }));
    assert!(matches!(at(4.7), Echo::Hit { .. }));
    assert_eq!(at(5.3), Echo::NoEcho);
}

#[test]
fn people_are_heard_and_hide_what_is_behind_them() {
    let person = Person { path: vec![[2.5, 0.0], [2.5, 0.1]], speed_mps: 0.0, radius_m: 0.25 };
    let walls = vec![wall(4.0, 0.0)];
    let parts = WorldParts { walls, people: vec![person], ..WorldParts::default() };
    let heard = standing(&exact(), World::new(parts).unwrap(), sonars(&[0.0]), [0.0; 3], 0.1)[0][0];
    assert_eq!(heard.cause, Cause::Person);
    assert!((range_m(&heard) / 2.25 - 1.0).abs() < NOISE, "{heard:?}");
    assert_eq!(heard.ahead_m, Some(4.0), "what is ahead is the wall");
}

/// Share of crosstalk among the readings of one sonar.
fn crosstalk(config: &SimulatorConfig, walls: &[Segment], headings_deg: &[f64], sonar: usize) -> f64 {
    let scans = standing(config, world(walls), sonars(headings_deg), [0.0; 3], 4.0);
    // Before the first round nobody has fired.
    let later = &scans[1..];
    let mine = |scan: &&Vec<Heard>| {
        scan.iter().any(|heard| usize::from(heard.transducer) == sonar && heard.cause == Cause::Crosstalk)
    };
    later.iter().filter(mine).count() as f64 / later.len() as f64
}

#[test]
fn the_firing_before_is_heard_late_by_a_neighbour_only() {
    // 40 ms are 6.86 m of range: what comes from 7.2 m seems to be at 0.34 m.
    let config = SimulatorConfig { firing_order: vec![vec![0], vec![1]], ..exact() };
    let far = [wall(7.2, 0.0)];
    assert_eq!(crosstalk(&config, &far, &[5.0, -5.0], 1), 1.0);
    let scans = standing(&config, world(&far), sonars(&[5.0, -5.0]), [0.0; 3], 1.0);
    let range = range_m(&scans[3][1]);
    assert!((range / (7.2 - 0.5 * 0.04 * 343.0) - 1.0).abs() < NOISE, "{range}");
    // Not by one that looks the other way, nor without a wall, nor if they leave each other time.
    assert_eq!(crosstalk(&config, &far, &[5.0, 175.0], 1), 0.0);
    assert_eq!(crosstalk(&config, &[wall(9.5, 0.0)], &[5.0, -5.0], 1), 0.0);
    let slow = SimulatorConfig { firing_period_s: 0.08, ..config.clone() };
    assert_eq!(crosstalk(&slow, &far, &[5.0, -5.0], 1), 0.0);
    let deaf = SimulatorConfig { crosstalk: false, ..config };
    assert_eq!(crosstalk(&deaf, &far, &[5.0, -5.0], 1), 0.0);
}

#[test]
fn neighbours_that_fire_together_hear_each_other() {
    // A small mirror at the rim of one cone, near the axis of the other, and a wall that it shows, 4.6 m away in all: too
    // faint in the first sonar's own sound, not in that of its neighbour.
    let unit = |angle_deg: f64| {
        let (sin, cos) = libm::sincos(angle_deg * DEGREE);
        [cos, sin]
    };
    let from = |place: [f64; 2], angle_deg: f64, metres: f64| {
        let [x, y] = unit(angle_deg);
        [place[0] + metres * x, place[1] + metres * y]
    };
    let aim_deg = -14.5;
    let spot = from([0.0; 2], aim_deg, 2.5);
    let shown = from(spot, aim_deg + 90.0, 2.1);
    let walls = [
        Segment { from: from(spot, aim_deg + 45.0, -0.02), to: from(spot, aim_deg + 45.0, 0.02) },
        Segment { from: from(shown, aim_deg, -0.3), to: from(shown, aim_deg, 0.3) },
    ];
    let together = SimulatorConfig { firing_order: vec![vec![0, 1]], ..exact() };
    let apart = SimulatorConfig { firing_order: vec![vec![0], vec![1]], ..exact() };
    let headings = [0.0, -17.5];
    let scans = standing(&together, world(&walls), sonars(&headings), [0.0; 3], 0.5);
    for scan in &scans {
        assert_eq!(scan[1].cause, Cause::Multipath, "its own");
        assert_eq!(scan[0].cause, Cause::Crosstalk, "its neighbour's");
        assert!((range_m(&scan[0]) / 4.6 - 1.0).abs() < NOISE, "{:?}", scan[0]);
    }
    assert_eq!(crosstalk(&apart, &walls, &headings, 0), 0.0);
}

#[test]
fn a_corridor_is_heard_to_its_sides_and_has_echoes_from_behind_its_walls() {
    // Closed at one end, 2 m wide; the robot stands somewhat askew.
    let walls = [line(-8.0, 0.0, 3.0, 0.0), line(-8.0, 2.0, 3.0, 2.0), line(3.0, 0.0, 3.0, 2.0)];
    let mut late = 0;
    for heading_deg in [-6.0, -3.0, 0.0, 3.0, 6.0] {
        let scans = standing(&pioneer_config("corridor"), world(&walls), pioneer(), [-1.6, 1.0, heading_deg], 3.0);
        for heard in scans.iter().flatten() {
            if [0, 7, 8, 15].contains(&heard.transducer) {
                assert_eq!(heard.cause, Cause::Direct, "{heard:?}");
                assert!(range_m(heard) < 1.0, "{heard:?}");
            }
            if heard.cause == Cause::Multipath {
                late += 1;
                assert!(range_m(heard) > heard.ahead_m.unwrap() * (1.0 - NOISE), "never too short: {heard:?}");
            }
        }
    }
    assert!(late > 10, "{late}");
}
