//! The frame of the odometry and that of the map, leaps, poses that are exact, and fixes that contradict.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::PathBuf;

use echogrid_core::noise::standard_normal_pair;
use echogrid_core::{Pose2, wrap_angle};
use serde_json::Value;
use tempfile::TempDir;

use crate::support::{data, echogrid, path, said, summary};

const NO_ERROR: [&str; 8] =
    ["--set", "odometry.k_ll=0", "--set", "odometry.k_lt=0", "--set", "odometry.k_tt=0", "--set", "odometry.k_tl=0"];
/// The room that the drive is in, metres from its middle.
const ROOM: [f64; 2] = [4.0, 3.0];
/// Where its odometry begins, seen from its world: shifted and turned.
const ELSEWHERE: [f64; 3] = [5.0, -7.0, 1.3];
const STEPS: u32 = 900;
/// Seconds from the stamp of the first pose.
const TENTH: f64 = 0.1;
const FIRST: f64 = 1000.0;

/// Where the robot really is: on an ellipse, faster and slower, 0.3 m/s and less.
fn true_pose(step: u32) -> Pose2 {
    let t = 0.015 * f64::from(step);
    let (s, c) = t.sin_cos();
    Pose2::new(2.0 * c, 1.5 * s, (1.5 * c).atan2(-2.0 * s))
}

fn range_m(at: Pose2, bearing: f64) -> f64 {
    let (s, c) = (at.theta + bearing).sin_cos();
    let to = |from: f64, towards: f64, wall: f64| {
        if towards.abs() < 1e-9 { f64::INFINITY } else { (wall * towards.signum() - from) / towards }
    };
    to(at.x, c, ROOM[0]).min(to(at.y, s, ROOM[1]))
}

/// A drive in a room, as a log; and as a reference path of where it really was.
struct Room {
    folder: TempDir,
}

