//! `echogrid service NAME`: one service, as this process.

use std::ffi::OsString;
use std::io::Write;
use std::process::{Command, ExitCode};

use anyhow::Context;
use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_topics::Domain;

use crate::config::Builtin;

/// The service that a program with lines speaks through: it needs one.
const LINES: &str = "lines";

/// Runs a built-in service in the domain that the environment or `domain` names.
pub(super) fn run(name: &str, domain: Option<String>, arguments: Vec<OsString>) -> ExitCode {
    if name == LINES && domain.is_none() {
        return echogrid_lines::main(&["service", LINES, "--"], arguments);
    }
    let Some(builtin) = Builtin::from_name(name) else {
        let names: Vec<&str> = Builtin::ALL.into_iter().map(Builtin::name).chain([LINES]).collect();
        let _ = writeln!(std::io::stderr(), "echogrid: no service {name:?}; there are: {}", names.join(", "));
        return ExitCode::from(2);
    };
    if let Some(domain) = domain {
        return reexecute(name, &domain);
    }
    match builtin {
        Builtin::Replay => echogrid_replay::main(),
        Builtin::Simulator => echogrid_simulator::main(),
        Builtin::Pioneer => echogrid_pioneer::main(),
        Builtin::Lidar => echogrid_lidar::main(),
        Builtin::Odometry => echogrid_odometry::main(),
        Builtin::Slam => echogrid_slam_service::main(),
        Builtin::Localizer => echogrid_localizer::main(),
        Builtin::Mapper => echogrid_mapper::main(),
        Builtin::Publisher => echogrid_publisher::main(),
        Builtin::Recorder => echogrid_recorder::main(),
        Builtin::Live => echogrid_live::main(),
    }
}

/// The domain travels in the environment, which a process can set only for another.
fn reexecute(name: &str, domain: &str) -> ExitCode {
    use std::os::unix::process::CommandExt;
    let error = match std::env::current_exe() {
        Ok(own) => Command::new(own).args(["service", name]).env(DOMAIN_VARIABLE, domain).exec(),
        Err(error) => error,
    };
    let _ = writeln!(std::io::stderr(), "echogrid: starting {name}: {error}");
    ExitCode::FAILURE
}

/// Cleans up after the dead of the domain that the environment names: the launcher's helper, as cleaning can hang.
pub(super) fn janitor() -> anyhow::Result<()> {
    let domain = std::env::var(DOMAIN_VARIABLE).with_context(|| format!("{DOMAIN_VARIABLE} is not set"))?;
    let cleaned = echogrid_topics::janitor::clean(&Domain::named(&domain)?)?;
    anyhow::ensure!(cleaned.failed == 0, "what {} dead processes left could not be removed", cleaned.failed);
    Ok(())
}
