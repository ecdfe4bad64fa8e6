//! What a sensor knows of the truth: a simulator, or a log with true poses. Not for odometry or mapper.

use echogrid_core::{POSITION_MAX_M, Pose2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::checks::{Fault, check, pose};
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, bytes_to_text, text_to_bytes, wire};

impl Content for TruePose {
    const TOPIC: Topic = Topic::TruePose;
    type Payload = TruePoseWire;

    fn qos(_: usize) -> Qos {
        Qos::STREAM
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

impl Content for TrueWorld {
    const TOPIC: Topic = Topic::TrueWorld;
    type Payload = TrueWorldWire;

    fn qos(_: usize) -> Qos {
        Qos::LATEST
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// Where the robot really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TruePose {
    /// The pose of the base in the map; none: not known at this time.
    pub map_from_base: Option<Pose2>,
}

/// The world that a simulated robot is in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrueWorld {
    /// Name of a world that comes with echogrid, or the path of its file.
    pub name: String,
    /// Lowest and highest x and y of its walls, metres, map frame.
    pub bounds_m: [[f64; 2]; 2],
}

wire! {
    /// `truth/pose`: where the robot really is; one before each message of `odometry/raw`, of the same stamp.
    "echogrid/TruePose/1" TruePoseWire {
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// 1 known; 0 not known at this time, and the pose says nothing.
        known: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `truth/world`: the world that a simulated robot is in.
    "echogrid/TrueWorld/1" TrueWorldWire {
        /// Name of a world that comes with echogrid, or the path of its file; UTF-8, padded with zeros.
        name: [u8; 480],
        /// Lowest x and y, then highest x and y of its walls, metres, map frame.
        bounds_m: [f64; 4],
    }
}

impl From<&TruePose> for TruePoseWire {
    fn from(TruePose { map_from_base }: &TruePose) -> Self {
        let Pose2 { x, y, theta } = map_from_base.unwrap_or_default();
        Self { x_m: x, y_m: y, theta_rad: theta, known: u32::from(map_from_base.is_some()), reserved: 0 }
    }
}

impl TryFrom<&TruePoseWire> for TruePose {
    type Error = Fault;

    fn try_from(wire: &TruePoseWire) -> Result<Self, Fault> {
        let known = (wire.known != 0).then(|| pose(wire.x_m, wire.y_m, wire.theta_rad));
        Ok(Self { map_from_base: known.transpose()? })
    }
}

/// A name that is too long is cut.
impl From<&TrueWorld> for TrueWorldWire {
    fn from(TrueWorld { name, bounds_m: [[x_low, y_low], [x_high, y_high]] }: &TrueWorld) -> Self {
        Self { name: text_to_bytes(name), bounds_m: [*x_low, *y_low, *x_high, *y_high] }
    }
}

impl TryFrom<&TrueWorldWire> for TrueWorld {
    type Error = Fault;

    fn try_from(wire: &TrueWorldWire) -> Result<Self, Fault> {
        let [x_low, y_low, x_high, y_high] = wire.bounds_m;
        for value in wire.bounds_m {
            check(value.is_finite() && value.abs() <= POSITION_MAX_M, "bounds_m", value, "within ±3e7 m")?;
        }
        check(x_low <= x_high && y_low <= y_high, "bounds_m", x_high, "the lowest x and y before the highest")?;
        Ok(Self { name: bytes_to_text(&wire.name), bounds_m: [[x_low, y_low], [x_high, y_high]] })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{any_bytes, pose, refused, sent, survives};
    use super::*;

    proptest! {
        #[test]
        fn what_is_sent_arrives(truth in prop::option::of(pose()), name in "[a-zäß ]{0,32}", corner in pose()) {
            let truth = TruePose { map_from_base: truth };
            let (low, high) = (corner.x.min(0.0), corner.x.max(0.0));
            let world = TrueWorld { name, bounds_m: [[low, -1.0], [high, 2.0]] };
            prop_assert_eq!(sent::<TruePoseWire, _>(&truth), truth);
            prop_assert_eq!(sent::<TrueWorldWire, _>(&world), world);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<TruePoseWire, TruePose>(&bytes);
            survives::<TrueWorldWire, TrueWorld>(&bytes);
        }
    }

    #[test]
    fn truths_that_cannot_be() {
        let truth = TruePoseWire { known: 1, ..TruePoseWire::default() };
        refused::<_, TruePose>(truth, "y_m", |w| w.y_m = f64::INFINITY);
        refused::<_, TrueWorld>(TrueWorldWire::default(), "bounds_m", |w| w.bounds_m[1] = f64::NAN);
        refused::<_, TrueWorld>(TrueWorldWire::default(), "bounds_m", |w| w.bounds_m[0] = 1.0);
    }
}
