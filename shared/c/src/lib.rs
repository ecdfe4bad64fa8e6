//! Sensors and listeners of echogrid graphs for programs in C: what `c/echogrid.h` declares.
//!
//! A sensor is asked for what it says next, as [`echogrid_service::Sensor`] is; all else (joining, windows, heartbeats, the end) is
//! done here. A listener looks on at the map.

mod map;
mod sensor;

pub use map::{Grid, Map, echogrid_map_close, echogrid_map_grid, echogrid_map_open, echogrid_map_update};
pub use sensor::{Driver, Said, echogrid_run_sensor};
