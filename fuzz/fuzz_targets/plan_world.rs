//! Any text as a world of our own: what is read makes a world, with people on their ways in it, or says why not.
#![no_main]

use echogrid_core::World;
use echogrid_formats::world::plan;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(parts) = plan::parse(text)
        && let Ok(world) = World::new(parts)
    {
        let [[x, y], _] = world.bounds_m();
        let _ = world.cast([x, y], 1.0, 10.0);
        let _ = world.clearance_m([x, y], 10.0);
        for person in &world.parts().people {
            let [x, y] = person.at(0.5 * person.length_m());
            assert!(x.is_finite() && y.is_finite());
        }
    }
});
