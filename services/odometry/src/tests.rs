use echogrid_core::localization::Ask;

use super::*;

const TENTH: u64 = 100_000_000;

fn service(localization: &LocalizationConfig) -> OdometryService {
    OdometryService::new(&OdometryConfig::default(), 0.05, localization, true).unwrap()
}

fn every_metre() -> LocalizationConfig {
    LocalizationConfig { ask: Ask::Schedule, every_m: 1.0, ..LocalizationConfig::default() }
}

fn give(service: &mut OdometryService, stamp_ns: u64, message: Message) -> Vec<Message> {
    let mut out = Outbox::default();
    service.step(Input::Message { sequence: 1, stamp_ns, message }, &mut out).unwrap();
    std::iter::from_fn(|| out.pop().map(|(_, message)| message)).collect()
}

fn drive(service: &mut OdometryService, index: u64) -> Vec<Message> {
    let odom_from_base = Pose2::new(0.1 * index as f64, 0.0, 0.0);
    give(service, index * TENTH, Message::Odometry(RawOdometry { odom_from_base, v_mps: 1.0, w_radps: 0.0 }))
}

fn answer(request: u64, fix: Option<Fix>) -> Message {
    Message::Fix(LocalizationFix { request, fix })
}

#[test]
fn waits_for_what_it_asked_for_and_goes_on_from_there() {
    let mut service = service(&every_metre());
    let requests = (0..=10).flat_map(|index| drive(&mut service, index)).filter_map(|message| match message {
        Message::Request(request) => Some(request.id),
        _ => None,
    });
    assert_eq!(requests.collect::<Vec<_>>(), [1]);
    assert!(!service.is_ready_for(Topic::OdometryRaw) && service.is_ready_for(Topic::LocalizationFix));
    // An answer to somebody else changes nothing.
    assert!(give(&mut service, 10 * TENTH, answer(7, Some(Fix::certain(Pose2::IDENTITY)))).is_empty());
    let fixed = give(&mut service, 10 * TENTH, answer(1, Some(Fix::certain(Pose2::new(0.9, 0.2, 0.0)))));
    let [Message::Estimate(fixed)] = fixed.as_slice() else { panic!("{fixed:?}") };
    assert_eq!((fixed.estimate.pose, fixed.trust, fixed.estimate.fixes), (Pose2::new(0.9, 0.2, 0.0), 1.0, 1));
    assert!(service.is_ready_for(Topic::OdometryRaw));
    // A jump is no way.
    assert!((fixed.distance_m - 1.0).abs() < 1e-9);
}

#[test]
fn without_a_fix_it_asks_again_later() {
    let mut service = service(&every_metre());
    (0..=10).for_each(|index| drop(drive(&mut service, index)));
    assert!(give(&mut service, 10 * TENTH, answer(1, None)).is_empty());
    for index in 11..20 {
        assert_eq!(drive(&mut service, index).len(), 1, "{index}");
    }
    assert!(matches!(drive(&mut service, 20).as_slice(), [Message::Estimate(_), Message::Request(_)]));
}

#[test]
fn a_fix_that_can_not_be_is_refused_and_asked_for_again() {
    let mut service = service(&every_metre());
    (0..=10).for_each(|index| drop(drive(&mut service, index)));
    let fix = |x: f64, y: f64| Some(Fix::about(Pose2::new(x, y, 0.0), 0.01, 0.01));
    assert_eq!(give(&mut service, 10 * TENTH, answer(1, fix(1.0, 0.0))).len(), 1);
    (11..=20).for_each(|index| drop(drive(&mut service, index)));
    // Elsewhere: nothing is told, and it is asked again, once a second.
    assert!(give(&mut service, 20 * TENTH, answer(2, fix(2.0, 3.0))).is_empty());
    let next = drive(&mut service, 21);
    let [Message::Estimate(next)] = next.as_slice() else { panic!("{next:?}") };
    assert_eq!((next.estimate.fixes, next.estimate.refused), (1, 1));
    assert!(next.estimate.pose.y.abs() < 0.01);
    (22..=30).for_each(|index| drop(drive(&mut service, index)));
    assert!(give(&mut service, 30 * TENTH, answer(3, fix(3.0, 3.0))).is_empty());
    (31..=40).for_each(|index| drop(drive(&mut service, index)));
    let found = give(&mut service, 40 * TENTH, answer(4, fix(4.0, 3.0)));
    let [Message::Estimate(found)] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!((found.estimate.pose.y, found.estimate.fixes, found.estimate.refused), (3.0, 2, 2));
}

#[test]
fn a_late_answer_changes_the_way_since() {
    let live = LocalizationConfig { wait: Choice::Never, ..every_metre() };
    let mut service = service(&live);
    (0..=10).for_each(|index| drop(drive(&mut service, index)));
    assert!(service.is_ready_for(Topic::OdometryRaw));
    (11..=14).for_each(|index| assert_eq!(drive(&mut service, index).len(), 1));
    let now = give(&mut service, 10 * TENTH, answer(1, Some(Fix::certain(Pose2::new(1.0, 0.5, 0.0)))));
    let [Message::Estimate(now)] = now.as_slice() else { panic!("{now:?}") };
    assert!(now.estimate.pose.distance_m(Pose2::new(1.4, 0.5, 0.0)) < 1e-9);
    assert!((now.estimate.travel_m - 0.4).abs() < 1e-9);
}

#[test]
fn degraded_holds_where_somebody_can_mend_it() {
    let held = |has_localizer, hold| {
        let config = LocalizationConfig { hold, ask: Ask::Never, ..LocalizationConfig::default() };
        let mut service = OdometryService::new(&OdometryConfig::default(), 0.05, &config, has_localizer).unwrap();
        (0..400).for_each(|index| drop(drive(&mut service, index)));
        let [Message::Estimate(last)] = &drive(&mut service, 400)[..] else { panic!() };
        (last.degraded, last.hold)
    };
    assert_eq!(held(true, Choice::Auto), (true, true));
    assert_eq!(held(false, Choice::Auto), (true, false));
    assert_eq!(held(false, Choice::Always), (true, true));
    assert_eq!(held(true, Choice::Never), (true, false));
}

#[test]
fn the_user_knows_where_the_robot_is() {
    let mut service = service(&LocalizationConfig::default());
    let mut out = Outbox::default();
    let fix = Command::Fix(Fix::certain(Pose2::new(5.0, 0.0, 0.0)));
    assert!(service.command(fix, &mut out).unwrap_err().to_string().contains("no odometry"));
    drive(&mut service, 0);
    assert!(service.command(fix, &mut out).unwrap().contains("5.00 m"));
    assert!(matches!(out.pop(), Some((0, Message::Estimate(told))) if told.estimate.pose.x == 5.0));
    let nowhere = Command::Fix(Fix::certain(Pose2 { x: f64::NAN, ..Pose2::IDENTITY }));
    assert!(service.command(nowhere, &mut out).is_err() && out.is_empty());
    assert!(service.command(Command::Save, &mut out).is_err());
}
