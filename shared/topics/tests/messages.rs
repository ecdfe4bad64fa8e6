//! Messages survive the way through shared memory; what breaks its contract does not.

#![allow(clippy::unwrap_used, clippy::panic)] // a test that can not go on has failed

use std::f64::consts::{PI, TAU};
use std::fmt::Debug;

use echogrid_core::localization::{Fix, Reason};
use echogrid_core::odometry::{Estimate, OdometryErrors};
use echogrid_core::{
    CellIndex, Echo, Footprint, JointCovariance, Pose2, Reading, Robot, Scales, Sensor, SensorKind, TileIndex, Verdict,
    VerdictCounts,
};
use echogrid_topics::message::Fault;
use echogrid_topics::wire::{
    EstimateWire, FixWire, HealthWire, LocalizationRequestWire, MAX_ACKS, MAX_SENSORS, MapInfoWire, OdometryRawWire,
    ReadingWire, RobotWire, TILE_CELLS, TileWire, TruePoseWire, TrueWorldWire, VerdictWire, Wire,
};
use echogrid_topics::{
    Ack, Health, Layer, LocalizationFix, LocalizationRequest, MapInfo, PoseEstimate, RawOdometry, ServiceState,
    TileUpdate, Topic, TruePose, TrueWorld,
};
use proptest::prelude::*;

// ---- what is sent arrives ------------------------------------------------------------------------------------------

