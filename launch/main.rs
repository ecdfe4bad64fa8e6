//! The program `echogrid`.

use std::process::ExitCode;

use clap::Parser;
use echogrid::cli::Cli;

fn main() -> ExitCode {
    // clap leaves with 2 where the command line makes no sense.
    echogrid::commands::run(Cli::parse())
}
