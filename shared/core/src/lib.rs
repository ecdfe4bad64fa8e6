//! The mathematics of echogrid: what is computed, and nothing of how it gets there.
//!
//! There is no I/O, clock, thread, file or message in this crate, so nothing here can fail for
//! an outside reason: it takes values and gives values. Equation numbers are those of the paper
//! named in `docs/` ("Probabilistic Mapping by Fusion of Range-Finders Sensors and Odometry").
//! Units are SI, angles counter-clockwise in (-π, π].

pub mod calibration;
pub mod config;
mod filter;
mod fusion;
mod geometry;
pub mod grid;
pub mod kernel;
pub mod landmarks;
pub mod localization;
pub mod mapping;
pub mod odometry;
mod sensor;
mod state;
pub mod world;

// Modules are named without their room.
pub use fusion::{first_echo, oriented, shares};
pub(crate) use geometry::semi_inverse;
pub use geometry::{angle, pose};
pub use grid::{log_odds, raster, summary};
pub use localization::placing;
pub(crate) use mapping::{doubt, driven, sonar_maps};
pub use mapping::{foretell, kept, remap, why};
pub use odometry::{fix, gate, incidents, joint, leap, sideways, smoothing};
pub(crate) use sensor::heard;
pub use sensor::{noise, nominal, novelty, reading, robot, sensor_model, verdict};
pub use state::{chunks, parts};

pub use angle::wrap_angle;
pub use calibration::{Calibration, CalibrationError, Trial};
pub use chunks::Chunks;
pub use config::{ConfigError, MapperConfig, OdometryConfig};
pub use filter::SILENT_SHARE;
pub use gate::Gate;
pub use grid::{CellIndex, Grid, Plane, TILE_CELLS, TILE_SIDE, Tile, TileIndex};
pub use incidents::Incidents;
pub use joint::{JointCovariance, Scales};
pub use landmarks::{Landmark, Localization, Sighting, TriangulationError, triangulate};
pub use leap::{DrivePose, Leap, Leaps};
pub use localization::LocalizationConfig;
pub use mapping::{GridMapper, RestoreError};
pub use nalgebra::Matrix3;
pub use nominal::NominalSensor;
pub use odometry::fix::Fix;
pub use odometry::{ErrorModel, Estimate, Increment, Odometry, OdometryErrors, move_by};
pub use parts::{Parts, Saved, SavedError};
pub use placing::Placing;
pub use pose::{POSITION_MAX_M, Pose2};
pub use raster::Raster;
pub use reading::{Echo, Reading};
pub use remap::Remapped;
pub use robot::{Footprint, Robot, Sensor, SensorKind, Transducer};
pub use sensor_model::nominal_trust;
pub use sideways::Sideways;
pub use smoothing::{placed, smooth};
pub use summary::GridSummary;
pub use verdict::{Verdict, VerdictCounts};
pub use world::{Cone, Fan, Meeting, Person, RayHit, Segment, Vicinity, World, WorldParts};
