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

/// A ring of sixteen sonars.
fn ring() -> Robot {
    let sonar = |number: u16| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.0, f64::from(number) * core::f64::consts::PI / 8.0)
            * Pose2::new(0.2, 0.0, 0.0),
        first_transducer: number,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: 30.0_f64.to_radians(),
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: (0..16).map(sonar).collect(), ..Robot::default() }
}

/// Where a ray meets a wall of a room of 8 m × 6 m with a pillar: how far it is, and the angle from the normal.
fn met(beam: Pose2) -> Option<(f64, f64)> {
    let walls = [
        ([-1.0, -2.0], [7.0, -2.0]),
        ([7.0, -2.0], [7.0, 4.0]),
        ([7.0, 4.0], [-1.0, 4.0]),
        ([-1.0, 4.0], [-1.0, -2.0]),
        ([3.0, 2.0], [4.0, 2.0]),
        ([4.0, 2.0], [4.0, 2.5]),
        ([3.0, 2.0], [3.0, 2.5]),
    ];
    let (s, c) = (beam.theta.sin(), beam.theta.cos());
    let hit = |([ax, ay], [bx, by]): ([f64; 2], [f64; 2])| {
        let (ex, ey) = (bx - ax, by - ay);
        let det = ex * s - ey * c;
        let (dx, dy) = (ax - beam.x, ay - beam.y);
        let (range, along) = ((ex * dy - ey * dx) / det, (c * dy - s * dx) / det);
        let off_rad = (det.abs() / ex.hypot(ey)).min(1.0).acos();
        (range > 0.0 && (0.0..=1.0).contains(&along)).then_some((range, off_rad))
    };
    walls.into_iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// What a robot sees or hears in the room at a pose. Sonars hear what they meet within 25° of its normal.
fn seen(robot: &Robot, at: Pose2) -> Vec<Reading> {
    let of = |number: u16| {
        let transducer = robot.transducer(number).unwrap();
        let axis = at * transducer.base_from_transducer;
        let range_m = if transducer.kind == SensorKind::Sonar {
            let rays = (-6..=6).map(|ray| axis * Pose2::new(0.0, 0.0, f64::from(ray) * transducer.aperture_rad / 12.0));
            let answers = rays.filter_map(met).filter(|(_, off_rad)| *off_rad < 25.0_f64.to_radians());
            answers.map(|(range, _)| range).fold(f64::INFINITY, f64::min)
        } else {
            met(axis).map_or(f64::INFINITY, |(range, _)| range)
        };
        let echo = if range_m < transducer.range_max_m { Echo::Hit { range_m } } else { Echo::NoEcho };
        Reading { transducer: number, echo, offset_ns: 0 }
    };
    (0..robot.transducer_count() as u16).map(of).collect()
}

/// Round the room three times; the odometry counts 4 % too much of its way and 3 % too little of its turns.
fn drive(service: &mut SlamService, between: impl FnMut(&mut SlamService, u64)) -> (Path, Path) {
    let (truth, told) = driven(service, &robot(), 360, between);
    (truth, told.into_iter().map(|(stamp_ns, estimate)| (stamp_ns, estimate.pose)).collect())
}

/// The same by so many steps, of 120 to a round, with this robot; estimates as they are told.
fn driven(
    service: &mut SlamService,
    robot: &Robot,
    steps: u64,
    mut between: impl FnMut(&mut SlamService, u64),
) -> (Path, Vec<(u64, Estimate)>) {
    let mut out = Outbox::default();
    let mut send = |service: &mut SlamService, stamp_ns, message| {
        service.step(Input::Message { sequence: 0, stamp_ns, message }, &mut out).unwrap();
    };
    send(service, 0, Message::Robot(robot.clone()));
    let (mut is, mut odom) = (Pose2::IDENTITY, Pose2::IDENTITY);
    let mut truth = Vec::new();
    for step in 0..steps {
        let stamp_ns = step * 200_000_000;
        truth.push((stamp_ns, is));
        let raw = RawOdometry { odom_from_base: odom, v_mps: 0.0, w_radps: 0.0 };
        send(service, stamp_ns, Message::Odometry(raw));
        send(service, stamp_ns, Message::Scan(seen(robot, is)));
        between(service, step);
        let step = Pose2::new(0.12, 0.0, core::f64::consts::TAU / 120.0);
        is = is * step;
        odom = odom * Pose2::new(step.x * 1.04, 0.0, step.theta * 0.97);
    }
    service.step(Input::Finish, &mut out).unwrap();
    let mut told = Vec::new();
    while let Some((stamp_ns, message)) = out.pop() {
        let Message::Estimate(estimate) = message else { panic!("{message:?}") };
        told.push((stamp_ns, estimate.estimate));
    }
    (truth, told)
}

/// What a service is after a death; what changed goes to `saved`, as to a store.
fn reborn(service: &mut SlamService, saved: &mut Saved) -> SlamService {
    let mut parts = Parts::default();
    service.save(&mut parts);
    saved.apply(parts.into_changes());
    let mut reborn = self::service();
    reborn.restore(saved).unwrap();
    reborn
}

fn service() -> SlamService {
    SlamService::new(&SlamConfig::default(), &OdometryConfig::default(), &MapperConfig::default(), None).unwrap()
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
    let mut saved = Saved::default();
    let (_, killed) = drive(&mut service(), |service, step| {
        if step % 70 == 33 {
            *service = reborn(service, &mut saved);
        }
    });
    assert_eq!(undisturbed, killed);
}

/// Settles what was driven every 24 m.
fn settling(out: Option<PathBuf>) -> SlamService {
    let config = SlamConfig { settle_after_m: 48.0, ..SlamConfig::default() };
    SlamService::new(&config, &OdometryConfig::default(), &MapperConfig::default(), out).unwrap()
}

#[test]
fn a_long_drive_is_told_while_it_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (mut service, mut seen) = (settling(Some(folder.path().into())), Vec::new());
    let (truth, told) = driven(&mut service, &robot(), 1500, |service, step| {
        if step % 300 == 299 {
            seen.push(service.slam.drive.nodes.iter().filter(|node| !node.points.is_empty()).count());
        }
    });
    assert!(service.slam.drive.graph.settled > 1000);
    // Of what is settled there is one scan of each place, of which this room has few.
    assert!(seen.iter().all(|seen| *seen < 650), "{seen:?}");
    assert_eq!(
        truth.iter().map(|(stamp_ns, _)| stamp_ns).collect::<Vec<_>>(),
        told.iter().map(|(ns, _)| ns).collect::<Vec<_>>()
    );
    let off_m: Vec<f64> = truth.iter().zip(&told).map(|((_, is), (_, told))| is.distance_m(told.pose)).collect();
    let mean_m = off_m.iter().sum::<f64>() / off_m.len() as f64;
    assert!(
        mean_m < 0.02 && off_m.iter().all(|off_m| *off_m < 0.06),
        "{mean_m} {:?}",
        off_m.iter().cloned().fold(0.0, f64::max)
    );
    let lines = std::fs::read_to_string(folder.path().join(PATH_FILE)).unwrap();
    assert_eq!(lines.lines().filter(|line| !line.starts_with('#')).count(), truth.len());
}

