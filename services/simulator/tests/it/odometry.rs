//! Odometry drifts for the reasons that it is given, by as much as the closed forms say.

use echogrid_core::config::Systematic;
use echogrid_core::{Calibration, Increment, Matrix3, Odometry, OdometryConfig, Pose2, Trial, move_by, wrap_angle};
use echogrid_service::Sensor as _;
use echogrid_simulator::{Drive, Motion, Simulator, SimulatorConfig};
use echogrid_topics::Message;

use crate::support::{exact, named, sonars};

const TRIALS: u64 = 200;
const STRAIGHT_M: f64 = 3.0;
const TURN_RAD: f64 = core::f64::consts::PI;

/// A robot that does everything wrong.
fn wrong(seed: u64) -> SimulatorConfig {
    SimulatorConfig {
        seed,
        axle_m: 0.5,
        ticks_per_m: 20_000.0,
        left_scale: 0.03,
        right_scale: 0.034,
        axle_scale: 0.02,
        slip_m2_per_m: 4e-5,
        scrub_rad2_per_rad: 4e-4,
        scrub_m2_per_rad: 3e-5,
        bumps_per_m: 0.5,
        bump_rad: 0.02,
        ..SimulatorConfig::default()
    }
}

fn trials(motion: Motion) -> Vec<Trial> {
    (0..TRIALS).map(|seed| Drive::new(&wrong(seed), Pose2::IDENTITY).run(motion)).collect()
}

fn fit() -> Calibration {
    let straight = trials(Motion::Straight { metres: STRAIGHT_M });
    let turns = trials(Motion::Turn { radians: TURN_RAD });
    Calibration::fit(&straight, &turns).unwrap()
}

/// Four standard errors: a mean of n trials is off by √(variance/n), a variance by √(2/(n − 1)) of itself. Bumps are few and
/// heavy-tailed, so the variance that they are in is off by more: its kurtosis is at most 3 + 3/(λ l) = 5.
#[test]
fn a_calibration_finds_the_closed_forms() {
    let (fit, expected) = (fit(), wrong(0).expected_error_model().over(STRAIGHT_M, TURN_RAD));
    let n = TRIALS as f64;
    let of_variance = |name: &str, fitted: f64, expected: f64, kurtosis: f64| {
        let error = ((kurtosis - 1.0) / (n - 1.0)).sqrt();
        assert!((fitted / expected - 1.0).abs() < 4.0 * error, "{name}: {fitted:e}, expected {expected:e}");
    };
    of_variance("k_ll", fit.k_ll, expected.k_ll, 3.0);
    of_variance("k_lt", fit.k_lt, expected.k_lt, 3.0);
    of_variance("k_tt", fit.k_tt, expected.k_tt, 3.0);
    of_variance("k_tl", fit.k_tl, expected.k_tl, 5.0);
    let of_mean = |name: &str, fitted: f64, expected: f64, variance: f64, over: f64| {
        let error = (variance / n).sqrt() / over;
        assert!((fitted - expected).abs() < 4.0 * error, "{name}: {fitted}, expected {expected} ± {error}");
    };
    of_mean("lin_scale", fit.lin_scale, expected.lin_scale, expected.k_ll * STRAIGHT_M, STRAIGHT_M);
    of_mean("ang_scale", fit.ang_scale, expected.ang_scale, expected.k_tt * TURN_RAD, TURN_RAD);
    of_mean("lin_offset_m", fit.lin_offset_m, expected.lin_offset_m, expected.k_lt * TURN_RAD, 1.0);
    of_mean("ang_offset_rad", fit.ang_offset_rad, expected.ang_offset_rad, expected.k_tl * STRAIGHT_M, 1.0);
    // And the bounds would notice: nothing here is zero.
    assert!(fit.lin_scale > 0.02 && fit.ang_scale > 0.03 && fit.ang_offset_rad > 0.01 && fit.lin_offset_m > 1e-3);
}

/// Another drive than those of the calibration: turns both ways, and ways of several lengths.
const MIXED: [Motion; 7] = [
    Motion::Straight { metres: 4.0 },
    Motion::Turn { radians: 1.6 },
    Motion::Straight { metres: 2.5 },
    Motion::Turn { radians: -2.4 },
    Motion::Straight { metres: 3.0 },
    Motion::Turn { radians: 0.7 },
    Motion::Straight { metres: 1.0 },
];

