//! What the sonars said on the whole way, and where the odometry said that the robot was.

use std::collections::BTreeMap;

use echogrid_core::{Increment, Pose2, Reading};
use serde::{Deserialize, Serialize};

/// A sonar that has come less far since it was heard last says nothing new, metres and radians.
const NEW: (f64, f64) = (0.02, 0.02);

/// A reading, and where the odometry said that the base was when it was taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Heard {
    /// The reading of a sonar.
    pub reading: Reading,
    /// The base in the frame of the odometry when it was taken.
    pub odom_from_base: Pose2,
}

/// What was heard in one go.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ring {
    /// Nanoseconds.
    pub stamp_ns: u64,
    /// Where the odometry said that the robot was at the stamp.
    pub odom_from_base: Pose2,
    /// What leaps of the odometry have left open until then: variances, m² and rad².
    pub left_open: [f64; 2],
    /// The readings that say something new.
    pub heard: Vec<Heard>,
}

/// All that was heard.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// In order of their stamps.
    pub rings: Vec<Ring>,
    /// Where each sonar was when it said something new.
    pub kept: BTreeMap<u16, Pose2>,
}

impl Drive {
    /// Adds what was heard next. A robot that stands still is not heard for ever.
    pub fn add(&mut self, mut ring: Ring) {
        ring.heard.retain(|heard| {
            let is_new = self.kept.get(&heard.reading.transducer).is_none_or(|last| {
                let step = Increment::between(*last, heard.odom_from_base);
                step.length_m() >= NEW.0 || step.turn_rad.abs() >= NEW.1
            });
            if is_new {
                self.kept.insert(heard.reading.transducer, heard.odom_from_base);
            }
            is_new
        });
        let is_in_order = self.rings.last().is_none_or(|last| last.stamp_ns <= ring.stamp_ns);
        if is_in_order && !ring.heard.is_empty() {
            self.rings.push(ring);
        }
    }
}
