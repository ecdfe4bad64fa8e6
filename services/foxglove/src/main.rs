//! `echogrid-foxglove`: a running graph in Foxglove.

use std::net::SocketAddr;
use std::process::ExitCode;

use clap::Parser;
use echogrid_foxglove::Request;

/// Shows a running echogrid graph in Foxglove: map, pose, path, readings and their verdicts, trust, health, log.
#[derive(Debug, Parser)]
#[command(name = "echogrid-foxglove", version)]
struct Cli {
    /// Which graph; may be left out when only one runs.
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Where Foxglove connects to: address and port.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8765")]
    listen: SocketAddr,
    /// Lets whoever connects save, pause, resume and fix. (Nobody is asked for a password: a page that is open in a browser on this
    /// machine can connect, too.)
    #[arg(long)]
    orders: bool,
}

fn main() -> ExitCode {
    let Cli { domain, listen, orders } = Cli::parse();
    echogrid_foxglove::main(&Request { domain, listen, orders })
}
