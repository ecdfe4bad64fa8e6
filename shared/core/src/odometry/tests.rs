use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::config::Systematic;

fn config(systematic: Systematic) -> OdometryConfig {
    OdometryConfig { systematic, lin_offset_m: 0.01, ang_offset_rad: 0.02, ..OdometryConfig::default() }
}

fn close(a: Pose2, b: Pose2) -> bool {
    a.distance_m(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-9
}

#[test]
fn backwards_is_negative() {
    let step = Increment::between(Pose2::new(0.0, 0.0, FRAC_PI_2), Pose2::new(0.0, -0.5, FRAC_PI_2));
    assert!((step.forward_m + 0.5).abs() < 1e-15);
    assert!(step.lateral_m.abs() < 1e-15);
    assert!((step.length_m() - 0.5).abs() < 1e-15);
}

#[test]
fn a_turn_across_pi_is_small() {
    let step = Increment::between(Pose2::new(0.0, 0.0, 3.1), Pose2::new(0.0, 0.0, -3.1));
    assert!((step.turn_rad - (2.0 * PI - 6.2)).abs() < 1e-12);
}

#[test]
fn first_pose_is_the_map_pose() {
    let first = Pose2::new(3.0, -2.0, 1.0);
    assert_eq!(Odometry::new(&config(Systematic::Off)).step(first), Estimate::certain(first));
    let carried = Odometry::new(&config(Systematic::Carry)).step(first);
    assert_eq!((carried.pose, carried.pose_covariance()), (first, Matrix3::zeros()));
    assert!((carried.covariance[(3, 3)] - 0.09 * 0.09).abs() < 1e-15);
}

#[test]
fn errors_grow_with_the_way_not_with_the_displacement() {
    let mut odometry = Odometry::new(&config(Systematic::Carry));
    for x in [0.0, 1.0, 0.0, 1.0, 0.0] {
        odometry.step(Pose2::new(x, 0.0, 0.0));
    }
    let estimate = odometry.step(Pose2::new(0.0, 0.0, -0.5));
    assert!((estimate.travel_m - 4.0).abs() < 1e-12);
    assert!((estimate.turn_rad - 0.5).abs() < 1e-12);
    assert!((estimate.errors.e_lin_m - (0.09 * 4.0 + 0.01)).abs() < 1e-12);
    assert!((estimate.errors.e_ang_rad - (0.095 * 0.5 + 0.02)).abs() < 1e-12);
}

#[test]
fn offsets_count_from_their_thresholds() {
    let model = ErrorModel::new(&config(Systematic::Carry));
    assert_eq!(model.errors(0.0, 0.0), OdometryErrors::default());
    assert!(model.errors(0.0, 0.08).e_lin_m < 0.01);
    assert!(model.errors(0.0, 0.09).e_lin_m >= 0.01);
    assert!(model.errors(0.09, 0.0).e_ang_rad < 0.02);
    assert!(model.errors(0.10, 0.0).e_ang_rad >= 0.02);
}

#[test]
fn correct_takes_the_scale_out() {
    let mut odometry = Odometry::new(&config(Systematic::Correct));
    odometry.step(Pose2::IDENTITY);
    let ahead = odometry.step(Pose2::new(10.0, 0.0, 0.0));
    assert!((ahead.pose.x - 9.1).abs() < 1e-12);
    assert!((ahead.travel_m - 9.1).abs() < 1e-12);
    assert_eq!((ahead.errors.e_lin_m, ahead.errors.e_ang_rad), (0.0, 0.0));
    let turned = odometry.step(Pose2::new(10.0, 0.0, 1.0));
    assert!((turned.pose.theta - 0.905).abs() < 1e-12);
}

#[test]
fn a_pose_that_is_not_finite_changes_nothing() {
    let mut odometry = Odometry::new(&config(Systematic::Carry));
    assert!(!odometry.step(Pose2 { x: f64::NAN, ..Pose2::IDENTITY }).pose.is_finite());
    assert_eq!(odometry.step(Pose2::IDENTITY).pose, Pose2::IDENTITY);
    assert!(!odometry.step(Pose2 { y: f64::INFINITY, ..Pose2::IDENTITY }).pose.is_finite());
    let next = odometry.step(Pose2::new(1.0, 0.0, 0.0));
    assert!(close(next.pose, Pose2::new(1.0, 0.0, 0.0)));
    assert!((next.travel_m - 1.0).abs() < 1e-12);
}

#[test]
fn a_sideways_step_is_followed_and_doubted() {
    let mut odometry = Odometry::new(&config(Systematic::Off));
    odometry.step(Pose2::IDENTITY);
    let estimate = odometry.step(Pose2::new(0.0, 2.0, 0.0));
    assert!(close(estimate.pose, Pose2::new(0.0, 2.0, 0.0)));
    assert!((estimate.covariance[(1, 1)] - 2.0 * 4e-4).abs() < 1e-15);
}

#[test]
fn interpolation_is_linear_and_never_extrapolates() {
    let mut odometry = Odometry::new(&config(Systematic::Carry));
    odometry.step(Pose2::IDENTITY);
    let a = odometry.step(Pose2::new(1.0, 0.0, 0.2));
    let b = odometry.step(Pose2::new(2.0, 1.0, 0.6));
    let middle = a.interpolate(&b, 0.5);
    assert!((middle.travel_m - 0.5 * (a.travel_m + b.travel_m)).abs() < 1e-12);
    assert!((middle.errors.eps_lin_m2 - 0.5 * (a.errors.eps_lin_m2 + b.errors.eps_lin_m2)).abs() < 1e-15);
    assert!((middle.covariance - (a.covariance + b.covariance) * 0.5).norm() < 1e-15);
    assert_eq!(a.interpolate(&b, 0.0), a);
    assert_eq!(a.interpolate(&b, 1.0), b);
    assert_eq!(a.interpolate(&b, 7.0), b);
    assert_eq!(a.interpolate(&b, -1.0), a);
    assert_eq!(a.interpolate(&b, f64::NAN), a);
}

fn any_pose() -> impl Strategy<Value = Pose2> {
    (-5.0..5.0f64, -5.0..5.0f64, -4.0..4.0f64).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

proptest! {
    #[test]
    fn steps_add_up_to_the_logs_own_poses(poses in prop::collection::vec(any_pose(), 2..30)) {
        let mut odometry = Odometry::new(&config(Systematic::Off));
        for pose in poses {
            prop_assert!(close(odometry.step(pose).pose, pose));
        }
    }

    #[test]
    fn covariance_stays_symmetric_and_grows(poses in prop::collection::vec(any_pose(), 2..30)) {
        let mut odometry = Odometry::new(&config(Systematic::Off));
        let mut heading = -1.0;
        for pose in poses {
            let c = odometry.step(pose).pose_covariance();
            prop_assert_eq!(c, c.transpose());
            prop_assert!(c[(2, 2)] >= heading);
            heading = c[(2, 2)];
            // No direction has a negative variance, but for rounding.
            for direction in [Vector3::x(), Vector3::new(1.0, -1.0, 0.3), Vector3::new(-0.2, 0.9, 2.0)] {
                prop_assert!((direction.transpose() * c * direction)[0] >= -1e-12 * (1.0 + c.norm()));
            }
        }
    }

    #[test]
    fn where_the_map_lies_does_not_matter(a in any_pose(), b in any_pose(), frame in any_pose()) {
        let step = Increment::between(a, b);
        let moved = Increment::between(frame * a, frame * b);
        prop_assert!((step.length_m() - moved.length_m()).abs() < 1e-9);
        prop_assert!(wrap_angle(step.turn_rad - moved.turn_rad).abs() < 1e-9);
    }
}