#[test]
fn killed_at_any_time_a_long_drive_comes_to_the_same_bits() {
    let (_, undisturbed) = driven(&mut settling(None), &robot(), 900, |_, _| {});
    let mut saved = Saved::default();
    let mut service = settling(None);
    let (_, killed) = driven(&mut service, &robot(), 900, |service, step| {
        if step % 7 == 3 {
            // As the store does: what changed is applied to what there is.
            let mut parts = Parts::default();
            service.save(&mut parts);
            saved.apply(parts.into_changes());
        }
        if step % 140 == 80 {
            let mut parts = Parts::default();
            service.save(&mut parts);
            saved.apply(parts.into_changes());
            let mut reborn = settling(None);
            reborn.restore(&saved).unwrap();
            assert!(reborn.slam.drive == service.slam.drive);
            *service = reborn;
        }
    });
    assert!(undisturbed == killed);
    assert!(saved.under("odom/").count() < 4 && saved.under("edges/").count() < 12, "what was told is stored no more");
}

#[test]
fn files_lie_beside_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let out = Some(folder.path().join("new"));
    let mut service =
        SlamService::new(&SlamConfig::default(), &OdometryConfig::default(), &MapperConfig::default(), out.clone())
            .unwrap();
    let (_, path) = drive(&mut service, |_, _| {});
    let read = |name: &str| std::fs::read_to_string(out.as_ref().unwrap().join(name)).unwrap();
    assert_eq!(read(PATH_FILE).lines().filter(|line| !line.starts_with('#')).count(), path.len());
    assert!(read(GRAPH_FILE).contains("EDGE_SE2 0 1 "));
    let report: echogrid_slam::report::Report = serde_json::from_str(&read(CLOSURES_FILE)).unwrap();
    assert!(report.applied() > 0 && report.nodes > 300, "{report:?}");
}

