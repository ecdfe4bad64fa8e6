use core::f64::consts::PI;
use std::fmt::Write as _;

use echogrid_core::Reading;
use proptest::prelude::*;

use super::*;

const MAX: &str = "PARAM echogrid_sonar_max 5 host 0\n";

/// Two sonars and odometry, ten times a second.
fn drive(seconds: u32) -> String {
    (0..seconds * 10).fold(String::new(), |mut text, tenth| {
        let (x, stamp) = (0.02 * f64::from(tenth), 100.0 + 0.1 * f64::from(tenth));
        let _ = writeln!(text, "ODOM {x} 0 0 0.2 0 0 {stamp:.1} host 0");
        let _ = writeln!(text, "SONAR 0.5 2 1.5 {:.2} 0.2 0 0 0.2 0 1.57 {stamp:.1} host 0", 4.0 - x);
        text
    })
}

/// All events of a text, and what the stream was at its end.
fn events(text: &str, robot: Option<Robot>) -> Result<(Vec<LogEvent>, LineStream), LogError> {
    let mut stream = LineStream::new("sensor", RangeUnit::Metres, robot);
    let mut lines = PrintedLines::new(text.as_bytes()).unwrap();
    let mut events = Vec::new();
    while let Some(line) = lines.next_line().unwrap() {
        stream.push(line)?;
        events.extend(std::iter::from_fn(|| stream.pop()));
    }
    stream.finish()?;
    events.extend(std::iter::from_fn(|| stream.pop()));
    Ok((events, stream))
}

fn scans<'a>(events: &'a [LogEvent]) -> Vec<&'a Vec<Reading>> {
    let scan = |event: &'a LogEvent| if let LogEvent::Scan { readings, .. } = event { Some(readings) } else { None };
    events.iter().filter_map(scan).collect()
}

#[test]
fn a_stream_gives_what_the_same_lines_give_as_a_log() {
    let text = format!("{MAX}{}", drive(30));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log");
    std::fs::write(&path, &text).unwrap();
    let survey = crate::log::survey(&path).unwrap();
    let logged: Vec<LogEvent> = crate::log::open(&path, &survey).unwrap().map(Result::unwrap).collect();
    let (streamed, stream) = events(&text, None).unwrap();
    assert_eq!(streamed, logged);
    assert_eq!(stream.robot(), Some(&survey.robot));
    assert_eq!(stream.faults(), []);
}

#[test]
fn events_come_before_the_end() {
    let mut stream = LineStream::new("sensor", RangeUnit::Metres, None);
    let text = format!("{MAX}{}", drive(3));
    for (number, line) in (1..).zip(text.lines()) {
        stream.push(PrintedLine { number, bytes: Some(line.into()), arrived_ns: None }).unwrap();
    }
    assert!(stream.robot().is_some());
    assert_eq!(std::iter::from_fn(|| stream.pop()).count(), 60);
}

#[test]
fn what_is_wrong_is_said_with_name_line_and_value() {
    let said = |text: &str| events(text, None).unwrap_err().to_string();
    let no_maximum =
        "sensor: nothing says how far the sensor of SONAR can see; print \"PARAM echogrid_sonar_max METRES\" first";
    assert!(said(&drive(3)).starts_with(no_maximum), "{}", said(&drive(3)));
    assert!(said("ODOM 1 2 x 0 0 0 1 h 1\n").contains("sensor: no range readings"), "{}", said("ODOM 1"));
    assert!(said("ODOM 1 2 x 0 0 0 1 h 1\n").contains("line 1: \"x\""));
    let (_, mut stream) = events(&format!("{MAX}{}Hello\nODOM nan 0 0 0 0 0 1 h 1\n", drive(3)), None).unwrap();
    let said: Vec<String> = stream.new_faults().iter().map(ToString::to_string).collect();
    assert_eq!(said, ["pose or velocity not finite (1 times, first in line 63: \"nan\")"]);
    assert_eq!(stream.new_faults(), [], "each kind is said once");
}

#[test]
fn a_sensor_that_comes_late_is_counted_and_not_used() {
    let late = "FLASER 3 1 2 3 0 0 0 0 0 0 104 h 0\n";
    let (given, stream) = events(&format!("{MAX}{}{late}", drive(3)), None).unwrap();
    assert_eq!(scans(&given).len(), 30);
    assert_eq!(
        stream.faults()[0].to_string(),
        format!("{} (1 times, first in line 62: \"FLASER\")", FaultKind::SensorCameLate)
    );
}

