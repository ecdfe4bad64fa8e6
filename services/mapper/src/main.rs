//! The mapper as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_mapper::main()
}
