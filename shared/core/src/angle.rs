//! Angles.

use core::f64::consts::{PI, TAU};

/// The same angle in (-π, π]. Non-finite input stays non-finite.
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let wrapped = angle_rad - TAU * (angle_rad / TAU).round();
    // `round` is half away from zero, so odd multiples of π can land on -π.
    if wrapped <= -PI { wrapped + TAU } else { wrapped }
}