fn pose() -> impl Strategy<Value = Pose2> {
    (-1e6..=1e6, -1e6..=1e6, -PI..=PI).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

fn number() -> impl Strategy<Value = f64> {
    prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL
}

fn amount() -> impl Strategy<Value = f64> {
    number().prop_map(f64::abs)
}

fn sensor() -> impl Strategy<Value = Sensor> {
    let kind = prop_oneof![Just(SensorKind::Sonar), Just(SensorKind::Lidar)];
    let bearings = (number(), number(), 1e-6..=TAU);
    (kind, pose(), any::<(u16, u16)>(), bearings, 0.0..10.0, 10.1..=1e5, amount()).prop_map(
        |(kind, base_from_sensor, (first_transducer, transducers), bearings, range_min_m, range_max_m, ratio)| {
            let (first_bearing_rad, bearing_step_rad, aperture_rad) = bearings;
            Sensor {
                kind,
                base_from_sensor,
                first_transducer,
                transducers,
                first_bearing_rad,
                bearing_step_rad,
                aperture_rad,
                range_min_m,
                range_max_m,
                range_error_ratio: ratio,
            }
        },
    )
}

fn robot() -> impl Strategy<Value = Robot> {
    let sensors = prop::collection::vec(sensor(), 0..=MAX_SENSORS);
    ("[a-zäß ]{0,32}", amount(), amount(), sensors).prop_map(|(name, length_m, width_m, sensors)| Robot {
        name,
        footprint: Footprint { length_m, width_m },
        sensors,
    })
}

fn reading() -> impl Strategy<Value = Reading> {
    let echo =
        prop_oneof![(1e-9..=1e5).prop_map(|range_m| Echo::Hit { range_m }), Just(Echo::NoEcho), Just(Echo::Invalid)];
    (any::<u16>(), echo, any::<i32>()).prop_map(|(transducer, echo, offset_ns)| Reading { transducer, echo, offset_ns })
}

fn estimate() -> impl Strategy<Value = PoseEstimate> {
    let covariance =
        (prop::collection::vec(number(), 25), prop::array::uniform5(amount())).prop_map(|(all, variances)| {
            let any = JointCovariance::from_row_slice(&all);
            let mut covariance = any.map(|value| 0.25 * value) + any.map(|value| 0.25 * value).transpose();
            covariance.set_diagonal(&nalgebra::SVector::from(variances));
            covariance
        });
    let scales = (-0.99..0.99f64, -0.99..0.99f64).prop_map(|(lin, ang)| Scales { lin, ang });
    let errors = (number(), number(), amount(), amount()).prop_map(|(e_lin_m, e_ang_rad, eps_lin_m2, eps_ang_rad2)| {
        OdometryErrors { e_lin_m, e_ang_rad, eps_lin_m2, eps_ang_rad2 }
    });
    let flags = any::<(bool, bool)>();
    (pose(), (covariance, scales), (amount(), amount()), errors, any::<(u32, u32)>(), 0.0..=1.0, amount(), flags)
        .prop_map(
            |(
                pose,
                (covariance, scales),
                (travel_m, turn_rad),
                errors,
                (fixes, refused),
                trust,
                distance_m,
                (degraded, hold),
            )| PoseEstimate {
                estimate: Estimate { pose, covariance, scales, travel_m, turn_rad, errors, fixes, refused },
                trust,
                distance_m,
                degraded,
                hold,
            },
        )
}

fn fix() -> impl Strategy<Value = LocalizationFix> {
    let known = prop::sample::select(vec![(true, true), (true, false), (false, true)]);
    let fix = (pose(), 0.0..1e3, 0.0..1e3, known).prop_map(|(pose, position_m, heading_rad, (position, heading))| {
        Fix { position_known: position, heading_known: heading, ..Fix::about(pose, position_m, heading_rad) }
    });
    (any::<u64>(), prop::option::of(fix)).prop_map(|(request, fix)| LocalizationFix { request, fix })
}

fn request() -> impl Strategy<Value = LocalizationRequest> {
    let reason = prop::sample::select(vec![Reason::Degraded, Reason::Schedule]);
    (any::<u64>(), estimate(), reason).prop_map(|(id, estimate, reason)| LocalizationRequest { id, estimate, reason })
}

fn tile() -> impl Strategy<Value = TileUpdate> {
    // Doubt is never negative.
    let cell = prop_oneof![Just(f32::NAN), 0.0_f32..50.0];
    let cells = prop::collection::vec(cell, TILE_CELLS).prop_map(|cells| Box::new(cells.try_into().unwrap()));
    let layer = prop_oneof![Just(Layer::Map), any::<u16>().prop_map(Layer::Sonar), Just(Layer::Doubt)];
    (layer, -(1 << 24)..=1 << 24, -(1 << 24)..=1 << 24, any::<u64>(), 1e-3..1e3, cells).prop_map(
        |(layer, x, y, revision, resolution_m, log_odds)| TileUpdate {
            layer,
            index: TileIndex { x, y },
            revision,
            resolution_m,
            log_odds,
        },
    )
}

fn info() -> impl Strategy<Value = MapInfo> {
    let bounds =
        any::<[i32; 4]>().prop_map(|[i, j, i_high, j_high]| (CellIndex { i, j }, CellIndex { i: i_high, j: j_high }));
    let counts = any::<[u64; Verdict::COUNT]>().prop_map(|counts| {
        let mut verdicts = VerdictCounts::default();
        Verdict::ALL.into_iter().zip(counts).for_each(|(verdict, count)| verdicts.add_many(verdict, count));
        verdicts
    });
    let cells = prop::option::of((1_u64.., bounds));
    let sonars = prop::collection::vec(any::<[u32; Verdict::COUNT]>(), 0..=MAX_SENSORS).prop_map(|sonars| {
        let counts = |counts: [u32; Verdict::COUNT]| {
            let mut verdicts = VerdictCounts::default();
            Verdict::ALL.into_iter().zip(counts).for_each(|(verdict, count)| verdicts.add_many(verdict, count.into()));
            verdicts
        };
        sonars.into_iter().map(counts).collect::<Vec<_>>()
    });
    let flags = (any::<([bool; 3], (u32, u32))>(), sonars);
    (any::<[u64; 6]>(), cells, amount(), number(), amount(), counts, flags).prop_map(
        |(
            [revision, scans, occupied, free, remapped, remap_left],
            cells,
            entropy_bits,
            trust,
            distance_m,
            verdicts,
            ((flags, (fixes, fixes_refused)), sonars),
        )| {
            MapInfo {
                revision,
                scans,
                cells_known: cells.map_or(0, |(known, _)| known),
                cells_occupied: occupied,
                cells_free: free,
                entropy_bits,
                trust,
                distance_m,
                bounds: cells.map(|(_, bounds)| bounds),
                verdicts,
                remapped,
                remap_left,
                finished: flags[0],
                degraded: flags[1],
                held: flags[2],
                fixes,
                fixes_refused,
                sonars,
            }
        },
    )
}

fn health() -> impl Strategy<Value = Health> {
    use ServiceState::{Draining, Failed, Finished, Running, Starting};
    let state = prop::sample::select(vec![Starting, Running, Draining, Finished, Failed]);
    let ack = (prop::sample::select(Topic::ALL.to_vec()), any::<u64>(), any::<u64>());
    let ack = ack.prop_map(|(topic, epoch, sequence)| Ack { topic, epoch, sequence });
    let acks = prop::collection::vec(ack, 0..=MAX_ACKS);
    ("[a-z0-9-]{1,20}", any::<u32>(), state, any::<[u64; 5]>(), acks, "[ -~äß]{0,256}").prop_map(
        |(service, pid, state, [progress, total, stamp_ns, faults, lost], acks, last_error)| Health {
            service,
            pid,
            state,
            progress,
            total,
            stamp_ns,
            faults,
            lost,
            acks,
            last_error,
        },
    )
}

/// Sent and received; a message that was refused has failed the test.
fn sent<W, M>(message: &M) -> M
where
    W: for<'a> From<&'a M>,
    M: for<'a> TryFrom<&'a W>,
    for<'a> <M as TryFrom<&'a W>>::Error: Debug,
{
    M::try_from(&W::from(message)).unwrap()
}

proptest! {
    #[test]
    fn what_is_sent_arrives(
        robot in robot(), pose in pose(), v_mps in number(), w_radps in number(), readings in reading(),
        estimate in estimate(), info in info(), health in health(), transducer: u16, verdict in 0..Verdict::COUNT,
        request in request(), fix in fix(), truth in prop::option::of(pose()),
    ) {
        let truth = TruePose { map_from_base: truth };
        let (low, high) = (pose.x.min(0.0), pose.x.max(0.0));
        let world = TrueWorld { name: robot.name.clone(), bounds_m: [[low, -1.0], [high, 2.0]] };
        let raw = RawOdometry { odom_from_base: pose, v_mps, w_radps };
        let verdict = (transducer, Verdict::ALL[verdict]);
        prop_assert_eq!(sent::<RobotWire, _>(&robot), robot);
        prop_assert_eq!(sent::<OdometryRawWire, _>(&raw), raw);
        prop_assert_eq!(sent::<ReadingWire, _>(&readings), readings);
        prop_assert_eq!(sent::<EstimateWire, _>(&estimate), estimate);
        prop_assert_eq!(sent::<MapInfoWire, _>(&info), info);
        prop_assert_eq!(sent::<HealthWire, _>(&health), health);
        prop_assert_eq!(sent::<VerdictWire, _>(&verdict), verdict);
        prop_assert_eq!(sent::<TruePoseWire, _>(&truth), truth);
        prop_assert_eq!(sent::<TrueWorldWire, _>(&world), world);
        prop_assert_eq!(sent::<LocalizationRequestWire, _>(&request), request);
        prop_assert_eq!(sent::<FixWire, _>(&fix), fix);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Unknown stays unknown, and every known cell keeps its bits.
    #[test]
    fn a_tile_arrives(tile in tile()) {
        let arrived = sent::<TileWire, _>(&tile);
        prop_assert_eq!((arrived.index, arrived.revision, arrived.resolution_m), (tile.index, tile.revision, tile.resolution_m));
        prop_assert!(arrived.log_odds.iter().zip(tile.log_odds.iter()).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

// ---- any bytes are survived ----------------------------------------------------------------------------------------

/// A wire type of these bytes, as shared memory would hold it; too few are taken again.
fn wire_of<W: Wire>(bytes: &[u8]) -> W {
    let mut wire = W::default();
    for (i, byte) in bytes.iter().cycle().take(size_of::<W>()).enumerate() {
        // SAFETY: in bounds; wire types are `repr(C)` of numbers and arrays of them, which any bits are.
        unsafe { (&raw mut wire).cast::<u8>().add(i).write(*byte) };
    }
    wire
}

/// Whatever arrives is taken or refused; and what is taken goes out as something that is taken, too.
fn survives<W, M>(bytes: &[u8])
where
    W: Wire + for<'a> From<&'a M>,
    M: for<'a> TryFrom<&'a W>,
    for<'a> <M as TryFrom<&'a W>>::Error: Debug,
{
    if let Ok(message) = M::try_from(&wire_of::<W>(bytes)) {
        sent::<W, M>(&message);
    }
}

proptest! {
    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(prop_oneof![Just(0_u8), Just(1), any::<u8>()], 1..700)) {
        survives::<RobotWire, Robot>(&bytes);
        survives::<OdometryRawWire, RawOdometry>(&bytes);
        survives::<ReadingWire, Reading>(&bytes);
        survives::<EstimateWire, PoseEstimate>(&bytes);
        survives::<TileWire, TileUpdate>(&bytes);
        survives::<MapInfoWire, MapInfo>(&bytes);
        survives::<VerdictWire, (u16, Verdict)>(&bytes);
        survives::<HealthWire, Health>(&bytes);
        survives::<TruePoseWire, TruePose>(&bytes);
        survives::<TrueWorldWire, TrueWorld>(&bytes);
        survives::<LocalizationRequestWire, LocalizationRequest>(&bytes);
        survives::<FixWire, LocalizationFix>(&bytes);
    }
}

// ---- what breaks its contract is refused ---------------------------------------------------------------------------

fn good_robot() -> RobotWire {
    let sensor = Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: 0.5,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    (&Robot { name: "r".into(), footprint: Footprint::default(), sensors: vec![sensor] }).into()
}

fn good_tile() -> TileWire {
    TileWire { resolution_m: 0.05, ..TileWire::default() }
}

fn good_health() -> HealthWire {
    HealthWire { state: 1, ack_count: 1, ..HealthWire::default() }
}

/// A good message with one wrong value is refused, and the fault names that field.
fn refused<W, M>(good: W, field: &str, spoil: impl FnOnce(&mut W))
where
    W: Wire,
    M: Debug + for<'a> TryFrom<&'a W, Error = Fault>,
{
    let mut wire = good;
    spoil(&mut wire);
    let fault = M::try_from(&wire).unwrap_err();
    assert_eq!(fault.field, field, "{fault}");
    assert!(fault.to_string().starts_with(&format!("{field} = ")) && !fault.expected.is_empty(), "{fault}");
}

#[test]
fn robots_that_cannot_be() {
    let check = |field, spoil: fn(&mut RobotWire)| refused::<_, Robot>(good_robot(), field, spoil);
    assert!(Robot::try_from(&good_robot()).is_ok());
    check("sensor_count", |w| w.sensor_count = 257);
    check("sensor_count", |w| w.sensor_count = u32::MAX);
    check("kind", |w| w.sensors[0].kind = 7);
    check("kind", |w| w.sensors[0].kind = 0);
    check("x_m", |w| w.sensors[0].x_m = f64::NAN);
    check("y_m", |w| w.sensors[0].y_m = -3.1e7);
    check("theta_rad", |w| w.sensors[0].theta_rad = f64::INFINITY);
    check("first_bearing_rad", |w| w.sensors[0].first_bearing_rad = f64::NAN);
    check("bearing_step_rad", |w| w.sensors[0].bearing_step_rad = f64::NEG_INFINITY);
    check("aperture_rad", |w| w.sensors[0].aperture_rad = 0.0);
    check("aperture_rad", |w| w.sensors[0].aperture_rad = 6.3);
    check("aperture_rad", |w| w.sensors[0].aperture_rad = f64::NAN);
    check("range_max_m", |w| w.sensors[0].range_max_m = 0.1);
    check("range_max_m", |w| w.sensors[0].range_max_m = 1e6);
    check("range_max_m", |w| w.sensors[0].range_max_m = f64::NAN);
    check("range_max_m", |w| w.sensors[0].range_min_m = -0.1);
    check("range_error_ratio", |w| w.sensors[0].range_error_ratio = -0.01);
    check("footprint_length_m", |w| w.footprint_length_m = f64::NAN);
    check("footprint_width_m", |w| w.footprint_width_m = -1.0);
}

#[test]
fn odometry_that_cannot_be() {
    let check =
        |field, spoil: fn(&mut OdometryRawWire)| refused::<_, RawOdometry>(OdometryRawWire::default(), field, spoil);
    assert!(RawOdometry::try_from(&OdometryRawWire::default()).is_ok());
    check("x_m", |w| w.x_m = f64::NAN);
    check("x_m", |w| w.x_m = 3e7 + 1.0);
    check("y_m", |w| w.y_m = f64::NEG_INFINITY);
    check("theta_rad", |w| w.theta_rad = f64::NAN);
    check("theta_rad", |w| w.theta_rad = 1e7);
    check("v_mps", |w| w.v_mps = f64::NAN);
    check("w_radps", |w| w.w_radps = f64::INFINITY);
}

#[test]
fn localizations_that_cannot_be() {
    let good = LocalizationFix { request: 1, fix: Some(Fix::about(Pose2::new(1.0, 2.0, 0.5), 0.1, 0.02)) };
    let check = |field, spoil: fn(&mut FixWire)| refused::<_, LocalizationFix>((&good).into(), field, spoil);
    check("x_m", |w| w.x_m = 1e7);
    check("theta_rad", |w| w.theta_rad = f64::NAN);
    check("covariance", |w| w.covariance[0] = -1.0);
    check("covariance", |w| w.covariance[1] = 0.005);
    check("covariance", |w| w.covariance[8] = f64::NAN);
    // Without anything known the rest says nothing.
    let nothing = FixWire { request: 3, x_m: f64::NAN, ..FixWire::default() };
    assert_eq!(LocalizationFix::try_from(&nothing).unwrap(), LocalizationFix { request: 3, fix: None });
    refused::<_, LocalizationRequest>(LocalizationRequestWire::default(), "reason", |_| {});
    let asked = LocalizationRequestWire { reason: 1, ..LocalizationRequestWire::default() };
    refused::<_, LocalizationRequest>(asked, "trust", |w| w.estimate.trust = 2.0);
    let truth = TruePoseWire { known: 1, ..TruePoseWire::default() };
    refused::<_, TruePose>(truth, "y_m", |w| w.y_m = f64::INFINITY);
    refused::<_, TrueWorld>(TrueWorldWire::default(), "bounds_m", |w| w.bounds_m[1] = f64::NAN);
    refused::<_, TrueWorld>(TrueWorldWire::default(), "bounds_m", |w| w.bounds_m[0] = 1.0);
}

#[test]
fn estimates_that_cannot_be() {
    let check = |field, spoil: fn(&mut EstimateWire)| refused::<_, PoseEstimate>(EstimateWire::default(), field, spoil);
    assert!(PoseEstimate::try_from(&EstimateWire::default()).is_ok());
    check("x_m", |w| w.x_m = f64::NAN);
    check("y_m", |w| w.y_m = 2e6);
    check("theta_rad", |w| w.theta_rad = f64::NAN);
    check("covariance", |w| w.covariance[8] = f64::INFINITY);
    check("covariance", |w| w.covariance[0] = -1e-9);
    check("covariance", |w| w.covariance[14] = -1.0);
    check("lin_scale", |w| w.lin_scale = 1.0);
    check("ang_scale", |w| w.ang_scale = f64::NAN);
    check("travel_m", |w| w.travel_m = -1.0);
    check("turn_rad", |w| w.turn_rad = f64::NAN);
    check("e_lin_m", |w| w.e_lin_m = f64::NAN);
    check("e_ang_rad", |w| w.e_ang_rad = f64::INFINITY);
    check("eps_lin_m2", |w| w.eps_lin_m2 = -1e-9);
    check("eps_ang_rad2", |w| w.eps_ang_rad2 = f64::NAN);
    check("trust", |w| w.trust = 1.5);
    check("trust", |w| w.trust = f64::NAN);
    check("distance_m", |w| w.distance_m = -1.0);
}

#[test]
fn tiles_that_cannot_be() {
    let check = |field, spoil: fn(&mut TileWire)| refused::<_, TileUpdate>(good_tile(), field, spoil);
    assert!(TileUpdate::try_from(&good_tile()).is_ok());
    check("layer", |w| w.layer = 3);
    check("log_odds", |w| (w.layer, w.log_odds[5]) = (2, -0.1));
    check("resolution_m", |w| w.resolution_m = 0.0);
    check("resolution_m", |w| w.resolution_m = f64::NAN);
    check("resolution_m", |w| w.resolution_m = 1e300);
    check("tile_x", |w| w.tile_x = (1 << 24) + 1);
    check("tile_y", |w| w.tile_y = i32::MIN);
    check("log_odds", |w| w.log_odds[TILE_CELLS - 1] = f32::NEG_INFINITY);
}

#[test]
fn numbers_of_a_map_that_cannot_be() {
    let check = |field, spoil: fn(&mut MapInfoWire)| refused::<_, MapInfo>(MapInfoWire::default(), field, spoil);
    assert!(MapInfo::try_from(&MapInfoWire::default()).is_ok());
    check("sonar_count", |w| w.sonar_count = 257);
    check("entropy_bits", |w| w.entropy_bits = -1.0);
    check("trust", |w| w.trust = f64::NAN);
    check("distance_m", |w| w.distance_m = f64::INFINITY);
}

#[test]
fn verdicts_and_health_that_cannot_be() {
    refused::<_, (u16, Verdict)>(VerdictWire::default(), "verdict", |w| w.verdict = Verdict::COUNT as u8);
    let check = |field, spoil: fn(&mut HealthWire)| refused::<_, Health>(good_health(), field, spoil);
    check("acks.topic", |_| {});
    check("acks.topic", |w| w.acks[0].topic = 99);
    check("state", |w| w.state = 0);
    check("state", |w| w.state = 7);
    check("ack_count", |w| w.ack_count = 9);
    assert!(Health::try_from(&HealthWire { ack_count: 0, ..good_health() }).is_ok());
}

#[test]
fn a_reading_that_cannot_be_is_an_invalid_one() {
    let check = |echo: u8, range_m: f64, expected: Echo| {
        let reading = Reading::from(&ReadingWire { echo, range_m, transducer: 3, offset_ns: -1, reserved: 0 });
        assert_eq!(reading, Reading { transducer: 3, echo: expected, offset_ns: -1 });
    };
    check(0, 1e5, Echo::Hit { range_m: 1e5 });
    for range_m in [0.0, -1.0, 1.1e5, f64::NAN, f64::INFINITY] {
        check(0, range_m, Echo::Invalid);
    }
    check(1, f64::NAN, Echo::NoEcho);
    check(2, 1.0, Echo::Invalid);
    check(3, 1.0, Echo::Invalid);
}
