//! What a range sensor says.

use serde::{Deserialize, Serialize};

/// A reading is one of three things, never a magic number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Echo {
    /// Something answered at this range, metres from the transducer.
    Hit {
        /// Metres, finite and positive.
        range_m: f64,
    },
    /// Nothing came back within the range the sensor can see at all.
    NoEcho,
    /// Below the sensor's minimum, a fault, a stalled transducer: says nothing about the world.
    Invalid,
}

/// One reading of one transducer (a sonar, or one beam of a lidar).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Index into the robot's transducers (see [`crate::Robot::transducer`]).
    pub transducer: u16,
    /// What the transducer heard.
    pub echo: Echo,
    /// The time at which it was heard, nanoseconds after the stamp of the scan (sonars fire in turn).
    pub offset_ns: i32,
}
