use core::f64::consts::PI;

use echogrid_core::Sensor;
use echogrid_core::parts::{Parts, Saved};

use super::*;

const SECOND: u64 = 1_000_000_000;

fn robot() -> Robot {
    let sonar = |first_transducer: u16, theta: f64| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.1, 0.0, theta),
        first_transducer,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: 0.5,
        range_min_m: 0.02,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: vec![sonar(0, PI / 2.0), sonar(1, -PI / 2.0)], ..Robot::default() }
}

fn pose(stamp_ns: u64, x: f64) -> DrivePose {
    DrivePose { stamp_ns, odom_from_base: Pose2::new(x, 0.0, 0.0), v_mps: 1.0, w_radps: 0.0 }
}

fn ring(range_m: f64) -> Vec<Reading> {
    let reading = |transducer| Reading { transducer, echo: Answered::Hit { range_m }, offset_ns: 0 };
    vec![reading(0), reading(1)]
}

/// Straight on, a metre and a ring each second; the ring half a second after the pose.
fn driven(seconds: u64) -> Drive {
    let mut drive = Drive::default();
    drive.described(robot());
    for second in 0..=seconds {
        drive.moved(pose(second * SECOND, second as f64));
        drive.scanned(second * SECOND + SECOND / 2, ring(1.0 + second as f64 * 0.01));
    }
    drive
}

fn ranges(piece: &Piece) -> Vec<f64> {
    piece.trail.echoes(Scales::default(), 1).iter().map(|echo| echo.range_m).collect()
}

#[test]
fn a_piece_is_the_same_however_far_what_is_measured_is_ahead() {
    let (early, late) = (driven(7), driven(40));
    let at = 6 * SECOND;
    let of = |drive: &Drive| drive.piece(at, 3.0, 1.0, Scales::default()).unwrap();
    assert_eq!(of(&early), of(&late));
    // The rings at 3.5, 4.5 and 5.5 m, of both sonars, the oldest first.
    assert_eq!(ranges(&of(&early)).len(), 6);
    assert!((ranges(&of(&early))[0] - 1.03).abs() < 1e-12);
    let first = of(&late).trail.echoes(Scales::default(), 1)[0].base_from_transducer;
    assert!((first.x - (0.1 - 2.5)).abs() < 1e-9, "{first:?}");
    assert_eq!(of(&late).trail.older, 2);
}

#[test]
fn what_the_drive_measures_too_much_is_taken_out() {
    let drive = driven(7);
    let scales = Scales { lin: 0.1, ang: 0.0 };
    let piece = drive.piece(6 * SECOND, 3.0, 1.0, scales).unwrap();
    let first = piece.trail.echoes(Scales::default(), 1)[0].base_from_transducer;
    assert!((first.x - (0.1 - 0.9 * 2.5)).abs() < 1e-9, "{first:?}");
    let went = drive.between(2 * SECOND, 6 * SECOND, scales).unwrap();
    assert!((went.x - 3.6).abs() < 1e-9, "{went:?}");
}

#[test]
fn an_answer_waits_for_all_that_was_measured_before() {
    let mut drive = Drive::default();
    drive.described(robot());
    drive.moved(pose(0, 0.0));
    assert!(!drive.reaches(0), "a ring of before may be on its way");
    drive.scanned(SECOND / 2, ring(1.0));
    assert!(drive.reaches(0));
    drive.moved(pose(SECOND, 1.0));
    assert!(!drive.reaches(SECOND));
    drive.scans_ended();
    assert!(drive.reaches(SECOND));
    // A sensor that falls silent is not waited for longer than it may be ahead.
    let mut silent = driven(3);
    silent.moved(pose(4 * SECOND, 4.0));
    assert!(!silent.reaches(4 * SECOND));
    (5..4 + SILENT as u64).for_each(|second| silent.moved(pose(second * SECOND, second as f64)));
    assert!(!silent.reaches(4 * SECOND));
    silent.moved(pose((4 + SILENT as u64) * SECOND, 900.0));
    assert!(silent.reaches(4 * SECOND));
}

#[test]
fn nothing_is_put_together_over_a_leap() {
    let mut drive = driven(6);
    drive.moved(pose(7 * SECOND, 70.0));
    drive.scanned(7 * SECOND + SECOND / 2, ring(2.0));
    drive.moved(pose(8 * SECOND, 71.0));
    let piece = drive.piece(8 * SECOND, 4.0, 1.0, Scales::default()).unwrap();
    assert_eq!(ranges(&piece), [2.0, 2.0]);
    assert!((piece.way_m - 1.0).abs() < 1e-9 && drive.between(6 * SECOND, 8 * SECOND, Scales::default()).is_none());
}

#[test]
fn what_is_remembered_is_bounded_and_goes_on_after_a_restart() {
    let drive = driven(3 * REMEMBERED as u64);
    assert!(drive.track.len() == REMEMBERED && drive.heard.len() < 3 * REMEMBERED, "{}", drive.heard.len());
    let (mut parts, mut saved) = (Parts::default(), Saved::default());
    parts.put_value("drive", &drive);
    saved.apply(parts.into_changes());
    let again: Drive = saved.value("drive").unwrap();
    let at = 3 * REMEMBERED as u64 * SECOND - 5 * SECOND;
    let of = |drive: &Drive| drive.piece(at, 4.0, 1.0, Scales::default());
    assert!(of(&again).is_some() && of(&again) == of(&drive));
    assert_eq!(drive.piece(SECOND, 4.0, 1.0, Scales::default()), None, "that is forgotten");
}

#[test]
fn a_robot_that_stands_for_long_is_where_it_was_however_far_the_sensor_is_ahead() {
    // 10.5 m, then it stands.
    let stood = |poses: u64| {
        let mut drive = driven(10);
        (0..poses).for_each(|index| drive.moved(pose(11 * SECOND + index * SECOND / 10, 10.5)));
        drive.scanned(11 * SECOND + poses * SECOND / 10, ring(1.0));
        drive
    };
    let (early, late) = (stood(1501), stood(2500));
    let at = 11 * SECOND + 150 * SECOND;
    assert!(early.track.front() != late.track.front() && early.step_before(at, 1.0).is_some());
    assert_eq!(early.step_before(at, 1.0), late.step_before(at, 1.0));
    let of = |drive: &Drive| drive.piece(at, 6.0, 1.0, Scales::default()).unwrap();
    assert_eq!(of(&early), of(&late));
    assert!((of(&late).way_m - 6.0).abs() < 1e-9);
}
