//! The launcher: from a graph file to supervised processes, and the command line.

pub mod cli;
pub mod commands;
pub mod config;
pub mod in_process;
pub mod limits;
pub mod progress;
pub mod sonars;
pub mod summary;
pub mod supervisor;