/// Where the drive ends, as odometry that was corrected by a calibration has it, against the truth; in the frame of the
/// true end.
fn final_errors(calibration: &Calibration) -> Vec<[f64; 3]> {
    let symmetric = |seed| SimulatorConfig { left_scale: 0.032, right_scale: 0.032, ..wrong(seed) };
    (1000..1000 + TRIALS)
        .map(|seed| {
            let mut drive = Drive::new(&symmetric(seed), Pose2::IDENTITY);
            let mut corrected = Pose2::IDENTITY;
            let mut before = drive.odometry_pose();
            for motion in MIXED {
                drive.run(motion);
                // Motions are straight or on the spot: so is what is measured of them, but for what went wrong.
                let now = drive.odometry_pose();
                let step = Increment::between(before, now);
                corrected = move_by(corrected, step.corrected(calibration.lin_scale, calibration.ang_scale));
                before = now;
            }
            let truth = drive.true_pose();
            let error = truth.inverse() * corrected;
            [error.x, error.y, wrap_angle(corrected.theta - truth.theta)]
        })
        .collect()
}

#[test]
fn the_fitted_model_predicts_another_drive() {
    let calibration = fit();
    let random = OdometryConfig { systematic: Systematic::Off, ..calibration.applied_to(&OdometryConfig::default()) };
    let mut odometry = Odometry::new(&random);
    let mut pose = Pose2::IDENTITY;
    let mut covariance = odometry.step(pose).pose_covariance();
    for motion in MIXED {
        // In small steps, as the odometry goes.
        for _ in 0..100 {
            let step = match motion {
                Motion::Straight { metres } => Increment { forward_m: metres / 100.0, ..Increment::default() },
                Motion::Turn { radians } => Increment { turn_rad: radians / 100.0, ..Increment::default() },
                Motion::Wait { .. } => Increment::default(),
            };
            pose = move_by(pose, step);
            covariance = odometry.step(pose).pose_covariance();
        }
    }
    let errors = final_errors(&calibration);
    let n = errors.len() as f64;
    let spread = |place: usize| errors.iter().map(|error| error[place] * error[place]).sum::<f64>() / n;
    // As seen from the end of the drive.
    let turned = Matrix3::new(
        libm::cos(pose.theta),
        libm::sin(pose.theta),
        0.0,
        -libm::sin(pose.theta),
        libm::cos(pose.theta),
        0.0,
        0.0,
        0.0,
        1.0,
    );
    let predicted = turned * covariance * turned.transpose();
    // The fit is off by √(2/n) and so is the spread; what is left of the systematic error after a correction that is off by
    // a standard error is as large as 1/n of it. Four standard errors of the ratio of the two.
    let bound = 4.0 * (2.0 * 2.0 / n).sqrt();
    for (place, name) in ["along", "across", "heading"].into_iter().enumerate() {
        let ratio = spread(place) / predicted[(place, place)];
        assert!((1.0 / (1.0 + bound)..1.0 + bound).contains(&ratio), "{name}: {ratio}, bound {bound}");
    }
}

#[test]
fn the_ticks_of_coarse_encoders_are_seen_in_the_stream() {
    let config = SimulatorConfig { ticks_per_m: 40.0, ..exact() };
    let script = [Motion::Straight { metres: 2.0 }];
    let mut simulator = Simulator::scripted(&config, named("room"), sonars(&[0.0]), script).unwrap();
    let mut seen = std::collections::BTreeSet::new();
    let mut poses = 0;
    while let Some((_, message)) = simulator.next().unwrap() {
        if let Message::Odometry(odometry) = message {
            let ticks = (odometry.odom_from_base.x - 1.0) * 40.0;
            assert!((ticks - ticks.round()).abs() < 1e-9, "{ticks}");
            seen.insert(ticks.round() as i64);
            poses += 1;
        }
    }
    assert!(seen.len() > 20 && seen.len() < poses, "{} different of {poses}", seen.len());
    assert!(simulator.odometry_pose().distance_m(simulator.true_pose()) < 1.0 / 40.0 + 1e-9);
}

#[test]
fn the_odometry_starts_where_the_robot_does() {
    let config = SimulatorConfig { start: vec![2.0, 1.0, 90.0], ..exact() };
    let mut simulator =
        Simulator::scripted(&config, named("room"), sonars(&[0.0]), [Motion::Wait { seconds: 0.1 }]).unwrap();
    let start = Pose2::new(2.0, 1.0, core::f64::consts::FRAC_PI_2);
    simulator.next().unwrap();
    let Some((0, Message::TrueWorld(world))) = simulator.next().unwrap() else { panic!("the world is second") };
    assert_eq!(world.bounds_m, [[0.0, 0.0], [6.0, 4.0]]);
    let Some((0, Message::TruePose(truth))) = simulator.next().unwrap() else { panic!("the truth is third") };
    assert_eq!(truth.map_from_base, Some(start));
    let Some((0, Message::Odometry(odometry))) = simulator.next().unwrap() else { panic!("odometry is fourth") };
    assert_eq!(odometry.odom_from_base, start);
}
