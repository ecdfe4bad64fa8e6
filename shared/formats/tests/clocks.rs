//! Clocks of logs as robots have them: set, frozen, coarse, without stamps. The path must be the file's, and every scan must
//! be at the pose that the file has it at.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::fmt::Write as _;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use echogrid_core::{Echo, Pose2};
use echogrid_formats::log::{self, LogError, LogEvent, LogSurvey, StepKind, carmen};

/// Poses, 0.1 s apart, on a circle of 2 m.
fn pose(tenth: u32) -> Pose2 {
    let angle = f64::from(tenth) * 0.015;
    Pose2::new(2.0 * angle.cos(), 2.0 * angle.sin(), angle)
}

/// A drive of `tenths` poses; every fifth has a scan, whose first range tells which. `stamp`: the text of the stamp of that
/// tenth; `restate`: the pose of the scan, which a line without a stamp says once more.
fn drive(tenths: u32, stamp: impl Fn(u32) -> String, restate: Option<f64>) -> String {
    let mut log = String::new();
    for tenth in 0..tenths {
        let (Pose2 { x, y, theta }, stamp) = (pose(tenth), stamp(tenth));
        writeln!(log, "ODOM {x} {y} {theta} 0.3 0.1 0 {stamp} h 0").unwrap();
        if tenth % 5 == 0 {
            let x = x + restate.unwrap_or(0.0);
            let range = 1.0 + f64::from(tenth) * 0.001;
            writeln!(log, "FLASER 3 {range} 2 3 {x} {y} {theta} {x} {y} {theta} {stamp} h 0").unwrap();
            if restate.is_some() {
                writeln!(log, "ODOM {x} {y} {theta} 0 0 0 0 h 0").unwrap();
            }
        }
    }
    log
}

fn read(text: &str) -> (LogSurvey, Vec<LogEvent>) {
    let path = Path::new("a.log");
    let survey = carmen::survey(text.as_bytes(), path).unwrap();
    let events = carmen::read(Cursor::new(text.to_owned().into_bytes()), path, &survey).unwrap();
    (survey, events.map(Result::unwrap).collect())
}

