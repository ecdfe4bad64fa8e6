//! Any text as a table of trials: what is taken are finite trials, and what they come to is a model or an error.
#![no_main]

use echogrid_core::calibration::{Bootstrap, Calibration};
use echogrid_formats::trials::{Phase, Trials};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match Trials::parse(text) {
        Ok(trials) => {
            let [translations, rotations] = [Phase::Translation, Phase::Rotation].map(|phase| trials.of(phase, None));
            assert!(!translations.is_empty() || !rotations.is_empty());
            for trial in translations.iter().chain(&rotations) {
                let numbers = [trial.measured_m, trial.measured_rad, trial.true_m, trial.true_rad];
                assert!(numbers.iter().all(|number| number.is_finite()));
            }
            let fit = Calibration::fit(&translations, &rotations);
            let interval = Bootstrap::of(&translations, &rotations, 20, 1);
            assert!(fit.is_ok() || interval.is_err());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
