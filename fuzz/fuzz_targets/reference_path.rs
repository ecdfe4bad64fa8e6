//! Any text as a reference path: what is read is in order, and every pose at or between its own is finite.
#![no_main]

use echogrid_formats::localization::ReferencePath;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match ReferencePath::parse(text) {
        Ok(path) => {
            assert!(path.poses().windows(2).all(|pair| pair[0].0 < pair[1].0));
            assert!(path.moved() < path.poses().len());
            for (stamp_ns, pose) in path.poses() {
                assert_eq!(path.at(*stamp_ns, 0), Some(*pose));
                assert!(path.at(stamp_ns + 1, u64::MAX).is_none_or(|pose| pose.is_finite()));
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
