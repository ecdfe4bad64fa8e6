//! The mathematics of echogrid: what is computed, and nothing of how it gets there.
//!
//! There is no I/O, clock, thread, file or message in this crate, so nothing here can fail for
//! an outside reason: it takes values and gives values. Equation numbers are those of the paper
//! named in `docs/` ("Probabilistic Mapping by Fusion of Range-Finders Sensors and Odometry").
//! Units are SI, angles counter-clockwise in (-π, π].

pub mod angle;
pub mod calibration;
pub mod chunks;
pub mod config;
mod doubt;
mod driven;
mod filter;
pub mod first_echo;
mod fusion;
pub mod gate;
pub mod grid;
pub mod incidents;
pub mod joint;
mod kalman;
pub mod kept;
pub mod kernel;
pub mod landmarks;
pub mod leap;
pub mod localization;
pub mod log_odds;
pub mod mapping;
pub mod noise;
pub mod novelty;
pub mod odometry;
pub mod oriented;
pub mod parts;
pub mod placing;
pub mod pose;
pub mod quality;
pub mod raster;
pub mod reading;
pub mod remap;
pub mod robot;
mod semi_inverse;
pub mod sensor_model;
pub mod shares;
pub mod sideways;
pub mod smoothing;
mod sonar_maps;
pub mod summary;
pub mod verdict;
pub mod walls;
pub mod why;
pub mod world;

pub use angle::wrap_angle;
pub use calibration::{Calibration, CalibrationError, Trial};
pub use chunks::Chunks;
pub use config::{ConfigError, MapperConfig, OdometryConfig};
pub use gate::Gate;
pub use grid::{CellIndex, Grid, Plane, TILE_CELLS, TILE_SIDE, Tile, TileIndex};
pub use incidents::Incidents;
pub use joint::{JointCovariance, Scales};
pub use landmarks::{Landmark, Localization, Sighting, TriangulationError, triangulate};
pub use leap::{DrivePose, Leap, Leaps};
pub use localization::{Fix, LocalizationConfig};
pub use mapping::{GridMapper, RestoreError};
pub use nalgebra::Matrix3;
pub use odometry::{ErrorModel, Estimate, Increment, Odometry, OdometryErrors, move_by};
pub use parts::{Parts, Saved, SavedError};
pub use placing::Placing;
pub use pose::{POSITION_MAX_M, Pose2};
pub use quality::{Quality, QualityError};
pub use raster::Raster;
pub use reading::{Echo, Reading};
pub use remap::Remapped;
pub use robot::{Footprint, Robot, Sensor, SensorKind, Transducer};
pub use sensor_model::nominal_trust;
pub use sideways::Sideways;
pub use smoothing::{placed, smooth};
pub use summary::GridSummary;
pub use verdict::{Verdict, VerdictCounts};
pub use walls::{Wall, Walls};
pub use world::{Cone, Fan, Meeting, Person, RayHit, Segment, Vicinity, World, WorldParts};