/// Where the mapper would put each scan: between the poses around its stamp, the last of several at one stamp.
fn scans(events: &[LogEvent]) -> Vec<(u32, Pose2)> {
    let poses: Vec<(u64, Pose2)> = events
        .iter()
        .filter_map(|event| match event {
            LogEvent::Odometry { stamp_ns, odom_from_base, .. } => Some((*stamp_ns, *odom_from_base)),
            _ => None,
        })
        .collect();
    let mut scans = Vec::new();
    for event in events {
        let LogEvent::Scan { stamp_ns, readings } = event else { continue };
        let Echo::Hit { range_m } = readings[0].echo else { panic!("an echo") };
        let after = poses.partition_point(|(pose_ns, _)| pose_ns <= stamp_ns);
        let (before_ns, before) = poses[after - 1];
        let at = match poses.get(after) {
            Some((after_ns, after)) if *stamp_ns > before_ns => {
                before.interpolate(*after, (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64)
            }
            _ => before,
        };
        scans.push((((range_m - 1.0) * 1000.0).round() as u32, at));
    }
    scans
}

/// The drive with these stamps has the path of the file, and each scan is where it was.
fn check(name: &str, tenths: u32, stamp: impl Fn(u32) -> String) -> LogSurvey {
    let (survey, events) = read(&drive(tenths, stamp, None));
    let way_m: f64 = (1..tenths).map(|tenth| pose(tenth - 1).distance_m(pose(tenth))).sum();
    assert!(
        (survey.distance_m - way_m).abs() < 1e-6,
        "{name}: {} m for {way_m}; {:?}",
        survey.distance_m,
        survey.clock
    );
    let scans = scans(&events);
    assert_eq!(scans.len() as u32, tenths.div_ceil(5), "{name}");
    for (tenth, at) in scans {
        assert!(at.distance_m(pose(tenth)) < 1e-6, "{name}: scan of {tenth} at {at:?}; {:?}", survey.clock);
    }
    survey
}

fn seconds(tenth: u32) -> f64 {
    1_700_000_000.0 + f64::from(tenth) / 10.0
}

#[test]
fn a_clock_set_back_or_ahead_keeps_the_path() {
    for (at, by) in
        [(300, -1.5), (300, -8.0), (300, -0.3), (203, -40.0), (300, 4000.0), (300, 1e8), (597, -5.0), (300, -1.6e9)]
    {
        let survey = check(&format!("{by} s at {at}"), 600, |tenth| {
            format!("{:.6}", seconds(tenth) + if tenth >= at { by } else { 0.0 })
        });
        let step = survey.clock.steps.first().unwrap();
        assert!((step.by_s - f64::abs(by)).abs() < 0.2, "{step:?}");
        assert_eq!(survey.clock.invented().is_some(), by != 4000.0, "a pause is no invention");
    }
    let often =
        check("set back every 15 s", 900, |tenth| format!("{:.6}", seconds(tenth) - 1.8 * f64::from(tenth / 150)));
    assert_eq!((often.clock.set_count, often.clock.order_only), (5, false));
    check("back and there again", 600, |tenth| {
        format!("{:.6}", seconds(tenth) - if (200..400).contains(&tenth) { 30.0 } else { 0.0 })
    });
    let booted = check("1970", 72, |tenth| {
        format!("{:.6}", if tenth < 30 { 5.0 + f64::from(tenth) / 10.0 } else { seconds(tenth) })
    });
    assert_eq!(booted.clock.steps.first().unwrap().kind, StepKind::SetAhead);
    assert!(booted.duration().as_secs() < 60);
}

#[test]
fn a_clock_that_stands_still_or_counts_whole_seconds() {
    let frozen =
        check("frozen", 900, |tenth| format!("{:.6}", seconds(if (300..600).contains(&tenth) { 300 } else { tenth })));
    assert!((frozen.duration().as_secs_f64() - 89.9).abs() < 0.2, "{:?}", frozen.duration());
    let lost = check("frozen, and time lost", 900, |tenth| {
        format!("{:.6}", seconds(if tenth < 300 { tenth } else { tenth.saturating_sub(300).max(300) }))
    });
    assert!(lost.clock.stood_still_s > 20.0 && lost.clock.invented().is_some());
    let whole = check("whole seconds", 600, |tenth| format!("{}", seconds(tenth).floor()));
    assert!(whole.clock.spread > 500 && whole.clock.invented().is_none());
    check("one stamp for all", 200, |_| "1700000000.5".to_owned());
}

#[test]
fn lines_without_stamps_stay_beside_their_neighbours() {
    for (name, none) in [("negative", "-1"), ("zero", "0"), ("absurd", "1e300"), ("no number", "nan"), ("words", "n/a")]
    {
        let good = |tenth| format!("{:.6}", seconds(tenth));
        for without in [0..40, 500..560, 540..900, 100..101, 0..1] {
            let survey = check(&format!("{name}, {without:?}"), 900, |tenth| {
                if without.contains(&tenth) { none.to_owned() } else { good(tenth) }
            });
            assert!(!survey.clock.order_only && survey.clock.unstamped > 0, "{name}: {:?}", survey.clock);
        }
        assert!(check(name, 100, |_| none.to_owned()).clock.order_only);
    }
}

/// Stamps that look like stamps, but would have the robot jump to and fro.
#[test]
fn stamps_that_make_detours_do_not_count() {
    // A number between -1 and 1 that looks like noise.
    let noise = |tenth: u32| f64::from((tenth * 7919 + 13) % 1999 * 1009 % 2000) / 1000.0 - 1.0;
    for by in [0.1, 0.15, 0.3, 0.5, 0.8, 1.5] {
        check(&format!("jitter of {by} s"), 900, |tenth| format!("{:.6}", seconds(tenth) + by * noise(tenth)));
    }
    check("a clock that runs backwards", 900, |tenth| format!("{:.6}", seconds(900 - tenth)));
}

/// The drive with other stamps in its `FLASER` lines, by the seconds that they had; without the first, as nothing tells of
/// another clock before the robot moved.
fn with_scans_at(stamp: impl Fn(f64) -> f64) -> String {
    let log = drive(600, |tenth| format!("{:.6}", seconds(tenth)), None);
    let changed = |line: &str| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let at = words.len() - 3;
        words[at] = format!("{:.6}", stamp(words[at].parse().unwrap()));
        words.join(" ") + "\n"
    };
    let log = log.lines().filter(|line| !line.starts_with("FLASER 3 1 "));
    log.map(|line| if line.starts_with('F') { changed(line) } else { line.to_owned() + "\n" }).collect()
}

/// Each scan is where the file has it, to within a pose and a half, and the way is the drive's.
fn check_text(name: &str, log: &str, tenths: u32) -> LogSurvey {
    let (survey, events) = read(log);
    let way_m: f64 = (1..tenths).map(|tenth| pose(tenth - 1).distance_m(pose(tenth))).sum();
    assert!(
        (survey.distance_m - way_m).abs() < 1e-6,
        "{name}: {} m for {way_m}; {:?}",
        survey.distance_m,
        survey.clock
    );
    for (tenth, at) in scans(&events) {
        assert!(at.distance_m(pose(tenth)) < 0.05, "{name}: scan of {tenth} at {at:?}; {:?}", survey.clock);
    }
    survey
}

#[test]
fn scans_of_another_clock_are_where_their_poses_say() {
    assert!(check_text("good", &with_scans_at(|s| s), 600).clock.is_clean());
    for by in [-0.5, -1.0, -1.9, -5.0, -3600.0, 0.5, 1.5, 3.0, 30.0, 1e7] {
        let clock = check_text(&format!("off by {by} s"), &with_scans_at(|s| s + by), 600).clock;
        assert!((clock.displaced_by_s - by).abs() < 0.01 && clock.displaced > 100, "{by}: {clock:?}");
    }
    let first_s = seconds(0);
    check_text("drifting", &with_scans_at(|s| first_s + (s - first_s) * 1.03), 600);
    check_text("standing still", &with_scans_at(|_| first_s + 1.0), 600);
    check_text(
        "standing still now and then",
        &with_scans_at(|s| if (s as u64 / 10).is_multiple_of(2) { s } else { (s / 10.0).floor() * 10.0 }),
        600,
    );
}

