//! Any name of a floor that is drawn by lot: every number makes a world that a robot can begin in, and everything else is no name.
#![no_main]

use std::path::Path;

use echogrid_formats::world::find;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    // A file of such a name is another matter.
    if text.contains(['/', '.', '\0']) {
        return;
    }
    match (find(Path::new(&format!("floor-{text}"))), text.parse::<u64>()) {
        (Ok(world), Ok(_)) => {
            let home = world.parts().places.home.expect("every floor has one");
            assert!(world.clearance_m([home.x, home.y], 10.0) > 0.3);
            assert!(!world.parts().places.goals.is_empty());
        }
        (found, number) => assert!(found.is_err() && number.is_err()),
    }
});
