//! Absolute localization from landmarks: what is measured without error gives the pose back, what is measured with error gives
//! the covariance that was promised, and what leaves the pose open is refused.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use core::f64::consts::{PI, TAU};

use echogrid_core::landmarks::{
    Degeneracy, SIGHTINGS_MAX, Sighting, TriangulationError, UNKNOWN_HEADING_VARIANCE_RAD2, triangulate,
};
use echogrid_core::noise::standard_normal_pair;
use echogrid_core::{Matrix3, Pose2, wrap_angle};
use proptest::prelude::*;

#[derive(Clone, Copy, PartialEq, Debug)]
enum What {
    Range,
    Bearing,
    Both,
}
use What::{Bearing, Both, Range};

const SIGMA_M: f64 = 0.01;
const SIGMA_RAD: f64 = 0.005;

fn see(pose: Pose2, landmark: [f64; 2], what: What) -> Sighting {
    let [x, y] = pose.inverse().transform(landmark);
    Sighting {
        landmark,
        range_m: (what != Bearing).then(|| libm::hypot(x, y)),
        bearing_rad: (what != Range).then(|| libm::atan2(y, x)),
        range_sigma_m: SIGMA_M,
        bearing_sigma_rad: SIGMA_RAD,
    }
}

fn see_all(pose: Pose2, landmarks: &[[f64; 2]], what: What) -> Vec<Sighting> {
    landmarks.iter().map(|landmark| see(pose, *landmark, what)).collect()
}

/// The same sightings, with errors of their standard deviations; `trial` and the index draw them.
fn noisy(sightings: &[Sighting], trial: u64) -> Vec<Sighting> {
    let add = |(index, sighting): (usize, &Sighting)| {
        let (range, bearing) = standard_normal_pair(11, trial, index as u16);
        Sighting {
            range_m: sighting.range_m.map(|range_m| (range_m + range * sighting.range_sigma_m).max(0.0)),
            bearing_rad: sighting.bearing_rad.map(|b| wrap_angle(b + bearing * sighting.bearing_sigma_rad)),
            ..*sighting
        }
    };
    sightings.iter().enumerate().map(add).collect()
}

const ROOM: [[f64; 2]; 4] = [[0.0, 0.0], [8.0, 0.5], [7.0, 6.0], [-0.5, 5.0]];
const FAR_OFF: Pose2 = Pose2 { x: 300.0, y: -200.0, theta: 3.0 };