#[test]
fn lines_that_were_buffered_by_kind_are_put_in_order() {
    let log = drive(600, |tenth| format!("{:.6}", seconds(tenth)), None);
    let lines: Vec<&str> = log.lines().collect();
    for block in [20, 50, 100] {
        for scans_first in [false, true] {
            let mut buffered = String::new();
            for chunk in lines.chunks(block) {
                let (scans, poses): (Vec<&str>, Vec<&str>) = chunk.iter().partition(|line| line.starts_with('F'));
                let (first, second) = if scans_first { (scans, poses) } else { (poses, scans) };
                first.iter().chain(&second).for_each(|line| buffered += &format!("{line}\n"));
            }
            let clock = check_text(&format!("blocks of {block}, {scans_first}"), &buffered, 600).clock;
            assert_eq!((clock.set_count, clock.order_only), (0, false), "{clock:?}");
        }
    }
}

/// As GMapping writes its corrected logs: after each scan its pose once more, without a stamp.
#[test]
fn a_corrected_log_has_its_scans_at_their_own_poses() {
    let stamp = |tenth| format!("{:.6}", seconds(tenth));
    let all_zero = |_| "0".to_owned();
    for (log, order_only) in [(drive(600, stamp, Some(0.03)), false), (drive(600, all_zero, Some(0.03)), true)] {
        let (survey, events) = read(&log);
        assert_eq!((survey.clock.restated, survey.clock.order_only), (120, order_only));
        let way_m: f64 = (1..600).map(|tenth| pose(tenth - 1).distance_m(pose(tenth))).sum();
        assert!((survey.distance_m - way_m).abs() < 120.0 * 0.065, "{}", survey.distance_m);
        for (tenth, at) in scans(&events) {
            let Pose2 { x, y, .. } = pose(tenth);
            assert!((at.x - x - 0.03).abs() + (at.y - y).abs() < 1e-6, "{tenth}: {at:?}");
        }
    }
}

#[test]
fn odometry_and_scans_one_after_the_other() {
    let log = drive(600, |tenth| format!("{:.6}", seconds(tenth)), None);
    let (scans_of, poses): (Vec<&str>, Vec<&str>) = log.lines().partition(|line| line.starts_with('F'));
    for parts in [[&scans_of, &poses], [&poses, &scans_of]] {
        let (survey, events) = read(&parts.map(|lines| lines.join("\n") + "\n").concat());
        assert!(
            survey.remarks.iter().any(|remark| remark.contains("600 ODOM lines stand apart")),
            "{:?}",
            survey.remarks
        );
        assert_eq!((survey.odometry_count, survey.scan_count), (120, 120));
        assert!(scans(&events).into_iter().all(|(tenth, at)| at.distance_m(pose(tenth)) < 1e-6));
    }
    let sonar = |tenth: u32| format!("SONAR 0.5 1 2.0 0 0 0 {:.6} h 0\n", seconds(tenth));
    let apart = poses.join("\n") + "\n" + &(0..600).map(sonar).collect::<String>();
    let error = carmen::survey(apart.as_bytes(), Path::new("a.log")).unwrap_err().to_string();
    assert!(error.contains("a.log: all odometry stands before, or behind, all readings"), "{error}");
}

#[test]
fn a_log_that_loses_its_end_while_it_is_played_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    let text = drive(5000, |tenth| format!("{:.6}", seconds(tenth)), None);
    std::fs::write(&path, &text).unwrap();
    let survey = log::survey(&path).unwrap();
    let mut events = log::open(&path, &survey).unwrap();
    events.next().unwrap().unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(200_000).unwrap();
    let error = events.find_map(Result::err).unwrap();
    assert!(matches!(error, LogError::Shrunk { left: 200_000, .. }), "{error}");
    assert!(events.next().is_none());
}

/// Logs of the data folder that went wrong: their ways in metres.
#[test]
fn logs_that_went_wrong_have_the_way_of_their_file() {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    for (name, way_m) in [
        ("faults/A0-good.log", 23.6),
        ("faults/A1-clock-back-1s5.log", 15.9),
        ("faults/A2-clock-back-8s.log", 63.3),
        ("faults/A3-clock-slewed-often.log", 23.6),
        ("faults/A4-clock-frozen.log", 23.6),
        ("faults/A5-no-stamp-block.log", 23.6),
        ("faults/A6-whole-seconds.log", 15.9),
        ("faults/A7-zero-stamps-3pct.log", 47.5),
        ("carmen/seattle-corrected.log.gz", 217.4),
        ("carmen/infinite-corridor-corrected.log.gz", 2004.8),
    ] {
        let path = root.join(name);
        if !path.exists() {
            eprintln!("skipped: no {}", path.display());
            continue;
        }
        let survey = log::survey(&path).unwrap();
        assert!((survey.distance_m - way_m).abs() < 0.06, "{name}: {} m", survey.distance_m);
    }
}
