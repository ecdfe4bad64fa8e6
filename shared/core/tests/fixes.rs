//! Absolute fixes: what they correct, what they leave open, what they teach, and which are refused.

#![allow(clippy::panic, clippy::expect_used, clippy::unwrap_used, reason = "tests")]

use echogrid_core::config::Systematic;
use echogrid_core::noise::standard_normal_pair;
use echogrid_core::{Estimate, Fix, Gate, Increment, Matrix3, Odometry, OdometryConfig, Pose2, move_by, wrap_angle};
use nalgebra::{Matrix3 as M3, Vector3};
use proptest::prelude::*;

const CLOSED: Gate = Gate { sigmas: Gate::DEFAULT_SIGMAS, refuses: true, places: false };

fn config(systematic: Systematic) -> OdometryConfig {
    OdometryConfig { systematic, lin_scale: 0.03, ang_scale: 0.03, ..OdometryConfig::default() }
}

fn close(a: Pose2, b: Pose2) -> bool {
    a.distance_m(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-9
}

/// Straight on along the drive's x, to there.
fn drive_to(odometry: &mut Odometry, from_m: f64, to_m: f64) -> Estimate {
    let steps = ((to_m - from_m) / 0.1).round().max(1.0) as u32;
    let at = |step: u32| Pose2::new(from_m + (to_m - from_m) * f64::from(step) / f64::from(steps), 0.0, 0.0);
    (0..=steps).map(|step| odometry.step(at(step))).last().unwrap()
}

#[test]
fn an_exact_fix_sets_the_errors_back() {
    let mut odometry = Odometry::new(&config(Systematic::Off));
    assert_eq!(odometry.apply(&Fix::certain(Pose2::IDENTITY), CLOSED).unwrap_err().value, "too early");
    odometry.step(Pose2::new(5.0, 5.0, 0.0));
    odometry.step(Pose2::new(8.0, 5.0, 0.4));
    let fixed = odometry.apply(&Fix::certain(Pose2::new(7.9, 5.05, 0.45)), CLOSED).unwrap();
    assert_eq!(fixed, Estimate { fixes: 1, ..Estimate::certain(Pose2::new(7.9, 5.05, 0.45)) });
    // From there on by the steps of the drive, seen from the corrected heading.
    let next = odometry.step(Pose2::new(8.0 + libm::cos(0.4_f64), 5.0 + libm::sin(0.4_f64), 0.4));
    assert!(close(next.pose, Pose2::new(7.9 + libm::cos(0.45_f64), 5.05 + libm::sin(0.45_f64), 0.45)));
    assert!((next.travel_m - 1.0).abs() < 1e-12 && next.fixes == 1);
}

#[test]
fn what_a_fix_leaves_open_stays() {
    let mut odometry = Odometry::new(&OdometryConfig { k_tl: 0.0, ..config(Systematic::Off) });
    let before = drive_to(&mut odometry, 0.0, 10.0);
    assert!((before.covariance[(0, 0)] - 4e-3).abs() < 1e-12);
    // Along the way both have a say, across it and in heading the odometry is sure.
    let fixed = odometry.apply(&Fix::about(Pose2::new(9.9, 0.0, 0.0), 0.1, 0.02), CLOSED).unwrap();
    let gain = 4e-3 / (4e-3 + 0.01);
    assert!((fixed.pose.x - (10.0 - 0.1 * gain)).abs() < 1e-12);
    assert!((fixed.covariance[(0, 0)] - 0.01 * gain).abs() < 1e-15);
    assert!((fixed.errors.eps_lin_m2 - 0.5 * 0.01 * gain).abs() < 1e-15 && fixed.errors.eps_ang_rad2 == 0.0);
    let next = odometry.step(Pose2::new(11.0, 0.0, 0.0));
    assert!((next.errors.eps_lin_m2 - 0.5 * 0.01 * gain - 4e-4).abs() < 1e-15);
}

#[test]
fn a_place_teaches_the_heading_it_was_reached_by() {
    let mut odometry = Odometry::new(&config(Systematic::Off));
    odometry.step(Pose2::new(0.0, 0.0, 0.0));
    let turned = odometry.step(Pose2::new(0.0, 0.0, 1.0));
    let before = odometry.step(Pose2::new(2.0 * libm::cos(1.0_f64), 2.0 * libm::sin(1.0_f64), 1.0));
    // 4 cm to the left of where it should be: it looks more to the left.
    let beside = before.pose * Pose2::new(0.0, 0.04, 0.0);
    let place = Fix { heading_known: false, ..Fix::certain(Pose2::new(beside.x, beside.y, 9.0)) };
    let fixed = odometry.apply(&place, CLOSED).unwrap();
    assert!(fixed.pose.distance_m(beside) == 0.0 && fixed.travel_m == 0.0 && fixed.turn_rad == 1.0);
    assert!(fixed.pose.theta > 1.015 && fixed.pose.theta < 1.025, "{fixed:?}");
    assert!(fixed.covariance[(2, 2)] > 0.0 && fixed.covariance[(2, 2)] < before.covariance[(2, 2)]);
    assert_eq!((fixed.covariance[(0, 2)], fixed.covariance[(0, 0)]), (0.0, 0.0));
    // Eq 4 goes on: nobody told the heading.
    assert!((fixed.errors.eps_ang_rad2 - before.errors.eps_ang_rad2).abs() < 1e-15);
    assert!(turned.errors.eps_ang_rad2 > 0.0);
    let heading = Fix { position_known: false, ..Fix::certain(Pose2::new(7.0, 7.0, 1.03)) };
    let fixed = odometry.apply(&heading, CLOSED).unwrap();
    assert!(fixed.pose.distance_m(beside) == 0.0 && fixed.pose.theta == 1.03 && fixed.turn_rad == 0.0);
    let refused = Fix { covariance: -Matrix3::identity(), ..place };
    assert!(odometry.apply(&refused, CLOSED).is_err());
}

/// A drive that measures 2 % too much of both, and knows that it may be off by 3 %.
#[test]
fn fixes_teach_what_the_drive_measures_too_much() {
    let off_at_the_end = |systematic| {
        let mut odometry = Odometry::new(&config(systematic));
        let (mut truth, mut drive) = (Pose2::IDENTITY, Pose2::IDENTITY);
        let mut last = odometry.step(drive);
        for step in 0..600_u32 {
            // Along the sides of a square.
            let turn_rad = if step % 50 >= 40 { core::f64::consts::FRAC_PI_2 / 10.0 } else { 0.0 };
            let made = Increment { forward_m: 0.1, lateral_m: 0.0, turn_rad };
            truth = move_by(truth, made);
            drive = move_by(drive, Increment { forward_m: 0.1 / 0.98, turn_rad: turn_rad / 0.98, ..made });
            last = odometry.step(drive);
            if step % 50 == 49 && step < 500 {
                last = odometry.apply(&Fix::certain(truth), CLOSED).unwrap();
                assert_eq!(last.pose_covariance(), Matrix3::zeros());
            }
        }
        (last.scales, last.pose.distance_m(truth))
    };
    let (scales, learned_m) = off_at_the_end(Systematic::Carry);
    assert!((scales.lin - 0.02).abs() < 2e-3 && (scales.ang - 0.02).abs() < 4e-3, "{scales:?}");
    let (scales, off_m) = off_at_the_end(Systematic::Off);
    assert!((scales.lin, scales.ang) == (0.0, 0.0));
    assert!(learned_m < 0.1 * off_m && off_m > 0.1, "{learned_m} {off_m}");
    let (scales, _) = off_at_the_end(Systematic::Correct);
    assert_eq!((scales.lin, scales.ang), (0.03, 0.03));
}

/// Two thousand drives with a fix now and then: what they are off by is as large as the covariance says.
#[test]
fn many_drives_are_off_as_it_says() {
    const DRIVES: u32 = 2_000;
    let config = config(Systematic::Carry);
    let (mut squares, mut scale_squares) = (0.0, 0.0);
    for drive in 0..DRIVES {
        let draw = |stream: u64, number: u16| standard_normal_pair(u64::from(drive), stream, number);
        let (lin, ang) = draw(0, 0);
        let (lin, ang) = (0.03 * lin, 0.03 * ang);
        let mut odometry = Odometry::new(&config);
        let (mut truth, mut measured) = (Pose2::IDENTITY, Pose2::IDENTITY);
        let mut last = odometry.step(measured);
        for step in 0..90_u32 {
            let turn_rad = if (20..40).contains(&(step % 45)) { 0.06 } else { 0.0 };
            let (a, b) = draw(u64::from(step) + 1, 1);
            let eps_lin = config.k_ll * 0.1 + config.k_lt * turn_rad;
            let eps_ang = config.k_tt * turn_rad + config.k_tl * 0.1;
            measured = move_by(measured, Increment { forward_m: 0.1, lateral_m: 0.0, turn_rad });
            let made = Increment {
                forward_m: 0.1 * (1.0 - lin) + eps_lin.sqrt() * a,
                lateral_m: 0.0,
                turn_rad: turn_rad * (1.0 - ang) + eps_ang.sqrt() * b,
            };
            truth = move_by(truth, made);
            last = odometry.step(measured);
            if step % 30 == 29 {
                let ((x, y), (theta, _)) = (draw(u64::from(step), 2), draw(u64::from(step), 3));
                let seen = Pose2::new(truth.x + 0.05 * x, truth.y + 0.05 * y, truth.theta + 0.02 * theta);
                let fix = Fix { heading_known: step != 59, ..Fix::about(seen, 0.05, 0.02) };
                last = odometry.apply(&fix, Gate::closed(0.0)).unwrap();
            }
        }
        let off = Vector3::new(last.pose.x - truth.x, last.pose.y - truth.y, wrap_angle(last.pose.theta - truth.theta));
        let inverse: M3<f64> = last.pose_covariance().try_inverse().unwrap();
        squares += (off.transpose() * inverse * off)[0] / f64::from(DRIVES);
        let off = last.scales.lin - lin;
        scale_squares += off * off / last.covariance[(3, 3)] / f64::from(DRIVES);
    }
    // Chi-squared of three numbers and of one: five standard errors, and 3 % for what the Jacobians leave out.
    let five = |numbers: f64| 5.0 * (2.0 * numbers / f64::from(DRIVES)).sqrt() + 0.03 * numbers;
    assert!((squares - 3.0).abs() < five(3.0), "{squares}");
    assert!((scale_squares - 1.0).abs() < five(1.0), "{scale_squares}");
}

// ---- the gate ------------------------------------------------------------------------------------------------------

/// After 10 m and a first fix at its end.
fn localized(systematic: Systematic) -> Odometry {
    let mut odometry = Odometry::new(&config(systematic));
    drive_to(&mut odometry, 0.0, 10.0);
    odometry.apply(&about(10.0, 0.0), CLOSED).unwrap();
    odometry
}

fn about(x: f64, y: f64) -> Fix {
    Fix::about(Pose2::new(x, y, 0.0), 0.05, 0.02)
}

#[test]
fn a_fix_too_far_off_is_refused_and_counted() {
    let mut odometry = localized(Systematic::Carry);
    let before = drive_to(&mut odometry, 10.0, 12.0);
    let refused = odometry.apply(&about(12.0, 3.0), CLOSED).unwrap_err();
    assert!(refused.to_string().contains("3.00 m and 0.0° off"), "{refused}");
    let stays = odometry.step(Pose2::new(12.0, 0.0, 0.0));
    assert_eq!(stays, Estimate { refused: 1, ..before });
    // A good one is believed after all; what was refused is forgotten.
    assert!(odometry.apply(&about(12.0, 0.0), CLOSED).unwrap().pose.y.abs() < 1e-9);
    for _ in 0..2 {
        assert!(odometry.apply(&about(12.0, 3.0), CLOSED).is_err());
    }
    assert_eq!(odometry.step(Pose2::new(12.0, 0.0, 0.0)).refused, 3);
}

#[test]
fn who_must_be_believed_is() {
    for fix in [Fix::certain(Pose2::new(12.0, 3.0, 1.0)), about(12.0, 3.0)] {
        let mut odometry = localized(Systematic::Carry);
        let before = drive_to(&mut odometry, 10.0, 12.0);
        let gate = if fix.covariance == Matrix3::zeros() { CLOSED } else { Gate::open() };
        let after = odometry.apply(&fix, gate).unwrap();
        assert_eq!((after.pose, after.pose_covariance(), after.refused), (fix.pose, fix.covariance, 0));
        // The drive is not to blame.
        assert_eq!((after.scales, after.covariance[(3, 3)]), (before.scales, before.covariance[(3, 3)]));
        assert_eq!(after.covariance[(0, 3)], 0.0);
    }
    // Where the map lies nobody has told before.
    let mut odometry = Odometry::new(&config(Systematic::Off));
    drive_to(&mut odometry, 0.0, 1.0);
    assert_eq!(odometry.apply(&about(30.0, -5.0), CLOSED).unwrap().pose, Pose2::new(30.0, -5.0, 0.0));
    // Without a gate nothing is refused.
    let mut odometry = localized(Systematic::Carry);
    assert!(odometry.apply(&about(99.0, 3.0), Gate::closed(0.0)).is_ok());
}

#[test]
fn a_robot_that_was_carried_off_is_found_again() {
    let mut odometry = localized(Systematic::Off);
    // Somebody put it 5 m to the left.
    let fixes = [11.0, 12.0, 13.0].map(|x| {
        drive_to(&mut odometry, x - 1.0, x);
        odometry.apply(&about(x, 5.0), CLOSED).is_ok()
    });
    assert_eq!(fixes, [false, false, true]);
    let found = odometry.step(Pose2::new(13.0, 0.0, 0.0));
    assert_eq!((found.pose, found.pose_covariance()), (Pose2::new(13.0, 5.0, 0.0), about(0.0, 0.0).covariance));
    assert_eq!((found.fixes, found.refused), (2, 2));
}

#[test]
fn wild_fixes_are_not_believed_soon() {
    let mut odometry = localized(Systematic::Off);
    for number in 0..9_u32 {
        let x = 11.0 + f64::from(number);
        drive_to(&mut odometry, x - 1.0, x);
        let wild = about(x + 20.0 * libm::cos(f64::from(number)), 20.0 * libm::sin(f64::from(number * number)) + 30.0);
        assert!(odometry.apply(&wild, CLOSED).is_err(), "{number}");
    }
    // But not never.
    assert!(odometry.apply(&about(0.0, -70.0), CLOSED).is_ok());
}

/// 9 % off and believed to be exact: no fix is within the gate.
#[test]
fn a_robot_that_nobody_calibrated_is_not_locked_out() {
    let mut odometry = localized(Systematic::Off);
    let accepted: Vec<bool> = (1..=30)
        .map(|fix| {
            let way_m = 3.0 * f64::from(fix);
            drive_to(&mut odometry, 10.0 + (way_m - 3.0) / 0.91, 10.0 + way_m / 0.91);
            odometry.apply(&about(10.0 + way_m, 0.0), CLOSED).is_ok()
        })
        .collect();
    assert!(accepted.contains(&false) && accepted.windows(3).all(|three| three.contains(&true)), "{accepted:?}");
}

// ---- laws ----------------------------------------------------------------------------------------------------------

#[derive(Debug, Clone)]
enum Event {
    Step(Increment),
    Fix(Fix),
}

fn any_event() -> impl Strategy<Value = Event> {
    let step = (-1.0..1.0f64, -0.2..0.2f64, -2.0..2.0f64)
        .prop_map(|(forward_m, lateral_m, turn_rad)| Event::Step(Increment { forward_m, lateral_m, turn_rad }));
    let known = prop::sample::select(vec![(true, true), (true, false), (false, true)]);
    let sigma = prop_oneof![Just(0.0), Just(1e-9), 0.001..1.0f64];
    let pose = (-3.0..3.0f64, -3.0..3.0f64, -4.0..4.0f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta));
    let fix =
        (pose, sigma.clone(), sigma, known).prop_map(|(pose, position, heading, (position_known, heading_known))| {
            Event::Fix(Fix { position_known, heading_known, ..Fix::about(pose, position, heading) })
        });
    prop_oneof![3 => step, 1 => fix]
}

