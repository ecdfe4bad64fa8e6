use echogrid_core::{Echo, Sensor};

use super::*;

/// Poses by stamp.
type Path = Vec<(u64, Pose2)>;

/// A lidar of 181 beams in the middle of the robot.
fn robot() -> Robot {
    let sensor = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: 181,
        first_bearing_rad: -core::f64::consts::FRAC_PI_2,
        bearing_step_rad: 1.0_f64.to_radians(),
        aperture_rad: 1.0_f64.to_radians(),
        range_min_m: 0.1,
        range_max_m: 30.0,
        range_error_ratio: 0.005,
    };
    Robot { sensors: vec![sensor], ..Robot::default() }
}

/// What it sees in a room of 8 m × 6 m with a pillar, at a pose.
fn seen(robot: &Robot, at: Pose2) -> Vec<Reading> {
    let walls = [
        ([-1.0, -2.0], [7.0, -2.0]),
        ([7.0, -2.0], [7.0, 4.0]),
        ([7.0, 4.0], [-1.0, 4.0]),
        ([-1.0, 4.0], [-1.0, -2.0]),
        ([3.0, 2.0], [4.0, 2.0]),
        ([4.0, 2.0], [4.0, 2.5]),
        ([3.0, 2.0], [3.0, 2.5]),
    ];
    (0..181)
        .map(|number| {
            let beam = at * robot.transducer(number).unwrap().base_from_transducer;
            let (s, c) = (beam.theta.sin(), beam.theta.cos());
            let hit = |([ax, ay], [bx, by]): ([f64; 2], [f64; 2])| {
                let (ex, ey) = (bx - ax, by - ay);
                let det = ex * s - ey * c;
                let (dx, dy) = (ax - beam.x, ay - beam.y);
                let (range, along) = ((ex * dy - ey * dx) / det, (c * dy - s * dx) / det);
                (range > 0.0 && (0.0..=1.0).contains(&along)).then_some(range)
            };
            let range_m = walls.into_iter().filter_map(hit).fold(f64::INFINITY, f64::min);
            let echo = if range_m < 30.0 { Echo::Hit { range_m } } else { Echo::NoEcho };
            Reading { transducer: number, echo, offset_ns: 0 }
        })
        .collect()
}

/// Round the room three times; the odometry counts 4 % too much of its way and 3 % too little of its turns.
fn drive(service: &mut SlamService, mut between: impl FnMut(&mut SlamService, u64)) -> (Path, Path) {
    let robot = robot();
    let mut out = Outbox::default();
    let mut send = |service: &mut SlamService, stamp_ns, message| {
        service.step(Input::Message { sequence: 0, stamp_ns, message }, &mut out).unwrap();
    };
    send(service, 0, Message::Robot(robot.clone()));
    let (mut is, mut odom) = (Pose2::IDENTITY, Pose2::IDENTITY);
    let mut truth = Vec::new();
    for step in 0..360_u64 {
        let stamp_ns = step * 200_000_000;
        truth.push((stamp_ns, is));
        let raw = RawOdometry { odom_from_base: odom, v_mps: 0.0, w_radps: 0.0 };
        send(service, stamp_ns, Message::Odometry(raw));
        send(service, stamp_ns, Message::Scan(seen(&robot, is)));
        between(service, step);
        let step = Pose2::new(0.12, 0.0, core::f64::consts::TAU / 120.0);
        is = is * step;
        odom = odom * Pose2::new(step.x * 1.04, 0.0, step.theta * 0.97);
    }
    service.step(Input::Finish, &mut out).unwrap();
    let mut path = Vec::new();
    while let Some((stamp_ns, message)) = out.pop() {
        let Message::Estimate(estimate) = message else { panic!("{message:?}") };
        path.push((stamp_ns, estimate.estimate.pose));
    }
    (truth, path)
}

fn service() -> SlamService {
    SlamService::new(&SlamConfig::default(), &OdometryConfig::default(), None).unwrap()
}

#[test]
fn a_drive_that_drifts_is_told_as_it_was() {
    let (truth, path) = drive(&mut service(), |_, _| {});
    assert_eq!(truth.len(), path.len());
    let off_m: Vec<f64> = truth.iter().zip(&path).map(|((_, is), (_, pose))| is.distance_m(*pose)).collect();
    let mean_m = off_m.iter().sum::<f64>() / off_m.len() as f64;
    assert!(mean_m < 0.02 && off_m.iter().all(|off_m| *off_m < 0.06), "{mean_m}");
}

#[test]
fn killed_at_any_time_it_goes_on_to_the_same_bits() {
    let (_, undisturbed) = drive(&mut service(), |_, _| {});
    let (_, killed) = drive(&mut service(), |service, step| {
        if step % 70 == 33 {
            let mut parts = Parts::default();
            service.save(&mut parts);
            let mut saved = Saved::default();
            saved.apply(parts.into_changes());
            *service = self::service();
            service.restore(&saved).unwrap();
        }
    });
    assert_eq!(undisturbed, killed);
}

#[test]
fn files_lie_beside_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let out = Some(folder.path().join("new"));
    let mut service = SlamService::new(&SlamConfig::default(), &OdometryConfig::default(), out.clone()).unwrap();
    let (_, path) = drive(&mut service, |_, _| {});
    let read = |name: &str| std::fs::read_to_string(out.as_ref().unwrap().join(name)).unwrap();
    assert_eq!(read(PATH_FILE).lines().filter(|line| !line.starts_with('#')).count(), path.len());
    assert!(read(GRAPH_FILE).contains("EDGE_SE2 0 1 "));
    let report: echogrid_slam::report::Report = serde_json::from_str(&read(CLOSURES_FILE)).unwrap();
    assert!(report.applied() > 0 && report.nodes > 300, "{report:?}");
}

#[test]
fn who_has_no_lidar_is_told() {
    let message = Message::Robot(Robot { name: "deaf".into(), ..Robot::default() });
    let error = service().step(Input::Message { sequence: 1, stamp_ns: 0, message }, &mut Outbox::default());
    assert!(error.unwrap_err().to_string().contains("\"deaf\" has no lidar"));
}