#[test]
fn a_named_robot_says_how_far_its_sensors_see() {
    let (_, stream) = events(&format!("{MAX}{}", drive(3)), None).unwrap();
    let mut robot = stream.robot().unwrap().clone();
    robot.sensors.iter_mut().for_each(|sensor| sensor.range_max_m = 3.6);
    let (given, stream) = events(&drive(3), Some(robot.clone())).unwrap();
    assert_eq!(stream.robot(), Some(&robot));
    let echoes: Vec<Echo> = scans(&given).iter().map(|readings| readings[1].echo).collect();
    assert!(echoes[..20].iter().all(|echo| *echo == Echo::NoEcho), "{echoes:?}");
    assert!(echoes[21..].iter().all(|echo| matches!(echo, Echo::Hit { .. })), "{echoes:?}");
}

#[test]
fn stamps_of_what_is_measured_now_are_times_of_arrival() {
    let mut stream = LineStream::new("sensor", RangeUnit::Metres, None);
    // The first lines were held up on their way; the clock of the sensor began at 100 s.
    let text = format!("{MAX}{}", drive(3));
    for (number, line) in (0_u64..).zip(text.lines()) {
        let held_up_ns = if number < 8 { 300_000_000 } else { 7 };
        let arrived_ns = Some(5_000_000_000 + number.saturating_sub(1) / 2 * 100_000_000 + held_up_ns);
        stream.push(PrintedLine { number: number + 1, bytes: Some(line.into()), arrived_ns }).unwrap();
    }
    let stamps: Vec<u64> = std::iter::from_fn(|| stream.pop()).map(|event| event.stamp_ns()).collect();
    assert_eq!(stamps[..3], [5_000_000_007, 5_000_000_007, 5_100_000_007]);
    assert_eq!(stamps.last(), Some(&7_900_000_007));
    // A program without a clock: each line as it comes.
    let mut stream = LineStream::new("sensor", RangeUnit::Metres, None);
    for (number, line) in (1..).zip([MAX, "ODOM 0 0 0 0 0 0 0 h 0", "SONAR 0.5 1 1 0 0 0 0 h 0"]) {
        stream.push(PrintedLine { number, bytes: Some(line.trim().into()), arrived_ns: Some(number * 7) }).unwrap();
    }
    stream.finish().unwrap();
    assert_eq!(std::iter::from_fn(|| stream.pop()).map(|event| event.stamp_ns()).collect::<Vec<_>>(), [14, 21]);
}

proptest! {
    #[test]
    fn whatever_is_printed_no_reading_is_of_a_transducer_that_is_not_there(
        lines in prop::collection::vec(prop_oneof![
            Just("ODOM 0 0 0 0 0 0 1 h 0".to_owned()),
            Just("PARAM echogrid_sonar_max 5 h 0".to_owned()),
            Just("PARAM robot_front_laser_max 50 h 0".to_owned()),
            (1..5_usize, 0..400_u32).prop_map(|(n, t)| format!("FLASER {n} {} 0 0 0 0 0 0 {t} h 0", "1 ".repeat(n))),
            (1..4_usize).prop_map(|n| format!("SONAR 0.5 {n} {} {} 3 h 0", "1 ".repeat(n), "0 0 1 ".repeat(n))),
            "[A-Z0-9 .\\-]{0,40}",
        ], 0..60)
    ) {
        if let Ok((given, stream)) = events(&lines.join("\n"), None) {
            let robot = stream.robot().unwrap();
            for readings in scans(&given) {
                let all_known = readings.iter().all(|reading| robot.transducer(reading.transducer).is_some());
                prop_assert!(all_known);
                let is_sane = |echo| !matches!(echo, Echo::Hit { range_m } if !(0.0..=1e5).contains(&range_m));
                let all_sane = readings.iter().all(|reading| is_sane(reading.echo));
                prop_assert!(all_sane);
            }
            prop_assert!(robot.sensors.iter().all(|sensor| sensor.aperture_rad.abs() <= 2.0 * PI));
        }
    }
}

/// Where another says what is heard, the robot is known before the first line.
#[test]
fn lines_of_odometry_alone_are_enough_where_the_robot_is_told() {
    let (_, whole) = events(&format!("{MAX}{}", drive(3)), None).unwrap();
    let mut stream = LineStream::of_odometry("base", whole.robot().unwrap().clone());
    stream
        .push(PrintedLine { number: 1, bytes: Some(b"ODOM 1 2 0 0.2 0 0 5.5 host 0".into()), arrived_ns: None })
        .unwrap();
    assert!(matches!(stream.pop(), Some(LogEvent::Odometry { stamp_ns: 5_500_000_000, .. })));
    stream
        .push(PrintedLine { number: 2, bytes: Some(b"SONAR 0.5 1 1.5 0.2 0 0 5.6 host 0".into()), arrived_ns: None })
        .unwrap();
    assert_eq!(stream.pop(), None);
    stream.finish().unwrap();
    assert_eq!(stream.robot(), whole.robot());
}
