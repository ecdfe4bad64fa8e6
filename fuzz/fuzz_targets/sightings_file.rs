//! Any text as a sightings file: every sighting that is taken is found at its stamp.
#![no_main]

use echogrid_formats::localization::{Landmarks, Sightings};
use libfuzzer_sys::fuzz_target;

const LANDMARKS: &str = "[[landmark]]\nname = \"A\"\nat = [0, 0]\n[[landmark]]\nname = \"door\"\nat = [5, 1]\n";

fuzz_target!(|text: &str| {
    let landmarks = Landmarks::parse(LANDMARKS).expect("it is one");
    match Sightings::parse(text, &landmarks) {
        Ok(sightings) => {
            assert!(sightings.moved() < sightings.all().len());
            for sighting in sightings.all() {
                assert!(sightings.near(sighting.stamp_ns, 0).contains(sighting));
                assert!(sighting.range_m.is_some() || sighting.bearing_rad.is_some());
                assert_eq!(sighting.at, landmarks.all()[sighting.landmark].at);
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
