//! Any bytes as a sonar pair: the first byte says how long the measurements are, in eighths.
#![no_main]

use std::io::Cursor;
use std::path::Path;

use echogrid_formats::log::udacity;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((share, bytes)) = bytes.split_first() else { return };
    let (measurement, poses) = bytes.split_at(bytes.len() * usize::from(share % 8) / 8);
    let [measurement, poses] = [measurement, poses].map(|half| Cursor::new(half.to_vec()));
    let path = Path::new("fuzz.txt");
    let Ok(survey) = udacity::survey(measurement.clone(), path, poses.clone(), path) else { return };
    let events = udacity::read(measurement, path, poses, path, &survey).expect("it could be read before");
    assert_eq!(events.count() as u64, survey.odometry_count + survey.scan_count);
});
