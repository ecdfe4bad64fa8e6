//! Any text as relations of poses: what is read is finite, and there is something.
#![no_main]

use echogrid_formats::localization::Relations;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match Relations::parse(text) {
        Ok(relations) => {
            assert!(!relations.all().is_empty());
            assert!(relations.all().iter().all(|relation| relation.pose.is_finite()));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
