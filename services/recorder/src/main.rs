//! The recorder as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_recorder::main()
}
