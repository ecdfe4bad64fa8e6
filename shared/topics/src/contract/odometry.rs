//! Odometry: what the drive believes, and where the robot is in the map.

use echogrid_core::odometry::{Estimate, OdometryErrors};
use echogrid_core::{Incidents, JointCovariance, Pose2, Scales};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::checks::{Fault, at_least_zero, check, finite, pose};
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, wire};

/// Flags of an estimate.
const DEGRADED: u32 = 1;
const HOLD: u32 = 2;
const UNPLACED: u32 = 4;

impl Content for RawOdometry {
    const TOPIC: Topic = Topic::OdometryRaw;
    type Payload = OdometryRawWire;

    fn qos(_: usize) -> Qos {
        Qos::STREAM
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

impl Content for PoseEstimate {
    const TOPIC: Topic = Topic::OdometryEstimate;
    type Payload = EstimateWire;

    fn qos(_: usize) -> Qos {
        Qos::STREAM
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// A pose as the drive reports it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawOdometry {
    /// The pose of the base in the odometry frame.
    pub odom_from_base: Pose2,
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s.
    pub w_radps: f64,
}

/// A pose in the map frame, and how far to trust it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseEstimate {
    /// Pose, covariance, accumulated errors.
    pub estimate: Estimate,
    /// Weight of a nominal reading (2 m), in [0, 1].
    pub trust: f64,
    /// Travelled since the start, metres.
    pub distance_m: f64,
    /// Whether a reading hardly says anything any more, for all that the odometry may be off.
    pub degraded: bool,
    /// Whether nothing is to be mapped from here.
    pub hold: bool,
    /// Whether nothing has said yet where the map lies: the pose is that of the odometry's own frame, and scans wait.
    pub unplaced: bool,
    /// Leaps of the odometry so far.
    pub leaps: Incidents,
    /// Fixes so far that the odometry contradicts, whether they were believed or not.
    pub contradictions: Incidents,
}

impl PoseEstimate {
    /// The estimate of a robot of which nothing is known to be wrong.
    #[must_use]
    pub fn plain(estimate: Estimate, trust: f64, distance_m: f64) -> Self {
        Self {
            estimate,
            trust,
            distance_m,
            degraded: false,
            hold: false,
            unplaced: false,
            leaps: Incidents::default(),
            contradictions: Incidents::default(),
        }
    }
}

wire! {
    /// `odometry/raw`: what the drive believes, in its own odometry frame.
    "echogrid/OdometryRaw/1" OdometryRawWire {
        /// Metres.
        x_m: f64,
        /// Metres.
        y_m: f64,
        /// Radians, counter-clockwise.
        theta_rad: f64,
        /// Forward speed, m/s.
        v_mps: f64,
        /// Turn rate, rad/s.
        w_radps: f64,
    }
}

wire! {
    /// What went wrong so often, since when, and how badly at worst.
    "echogrid/Incidents/1" IncidentsWire {
        /// Stamp of the first, nanoseconds.
        first_ns: u64,
        /// The greatest distance among them, metres.
        largest_m: f64,
        /// The greatest angle among them, radians.
        largest_rad: f64,
        /// How many; 0: the rest says nothing.
        count: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `odometry/estimate`: where the robot is in the map, and how far to trust that.
    "echogrid/OdometryEstimate/4" EstimateWire {
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Covariance of (x, y, θ, `lin_scale`, `ang_scale`) on and above its diagonal, row by row; m, rad, 1.
        covariance: [f64; 15],
        /// What the drive is believed to measure too much of every translation, as a share of it, and is taken out.
        lin_scale: f64,
        /// Likewise of every rotation.
        ang_scale: f64,
        /// Λ: travelled since the last absolute fix, metres.
        travel_m: f64,
        /// Θ: turned since the last absolute fix, radians.
        turn_rad: f64,
        /// E_lin (eq 1), metres.
        e_lin_m: f64,
        /// E_ang (eq 2), radians.
        e_ang_rad: f64,
        /// ε_lin (eq 3), m².
        eps_lin_m2: f64,
        /// ε_ang (eq 4), rad².
        eps_ang_rad2: f64,
        /// Weight of a nominal reading, in [0, 1].
        trust: f64,
        /// Travelled since the start, metres.
        distance_m: f64,
        /// Absolute fixes so far.
        fixes: u32,
        /// Bit 0: degraded, readings hardly say anything any more; bit 1: mapping is to hold; bit 2: nothing has said yet where
        /// the map lies, the pose is in the frame of `odometry/raw`.
        flags: u32,
        /// Fixes refused so far, for being too far off.
        fixes_refused: u32,
        /// Zero.
        reserved: u32,
        /// Leaps of the odometry so far: distance and turn of the leap.
        leaps: IncidentsWire,
        /// Fixes so far that the odometry contradicts, believed or not: how far the fix is from where the robot was believed to be.
        contradictions: IncidentsWire,
    }
}

impl From<&RawOdometry> for OdometryRawWire {
    fn from(raw: &RawOdometry) -> Self {
        Self {
            x_m: raw.odom_from_base.x,
            y_m: raw.odom_from_base.y,
            theta_rad: raw.odom_from_base.theta,
            v_mps: raw.v_mps,
            w_radps: raw.w_radps,
        }
    }
}

impl TryFrom<&OdometryRawWire> for RawOdometry {
    type Error = Fault;

    fn try_from(wire: &OdometryRawWire) -> Result<Self, Fault> {
        Ok(Self {
            odom_from_base: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
            v_mps: finite("v_mps", wire.v_mps)?,
            w_radps: finite("w_radps", wire.w_radps)?,
        })
    }
}

impl From<&Incidents> for IncidentsWire {
    fn from(Incidents { count, first_ns, largest_m, largest_rad }: &Incidents) -> Self {
        Self { first_ns: *first_ns, largest_m: *largest_m, largest_rad: *largest_rad, count: *count, reserved: 0 }
    }
}

impl TryFrom<&IncidentsWire> for Incidents {
    type Error = Fault;

    fn try_from(wire: &IncidentsWire) -> Result<Self, Fault> {
        Ok(Self {
            count: wire.count,
            first_ns: wire.first_ns,
            largest_m: at_least_zero("largest_m", wire.largest_m)?,
            largest_rad: at_least_zero("largest_rad", wire.largest_rad)?,
        })
    }
}

impl From<&PoseEstimate> for EstimateWire {
    fn from(message: &PoseEstimate) -> Self {
        let PoseEstimate { estimate, trust, distance_m, degraded, hold, unplaced, leaps, contradictions } = message;
        let mut covariance = [0.0; 15];
        covariance.iter_mut().zip(upper()).for_each(|(slot, place)| *slot = estimate.covariance[place]);
        Self {
            x_m: estimate.pose.x,
            y_m: estimate.pose.y,
            theta_rad: estimate.pose.theta,
            covariance,
            lin_scale: estimate.scales.lin,
            ang_scale: estimate.scales.ang,
            travel_m: estimate.travel_m,
            turn_rad: estimate.turn_rad,
            e_lin_m: estimate.errors.e_lin_m,
            e_ang_rad: estimate.errors.e_ang_rad,
            eps_lin_m2: estimate.errors.eps_lin_m2,
            eps_ang_rad2: estimate.errors.eps_ang_rad2,
            trust: *trust,
            distance_m: *distance_m,
            fixes: estimate.fixes,
            flags: u32::from(*degraded) * DEGRADED + u32::from(*hold) * HOLD + u32::from(*unplaced) * UNPLACED,
            fixes_refused: estimate.refused,
            reserved: 0,
            leaps: leaps.into(),
            contradictions: contradictions.into(),
        }
    }
}

impl TryFrom<&EstimateWire> for PoseEstimate {
    type Error = Fault;

    fn try_from(wire: &EstimateWire) -> Result<Self, Fault> {
        check((0.0..=1.0).contains(&wire.trust), "trust", wire.trust, "in [0, 1]")?;
        Ok(Self {
            estimate: Estimate {
                pose: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
                covariance: joint_covariance(&wire.covariance)?,
                scales: Scales { lin: scale("lin_scale", wire.lin_scale)?, ang: scale("ang_scale", wire.ang_scale)? },
                travel_m: at_least_zero("travel_m", wire.travel_m)?,
                turn_rad: at_least_zero("turn_rad", wire.turn_rad)?,
                errors: OdometryErrors {
                    e_lin_m: finite("e_lin_m", wire.e_lin_m)?,
                    e_ang_rad: finite("e_ang_rad", wire.e_ang_rad)?,
                    eps_lin_m2: at_least_zero("eps_lin_m2", wire.eps_lin_m2)?,
                    eps_ang_rad2: at_least_zero("eps_ang_rad2", wire.eps_ang_rad2)?,
                },
                fixes: wire.fixes,
                refused: wire.fixes_refused,
            },
            trust: wire.trust,
            distance_m: at_least_zero("distance_m", wire.distance_m)?,
            degraded: wire.flags & DEGRADED != 0,
            hold: wire.flags & HOLD != 0,
            unplaced: wire.flags & UNPLACED != 0,
            leaps: (&wire.leaps).try_into()?,
            contradictions: (&wire.contradictions).try_into()?,
        })
    }
}

/// Row and column of each number on and above the diagonal.
fn upper() -> impl Iterator<Item = (usize, usize)> {
    (0..5).flat_map(|row| (row..5).map(move |column| (row, column)))
}

/// Symmetric, whatever the numbers.
fn joint_covariance(numbers: &[f64; 15]) -> Result<JointCovariance, Fault> {
    let mut covariance = JointCovariance::zeros();
    for ((row, column), value) in upper().zip(numbers) {
        let checked = if row == column { at_least_zero("covariance", *value) } else { finite("covariance", *value) }?;
        (covariance[(row, column)], covariance[(column, row)]) = (checked, checked);
    }
    Ok(covariance)
}

/// At 1 no step would be left of what the drive measures.
fn scale(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.abs() < 1.0, field, value, "between -1 and 1")?;
    Ok(value)
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::super::testing::{amount, any_bytes, incidents, number, pose, refused, sent, survives};
    use super::*;

    pub(crate) fn estimate() -> impl Strategy<Value = PoseEstimate> {
        let covariance =
            (prop::collection::vec(number(), 25), prop::array::uniform5(amount())).prop_map(|(all, variances)| {
                let any = JointCovariance::from_row_slice(&all);
                let mut covariance = any.map(|value| 0.25 * value) + any.map(|value| 0.25 * value).transpose();
                covariance.set_diagonal(&nalgebra::SVector::from(variances));
                covariance
            });
        let scales = (-0.99..0.99f64, -0.99..0.99f64).prop_map(|(lin, ang)| Scales { lin, ang });
        let errors =
            (number(), number(), amount(), amount()).prop_map(|(e_lin_m, e_ang_rad, eps_lin_m2, eps_ang_rad2)| {
                OdometryErrors { e_lin_m, e_ang_rad, eps_lin_m2, eps_ang_rad2 }
            });
        let flags = (any::<(bool, bool, bool)>(), incidents(), incidents());
        (pose(), (covariance, scales), (amount(), amount()), errors, any::<(u32, u32)>(), 0.0..=1.0, amount(), flags)
            .prop_map(
                |(
                    pose,
                    (covariance, scales),
                    (travel_m, turn_rad),
                    errors,
                    (fixes, refused),
                    trust,
                    distance_m,
                    ((degraded, hold, unplaced), leaps, contradictions),
                )| PoseEstimate {
                    estimate: Estimate { pose, covariance, scales, travel_m, turn_rad, errors, fixes, refused },
                    trust,
                    distance_m,
                    degraded,
                    hold,
                    unplaced,
                    leaps,
                    contradictions,
                },
            )
    }

    proptest! {
        #[test]
        fn what_is_sent_arrives(pose in pose(), v_mps in number(), w_radps in number(), estimate in estimate()) {
            let raw = RawOdometry { odom_from_base: pose, v_mps, w_radps };
            prop_assert_eq!(sent::<OdometryRawWire, _>(&raw), raw);
            prop_assert_eq!(sent::<EstimateWire, _>(&estimate), estimate);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<OdometryRawWire, RawOdometry>(&bytes);
            survives::<EstimateWire, PoseEstimate>(&bytes);
        }
    }

    #[test]
    fn odometry_that_cannot_be() {
        let check = |field, spoil: fn(&mut OdometryRawWire)| {
            refused::<_, RawOdometry>(OdometryRawWire::default(), field, spoil)
        };
        assert!(RawOdometry::try_from(&OdometryRawWire::default()).is_ok());
        check("x_m", |w| w.x_m = f64::NAN);
        check("x_m", |w| w.x_m = 3e7 + 1.0);
        check("y_m", |w| w.y_m = f64::NEG_INFINITY);
        check("theta_rad", |w| w.theta_rad = f64::NAN);
        check("theta_rad", |w| w.theta_rad = 1e7);
        check("v_mps", |w| w.v_mps = f64::NAN);
        check("w_radps", |w| w.w_radps = f64::INFINITY);
    }

    #[test]
    fn estimates_that_cannot_be() {
        let check =
            |field, spoil: fn(&mut EstimateWire)| refused::<_, PoseEstimate>(EstimateWire::default(), field, spoil);
        assert!(PoseEstimate::try_from(&EstimateWire::default()).is_ok());
        check("x_m", |w| w.x_m = f64::NAN);
        check("y_m", |w| w.y_m = 4e7);
        check("theta_rad", |w| w.theta_rad = f64::NAN);
        check("covariance", |w| w.covariance[8] = f64::INFINITY);
        check("covariance", |w| w.covariance[0] = -1e-9);
        check("covariance", |w| w.covariance[14] = -1.0);
        check("lin_scale", |w| w.lin_scale = 1.0);
        check("ang_scale", |w| w.ang_scale = f64::NAN);
        check("travel_m", |w| w.travel_m = -1.0);
        check("turn_rad", |w| w.turn_rad = f64::NAN);
        check("e_lin_m", |w| w.e_lin_m = f64::NAN);
        check("e_ang_rad", |w| w.e_ang_rad = f64::INFINITY);
        check("eps_lin_m2", |w| w.eps_lin_m2 = -1e-9);
        check("eps_ang_rad2", |w| w.eps_ang_rad2 = f64::NAN);
        check("trust", |w| w.trust = 1.5);
        check("trust", |w| w.trust = f64::NAN);
        check("distance_m", |w| w.distance_m = -1.0);
    }
}
