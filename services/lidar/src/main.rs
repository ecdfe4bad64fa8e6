//! The driver of a lidar as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_lidar::main()
}
