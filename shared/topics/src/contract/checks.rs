//! What is checked of whatever comes from shared memory, before anyone uses it: a faulty peer gets its messages counted
//! and dropped, not the map.

use echogrid_core::{POSITION_MAX_M, Pose2};

/// A message that breaks its contract.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} = {value}: expected {expected}")]
pub struct Fault {
    /// The field that is wrong.
    pub field: &'static str,
    /// The value that the field held.
    pub value: String,
    /// What would have been right.
    pub expected: &'static str,
}

pub(super) fn check(ok: bool, field: &'static str, value: impl ToString, expected: &'static str) -> Result<(), Fault> {
    if ok { Ok(()) } else { Err(Fault { field, value: value.to_string(), expected }) }
}

pub(super) fn finite(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.is_finite(), field, value, "a finite number")?;
    Ok(value)
}

pub(super) fn at_least_zero(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.is_finite() && value >= 0.0, field, value, "a finite number, 0 or more")?;
    Ok(value)
}

pub(super) fn pose(x: f64, y: f64, theta: f64) -> Result<Pose2, Fault> {
    for (field, value) in [("x_m", x), ("y_m", y)] {
        check(value.is_finite() && value.abs() <= POSITION_MAX_M, field, value, "within ±3e7 m")?;
    }
    check(theta.is_finite() && theta.abs() <= 1e6, "theta_rad", theta, "a finite angle")?;
    Ok(Pose2::new(x, y, theta))
}

/// What can't be refused has no fault.
impl From<core::convert::Infallible> for Fault {
    fn from(never: core::convert::Infallible) -> Self {
        match never {}
    }
}
