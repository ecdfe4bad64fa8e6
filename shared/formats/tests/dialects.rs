//! Text logs of every dialect, packed in every way: the same drive gives the same events.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::io::Write as _;
use std::path::{Path, PathBuf};

use echogrid_formats::log::{self, LogEvent, LogFormat, LogSurvey};

const POSES: usize = 40;

/// Where the robot is in the row `i`, and what its two beams say; metres.
fn row(i: usize) -> ([f64; 3], [f64; 2], f64) {
    let i = i as f64;
    ([i * 0.25, i * -0.125, i * 0.03125], [2.5 + 0.25 * i, 3.75], 10.0 + 0.5 * i)
}

fn text(line: impl Fn([f64; 3], [f64; 2], f64) -> String) -> String {
    (0..POSES).map(row).map(|(pose, ranges, t)| line(pose, ranges, t)).collect()
}

fn gfs() -> String {
    let line = |[x, y, theta]: [f64; 3], [a, b]: [f64; 2], t| {
        format!("LASER_READING 2 {a} {b} {x} {y} {theta} {t}\nODOM {x} {y} {theta} {t}\nNEFF 30\n")
    };
    format!("PARAM laser 1\n{}", text(line))
}

fn wean() -> String {
    text(|[x, y, theta], [a, b], t| {
        let (x, y, a, b) = (100.0 * x, 100.0 * y, 100.0 * a, 100.0 * b);
        format!("L {x} {y} {theta} {x} {y} {theta} {a} {b} {t}\nO {x} {y} {theta} {t}\n")
    })
}

fn csv() -> String {
    let line = |[x, y, theta]: [f64; 3], [a, b]: [f64; 2], t| format!("{t},{x},{y},{theta},{a},{b}\n");
    format!("t,x,y,theta,r0,r1\n{}", text(line))
}

fn carmen() -> String {
    text(|[x, y, theta], [a, b], t| format!("FLASER 2 {a} {b} {x} {y} {theta} {x} {y} {theta} {t} h {t}\n"))
}

fn read(name: &str, content: &[u8]) -> (LogSurvey, Vec<LogEvent>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    let survey = log::survey(&path).unwrap();
    let events = log::open(&path, &survey).unwrap().map(Result::unwrap).collect();
    (survey, events)
}

#[test]
fn one_drive_in_every_dialect() {
    let (_, expected) = read("a.log", carmen().as_bytes());
    assert_eq!(expected.len(), 2 * POSES);
    for (text, format) in [(gfs(), LogFormat::GmappingLog), (wean(), LogFormat::WeanLog), (csv(), LogFormat::CsvTable)]
    {
        let (survey, events) = read("a.txt", text.as_bytes());
        assert_eq!((survey.format, survey.faults.len()), (format, 0), "{:?}", survey.faults);
        assert_eq!(events, expected, "{format}");
        let (_, marked) = read("a.txt", format!("\u{feff}{text}").replace('\n', "\r\n").as_bytes());
        assert_eq!(marked, expected, "{format} with a byte order mark");
    }
}

#[test]
fn packed_or_not_it_is_the_same_log() {
    let gzip = |text: &[u8]| {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    };
    let bzip2 = |text: &[u8]| {
        let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    };
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    for text in [gfs(), wean(), csv(), carmen()] {
        let (_, expected) = read("a.log", text.as_bytes());
        let packed =
            [gzip(text.as_bytes()), bzip2(text.as_bytes()), ruzstd::encoding::compress_to_vec(text.as_bytes(), level)];
        for packed in packed {
            assert_eq!(read("a.log", &packed).1, expected);
            // Cut: what came before is used, and the loss is counted.
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("cut.log");
            std::fs::write(&path, &packed[..packed.len() - 3]).unwrap();
            match log::survey(&path) {
                Ok(survey) => assert!(!survey.faults.is_empty()),
                Err(error) => assert!(error.to_string().contains("cut.log"), "{error}"),
            }
        }
    }
}

/// A scan of Wean Hall belongs to the pose beside it, not to where the robot is at its stamp.
#[test]
fn wean_hall() {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    for (name, scans, metres) in [("robotdata1.log", 713, 41.2), ("robotdata3.log", 1241, 42.6)] {
        let path = root.join("wean").join(name);
        if !path.exists() {
            println!("skipped: {name} is not there");
            return;
        }
        let survey = log::survey(&path).unwrap();
        assert_eq!((survey.scan_count, survey.odometry_count), (scans, scans), "{name}");
        assert!((survey.distance_m - metres).abs() < 1.0, "{name}: {} m", survey.distance_m);
        let sensor = &survey.robot.sensors[0];
        assert!((sensor.base_from_sensor.x - 0.25).abs() < 0.01, "{sensor:?}");
        assert!(survey.faults.is_empty(), "{:?}", survey.faults);
    }
}