fn any_pose() -> impl Strategy<Value = Pose2> {
    (-20.0..20.0f64, -20.0..20.0f64, -PI..PI).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

fn any_place() -> impl Strategy<Value = [f64; 2]> {
    [-20.0..20.0f64, -20.0..20.0f64]
}

fn any_what() -> impl Strategy<Value = What> {
    prop_oneof![Just(Range), Just(Bearing), Just(Both)]
}

fn close(found: Pose2, pose: Pose2) -> bool {
    found.distance_m(pose) < 1e-6 && wrap_angle(found.theta - pose.theta).abs() < 1e-6
}

/// Where a refusal is right, of measurements that agree with each other.
fn is_open(error: &TriangulationError) -> bool {
    matches!(error, TriangulationError::Degenerate { .. } | TriangulationError::Ambiguous { .. })
}

#[test]
fn exact_measurements_are_hardly_ever_refused_and_never_wrong() {
    // Counted over random rooms: the properties below say that nothing is wrong, this one that something comes out.
    for (what, least) in [(Both, 990), (Range, 900), (Bearing, 900)] {
        let mut found = 0;
        for trial in 0..1000u64 {
            let place = |index| {
                let (x, y) = standard_normal_pair(3, trial, index);
                [7.0 * x, 7.0 * y]
            };
            let [x, y] = place(9);
            let pose = Pose2::new(x, y, trial as f64);
            let landmarks: Vec<_> = (0..4).map(place).collect();
            match triangulate(&see_all(pose, &landmarks, what), FAR_OFF) {
                Ok(fix) => {
                    assert!(fix.pose.distance_m(pose) < 1e-6, "{what:?} {trial}: {fix:?} {pose:?}");
                    found += 1;
                }
                Err(error) => assert!(is_open(&error), "{what:?} {trial}: {error}"),
            }
        }
        println!("{what:?}: {found} of 1000");
        assert!(found >= least, "{what:?}: {found} of 1000");
    }
}

proptest! {
    #[test]
    fn exact_measurements_give_the_pose_back(
        pose in any_pose(),
        guess in any_pose(),
        seen in prop::collection::vec((any_place(), any_what()), 3..9),
    ) {
        prop_assume!(seen.iter().any(|(_, what)| *what != Range));
        let sightings: Vec<_> = seen.iter().map(|(landmark, what)| see(pose, *landmark, *what)).collect();
        match triangulate(&sightings, guess) {
            Ok(fix) => {
                prop_assert!(fix.guess_decided || close(fix.pose, pose), "{fix:?}");
                prop_assert!(fix.heading_known && (fix.guess_decided || fix.chi2 < 1e-6));
            }
            Err(error) => prop_assert!(is_open(&error), "{error}"),
        }
    }

    #[test]
    fn a_guess_near_the_truth_settles_what_the_sightings_leave_open(
        pose in any_pose(),
        seen in prop::collection::vec((any_place(), any_what()), 2..5),
        aside in [-0.01..0.01f64, -0.01..0.01],
    ) {
        let sightings: Vec<_> = seen.iter().map(|(landmark, what)| see(pose, *landmark, *what)).collect();
        let guess = Pose2::new(pose.x + aside[0], pose.y + aside[1], pose.theta);
        match triangulate(&sightings, guess) {
            Ok(fix) => prop_assert!(close(fix.pose, pose), "{fix:?}"),
            Err(error) => prop_assert!(is_open(&error) || matches!(error, TriangulationError::TooFew { .. }), "{error}"),
        }
    }

    #[test]
    fn where_the_map_lies_does_not_matter(
        pose in any_pose(),
        frame in any_pose(),
        landmarks in prop::collection::vec(any_place(), 3..6),
    ) {
        let here = triangulate(&see_all(pose, &landmarks, Both), pose);
        let moved: Vec<_> = landmarks.iter().map(|landmark| frame.transform(*landmark)).collect();
        let there = triangulate(&see_all(frame * pose, &moved, Both), frame * pose);
        if let (Ok(here), Ok(there)) = (here, there) {
            prop_assert!(close(frame * here.pose, there.pose));
            let (s, c) = libm::sincos(frame.theta);
            let turn = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
            let turned = turn * here.covariance * turn.transpose();
            prop_assert!((turned - there.covariance).norm() < 1e-6 * there.covariance.norm());
        }
    }

    #[test]
    fn any_finite_input_comes_to_an_end(
        seen in prop::collection::vec(
            ([any_number(), any_number()], prop::option::of(any_number()), prop::option::of(any_number()), any_number(), any_number()),
            0..7,
        ),
        guess in [any_number(), any_number(), any_number()],
    ) {
        let sightings: Vec<_> = seen
            .into_iter()
            .map(|(landmark, range_m, bearing_rad, range_sigma_m, bearing_sigma_rad)| {
                Sighting { landmark, range_m, bearing_rad, range_sigma_m, bearing_sigma_rad }
            })
            .collect();
        check_sane(&sightings, Pose2 { x: guess[0], y: guess[1], theta: guess[2] });
    }

    #[test]
    fn measurements_that_have_nothing_to_do_with_each_other_come_to_an_end(
        seen in prop::collection::vec(
            (
                [odd(&[0.0, 1.0, 1e-9, 1e-300, 1e6, -1e6]), odd(&[0.0, 1.0, 2.0, 1e-5])],
                prop::option::of(odd(&[0.0, 1.0, 1e-300, 1e6, 1e-12]).prop_map(f64::abs)),
                prop::option::of((odd(&[0.0, PI, TAU, 1e-300])).prop_map(|bearing| bearing % TAU)),
                prop::sample::select(vec![1e-9, 1e-3, 0.1, 1e6]),
                prop::sample::select(vec![1e-9, 1e-3, 0.1, 1e6]),
            ),
            2..7,
        ),
    ) {
        let sightings: Vec<_> = seen
            .into_iter()
            .map(|(landmark, range_m, bearing_rad, range_sigma_m, bearing_sigma_rad)| {
                Sighting { landmark, range_m, bearing_rad, range_sigma_m, bearing_sigma_rad }
            })
            .collect();
        check_sane(&sightings, Pose2::IDENTITY);
    }
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![prop::num::f64::ANY, prop::num::f64::NORMAL, -10.0..10.0f64, 0.0..1.0f64, Just(0.0)]
}

fn odd(values: &'static [f64]) -> impl Strategy<Value = f64> {
    prop_oneof![prop::sample::select(values), -10.0..10.0f64]
}

/// No panic, no NaN, and a covariance that is one.
fn check_sane(sightings: &[Sighting], guess: Pose2) {
    match triangulate(sightings, guess) {
        Ok(fix) => {
            let c = fix.covariance;
            assert!(fix.pose.is_finite() && fix.chi2.is_finite() && c.iter().all(|value| value.is_finite()));
            assert!(c == c.transpose() && (0..3).all(|k| c[(k, k)] > 0.0));
        }
        Err(error) => assert!(!error.to_string().contains("NaN") || has_nan(sightings, guess), "{error}"),
    }
}

fn has_nan(sightings: &[Sighting], guess: Pose2) -> bool {
    let numbers = |s: &Sighting| {
        let [x, y] = s.landmark;
        [x, y, s.range_m.unwrap_or(0.0), s.bearing_rad.unwrap_or(0.0), s.range_sigma_m, s.bearing_sigma_rad]
    };
    sightings.iter().flat_map(numbers).chain([guess.x, guess.y, guess.theta]).any(f64::is_nan)
}

/// Sample covariance over N trials against (HᵀWH)⁻¹ at the true pose, each entry by the deviations of its row and column. A
/// sample's standard error is √(2/N) = 3.2 % at most; five of them are allowed, and curvature has to stay within that.
fn covariance_is_the_spread(pose: Pose2, exact: &[Sighting]) {
    const N: u64 = 2000;
    let promised = triangulate(exact, pose).unwrap().covariance;
    let (mut sum, mut mean_chi2, mut degrees) = (Matrix3::zeros(), 0.0, 0);
    for trial in 0..N {
        let fix = match triangulate(&noisy(exact, trial), pose) {
            Ok(fix) => fix,
            // One in a thousand is beyond the limit, and should be.
            Err(TriangulationError::Inconsistent { .. }) => continue,
            Err(error) => panic!("{error}"),
        };
        let heading = if fix.heading_known { wrap_angle(fix.pose.theta - pose.theta) } else { 0.0 };
        let off = [fix.pose.x - pose.x, fix.pose.y - pose.y, heading];
        sum += Matrix3::from_fn(|row, column| off[row] * off[column]) / N as f64;
        mean_chi2 += fix.chi2 / N as f64;
        degrees = fix.degrees_of_freedom;
    }
    let known = if exact.iter().any(|sighting| sighting.bearing_rad.is_some()) { 3 } else { 2 };
    for row in 0..known {
        for column in 0..known {
            let scale = (promised[(row, row)] * promised[(column, column)]).sqrt();
            let difference = (sum[(row, column)] - promised[(row, column)]) / scale;
            assert!(difference.abs() < 0.16, "{row} {column}: {sum} {promised}");
        }
    }
    // Its standard error is √(2k/N); what the limit cuts off takes less than one per cent.
    let k = degrees as f64;
    assert!((mean_chi2 - k).abs() < 5.0 * (2.0 * k / N as f64).sqrt() + 0.01 * k + 1e-9, "{mean_chi2} {k}");
}

#[test]
fn covariance_agrees_with_what_is_drawn() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    for what in [Range, Bearing, Both] {
        covariance_is_the_spread(pose, &see_all(pose, &ROOM, what));
    }
    covariance_is_the_spread(pose, &see_all(pose, &ROOM[..2], Both));
    covariance_is_the_spread(pose, &see_all(pose, &ROOM[..2], Range));
    covariance_is_the_spread(pose, &see_all(pose, &ROOM[..3], Bearing));
    covariance_is_the_spread(pose, &[see(pose, ROOM[0], Range), see(pose, ROOM[1], Bearing), see(pose, ROOM[2], Both)]);
}

