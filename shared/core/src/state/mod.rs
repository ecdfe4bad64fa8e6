//! A state as bytes, so that it can outlive the process that holds it.

pub mod chunks;
pub mod parts;
