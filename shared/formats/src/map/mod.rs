//! Maps, written and read back.
//!
//! | file | what it holds | module |
//! |---|---|---|
//! | `map.echogrid` | everything, exactly: log-odds, revisions, path, provenance | [`native`] |
//! | `map.png` | a picture for people | [`picture`] |
//! | `map.pgm` + `map.yaml` | occupancy for ROS's map_server and Nav2 | [`map_server`] |
//! | `map.npy` | probabilities for NumPy | [`npy`] |
//! | `doubt.png`, `doubt.npy` | how much odometry error the evidence of each cell carried, where that was kept | [`doubt`] |
//! | `readings.echogrid` | the readings as they were fused, where they were kept | [`readings`] |
//!
//! [`MapFiles::write_all`] writes those that are chosen. Every file is written whole or not at all: whatever
//! stood at its path stays intact until the new one is complete and stored. Unknown cells stay
//! unknown in all of them. Coordinates are those of the map frame, which for a map made of a log is
//! the log's own odometry frame.

mod document;
pub mod doubt;
mod drawable;
mod error;
pub mod facing;
mod files;
pub(crate) mod layer;
mod legend;
mod main_part;
pub mod map_server;
pub mod native;
pub mod npy;
mod occupancy;
pub mod picture;
pub mod readings;
pub mod sheet;

pub use document::{MapDocument, PathPoint, Provenance};
pub use drawable::Drawable;
pub use error::MapError;
pub use files::{MapFileOptions, MapFiles, MapFormat};
pub use occupancy::OccupancyMap;
