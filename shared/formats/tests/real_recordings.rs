//! Recordings of real robots, as they are, cut, and written again by the tools of others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use std::path::{Path, PathBuf};
use std::process::Command;

use echogrid_formats::log::{self, FaultKind, LogEvent, SurveyOptions};

fn data() -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join("rosbag");
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: rosbag is not there");
    None
}

fn events(path: &Path) -> Vec<LogEvent> {
    let survey = log::survey(path).unwrap_or_else(|error| panic!("{error}"));
    log::open(path, &survey).unwrap().map(Result::unwrap).collect()
}

#[test]
fn a_pioneer_and_a_turtlebot() {
    let Some(data) = data() else { return };
    let pioneer = log::survey(&data.join("trace0.bag")).unwrap();
    assert_eq!((pioneer.odometry_count, pioneer.scan_count, pioneer.faults.len()), (958, 958, 0));
    assert!((pioneer.robot.sensors[0].base_from_sensor.x - 0.135).abs() < 1e-9);
    assert_eq!(pioneer.robot.sensors[0].transducers, 726);
    assert!((30.0..34.0).contains(&pioneer.distance_m), "{}", pioneer.distance_m);
    assert_eq!(pioneer.remarks, [""; 0]);
    let turtlebot = log::survey(&data.join("test_turtlebot.bag")).unwrap();
    assert_eq!((turtlebot.odometry_count, turtlebot.scan_count, turtlebot.true_pose_count), (1376, 819, 0));
    let mount = turtlebot.robot.sensors[0].base_from_sensor;
    assert!((mount.x + 0.087).abs() < 1e-3 && (mount.y - 0.0125).abs() < 1e-3, "{mount:?}");
    let options = SurveyOptions { truth: Some("tf".into()), ..SurveyOptions::default() };
    assert!(log::survey_with(&data.join("trace0.bag"), options).unwrap().true_pose_count > 900);
}

/// Each length to which a recording is cut: with `ECHOGRID_CUTS=1000` at each 1,000th byte; a few are enough to notice.
fn end_with_a_counted_loss(file: &Path) {
    let step = std::env::var("ECHOGRID_CUTS").ok().and_then(|step| step.parse().ok()).unwrap_or(250_007);
    let folder = tempfile::tempdir().unwrap();
    let (name, cut) = (file.display(), folder.path().join("cut"));
    let whole = std::fs::read(file).unwrap();
    let (mut used, mut cuts) = (0, 0);
    for length in (1..whole.len()).step_by(step) {
        cuts += 1;
        std::fs::write(&cut, &whole[..length]).unwrap();
        let Ok(survey) = log::survey(&cut) else { continue };
        assert!(survey.faults.iter().any(|fault| fault.kind == FaultKind::RecordingCut), "{name} at {length}");
        let events = log::open(&cut, &survey).unwrap().map(Result::unwrap).count() as u64;
        assert_eq!(events, survey.odometry_count + survey.scan_count, "{name} at {length}");
        used += 1;
    }
    println!("{name}: {used} of {cuts} cuts were of use");
    assert!(used * 2 > cuts, "{name}: {used} of {cuts} cuts were of use");
}

#[test]
fn cut_anywhere_they_end_with_a_counted_loss() {
    let Some(data) = data() else { return };
    for name in ["trace0.bag", "test_turtlebot.bag"] {
        end_with_a_counted_loss(&data.join(name));
    }
}

/// What Python's `rosbags` and `mcap` make of a bag gives the same events, and so the same map. `ECHOGRID_PYTHON` names a Python that has
/// them.
#[test]
fn written_again_by_others_they_give_the_same() {
    let Some(data) = data() else { return };
    let python = std::env::var("ECHOGRID_PYTHON").unwrap_or_else(|_| "python3".into());
    let knows = Command::new(&python).args(["-c", "import rosbags, mcap"]).output();
    if !knows.is_ok_and(|output| output.status.success()) {
        println!("skipped: no Python with rosbags and mcap");
        return;
    }
    for name in ["trace0.bag", "test_turtlebot.bag"] {
        let folder = tempfile::tempdir().unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/convert_recordings.py");
        let made = Command::new(&python).arg(script).arg(data.join(name)).arg(folder.path()).status().unwrap();
        assert!(made.success());
        let expected = events(&data.join(name));
        let mut count = 0;
        for entry in std::fs::read_dir(folder.path()).unwrap() {
            let path = entry.unwrap().path();
            let found = events(&path);
            let differs = expected.iter().zip(&found).position(|(a, b)| a != b);
            assert!(
                found.len() == expected.len() && differs.is_none(),
                "{}: from event {differs:?} on",
                path.display()
            );
            if path.extension().is_some_and(|extension| extension == "mcap") {
                end_with_a_counted_loss(&path);
            }
            count += 1;
        }
        assert!(count >= 9, "{count} ways");
    }
}
