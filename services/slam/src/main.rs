//! SLAM as a process of its own.

fn main() -> std::process::ExitCode {
    echogrid_slam_service::main()
}
