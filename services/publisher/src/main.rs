//! The publisher as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_publisher::main()
}
