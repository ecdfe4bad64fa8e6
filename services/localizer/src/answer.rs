//! What whoever knows where the robot was says to a request.

use echogrid_core::Fix;
use echogrid_core::noise::standard_normal_pair;

/// What a source says to a request.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Answer {
    /// Where the robot was.
    Fix(Fix),
    /// That can't be told, and why.
    Unknown(String),
    /// The robot has not driven far enough for that to be told.
    TooEarly,
    /// The truth has not come that far.
    NotYet,
}

/// What is said where the sensor has no true pose.
pub(crate) const NO_TRUTH: &str = "the sensor says nothing of where the robot really was at that time";

/// Seconds of the configuration as nanoseconds.
pub(crate) fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

/// Two draws from N(0, 1) that belong to one request. Not those that the mapper draws for the scan of that number, where
/// both have the same seed.
pub(crate) fn draws(seed: u64, request: u64, index: u16) -> (f64, f64) {
    standard_normal_pair(seed ^ u64::from_le_bytes(*b"localize"), request, index)
}
