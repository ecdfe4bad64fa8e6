//! Any bytes as a log: it is read by its path.

use std::fs::File;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::sync::LazyLock;

use echogrid_formats::log::{self, LogEvent, SurveyOptions};

/// A file without a name, so that nothing of it stays however the process ends, and the path that it is opened by.
static FILE: LazyLock<(File, PathBuf)> = LazyLock::new(|| {
    let file = tempfile::tempfile().expect("there is a folder for temporary files");
    let path = format!("/proc/self/fd/{}", file.as_raw_fd()).into();
    (file, path)
});

/// The path of a file that holds `bytes`, until the next call.
pub fn file_of(bytes: &[u8]) -> &'static PathBuf {
    let (file, path) = &*FILE;
    file.set_len(0).and_then(|()| file.write_all_at(bytes, 0)).expect("there is room");
    path
}

/// Reads a log: what the survey promises, the reader gives.
pub fn read(path: &PathBuf, options: SurveyOptions) {
    let Ok(survey) = log::survey_with(path, options) else { return };
    let (mut odometry, mut scans, mut last_ns) = (0, 0, survey.first_stamp_ns);
    for event in log::open(path, &survey).expect("it could be read before") {
        let event = event.expect("it could be read before");
        assert!(event.stamp_ns() >= last_ns);
        last_ns = event.stamp_ns();
        match event {
            LogEvent::Odometry { odom_from_base, .. } => {
                odometry += 1;
                assert!(odom_from_base.is_finite());
            }
            LogEvent::Scan { readings, .. } => {
                scans += 1;
                assert!(readings.len() <= survey.max_readings_per_scan);
                assert!(readings.iter().all(|reading| survey.robot.transducer(reading.transducer).is_some()));
            }
            LogEvent::TruePose { .. } => {}
        }
    }
    assert_eq!((odometry, scans), (survey.odometry_count, survey.scan_count));
}
