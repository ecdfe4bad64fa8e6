//! Any text as a robot's parameter file, as ARIA has it.
#![no_main]

use echogrid_arcos::Parameters;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match Parameters::read(text) {
        Ok(found) => {
            assert!(found.sonars.windows(2).all(|pair| pair[0].number < pair[1].number));
            assert!(found.distance_mm_per_count > 0.0 && found.angle_rad_per_count.is_finite());
        }
        Err(error) => assert!(error.line >= 1 && error.line <= text.lines().count()),
    }
});
