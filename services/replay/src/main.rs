//! The replay as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_replay::main()
}
