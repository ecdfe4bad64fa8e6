//! SLAM by sonars alone: a ring that corrects its own odometry where it hears again what it has heard before.
//!
//! What was heard on a piece of way is a map of its own, drawn as the mapper would, in the frame of a node in its middle. The last metres
//! of a later way are laid on it (`known`), which measures how the robot lies now, seen from that node: an edge of the pose graph between
//! two nodes of the drive, never a place in a map that moved with the robot. Only what is older than some metres of way is compared with, so
//! that a drift can't confirm itself; and a place counts when several ends of the way agree on it.

mod closures;
mod place;
mod rings;
mod slam;
mod told;
mod window;

pub use rings::{Drive, Heard, Ring};
pub use slam::SonarSlam;
