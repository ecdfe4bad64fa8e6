//! What range sensors are, what they say, and what one reading says about one cell.

pub(crate) mod heard;
pub mod noise;
pub mod nominal;
pub mod novelty;
pub mod reading;
pub mod robot;
pub mod sensor_model;
pub mod verdict;
