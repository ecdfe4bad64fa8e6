//! Any bytes as a CARMEN log: what the survey promises, the reader gives.
#![no_main]

use std::io::Cursor;
use std::path::Path;

use echogrid_formats::log::{LogEvent, carmen};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("fuzz.log");
    let Ok(survey) = carmen::survey(bytes, path) else { return };
    let events = carmen::read(Cursor::new(bytes.to_vec()), path, &survey).expect("it could be read before");
    let (mut odometry, mut scans, mut true_poses, mut last_ns) = (0, 0, 0, survey.first_stamp_ns);
    for event in events {
        let event = event.expect("it could be read before");
        assert!(event.stamp_ns() >= last_ns);
        last_ns = event.stamp_ns();
        match event {
            LogEvent::Odometry { odom_from_base, .. } => {
                odometry += 1;
                assert!(odom_from_base.is_finite());
            }
            LogEvent::TruePose { .. } => true_poses += 1,
            LogEvent::Scan { readings, .. } => {
                scans += 1;
                assert!(readings.len() <= survey.max_readings_per_scan);
                assert!(readings.iter().all(|reading| survey.robot.transducer(reading.transducer).is_some()));
            }
        }
    }
    assert_eq!(last_ns, survey.last_stamp_ns);
    assert_eq!((odometry, scans, true_poses), (survey.odometry_count, survey.scan_count, survey.true_pose_count));
});
