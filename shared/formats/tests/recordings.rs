//! Recordings: bags and MCAP files, packed in every way, cut and damaged, and what is chosen of them.

#![allow(clippy::unwrap_used, clippy::panic)]

mod recorder;

use std::path::{Path, PathBuf};

use echogrid_core::{Echo, Pose2, SensorKind};
use echogrid_formats::log::{self, FaultKind, LogEvent, LogSurvey, SurveyOptions};
use recorder::{Content, Encoding, File, Packing, Recorded, yaw};

const START_NS: u64 = 1_300_000_000_000_000_000;
const TENTH_NS: u64 = 100_000_000;
const FILES: [File; 9] = [
    File::Bag(Packing::None),
    File::Bag(Packing::Bzip2),
    File::Bag(Packing::Lz4),
    File::Mcap(Packing::None, Encoding::Cdr),
    File::Mcap(Packing::None, Encoding::Ros1),
    File::Mcap(Packing::Lz4, Encoding::Cdr),
    File::Mcap(Packing::Lz4, Encoding::Ros1),
    File::Mcap(Packing::Zstandard, Encoding::Cdr),
    File::Mcap(Packing::Zstandard, Encoding::Ros1),
];

fn scan(topic: &'static str, connection: u32, frame: &'static str, tenth: u64) -> Recorded {
    let stamp_ns = START_NS + tenth * TENTH_NS;
    let ranges = vec![2.0, f32::INFINITY, f32::NAN, 0.01, 30.0, 1.5 + tenth as f32 * 0.01];
    let content = Content::Scan { stamp_ns, frame, first: -0.5, step: 0.2, beam_s: 1e-3, min: 0.05, max: 30.0, ranges };
    Recorded { topic, connection, log_ns: stamp_ns + 7, content }
}

fn odometry(topic: &'static str, connection: u32, tenth: u64) -> Recorded {
    let stamp_ns = START_NS + tenth * TENTH_NS;
    let pose = [0.05 * tenth as f64, 0.0, 0.1];
    let content = Content::Odometry { stamp_ns, frame: "odom", child: "base_link", pose, v: 0.5, w: 0.0 };
    Recorded { topic, connection, log_ns: stamp_ns + 5, content }
}

fn transform(connection: u32, tenth: u64, edges: &[(&'static str, &'static str, [f64; 3], [f64; 4])]) -> Recorded {
    let stamp_ns = START_NS + tenth * TENTH_NS;
    let edges = edges.iter().map(|(parent, child, t, r)| (stamp_ns, *parent, *child, *t, *r));
    Recorded { topic: "/tf", connection, log_ns: stamp_ns, content: Content::Transforms(edges.collect()) }
}

