//! What a map is worth: against a known world and the true path, or by its own walls where no world is known.
//!
//! Values in, values out, as in `echogrid-core`: no I/O, clock, thread, file or message.

pub mod quality;
pub mod walls;

pub use quality::{Quality, QualityError};
pub use walls::{Wall, Walls};
