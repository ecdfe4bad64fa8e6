//! `echogrid emulate`, as it is typed.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// What is emulated, and how it is reached.
#[derive(Debug, Args)]
pub struct Emulate {
    /// What it pretends to be.
    #[arg(value_enum)]
    pub what: Emulated,
    /// The world that it drives through: office, room, a floor drawn by lot (floor-1 …), or a file.
    #[arg(long, value_name = "WORLD", default_value = "office")]
    pub world: String,
    /// The robot: pioneer3at, pioneer3dx or a robot file.
    #[arg(long, value_name = "NAME|FILE", default_value = "pioneer3at")]
    pub robot: String,
    /// The model that it says it is: p3at-sh, p3dx-sh, p3at or p3dx; others are not known.
    #[arg(long, value_name = "MODEL", default_value = "p3at-sh")]
    pub model: String,
    /// Listens here for one client, instead of behind a pseudo-terminal.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "link")]
    pub listen: Option<std::net::SocketAddr>,
    /// A link that leads to the pseudo-terminal.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Another drive: other slips, bumps and echoes.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Sets any key of the simulation, as in `--set simulator.route=commands`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

/// What can be emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Emulated {
    /// A Pioneer, over ARCOS.
    Pioneer,
}