#[test]
fn a_ring_of_sonars_corrects_its_own_odometry() {
    let (truth, told) = driven(&mut service(), &ring(), 360, |_, _| {});
    assert_eq!(truth.len(), told.len());
    let mut odometry = Odometry::new(&OdometryConfig::default());
    let mut odom = Pose2::IDENTITY;
    let (mut off_m, mut drifted_m) = (0.0, 0.0);
    for ((_, is), (_, estimate)) in truth.iter().zip(&told) {
        let drifted = odometry.step(odom);
        odom = odom * Pose2::new(0.12 * 1.04, 0.0, core::f64::consts::TAU / 120.0 * 0.97);
        drifted_m += drifted.pose.distance_m(*is);
        off_m += estimate.pose.distance_m(*is);
        // No pose is off by more than three standard deviations along the axis in which it is less exact.
        let c = estimate.pose_covariance();
        let sigma_m = (0.5 * (c[(0, 0)] + c[(1, 1)] + (c[(0, 0)] - c[(1, 1)]).hypot(2.0 * c[(0, 1)]))).sqrt();
        assert!(estimate.pose.distance_m(*is) <= 3.0 * sigma_m + 1e-6, "{is:?} {estimate:?}");
    }
    assert!(off_m < 0.25 * drifted_m && drifted_m > 0.2 * truth.len() as f64, "{off_m} {drifted_m}");
}

#[test]
fn where_the_lidar_recognises_nothing_the_sonars_correct() {
    let mut both = ring();
    // It sees no farther than this.
    both.sensors.push(Sensor { first_transducer: 16, range_max_m: 0.2, ..robot().sensors.remove(0) });
    let told = |robot: &Robot| {
        let (_, told) = driven(&mut service(), robot, 360, |_, _| {});
        told.into_iter().map(|(stamp_ns, estimate)| (stamp_ns, estimate.pose)).collect::<Path>()
    };
    assert!(told(&both) == told(&ring()));
    // One that sees does it by itself.
    let mut seeing = both.clone();
    seeing.sensors[16].range_max_m = 30.0;
    assert!(told(&seeing) != told(&ring()));
    let (folder, blind) = (tempfile::tempdir().unwrap(), reborn(&mut service(), &mut Saved::default()));
    driven(&mut SlamService { out: Some(folder.path().into()), ..blind }, &both, 360, |_, _| {});
    let text = std::fs::read_to_string(folder.path().join(CLOSURES_FILE)).unwrap();
    let report: Report = serde_json::from_str(&text).unwrap();
    assert!(report.instead_of_lidar.is_some_and(|[lost, nodes]| 2 * lost > nodes) && report.applied() > 0);
}

#[test]
fn killed_at_any_time_sonars_tell_the_same_bits() {
    let (truth, undisturbed) = driven(&mut service(), &ring(), 300, |_, _| {});
    let mut saved = Saved::default();
    let (_, killed) = driven(&mut service(), &ring(), 300, |service, step| {
        if step % 70 == 33 {
            *service = reborn(service, &mut saved);
        }
    });
    assert!(undisturbed == killed);
    let off_m = truth[299].1.distance_m(undisturbed[299].1.pose);
    assert!(off_m < 0.3, "{off_m} m off at the end: nothing was recognised");
}

#[test]
fn where_sonars_hear_nothing_again_the_odometry_counts_as_without() {
    // Not once round.
    let (_, told) = driven(&mut service(), &ring(), 100, |_, _| {});
    let mut odometry = Odometry::new(&OdometryConfig::default());
    let mut odom = Pose2::IDENTITY;
    for (_, estimate) in told {
        assert_eq!(estimate, odometry.step(odom));
        odom = odom * Pose2::new(0.12 * 1.04, 0.0, core::f64::consts::TAU / 120.0 * 0.97);
    }
}

#[test]
fn who_has_no_sensor_is_told() {
    let message = Message::Robot(Robot { name: "deaf".into(), ..Robot::default() });
    let error = service().step(Input::Message { sequence: 1, stamp_ns: 0, message }, &mut Outbox::default());
    assert!(error.unwrap_err().to_string().contains("\"deaf\" has no sensor"));
}
