//! The simulator as a library: what is heard, driven and told, against the physics that it claims.

#![allow(clippy::unwrap_used, clippy::panic)] // a test that can not go on has failed

mod changes;
mod drive;
mod errors;
mod laps;
mod mapped;
mod odometry;
mod sonar;
mod stream;
mod support;
mod variations;
