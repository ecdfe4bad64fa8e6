//! Poses and angles in the plane.

pub mod angle;
pub mod pose;
pub(crate) mod semi_inverse;
