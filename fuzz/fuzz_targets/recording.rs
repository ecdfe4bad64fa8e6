//! Any bytes as a recording, with and without the truth in it: what the survey promises, the reader gives.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use echogrid_formats::log::{self, LogEvent, SurveyOptions};
use libfuzzer_sys::fuzz_target;

/// In memory; a log is read by its path.
static FILE: LazyLock<PathBuf> = LazyLock::new(|| format!("/dev/shm/echogrid-fuzz-recording-{}", std::process::id()).into());

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("there is room");
    // What is in it is told, whatever it is.
    let _ = log::contents(&FILE);
    for truth in [None, Some("tf".to_owned())] {
        read(SurveyOptions { truth, ..SurveyOptions::default() });
    }
    std::fs::remove_file(&*FILE).expect("it is there");
});

fn read(options: SurveyOptions) {
    let survey = log::survey_with(&FILE, options);
    if let Ok(survey) = &survey {
        let (mut odometry, mut scans, mut last_ns) = (0, 0, survey.first_stamp_ns);
        for event in log::open(&FILE, survey).expect("it could be read before") {
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
}