/// A drive with all there may be: odometry, a lidar ahead of the base, the answer of a localization, and things of no use.
fn drive() -> Vec<Recorded> {
    let mut all = Vec::new();
    for tenth in 0..30 {
        all.push(transform(0, tenth, &[("/base_link", "/laser", [0.135, 0.0, 0.2], yaw(0.0))]));
        all.push(transform(1, tenth, &[("map", "odom", [7.0, 8.0, 0.0], yaw(0.0))]));
        all.push(odometry("/odom", 2, tenth));
        all.push(scan("/scan", 3, "laser", tenth));
        all.push(Recorded { topic: "/rosout", connection: 4, log_ns: 1, content: Content::Text("nothing of use") });
    }
    all
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("recording");
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn read(path: &Path, options: &SurveyOptions) -> (LogSurvey, Vec<LogEvent>) {
    let survey = log::survey_with(path, options.clone()).unwrap_or_else(|error| panic!("{error}"));
    let events: Vec<_> = log::open(path, &survey).unwrap().collect::<Result<_, _>>().unwrap();
    let (mut odometry, mut scans, mut truth) = (0, 0, 0);
    for event in &events {
        match event {
            LogEvent::Odometry { .. } => odometry += 1,
            LogEvent::Scan { .. } => scans += 1,
            LogEvent::TruePose { .. } => truth += 1,
        }
    }
    assert_eq!((odometry, scans, truth), (survey.odometry_count, survey.scan_count, survey.true_pose_count));
    assert!(events.windows(2).all(|pair| pair[0].stamp_ns() <= pair[1].stamp_ns()));
    (survey, events)
}

fn read_messages(messages: &[Recorded], options: &SurveyOptions) -> (LogSurvey, Vec<LogEvent>) {
    let folder = Folder::new();
    read(&folder.write(&File::Bag(Packing::None).write(messages, 7)), options)
}

fn refused(messages: &[Recorded], options: &SurveyOptions) -> String {
    let folder = Folder::new();
    let path = folder.write(&File::Mcap(Packing::None, Encoding::Cdr).write(messages, 7));
    log::survey_with(&path, options.clone()).unwrap_err().to_string()
}

fn named(topics: &[&str]) -> SurveyOptions {
    SurveyOptions { topics: topics.iter().map(|topic| (*topic).to_owned()).collect(), ..SurveyOptions::default() }
}

fn truth(from: &str) -> SurveyOptions {
    SurveyOptions { truth: Some(from.to_owned()), ..SurveyOptions::default() }
}

fn poses(events: &[LogEvent]) -> Vec<Pose2> {
    let pose = |event: &LogEvent| match event {
        LogEvent::Odometry { odom_from_base, .. } => Some(*odom_from_base),
        _ => None,
    };
    events.iter().filter_map(pose).collect()
}

#[test]
fn every_kind_of_file_gives_the_same_events() {
    let folder = Folder::new();
    let mut first = None;
    for file in FILES {
        for per_chunk in [1, 7, 1000] {
            let (survey, events) = read(&folder.write(&file.write(&drive(), per_chunk)), &SurveyOptions::default());
            assert_eq!(survey.faults, [], "{file:?}");
            assert_eq!((survey.odometry_count, survey.scan_count), (30, 30));
            assert_eq!(&events, first.get_or_insert_with(|| events.clone()), "{file:?} {per_chunk}");
        }
    }
}

#[test]
fn a_lidar_is_as_its_messages_and_frames_say() {
    let (survey, events) = read_messages(&drive(), &SurveyOptions::default());
    let [lidar] = survey.robot.sensors.as_slice() else { panic!("{:?}", survey.robot) };
    assert_eq!((lidar.kind, lidar.transducers), (SensorKind::Lidar, 6));
    assert!((lidar.base_from_sensor.x - 0.135).abs() < 1e-12 && lidar.base_from_sensor.theta == 0.0);
    assert!((lidar.range_max_m - 30.0).abs() < 1e-6 && (lidar.range_min_m - 0.05).abs() < 1e-6);
    assert!((lidar.first_bearing_rad + 0.5).abs() < 1e-6 && (lidar.bearing_step_rad - 0.2).abs() < 1e-6);
    let LogEvent::Scan { readings, stamp_ns } = &events[1] else { panic!("{:?}", events[1]) };
    assert_eq!(*stamp_ns, START_NS);
    let echoes: Vec<Echo> = readings.iter().map(|reading| reading.echo).collect();
    // Infinity and the maximum: nothing came back. No number, and nearer than the minimum: no reading.
    let hit = |range: f32| Echo::Hit { range_m: f64::from(range) };
    assert_eq!(echoes, [hit(2.0), Echo::NoEcho, Echo::Invalid, Echo::Invalid, Echo::NoEcho, hit(1.5)]);
    assert_eq!(readings[5].offset_ns, 5_000_000, "beams follow each other");
    assert!(poses(&events).iter().all(|pose| pose.x < 2.0), "what a localization said moves no odometry");
    assert_eq!(survey.skipped.get("/rosout (std_msgs/String)"), Some(&30));
}

#[test]
fn odometry_may_be_in_tf_alone() {
    let mut messages: Vec<_> = drive().into_iter().filter(|message| message.topic != "/odom").collect();
    for tenth in 0..30 {
        let at = [0.05 * tenth as f64, 0.0, 0.0];
        let edge =
            [("/odom", "/base_footprint", at, yaw(0.1)), ("base_footprint", "base_link", [0.1, 0.0, 0.1], yaw(0.0))];
        messages.push(transform(9, tenth, &edge));
        // Two tell the same.
        messages.push(transform(10, tenth, &edge));
    }
    messages.sort_by_key(|message| message.log_ns);
    let (survey, events) = read_messages(&messages, &SurveyOptions::default());
    assert_eq!(survey.odometry_count, 30);
    assert!((survey.robot.sensors[0].base_from_sensor.x - 0.235).abs() < 1e-12, "{:?}", survey.robot.sensors);
    assert!((poses(&events)[29].x - 1.45).abs() < 1e-12);
    let (with_truth, events) = read_messages(&messages, &truth("tf"));
    assert!(with_truth.true_pose_count > 28, "{}", with_truth.true_pose_count);
    let last = events.iter().rev().find_map(|event| match event {
        LogEvent::TruePose { map_from_base, .. } => Some(*map_from_base),
        _ => None,
    });
    assert!(last.unwrap().distance_m(Pose2::new(8.45, 8.0, 0.1)) < 1e-9);
}

#[test]
fn a_laser_that_hangs_upside_down_is_mirrored() {
    let mut messages: Vec<_> = drive().into_iter().filter(|message| message.connection != 0).collect();
    let over = [1.0, 0.0, 0.0, 0.0];
    messages.insert(0, transform(0, 0, &[("base_link", "laser", [0.0, 0.0, 1.0], over)]));
    let (survey, _) = read_messages(&messages, &SurveyOptions::default());
    let lidar = &survey.robot.sensors[0];
    assert!((lidar.first_bearing_rad - 0.5).abs() < 1e-6 && (lidar.bearing_step_rad + 0.2).abs() < 1e-6);
    assert!(survey.remarks.iter().any(|remark| remark.contains("upside down")), "{:?}", survey.remarks);
}

#[test]
fn a_laser_that_looks_at_the_floor_is_refused() {
    let mut messages: Vec<_> = drive().into_iter().filter(|message| message.connection != 0).collect();
    let half = core::f64::consts::FRAC_1_SQRT_2;
    messages.insert(0, transform(0, 0, &[("base_link", "laser", [0.0, 0.0, 1.0], [0.0, half, 0.0, half])]));
    assert!(refused(&messages, &SurveyOptions::default()).contains("looks along the floor: /scan"));
}

#[test]
fn a_ring_of_sonars_is_one_sensor_each() {
    let frames = ["sonar_0", "sonar_1", "sonar_2"];
    let mut messages = Vec::new();
    for tenth in 0..20 {
        messages.push(odometry("/odom", 0, tenth));
        let stamp_ns = START_NS + tenth * TENTH_NS;
        for (index, frame) in frames.into_iter().enumerate() {
            let range = if index == 2 { f32::INFINITY } else { 1.0 + index as f32 };
            let content = Content::Range { stamp_ns, frame, fov: 0.5, min: 0.1, max: 5.0, range };
            // Two on one topic, the third on its own.
            let topic = if index < 2 { "/sonar" } else { "/sonar_behind" };
            messages.push(Recorded { topic, connection: 1 + index as u32 / 2, log_ns: stamp_ns, content });
        }
        let edges = [0.0, 1.0, 3.0].map(|theta| ([0.1, theta / 10.0, 0.2], yaw(theta)));
        let edges: Vec<_> =
            frames.iter().zip(edges).map(|(frame, (at, turn))| ("base_link", *frame, at, turn)).collect();
        messages.push(transform(5, tenth, &edges));
    }
    let (survey, events) = read_messages(&messages, &SurveyOptions::default());
    assert_eq!((survey.robot.sensors.len(), survey.scan_count), (3, 60));
    assert!(survey.clock.is_clean(), "{:?}", survey.clock);
    let headings: Vec<f64> = survey.robot.sensors.iter().map(|sensor| sensor.base_from_sensor.theta).collect();
    assert!(headings.iter().zip([0.0, 1.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{headings:?}");
    assert!(survey.robot.sensors.iter().all(|sensor| sensor.kind == SensorKind::Sonar && sensor.range_max_m == 5.0));
    let silent = events
        .iter()
        .filter(|event| matches!(event, LogEvent::Scan { readings, .. } if readings[0].echo == Echo::NoEcho));
    assert_eq!(silent.count(), 20);
}

#[test]
fn what_is_used_is_named_where_there_is_a_choice() {
    let mut messages = drive();
    for tenth in 0..30 {
        messages.push(scan("/scan_rear", 11, "laser", tenth));
        messages.push(odometry("/base_pose_ground_truth", 12, tenth));
    }
    let told = refused(&messages, &SurveyOptions::default());
    assert!(told.contains("2 topics of nav_msgs/Odometry") && told.contains("--topic"), "{told}");
    assert!(
        told.contains("/scan_rear") && told.contains("sensor_msgs/LaserScan") && told.contains("10.0 Hz"),
        "{told}"
    );
    assert!(refused(&messages, &named(&["/odom"])).contains("2 topics of sensor_msgs/LaserScan"));
    assert!(refused(&messages, &named(&["/odon"])).contains("did you mean /odom?"));
    assert!(refused(&messages, &named(&["/rosout"])).contains("/rosout is of std_msgs/String"));
    assert!(refused(&messages, &truth("/nowhere")).contains("no topic /nowhere"));
    let (survey, _) = read_messages(&messages, &named(&["odom", "/scan"]));
    assert_eq!((survey.scan_count, survey.robot.sensors.len()), (30, 1));
    let (survey, _) = read_messages(&messages, &named(&["/odom", "/scan", "/scan_rear"]));
    assert_eq!(survey.scan_count, 60);
    // Who says the truth is no odometry.
    let options = SurveyOptions {
        topics: vec!["/scan".into()],
        truth: Some("/base_pose_ground_truth".into()),
        ..SurveyOptions::default()
    };
    assert_eq!(read_messages(&messages, &options).0.true_pose_count, 30);
}

#[test]
fn truth_may_be_a_topic_of_poses() {
    let mut messages = drive();
    for tenth in 0..30 {
        let stamp_ns = START_NS + tenth * TENTH_NS;
        let content = Content::Pose { stamp_ns, pose: [1.0, 2.0, 0.5] };
        messages.push(Recorded { topic: "/pose", connection: 8, log_ns: stamp_ns, content });
    }
    assert_eq!(read_messages(&messages, &SurveyOptions::default()).0.true_pose_count, 0);
    assert_eq!(read_messages(&messages, &truth("/pose")).0.true_pose_count, 30);
    assert!(refused(&messages, &truth("/scan")).contains("can't say where the robot was"));
}

#[test]
fn topics_of_two_clocks_count_when_they_were_recorded() {
    let mut messages = drive();
    for message in &mut messages {
        if let Content::Scan { stamp_ns, .. } = &mut message.content {
            *stamp_ns -= 3_600_000_000_000;
        }
    }
    let (survey, events) = read_messages(&messages, &SurveyOptions::default());
    assert!(survey.remarks.iter().any(|remark| remark.contains("3600.0 s behind")), "{:?}", survey.remarks);
    assert!(events.iter().all(|event| event.stamp_ns() >= START_NS));
    for message in &mut messages {
        if let Content::Scan { stamp_ns, .. } = &mut message.content {
            *stamp_ns = 0;
        }
    }
    let (survey, _) = read_messages(&messages, &SurveyOptions::default());
    assert!(survey.remarks.iter().any(|remark| remark.contains("have no stamps")), "{:?}", survey.remarks);
}

/// A recording that is cut gives what stands before the cut, and says so.
#[test]
fn cut_anywhere_it_is_used_up_to_there() {
    let folder = Folder::new();
    for file in FILES {
        let whole = file.write(&drive(), 10);
        let mut most = 0;
        for length in 0..whole.len() {
            // Every byte of the beginning and the end, and some between.
            if length > 200 && length + 200 < whole.len() && length % 331 != 0 {
                continue;
            }
            let path = folder.write(&whole[..length]);
            let Ok(survey) = log::survey(&path) else { continue };
            let events = log::open(&path, &survey).unwrap().count() as u64;
            assert_eq!(events, survey.odometry_count + survey.scan_count, "{file:?} cut at {length}");
            let is_told = |kind| survey.faults.iter().any(|fault| fault.kind == kind);
            assert!(
                is_told(FaultKind::RecordingCut) || is_told(FaultKind::RecordingUnclosed),
                "{file:?} cut at {length} of {}: {:?}",
                whole.len(),
                survey.faults
            );
            assert!(events >= most, "a longer part holds no less");
            most = events;
        }
        assert_eq!(most, 60, "{file:?}");
    }
}

#[test]
fn a_damaged_chunk_is_counted_and_the_others_are_used() {
    let folder = Folder::new();
    for file in FILES {
        let mut bytes = file.write(&drive(), 10);
        let middle = bytes.len() / 2;
        bytes[middle..middle + 40].fill(0xa5);
        let path = folder.write(&bytes);
        let survey = log::survey(&path).unwrap_or_else(|error| panic!("{file:?}: {error}"));
        assert!(!survey.faults.is_empty(), "{file:?}");
        let events = log::open(&path, &survey).unwrap().count() as u64;
        assert_eq!(events, survey.odometry_count + survey.scan_count, "{file:?}");
        assert!(events >= 40, "{file:?}: {events}: {:?}", survey.faults);
    }
}

#[test]
fn a_packed_bag_is_read_and_one_that_shrinks_is_an_error() {
    let folder = Folder::new();
    let bytes = File::Bag(Packing::None).write(&drive(), 10);
    let path = folder.write(&bytes);
    let survey = log::survey(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    let last = log::open(&path, &survey).unwrap().last().unwrap();
    assert!(last.unwrap_err().to_string().contains("when it was surveyed"));
    let packed = ruzstd::encoding::compress_to_vec(bytes.as_slice(), ruzstd::encoding::CompressionLevel::Fastest);
    assert_eq!(log::survey(&folder.write(&packed)).unwrap().scan_count, 30);
}

#[test]
fn contents_are_told_even_of_what_makes_no_map() {
    let folder = Folder::new();
    let messages = vec![Recorded { topic: "/chat", connection: 0, log_ns: 5, content: Content::Text("hello") }];
    let path = folder.write(&File::Mcap(Packing::Zstandard, Encoding::Cdr).write(&messages, 1));
    let contents = log::contents(&path).unwrap().unwrap();
    assert_eq!((contents.messages, contents.topics[0].datatype.as_str()), (1, "std_msgs/String"));
    assert!(log::survey(&path).unwrap_err().to_string().contains("no odometry in it"));
    let nothing = log::survey(&folder.write(b"#ROSBAG V2.0\n")).unwrap_err().to_string();
    assert!(nothing.contains("it holds no message; 1 times something of it could not be read"), "{nothing}");
}

/// Encrypted, or packed as nobody knows: not a recording without messages, but one that can't be read, and why.
#[test]
fn chunks_of_an_unknown_packing_are_named() {
    let folder = Folder::new();
    for (file, known, unknown) in [
        (File::Mcap(Packing::Lz4, Encoding::Cdr), &b"\x03\0\0\0lz4"[..], &b"\x03\0\0\0aes"[..]),
        (File::Bag(Packing::Lz4), &b"compression=lz4"[..], &b"compression=aes"[..]),
    ] {
        let mut bytes = file.write(&drive(), 50);
        let places: Vec<usize> = (0..bytes.len() - known.len()).filter(|at| bytes[*at..].starts_with(known)).collect();
        assert!(places.len() >= 3, "{file:?}: {places:?}");
        let hide = |bytes: &mut Vec<u8>, at: usize| bytes[at..at + known.len()].copy_from_slice(unknown);
        hide(&mut bytes, places[1]);
        let survey = log::survey(&folder.write(&bytes)).unwrap();
        assert!(survey.faults.iter().any(|fault| fault.kind == FaultKind::ChunkDamaged), "{:?}", survey.faults);
        places.iter().for_each(|at| hide(&mut bytes, *at));
        let told = log::survey(&folder.write(&bytes)).unwrap_err().to_string();
        let (message, why) = ("it holds no message; 3 times something of it could not be read", "packed ");
        assert!(told.contains(message) && told.contains(why), "{file:?}: {told}");
    }
}

#[test]
fn odd_scans_are_used_as_far_as_they_can_be() {
    let count = |change: fn(&mut f32, &mut f32, &mut f32, &mut Vec<f32>)| {
        let mut messages = drive();
        for message in &mut messages {
            if let Content::Scan { min, max, step, ranges, .. } = &mut message.content {
                change(min, max, step, ranges);
            }
        }
        let folder = Folder::new();
        let path = folder.write(&File::Bag(Packing::None).write(&messages, 7));
        let survey = log::survey(&path).map_err(|error| error.to_string())?;
        let events = log::open(&path, &survey).unwrap().map(Result::unwrap);
        let hits = |event: LogEvent| match event {
            LogEvent::Scan { readings, .. } => readings.iter().filter(|r| matches!(r.echo, Echo::Hit { .. })).count(),
            _ => 0,
        };
        Ok::<usize, String>(events.map(hits).sum())
    };
    // Two of six beams of each scan hit something.
    assert_eq!(count(|_, _, _, _| {}), Ok(60));
    // Who states no range states no limit: what lay beyond the maximum counts, too.
    assert_eq!(count(|_, max, _, _| *max = 0.0), Ok(90));
    assert_eq!(count(|_, max, _, _| *max = f32::NAN), Ok(90));
    assert_eq!(count(|_, max, _, _| *max = f32::INFINITY), Ok(90));
    // A minimum that can't be makes no reading of what is as good as nothing.
    assert_eq!(count(|min, _, _, _| *min = -1.0), Ok(60));
    assert_eq!(count(|_, _, _, ranges| ranges.fill(f32::NAN)), Ok(0));
    assert!(count(|_, _, step, _| *step = 0.0).unwrap_err().contains("bearings from -0.5 by 0"));
    assert!(count(|_, _, _, ranges| ranges.clear()).unwrap_err().contains("0 ranges"));
}
