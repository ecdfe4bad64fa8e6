//! Any text as a landmarks file: every landmark that is taken can be told by its name.
#![no_main]

use echogrid_formats::localization::Landmarks;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match Landmarks::parse(text) {
        Ok(landmarks) => {
            assert!(!landmarks.all().is_empty());
            for (index, landmark) in landmarks.all().iter().enumerate() {
                assert_eq!(landmarks.index_of(&landmark.name), Some(index));
                assert!(landmark.at.iter().all(|value| value.is_finite()));
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
