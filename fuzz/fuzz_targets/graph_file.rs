//! Any text as a graph file: what is taken can be written down, and means the same when it is read again.
#![no_main]

use echogrid_config::{Config, parse_graph};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match parse_graph(text) {
        Ok(config) => {
            let written = config.to_toml().expect("what was taken can be written");
            assert_eq!(Config::from_toml(&written).expect("what was written can be read"), config);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
