//! `echogrid evaluate`, as it is typed.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::align::Align;

/// What is judged, and by what.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Worlds to simulate in: names, files, or ranges of floors drawn by lot, as in floor-101..110.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "floor-101..110")]
    pub worlds: Vec<String>,
    /// The number of drives in each world.
    #[arg(long, default_value_t = 1)]
    pub seeds: u64,
    /// A log that knows where the robot really was, and its world; may be repeated.
    #[arg(long = "log", value_name = "LOG=WORLD")]
    pub logs: Vec<String>,
    /// The folder of a sonar workload with true poses (workload_s.bin and building.map).
    #[arg(long, value_name = "DIR")]
    pub workload: Option<PathBuf>,
    /// Writes the table to this file, too.
    #[arg(long, value_name = "FILE.md")]
    pub out: Option<PathBuf>,
    /// Learns the parameters of each fusion on these worlds first (and then say others to judge by), behind the filters of
    /// --set or those that come by default, whatever those of a --method are.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub learn: Vec<String>,
    /// What learning is for.
    #[arg(long, value_enum, default_value = "bits")]
    pub goal: Goal,
    /// A way of mapping, as the table names it: only those that are named are judged, and only their fusions learnt; may be
    /// repeated.
    #[arg(long = "method", value_name = "NAME")]
    pub methods: Vec<String>,
    /// How a log's map is laid on its world: by where the robot really was at the start; by all of its path, as well as it
    /// goes (drives twice); or not at all.
    #[arg(long, value_enum, default_value = "start")]
    pub align: Align,
    /// How often there is a fix, as the table names it: only at those that are named is judged and learnt; may be repeated.
    #[arg(long = "fix", value_name = "exact|5 m|15 m|never")]
    pub fixes: Vec<String>,
    /// Prints the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Sets any key in every run.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

/// What learning is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Goal {
    /// The fewest bits.
    Bits,
    /// The most walls found, with at most 5 % of the free cells called occupied.
    Walls,
}