impl Room {
    fn new() -> Self {
        let room = Self { folder: tempfile::tempdir().unwrap() };
        let world = "[[wall]]\nfrom = [-4, -3]\nto = [4, -3]\n[[wall]]\nfrom = [4, -3]\nto = [4, 3]\n\
            [[wall]]\nfrom = [4, 3]\nto = [-4, 3]\n[[wall]]\nfrom = [-4, 3]\nto = [-4, -3]\n";
        std::fs::write(room.at("room.toml"), world).unwrap();
        room.reference("reference.txt", |_, stamp, at| (stamp, at.x, at.y, at.theta));
        room
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A log whose odometry says `odometry` of each step, in order of time.
    fn log(&self, name: &str, odometry: impl Fn(u32) -> Pose2) -> String {
        let mut text = String::new();
        for step in 0..STEPS {
            let (Pose2 { x, y, theta }, truth) = (odometry(step), true_pose(step));
            let stamp = format!("{:.3} host 0", FIRST + TENTH * f64::from(step));
            writeln!(text, "ODOM {x:.6} {y:.6} {theta:.6} 0.3 0.1 0 {stamp}").unwrap();
            let Pose2 { x: true_x, y: true_y, theta: true_theta } = truth;
            writeln!(text, "TRUEPOS {true_x:.6} {true_y:.6} {true_theta:.6} {x:.6} {y:.6} {theta:.6} {stamp}").unwrap();
            if step % 5 == 0 {
                let ranges: Vec<String> = (0..181)
                    .map(|beam| format!("{:.3}", range_m(truth, PI * (f64::from(beam) / 180.0 - 0.5))))
                    .collect();
                let pose = format!("{x:.6} {y:.6} {theta:.6}");
                writeln!(text, "FLASER 181 {} {pose} {pose} {stamp}", ranges.join(" ")).unwrap();
            }
        }
        std::fs::write(self.at(name), text).unwrap();
        path(&self.at(name))
    }

    /// A reference path: `row` of the step, its stamp and where the robot really was.
    fn reference(&self, name: &str, row: impl Fn(u32, f64, Pose2) -> (f64, f64, f64, f64)) -> String {
        let row = |step| {
            let (stamp, x, y, theta) = row(step, FIRST + TENTH * f64::from(step), true_pose(step));
            format!("{stamp:.3} {x:.6} {y:.6} {theta:.6}\n")
        };
        std::fs::write(self.at(name), (0..STEPS).map(row).collect::<String>()).unwrap();
        path(&self.at(name))
    }

    fn map(&self, log: &str, more: &[&str]) -> Value {
        let out = path(&self.at("maps"));
        summary(&echogrid([&["map", log, "--out", &out, "--json", "-q"], more].concat()))
    }

    /// Bits per cell of the last map; `log` knows the truth.
    fn bits(&self, log: &str, more: &[&str]) -> f64 {
        let (map, world) = (path(&self.at("maps/map.echogrid")), path(&self.at("room.toml")));
        let scored = echogrid([&["score", &map, "--world", &world, "--path", log, "--json"], more].concat());
        summary(&scored)["bits"].as_f64().unwrap()
    }
}

/// A drive that drifts a little, in a frame of its own.
fn drifting(step: u32) -> Pose2 {
    let at = true_pose(step);
    let drift = 2e-5 * f64::from(step);
    Pose2::new(at.x * (1.0 + drift), at.y, at.theta + drift)
}

fn elsewhere(pose: Pose2) -> Pose2 {
    Pose2::new(ELSEWHERE[0], ELSEWHERE[1], ELSEWHERE[2]) * pose
}

#[test]
fn odometry_that_starts_elsewhere_maps_as_one_that_starts_right() {
    let room = Room::new();
    let (right, wrong) = (room.log("right.log", drifting), room.log("wrong.log", |step| elsewhere(drifting(step))));
    let reference = path(&room.at("reference.txt"));
    // The first 12 s are not in it.
    let rows = std::fs::read_to_string(&reference).unwrap();
    let late = path(&room.at("late.txt"));
    std::fs::write(&late, rows.lines().skip(120).collect::<Vec<_>>().join("\n")).unwrap();
    for fix in ["truth", &reference, &late] {
        for remap in ["false", "true"] {
            let more = ["--fix", fix, "--fix-every", "2m", "--set", &format!("mapper.remap={remap}")];
            let [at_right, at_wrong] = [&right, &wrong].map(|log| {
                let run = room.map(log, &more);
                assert!(run["contradictions"].is_null() && run["fixes_refused"] == 0, "{run}");
                (room.bits(log, &["--align", "none"]), run)
            });
            assert!((at_right.0 - at_wrong.0).abs() < 0.01, "{fix} {remap}: {at_right:?} {at_wrong:?}");
            assert_eq!(at_right.1["accepted"], at_wrong.1["accepted"], "{fix} {remap}");
            assert!(at_right.1["extent_m"][0].as_f64().unwrap() < 9.0, "{at_right:?}");
        }
    }
}

#[test]
fn a_start_that_is_given_is_where_the_map_begins() {
    let room = Room::new();
    let wrong = room.log("wrong.log", |step| elsewhere(true_pose(step)));
    room.map(&wrong, &[&["--start", "2", "0", "90deg"][..], &NO_ERROR].concat());
    let given = room.bits(&wrong, &["--align", "none"]);
    // Without it the first pose is kept as it stands; scores are aligned all the same.
    room.map(&wrong, &NO_ERROR);
    let [none, start, best] = ["none", "start", "best"].map(|by| room.bits(&wrong, &["--align", by]));
    assert!((start - given).abs() < 0.05 && (best - given).abs() < 0.05, "{given} {start} {best}");
    assert!(none > given + 0.2, "{given} {none}");
    let refused = echogrid(["map", &wrong, "--start", "1", "2"]);
    assert!(!refused.status.success() && said(&refused).contains("3 values required"), "{}", said(&refused));
}

#[test]
fn nothing_is_mapped_while_nobody_tells_where() {
    let room = Room::new();
    let log = room.log("drive.log", true_pose);
    let other = room.reference("other-day.txt", |_, stamp, at| (stamp + 86_400.0, at.x, at.y, at.theta));
    let refused = echogrid(["map", &log, "--out", &path(&room.at("maps")), "-q", "--fix", &other, "--fix-every", "2m"]);
    assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
    assert!(said(&refused).contains("of another time, and no fix would ever come"), "{}", said(&refused));
    // Hardly any of it: said.
    let hardly = room.reference("hardly.txt", |_, stamp, at| (stamp - 81.0, at.x, at.y, at.theta));
    let run = room.map(&log, &["--fix", &hardly, "--fix-every", "2m"]);
    assert!(run["log_faults"].to_string().contains("that is 10 % of it; is it of this drive?"), "{run}");
}

#[test]
fn a_base_that_counts_anew_and_poses_far_away_spoil_no_map() {
    let room = Room::new();
    let anew = |step: u32| if step < 450 { true_pose(step) } else { true_pose(450).inverse() * true_pose(step) };
    let far = |step: u32| {
        let at = true_pose(step);
        if step < 300 { at } else { Pose2 { x: at.x + 5e5, ..at } }
    };
    // Away, and back again.
    let glitch = |step: u32| if step == 300 { Pose2::new(99.0, -30.0, 3.0) } else { true_pose(step) };
    let twice = |step: u32| if step < 700 { anew(step) } else { true_pose(700).inverse() * true_pose(step) };
    for (name, leaps, odometry) in
        [("anew", 1, &anew as &dyn Fn(u32) -> Pose2), ("far", 1, &far), ("glitch", 2, &glitch), ("twice", 2, &twice)]
    {
        let run = room.map(&room.log("leap.log", odometry), &NO_ERROR);
        assert_eq!(run["leaps"]["count"], leaps, "{name}: {run}");
        assert!(run["trust"].as_f64().unwrap() < 1.0, "{name}: no doubt is left: {run}");
        let [width, height] = [0, 1].map(|axis| run["extent_m"][axis].as_f64().unwrap());
        assert!(width < 8.6 && height < 6.6, "{name}: {run}");
    }
    // As soon as 0.5 m from its origin.
    let soon = |step: u32| {
        let origin = if step < 17 { true_pose(0) } else { true_pose(17) };
        origin.inverse() * true_pose(step)
    };
    assert_eq!(room.map(&room.log("soon.log", soon), &NO_ERROR)["leaps"]["count"], 1);
    let whole = room.map(&room.log("good.log", true_pose), &NO_ERROR);
    assert!(whole["leaps"].is_null() && whole["log_faults"].as_array().unwrap().is_empty(), "{whole}");
}

#[test]
fn fixes_of_another_unit_frame_or_drive_are_said_to_contradict() {
    let room = Room::new();
    let log = room.log("drive.log", |step| elsewhere(drifting(step)));
    type Row = fn(u32, f64, Pose2) -> (f64, f64, f64, f64);
    let wrong: [(&str, Row); 5] = [
        ("degrees", |_, t, at| (t, at.x, at.y, at.theta.to_degrees())),
        ("swapped", |_, t, at| (t, at.y, at.x, at.theta)),
        ("mirrored", |_, t, at| (t, at.x, -at.y, at.theta)),
        ("millimetres", |_, t, at| (t, 1e3 * at.x, 1e3 * at.y, at.theta)),
        ("another drive", |step, t, _| (t, 0.01 * f64::from(step), 0.0, 0.0)),
    ];
    for (name, row) in wrong {
        for every in ["2m", "5m", "0.5m"] {
            let reference = room.reference("wrong.txt", row);
            let more = ["--fix", &reference, "--fix-every", every, "--set", "mapper.resolution_m=0.2"];
            let out = path(&room.at("maps"));
            let run = echogrid([&["map", &log, "--out", &out, "--json", "-q"][..], &more].concat());
            let told = summary(&run);
            assert!(told["contradictions"]["count"].as_u64().unwrap() > 0, "{name} {every}: {told}");
            let lines = said(&run).lines().filter(|line| line.contains("contradict each other")).count();
            assert!((1..=3).contains(&lines), "{name} {every}: {}", said(&run));
        }
    }
    // Another frame is none of these, and neither is a drive that nobody calibrated.
    let turned = room.reference("turned.txt", |_, t, at| {
        let at = Pose2::new(100.0, 50.0, 2.0) * at;
        (t, at.x, at.y, at.theta)
    });
    let uncalibrated = room.log("uncalibrated.log", |step| {
        let at = true_pose(step);
        Pose2::new(1.05 * at.x, 1.05 * at.y, at.theta)
    });
    for (log, reference) in [(&log, &turned), (&uncalibrated, &path(&room.at("reference.txt")))] {
        for every in ["2m", "5m", "0.5m"] {
            let run = room.map(log, &["--fix", reference, "--fix-every", every]);
            assert!(run["contradictions"].is_null(), "{every}: {run}");
        }
    }
}

#[test]
fn poses_that_are_corrected_are_taken_for_exact_when_told() {
    let room = Room::new();
    let corrected = room.log("slam.log", |step| {
        let ((x, y), (theta, _)) = (standard_normal_pair(3, step.into(), 0), standard_normal_pair(3, step.into(), 1));
        let at = true_pose(step);
        Pose2::new(at.x + 0.01 * x, at.y + 0.01 * y, wrap_angle(at.theta + 0.01 * theta))
    });
    let suggested = room.map(&corrected, &[]);
    assert!(suggested["log_faults"].to_string().contains("--poses exact"), "{suggested}");
    let told = room.map(&corrected, &["--poses", "exact"]);
    assert_eq!((told["trust"].as_f64(), told["log_faults"].as_array().unwrap().len()), (Some(1.0), 0), "{told}");
}

/// A map across a country: pictures show the main part, and the native map has all of it.
#[test]
fn a_cell_far_away_spoils_no_picture() {
    let room = Room::new();
    let far = room.log("far.log", |step| {
        let at = true_pose(step);
        if step < 600 { at } else { Pose2 { x: at.x + 5e5, ..at } }
    });
    // Exact poses are followed wherever they are.
    let run = room.map(&far, &["--poses", "exact"]);
    assert!(run["restarts"].as_object().unwrap().is_empty() && run["extent_m"][0].as_f64().unwrap() > 4e5, "{run}");
    assert_eq!(run["files"].as_array().unwrap().len(), 5, "{run}");
    let yaml = std::fs::read_to_string(room.at("maps/map.yaml")).unwrap();
    let pixels = std::fs::metadata(room.at("maps/map.pgm")).unwrap().len();
    assert!(yaml.contains("origin: [-4.") && pixels < 100_000, "{pixels} {yaml}");
}

#[test]
fn recordings_that_went_wrong_are_told() {
    let room = Room::new();
    for (log, most_m) in [("faults/E2-odometry-reset.log", 8.6), ("faults/E3-teleport-500km.log", 8.6)] {
        let Some(log) = data(log) else { return };
        let run = room.map(&path(&log), &NO_ERROR);
        assert_eq!(run["leaps"]["count"], 1, "{run}");
        assert!(run["extent_m"][0].as_f64().unwrap() < most_m, "{run}");
    }
    let Some((log, degrees)) = data("faults/E4-drive.log").zip(data("faults/E4-reference-in-degrees.txt")) else {
        return;
    };
    let run = room.map(&path(&log), &["--fix", &path(&degrees), "--fix-every", "2m"]);
    assert!(run["contradictions"]["count"].as_u64().unwrap() > 0, "{run}");
}