proptest! {
    /// Whatever is driven and told: finite, symmetric, and no direction has a negative variance, but for rounding.
    #[test]
    fn a_covariance_stays_one(
        events in prop::collection::vec(any_event(), 1..40), carried: bool, gated: bool, quiet: bool,
    ) {
        let mut config = config(if carried { Systematic::Carry } else { Systematic::Off });
        if quiet {
            (config.k_ll, config.k_lt, config.k_tt, config.k_tl) = (0.0, 0.0, 0.0, 0.0);
        }
        let gate = Gate::closed(if gated { 3.0 } else { 0.0 });
        let mut odometry = Odometry::new(&config);
        let mut drive = Pose2::IDENTITY;
        let mut last = odometry.step(drive);
        for event in events {
            match event {
                Event::Step(step) => {
                    drive = move_by(drive, step);
                    last = odometry.step(drive);
                }
                Event::Fix(fix) => {
                    let before = last;
                    match odometry.apply(&fix, gate) {
                        Ok(after) => last = after,
                        Err(_) => last = odometry.step(drive),
                    }
                    if fix.covariance == Matrix3::zeros() {
                        prop_assert!(!fix.position_known || last.pose.distance_m(fix.pose) == 0.0);
                        prop_assert!(!fix.heading_known || last.pose.theta == fix.pose.theta);
                        prop_assert!(!fix.position_known || last.covariance[(0, 0)] == 0.0);
                    } else if last.refused == before.refused {
                        // Two doubts that are not zero leave one that is not. (Without noise all may hang on one scale,
                        // which an exact heading tells.)
                        let (prior, own) = (before.covariance[(0, 0)], fix.covariance[(0, 0)]);
                        let open = fix.position_known && prior > 1e-9 && own > 1e-9 && fix.covariance[(2, 2)] > 0.0;
                        prop_assert!(!open || quiet || last.covariance[(0, 0)] > 0.0, "{:?}", last);
                    }
                }
            }
            let c = last.covariance;
            prop_assert!(last.pose.is_finite() && c.iter().all(|value| value.is_finite()), "{:?}", last);
            prop_assert!(last.scales.lin.abs() <= 0.5 && last.scales.ang.abs() <= 0.5);
            prop_assert_eq!(c, c.transpose());
            prop_assert!(c.diagonal().iter().all(|variance| *variance >= 0.0), "{}", c);
            let lowest = c.symmetric_eigenvalues().min();
            prop_assert!(lowest >= -1e-9 * (1.0 + c.norm()), "{} of {}", lowest, c);
        }
    }
}
