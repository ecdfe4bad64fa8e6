//! The driver of a Pioneer as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_pioneer::main()
}
