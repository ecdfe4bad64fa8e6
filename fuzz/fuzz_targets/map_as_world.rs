//! Any bytes as a map_server map to simulate in: its YAML, a zero, its image.
#![no_main]

use echogrid_core::World;
use echogrid_formats::map::map_server::{MapYaml, read_image};
use echogrid_formats::world::parts_of_map;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some(end) = bytes.iter().position(|byte| *byte == 0) else { return };
    let Ok(yaml) = MapYaml::parse(&String::from_utf8_lossy(&bytes[..end])) else { return };
    if let Ok(map) = read_image(&bytes[end + 1..], &yaml)
        && let Ok(world) = World::new(parts_of_map(&yaml, &map))
    {
        let [[x, y], _] = world.bounds_m();
        let _ = world.cast([x, y], 1.0, 10.0);
        let _ = world.clearance_m([x, y], 10.0);
    }
});
