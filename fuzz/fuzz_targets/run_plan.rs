//! Any text as the plan that a process reads when it starts: what is read is written so that it is read again, and a service
//! begins with what it says, or says why not.
#![no_main]

use echogrid_mapper::MapperService;
use echogrid_odometry::OdometryService;
use echogrid_publisher::PublisherService;
use echogrid_service::Plan;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(plan) = toml::from_str::<Plan>(text) else { return };
    let written = toml::to_string(&plan).expect("what was read can be written");
    let again: Plan = toml::from_str(&written).expect("what was written can be read");
    // As text: what is not a number equals nothing.
    assert_eq!(toml::to_string(&again).as_ref(), Ok(&written));
    // The others look at the files that it names.
    let _ = (OdometryService::from_plan(&plan), MapperService::from_plan(&plan), PublisherService::from_plan(&plan));
});
