//! The launcher: from a graph file to supervised processes, and the command line.

pub mod cli;
pub mod commands;
pub use echogrid_config as config;
pub use echogrid_instruments::in_process;
pub mod limits;
pub mod progress;
pub mod sonars;
pub mod summary;
pub mod supervisor;
