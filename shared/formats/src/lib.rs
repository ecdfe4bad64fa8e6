//! Files in, files out: logs of robots, and maps.
//!
//! [`log`] reads a log twice, as a stream both times: once to learn what is in it
//! ([`log::survey`]), once to hand out its events in order ([`log::open`]).
//!
//! [`map`] writes maps as pictures, for ROS's map_server, for NumPy and whole, and reads them back.
//!
//! [`world`] reads worlds: what maps are judged by.
//!
//! [`localization`] reads what tells a robot where it is: reference paths, landmarks and sightings of them.
//!
//! [`trials`] reads what an odometry error model is made of, and [`chart`] draws how well it fits.
//!
//! [`canvas`] draws pictures with words in them.
//!
//! [`convert`] goes from one format to another; [`kind`] tells what a file is.
//!
//! This crate knows the mathematics (`echogrid-core`) and never a message topic. Whatever bytes a
//! file holds, reading it ends with values or with an error that names the file; memory stays
//! bounded and nothing panics.

mod bounded;
pub mod canvas;
pub mod chart;
pub mod convert;
mod foreign;
pub mod kind;
pub mod localization;
pub mod log;
pub mod map;
mod near;
mod tables;
mod text;
pub mod trials;
mod whole_file;
pub mod world;

pub use bounded::{open_regular, read_at_most};
pub use foreign::Foreign;
pub use text::{TextError, TextFileError};
pub use whole_file::{WriteError, probe_file, sweep_unfinished, write_whole};
