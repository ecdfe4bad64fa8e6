//! A service that misbehaves, for the tests of whole graphs: see `echogrid_harness::fault`.

use std::process::ExitCode;

fn main() -> ExitCode {
    echogrid_harness::fault::main()
}
