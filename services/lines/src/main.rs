//! A program that prints lines, as a process of its own: `echogrid-lines [--replays] PROGRAM [ARGUMENT]…`.

fn main() -> std::process::ExitCode {
    echogrid_lines::main(&[], std::env::args_os().skip(1))
}
