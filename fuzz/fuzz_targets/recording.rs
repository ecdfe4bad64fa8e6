//! Any bytes as a recording, with and without the truth in it: what the survey promises, the reader gives.
#![no_main]

use echogrid_formats::log::{self, SurveyOptions};
use echogrid_fuzz::log_files::{file_of, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes);
    // What is in it is told, whatever it is.
    let _ = log::contents(path);
    for truth in [None, Some("tf".to_owned())] {
        read(path, SurveyOptions { truth, ..SurveyOptions::default() });
    }
});
