//! What tells a robot where it is: a reference path, or surveyed landmarks and what the robot measured of them.
//!
//! | file | what it holds | module |
//! |---|---|---|
//! | reference, text | poses known from elsewhere: `t x y theta` per line | [`mod@reference`] |
//! | relations, text | how one pose of a path truly lies, seen from another | [`relations`] |
//! | covariances, text | how sure the poses of a path are | [`read_covariances`] |
//! | landmarks, TOML | places that were surveyed: `[[landmark]]` with `name` and `at` | [`landmarks`] |
//! | sightings, text | ranges and bearings to landmarks: `t landmark range_m bearing_rad` per line | [`sightings`] |
//!
//! Seconds, metres, radians counter-clockwise; map frame. Stamps are the log's own, to the nanosecond. These files are small and
//! made with care, so nothing in them is passed over: whatever is wrong is an error with its line.

mod covariances;
pub mod landmarks;
pub mod reference;
pub mod relations;
mod rows;
pub mod sightings;

pub use covariances::{Covariance, read_covariances, write_covariances};
pub use landmarks::Landmarks;
pub use reference::{ReferencePath, write_tum};
pub use relations::Relations;
pub use sightings::{Sightings, TimedSighting};
