//! The live page as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_live::main()
}
