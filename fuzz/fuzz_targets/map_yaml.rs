//! Any text as a map's YAML: what is read is written so that it is read again.
#![no_main]

use echogrid_formats::map::map_server::MapYaml;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(yaml) = MapYaml::parse(text) {
        assert_eq!(MapYaml::parse(&yaml.to_string()), Ok(yaml));
    }
});
