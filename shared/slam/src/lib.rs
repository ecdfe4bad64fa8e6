//! Simultaneous localization and mapping: how a drive went, by what its range sensors saw again.
//!
//! As in `core` there is no I/O, clock, thread, file or message here, and no order that depends on hashes: the same readings give the
//! same bytes on every machine. Units are SI, angles counter-clockwise in (-π, π].

pub mod by_hand;
pub mod closures;
mod cloud;
pub mod config;
pub mod correlate;
pub mod evaluate;
mod front;
pub mod graph;
pub mod known;
mod loops;
pub mod matching;
pub mod matrix;
pub mod path;
mod refine;
pub mod report;
mod saving;
pub mod scan;
mod settling;
pub mod slam;
pub mod solver;
pub mod sonar;

pub use config::{SlamConfig, UseOdometry};
pub use scan::Points;
pub use slam::{Drive, Node, Slam};