#[test]
fn a_bad_guess_does_no_harm() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    for what in [Range, Bearing, Both] {
        let fix = triangulate(&see_all(pose, &ROOM, what), FAR_OFF).unwrap();
        assert!(fix.pose.distance_m(pose) < 1e-6 && !fix.guess_decided, "{fix:?}");
    }
}

#[test]
fn ranges_alone_leave_the_heading_open() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    let fix = triangulate(&see_all(pose, &ROOM, Range), Pose2::new(0.0, 0.0, 0.7)).unwrap();
    assert!(!fix.heading_known && fix.pose.theta == 0.7);
    let c = fix.covariance;
    assert_eq!((c[(0, 2)], c[(1, 2)], c[(2, 2)]), (0.0, 0.0, UNKNOWN_HEADING_VARIANCE_RAD2));
}

#[test]
fn two_ranges_need_a_guess() {
    let pose = Pose2::new(2.0, 3.0, 0.0);
    let sightings = see_all(pose, &[[0.0, 0.0], [6.0, 0.0]], Range);
    let fix = triangulate(&sightings, Pose2::new(2.4, 1.8, 0.0)).unwrap();
    assert!(fix.guess_decided && fix.pose.distance_m(pose) < 1e-6);
    let mirrored = triangulate(&sightings, Pose2::new(2.2, -1.7, 0.0)).unwrap();
    assert!(mirrored.pose.distance_m(Pose2::new(2.0, -3.0, 0.0)) < 1e-6);
    let error = triangulate(&sightings, Pose2::new(2.5, 0.4, 0.0)).unwrap_err();
    assert!(matches!(error, TriangulationError::Ambiguous { .. }));
    let text = error.to_string();
    assert!(text.contains("(2.000, 3.000)") && text.contains("(2.000, -3.000)"), "{text}");
    // Three in line are no better; one off the line is.
    let mut sightings = see_all(pose, &[[0.0, 0.0], [6.0, 0.0], [9.0, 0.0]], Range);
    assert!(matches!(triangulate(&sightings, Pose2::IDENTITY), Err(TriangulationError::Ambiguous { .. })));
    sightings.push(see(pose, [1.0, 1.0], Range));
    assert!(!triangulate(&sightings, Pose2::IDENTITY).unwrap().guess_decided);
}

