//! The localizer as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_localizer::main()
}
