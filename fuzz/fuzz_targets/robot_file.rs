//! Any text as a robot file: a robot that is taken is one that the processes can be told of.
#![no_main]

use echogrid_config::parse_robot;
use echogrid_core::Robot;
use echogrid_topics::contract::RobotWire;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match parse_robot(text) {
        Ok(robot) => {
            let mut next = 0;
            for sensor in &robot.sensors {
                assert_eq!(usize::from(sensor.first_transducer), next);
                next += usize::from(sensor.transducers);
            }
            assert_eq!(robot.transducer_count(), next);
            let told = Robot::try_from(&RobotWire::from(&robot)).expect("it can be sent");
            assert_eq!((told.footprint, told.sensors), (robot.footprint, robot.sensors));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