#[test]
fn too_few_says_how_many_more() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    let check = |sightings: &[Sighting], expected: &str| {
        let error = triangulate(sightings, pose).unwrap_err();
        assert!(matches!(error, TriangulationError::TooFew { .. } | TriangulationError::OnePlace { .. }), "{error:?}");
        assert!(error.to_string().contains(expected), "{error}");
    };
    check(&[], "two ranges, or three bearings, to different landmarks are needed at least");
    check(
        &see_all(pose, &ROOM[..1], Range),
        "1 range and 0 bearings to different landmarks are too few: one more range",
    );
    check(&see_all(pose, &ROOM[..1], Bearing), "two more bearings or ranges to different landmarks are needed");
    check(&see_all(pose, &ROOM[..1], Both), "one more bearing or range to different landmarks is needed");
    check(&see_all(pose, &ROOM[..2], Bearing), "0 ranges and 2 bearings to different landmarks are too few: one more");
    check(&see_all(pose, &[ROOM[0]; 3], Both), "all 3 sightings are of landmarks at one and the same place");
    check(&see_all(pose, &[ROOM[0], ROOM[0], ROOM[1]], Bearing), "2 bearings");
}

fn geometry_of(error: TriangulationError) -> Degeneracy {
    match error {
        TriangulationError::Degenerate { geometry, .. } => geometry,
        other => panic!("{other}"),
    }
}

#[test]
fn on_one_circle_bearings_leave_the_pose_open() {
    let on_circle = |angle: f64| [3.0 + 5.0 * libm::cos(angle), 1.0 + 5.0 * libm::sin(angle)];
    let [x, y] = on_circle(4.0);
    let pose = Pose2::new(x, y, 0.3);
    for angles in [&[0.0, 1.0, 2.5][..], &[0.2, 1.0, 2.0, 3.0, 5.5]] {
        let landmarks: Vec<_> = angles.iter().map(|angle| on_circle(*angle)).collect();
        let exact = see_all(pose, &landmarks, Bearing);
        assert_eq!(geometry_of(triangulate(&exact, pose).unwrap_err()), Degeneracy::OneCircle);
        // With errors, too, it is hardly ever taken for settled.
        let taken = (0..1000).filter(|trial| triangulate(&noisy(&exact, *trial), pose).is_ok()).count();
        println!("taken: {taken} of 1000");
        assert!(taken <= 5, "{taken}");
        // A range settles it.
        let mut more = exact;
        more.push(see(pose, landmarks[0], Range));
        assert!(triangulate(&more, pose).unwrap().pose.distance_m(pose) < 1e-6);
    }
}

