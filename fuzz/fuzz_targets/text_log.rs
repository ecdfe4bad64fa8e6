//! Any bytes as a log of any format, packed or not: what the survey promises, the reader gives.
#![no_main]

use echogrid_formats::log::SurveyOptions;
use echogrid_fuzz::log_files::{file_of, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| read(file_of(bytes), SurveyOptions::default()));
