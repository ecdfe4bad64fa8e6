//! `echogrid new`, as it is typed.

use std::path::PathBuf;

use clap::Subcommand;

/// What can be begun.
#[derive(Debug, Subcommand)]
pub enum NewCommand {
    /// A working sensor, with its graph file and a test that makes a map with it.
    Sensor {
        /// A new or empty folder.
        folder: PathBuf,
        /// In which language; lines: any program that prints lines.
        #[arg(long, value_name = "LANGUAGE")]
        lang: SensorLanguage,
        /// Where echogrid's own sources lie: Rust and C need them, Python its module.
        #[arg(long, value_name = "DIR")]
        source: Option<PathBuf>,
    },
}

/// A language that a sensor can be begun in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SensorLanguage {
    /// The trait of echogrid's own sensors.
    Rust,
    /// The module `echogrid`.
    Python,
    /// libechogrid_c.so.
    C,
    /// A script that prints lines, without any library.
    Lines,
}
