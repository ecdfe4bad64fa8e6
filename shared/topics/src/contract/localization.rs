//! Localization: the question where the robot is, and the answer.

use echogrid_core::Fix;
use echogrid_core::localization::Reason;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::checks::{Fault, pose};
use super::odometry::{EstimateWire, PoseEstimate};
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, wire};

/// What is known in a fix.
const POSITION: u32 = 1;
const HEADING: u32 = 2;

impl Content for LocalizationRequest {
    const TOPIC: Topic = Topic::LocalizationRequest;
    type Payload = LocalizationRequestWire;

    fn qos(_: usize) -> Qos {
        // One at a time is on its way.
        Qos { history: 16, buffer: 32, window: 16, ..Qos::STREAM }
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

impl Content for LocalizationFix {
    const TOPIC: Topic = Topic::LocalizationFix;
    type Payload = FixWire;

    fn qos(_: usize) -> Qos {
        Qos { buffer: 16, ..Qos::LATEST }
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// An absolute localization is wanted, of the stamp of the message.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LocalizationRequest {
    /// The number of the request: 1, 2, 3 …
    pub id: u64,
    /// Where the robot believes to be.
    pub estimate: PoseEstimate,
    /// Why a localization is wanted.
    pub reason: Reason,
}

/// Where the robot was at the stamp of the message.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalizationFix {
    /// The request that it answers; 0: nobody asked.
    pub request: u64,
    /// Where the robot was; none: that can't be told.
    pub fix: Option<Fix>,
}

wire! {
    /// `localization/request`: an absolute localization is wanted.
    "echogrid/LocalizationRequest/4" LocalizationRequestWire {
        /// Number of the request: 1, 2, 3 …
        id: u64,
        /// Where the robot believes to be at the stamp of the message.
        estimate: EstimateWire,
        /// 1 degraded, 2 by schedule, 3 nothing has said yet where the map lies, 4 after a leap of the odometry.
        reason: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `localization/fix`: where the robot was at the stamp of the message, or that this can't be told.
    "echogrid/LocalizationFix/1" FixWire {
        /// Of the request that it answers; 0: nobody asked.
        request: u64,
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Covariance of (x, y, θ), row by row; m², m·rad, rad².
        covariance: [f64; 9],
        /// Bit 0 position known, bit 1 heading known; 0: no fix.
        known: u32,
        /// Zero.
        reserved: u32,
    }
}

impl From<&LocalizationRequest> for LocalizationRequestWire {
    fn from(LocalizationRequest { id, estimate, reason }: &LocalizationRequest) -> Self {
        Self { id: *id, estimate: estimate.into(), reason: *reason as u32, reserved: 0 }
    }
}

impl TryFrom<&LocalizationRequestWire> for LocalizationRequest {
    type Error = Fault;

    fn try_from(wire: &LocalizationRequestWire) -> Result<Self, Fault> {
        const REASONS: [Reason; 4] = [Reason::Degraded, Reason::Schedule, Reason::Start, Reason::Leap];
        let reason = REASONS.into_iter().find(|reason| *reason as u32 == wire.reason);
        let reason = reason.ok_or(Fault { field: "reason", value: wire.reason.to_string(), expected: "1 to 4" })?;
        Ok(Self { id: wire.id, estimate: (&wire.estimate).try_into()?, reason })
    }
}

impl From<&LocalizationFix> for FixWire {
    fn from(LocalizationFix { request, fix }: &LocalizationFix) -> Self {
        let Some(Fix { pose, covariance, position_known, heading_known }) = fix else {
            return Self { request: *request, ..Self::default() };
        };
        Self {
            request: *request,
            x_m: pose.x,
            y_m: pose.y,
            theta_rad: pose.theta,
            covariance: rows(covariance),
            known: u32::from(*position_known) * POSITION + u32::from(*heading_known) * HEADING,
            reserved: 0,
        }
    }
}

impl TryFrom<&FixWire> for LocalizationFix {
    type Error = Fault;

    fn try_from(wire: &FixWire) -> Result<Self, Fault> {
        let (position_known, heading_known) = (wire.known & POSITION != 0, wire.known & HEADING != 0);
        if !position_known && !heading_known {
            return Ok(Self { request: wire.request, fix: None });
        }
        let fix = Fix {
            pose: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
            covariance: Matrix3::from_row_slice(&wire.covariance),
            position_known,
            heading_known,
        };
        fix.validate().map_err(|error| Fault { field: error.field, value: error.value, expected: error.expected })?;
        Ok(Self { request: wire.request, fix: Some(fix) })
    }
}

fn rows(covariance: &Matrix3<f64>) -> [f64; 9] {
    // Columns of the transpose are rows.
    let mut rows = [0.0; 9];
    rows.iter_mut().zip(covariance.transpose().iter()).for_each(|(slot, value)| *slot = *value);
    rows
}

#[cfg(test)]
mod tests {
    use echogrid_core::Pose2;
    use proptest::prelude::*;

    use super::super::testing::{any_bytes, pose, refused, sent, survives};
    use super::*;

    fn fix() -> impl Strategy<Value = LocalizationFix> {
        let known = prop::sample::select(vec![(true, true), (true, false), (false, true)]);
        let fix =
            (pose(), 0.0..1e3, 0.0..1e3, known).prop_map(|(pose, position_m, heading_rad, (position, heading))| Fix {
                position_known: position,
                heading_known: heading,
                ..Fix::about(pose, position_m, heading_rad)
            });
        (any::<u64>(), prop::option::of(fix)).prop_map(|(request, fix)| LocalizationFix { request, fix })
    }

    fn request() -> impl Strategy<Value = LocalizationRequest> {
        let reason = prop::sample::select(vec![Reason::Degraded, Reason::Schedule, Reason::Start, Reason::Leap]);
        (any::<u64>(), super::super::odometry::tests::estimate(), reason)
            .prop_map(|(id, estimate, reason)| LocalizationRequest { id, estimate, reason })
    }

    proptest! {
        #[test]
        fn what_is_sent_arrives(request in request(), fix in fix()) {
            prop_assert_eq!(sent::<LocalizationRequestWire, _>(&request), request);
            prop_assert_eq!(sent::<FixWire, _>(&fix), fix);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<LocalizationRequestWire, LocalizationRequest>(&bytes);
            survives::<FixWire, LocalizationFix>(&bytes);
        }
    }

    #[test]
    fn localizations_that_cannot_be() {
        let good = LocalizationFix { request: 1, fix: Some(Fix::about(Pose2::new(1.0, 2.0, 0.5), 0.1, 0.02)) };
        let check = |field, spoil: fn(&mut FixWire)| refused::<_, LocalizationFix>((&good).into(), field, spoil);
        check("x_m", |w| w.x_m = 4e7);
        check("theta_rad", |w| w.theta_rad = f64::NAN);
        check("covariance", |w| w.covariance[0] = -1.0);
        check("covariance", |w| w.covariance[1] = 0.005);
        check("covariance", |w| w.covariance[8] = f64::NAN);
        // Without anything known the rest says nothing.
        let nothing = FixWire { request: 3, x_m: f64::NAN, ..FixWire::default() };
        assert_eq!(LocalizationFix::try_from(&nothing).unwrap(), LocalizationFix { request: 3, fix: None });
        refused::<_, LocalizationRequest>(LocalizationRequestWire::default(), "reason", |_| {});
        let asked = LocalizationRequestWire { reason: 1, ..LocalizationRequestWire::default() };
        refused::<_, LocalizationRequest>(asked, "trust", |w| w.estimate.trust = 2.0);
    }
}
