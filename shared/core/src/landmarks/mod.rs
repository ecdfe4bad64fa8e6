//! Absolute localization from surveyed landmarks: where a robot is, from what it measured of things whose place is known.
//!
//! A [`Sighting`] is a range, a bearing or both to one landmark. [`triangulate`] finds the pose that fits all of them best, says
//! how far to trust it, and refuses with a [`TriangulationError`] whenever the sightings do not settle where the robot is.

mod error;
mod fit;
mod geometry;
mod sighting;
mod starts;
mod triangulate;

pub use error::{Degeneracy, TriangulationError};
pub use sighting::{LENGTH_MAX_M, SIGHTINGS_MAX, SIGMA_MAX, SIGMA_MIN, Sighting};
pub use triangulate::{Localization, UNKNOWN_HEADING_VARIANCE_RAD2, triangulate};

/// Something whose place has been surveyed.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmark {
    /// What sightings call it.
    pub name: String,
    /// The place of the landmark: x, y in the map frame, metres.
    pub at: [f64; 2],
}