#[test]
fn on_one_line_the_pose_stays_open() {
    let pose = Pose2::new(2.0, 1.0, 0.3);
    let line = [[4.0, 2.0], [6.0, 3.0], [-2.0, -1.0]];
    for what in [Range, Bearing] {
        let error = triangulate(&see_all(pose, &line, what), pose).unwrap_err();
        assert!(error.to_string().contains("on one line"), "{what:?}: {error}");
        for trial in 0..300 {
            if let Ok(fix) = triangulate(&noisy(&see_all(pose, &line, what), trial), pose) {
                // Off the line by the square root of the error; whoever takes it must know how uncertain it is.
                let off = fix.pose.distance_m(pose);
                let sigma = (fix.covariance[(0, 0)] + fix.covariance[(1, 1)]).sqrt();
                assert!(off < 5.0 * sigma, "{what:?} {trial}: {off} {sigma}");
            }
        }
    }
    // With both, a line is enough.
    assert!(close(triangulate(&see_all(pose, &line, Both), pose).unwrap().pose, pose));
}

#[test]
fn landmarks_close_together_are_too_little_for_what_is_uncertain() {
    let pose = Pose2::new(30.0, 2.0, 0.3);
    let error = triangulate(&see_all(pose, &[[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]], Bearing), pose).unwrap_err();
    let text = error.to_string();
    assert!(
        matches!(error, TriangulationError::Degenerate { position_sigma_m: Some(sigma), .. } if sigma > 1.0),
        "{text}"
    );
}

#[test]
fn a_wrong_landmark_is_noticed_and_named() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    for what in [Range, Bearing, Both] {
        let mut sightings = see_all(pose, &[ROOM[0], ROOM[1], ROOM[2], ROOM[3], [3.0, 7.0], [3.0, -3.0]], what);
        sightings[2].landmark = [7.0, 3.0];
        match triangulate(&sightings, pose) {
            Err(TriangulationError::Inconsistent { worst: 2, worst_sigmas, chi2, limit, .. }) => {
                assert!(worst_sigmas > 10.0 && chi2 > limit);
            }
            other => panic!("{what:?}: {other:?}"),
        }
    }
    // Two circles that do not meet.
    let apart =
        [see(Pose2::IDENTITY, [1.0, 0.0], Range), Sighting { landmark: [9.0, 0.0], ..see(pose, ROOM[0], Range) }];
    assert!(matches!(triangulate(&apart, pose), Err(TriangulationError::Inconsistent { degrees_of_freedom: 0, .. })));
}

#[test]
fn impossible_numbers_are_named() {
    let pose = Pose2::new(2.5, 1.5, 2.0);
    let good = see_all(pose, &ROOM, Both);
    let check = |change: &dyn Fn(&mut Sighting), expected: &str| {
        let mut sightings = good.clone();
        change(&mut sightings[1]);
        let error = triangulate(&sightings, pose).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check(&|s| s.range_m = Some(f64::NAN), "sighting 2: the range is NaN; expected metres, from 0 to 3e7");
    check(&|s| s.range_m = Some(-1.0), "sighting 2: the range is -1;");
    check(&|s| s.bearing_rad = Some(90.0), "sighting 2: the bearing is 90; expected radians within a turn");
    check(&|s| s.range_sigma_m = 0.0, "sighting 2: the range's sigma is 0; expected a standard deviation");
    check(&|s| s.landmark[1] = f64::INFINITY, "sighting 2: the position of its landmark is inf");
    check(&|s| (s.range_m, s.bearing_rad) = (None, None), "sighting 2: nothing was measured");
    let error = triangulate(&good, Pose2 { x: f64::NAN, ..pose }).unwrap_err().to_string();
    assert!(error.contains("the guess of the pose has NaN in it"), "{error}");
    let error = triangulate(&vec![good[0]; SIGHTINGS_MAX + 1], pose).unwrap_err();
    assert_eq!(error, TriangulationError::TooMany { count: SIGHTINGS_MAX + 1 });
}
