//! Reference paths and landmarks of real robots, read where they lie: `$ECHOGRID_DATA`, or `../shared/data` beside the workspace.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use echogrid_core::landmarks::{Localization, TriangulationError, triangulate};
use echogrid_core::{Pose2, Sighting};
use echogrid_formats::localization::{Landmarks, ReferencePath, Sightings};
use echogrid_formats::log::{self, LogEvent};

const SECOND: u64 = 1_000_000_000;

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("skipped: {name} is not there");
        None
    }
}

/// The reference has a pose for every scan, to the nanosecond; and the raw pose it was corrected from, its columns 5 to 7, is the
/// one of the log's odometry: the corrected pose is of what the log calls the robot.
fn matches_its_log(name: &str, scans: usize) {
    let (Some(raw), Some(reference_file)) =
        (data(&format!("carmen/{name}-raw.log.gz")), data(&format!("carmen/{name}-reference.txt")))
    else {
        return;
    };
    let reference = ReferencePath::read(&reference_file).unwrap();
    assert_eq!((reference.poses().len(), reference.moved()), (scans, 0));
    let text = std::fs::read_to_string(&reference_file).unwrap();
    let mut raw_poses = text.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let words: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        Pose2::new(words[4], words[5], words[6])
    });
    let survey = log::survey(&raw).unwrap();
    assert!(survey.clock.is_clean(), "{:?}", survey.clock);
    let (mut odometry, mut compared, mut far_m) = (Vec::new(), 0, 0.0_f64);
    for event in log::open(&raw, &survey).unwrap() {
        match event.unwrap() {
            LogEvent::Odometry { stamp_ns, odom_from_base, .. } => odometry.push((stamp_ns, odom_from_base)),
            LogEvent::Scan { stamp_ns, .. } => {
                assert!(reference.at(stamp_ns, 0).is_some(), "{stamp_ns}");
                let at_scan = raw_poses.next().unwrap();
                if let Some((_, before)) = odometry.last() {
                    far_m = far_m.max(before.distance_m(at_scan));
                    compared += 1;
                }
            }
            LogEvent::TruePose { .. } => {}
        }
    }
    assert!(raw_poses.next().is_none());
    println!("{name}: {compared} scans, odometry at most {far_m} m from the raw pose of the reference");
    // Odometry comes every 0.1 s or so; the robot does not go farther in that time.
    assert!(compared > scans / 2 && far_m < 0.3, "{far_m}");
    // Between scans of a robot that drives, but not from one end of a long halt to the other.
    let (first_ns, last_ns) = (reference.poses()[0].0, reference.poses()[scans - 1].0);
    assert!(reference.at(first_ns - 1, u64::MAX).is_none() && reference.at(last_ns + 1, u64::MAX).is_none());
    assert!(reference.at(first_ns + 1, 10 * SECOND).is_some());
}

#[test]
fn aces_matches_its_reference() {
    matches_its_log("aces", 440);
}

#[test]
fn freiburg_matches_its_reference() {
    matches_its_log("freiburg-101", 292);
}

#[test]
fn stamps_that_do_not_change_are_refused() {
    let Some(path) = data("carmen/belgioioso-reference.txt") else { return };
    let error = ReferencePath::read(&path).unwrap_err().to_string();
    assert!(error.contains("belgioioso-reference.txt: line 3: the stamp of line 2 again"), "{error}");
}

/// The columns of a table, without comments.
fn table(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.lines().filter(|line| !line.starts_with('#'));
    rows.map(|row| row.split_whitespace().map(str::to_owned).collect()).filter(|row: &Vec<_>| !row.is_empty()).collect()
}

/// Fifteen landmarks, five robots, an arena of about 15 m by 8 m: what a camera measured of several landmarks at one moment gives
/// poses that follow each other as those of a slow robot do.
#[test]
fn a_real_robot_is_found_among_its_landmarks() {
    let Some(folder) = data("utias/MRCLAM9") else { return };
    let barcodes = table(&folder.join("Barcodes.dat"));
    let mut toml = String::new();
    for row in table(&folder.join("Landmark_Groundtruth.dat")) {
        let barcode = barcodes.iter().find(|barcode| barcode[0] == row[0]).unwrap();
        writeln!(toml, "[[landmark]]\nname = \"{}\"\nat = [{}, {}]", barcode[1], row[1], row[2]).unwrap();
    }
    let landmarks = Landmarks::parse(&toml).unwrap();
    assert_eq!(landmarks.all().len(), 15);
    let mut text = String::new();
    let mut last = Vec::new();
    for row in table(&folder.join("Robot1_Measurement.dat")) {
        // Other robots are no landmarks; some rows are there twice.
        if landmarks.index_of(&row[1]).is_some() && row[..2] != last[..] {
            writeln!(text, "{}", row.join(" ")).unwrap();
        }
        last = row[..2].to_vec();
    }
    let sightings = Sightings::parse(&text, &landmarks).unwrap();
    let mut stamps: Vec<u64> = sightings.all().iter().map(|sighting| sighting.stamp_ns).collect();
    stamps.dedup();
    let mut fixes: Vec<(u64, Localization)> = Vec::new();
    let (mut few, mut open, mut inconsistent) = (0, 0, 0);
    for stamp_ns in stamps {
        let seen: Vec<Sighting> =
            sightings.near(stamp_ns, 0).iter().map(|sighting| sighting.measured(0.15, 0.05)).collect();
        let guess = fixes.last().map_or(Pose2::IDENTITY, |(_, fix)| fix.pose);
        match triangulate(&seen, guess) {
            Ok(fix) => fixes.push((stamp_ns, fix)),
            Err(TriangulationError::TooFew { .. }) => few += 1,
            Err(TriangulationError::Inconsistent { .. }) => inconsistent += 1,
            Err(_) => open += 1,
        }
    }
    let variance_m2 = |fix: &Localization| fix.covariance[(0, 0)] + fix.covariance[(1, 1)];
    let (mut soon, mut near) = (0, 0);
    for pair in fixes.windows(2).filter(|pair| pair[1].0 - pair[0].0 < SECOND) {
        let [before, after] = [pair[0].1, pair[1].1];
        soon += 1;
        // It drives at 0.3 m/s at most.
        let away_m = before.pose.distance_m(after.pose) - 0.3;
        near += usize::from(away_m < 3.0 * (variance_m2(&before) + variance_m2(&after)).sqrt());
    }
    println!(
        "{} fixes, {few} too few, {open} open, {inconsistent} inconsistent; {near} of {soon} near the one before",
        fixes.len()
    );
    assert!(fixes.len() > 500 && soon > 500 && near as f64 > 0.98 * soon as f64);
}
