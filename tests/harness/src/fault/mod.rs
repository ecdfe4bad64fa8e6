//! Processes that misbehave: `echogrid-fault MODE [N|TOPIC]`, as the `exec` of a service in a graph file.
//!
//! ```toml
//! [services.sensor]
//! kind = "sensor"
//! exec = "target/debug/examples/echogrid-fault"
//! args = ["crash-late", "500"]
//! ```
//!
//! Whether it is a sensor or a reader the plan of the run tells: who is to read nothing is a sensor, and walks down a
//! corridor ([`walk`]); a reader takes in what it is to read, and makes nothing of it.

mod flood;
pub mod halt;
mod mode;
mod reader;
mod strangers;
pub mod walk;

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use echogrid_service::lifeline::Lifeline;
use echogrid_service::plan::{DOMAIN_VARIABLE, SERVICE_VARIABLE};
use echogrid_service::{Plan, in_words};
use echogrid_topics::{Domain, Topic};
use nix::sys::signal::{SigHandler, SigSet, Signal, signal};

pub use mode::{GATE_VARIABLE, Mode, WORLD_VARIABLE};

/// What the process does: of the program `echogrid-fault`, or of one of your own.
#[must_use]
pub fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("echogrid-fault: {}", in_words(&error));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<ExitCode> {
    let word = arguments.first().map_or("", String::as_str);
    let mode = Mode::of(word).with_context(|| format!("no mode {word:?}; there are: {}", Mode::words()))?;
    let argument = arguments.get(1).map(String::as_str);
    if let Mode::GarbageOn | Mode::SlowReader = mode {
        let topic = argument.and_then(topic).context("which topic?")?;
        strangers::meddle(mode, topic)?;
        return Ok(ExitCode::SUCCESS);
    }
    let after = argument.map_or(Ok(0), str::parse).context("after how many messages?")?;
    match mode {
        Mode::AlwaysCrash => std::process::abort(),
        Mode::HangBeforeReady => {
            // It leaves with its launcher all the same.
            let _lifeline = Lifeline::attach();
            hang()
        }
        Mode::Silent => flood::silent(),
        Mode::Flooding => flood::flood(after, 0),
        Mode::WrongEpoch => flood::flood(after, 1),
        Mode::TellsToHalt => Ok(halt::tell(inputs()?, after)),
        Mode::Halts => Ok(halt::drive(inputs()?, after)),
        _ => {
            let inputs = inputs()?;
            Ok(if inputs.is_empty() { walk::run(mode, after) } else { reader::run(inputs, mode, after) })
        }
    }
}

fn topic(name: &str) -> Option<Topic> {
    Topic::ALL.into_iter().find(|topic| topic.name() == name)
}

/// The domain that the environment names.
fn domain() -> Result<Domain> {
    let name = std::env::var(DOMAIN_VARIABLE).with_context(|| format!("{DOMAIN_VARIABLE} is not set"))?;
    Ok(Domain::named(&name)?)
}

/// Names the topics that are read, separated by commas, whatever the graph file says.
pub const READS_VARIABLE: &str = "ECHOGRID_FAULT_READS";

/// What the graph file says that this service reads or looks on.
fn inputs() -> Result<&'static [Topic]> {
    let name = std::env::var(SERVICE_VARIABLE).with_context(|| format!("{SERVICE_VARIABLE} is not set"))?;
    let plan = Plan::read(&domain()?)?;
    let service = plan.config.get("services").and_then(|services| services.get(&name));
    let named = |key| service.and_then(|service| service.get(key)?.as_array()).into_iter().flatten();
    let mut names: Vec<String> = ["reads", "looks_on"]
        .into_iter()
        .flat_map(named)
        .filter_map(|topic| topic.as_str())
        .map(str::to_owned)
        .collect();
    if let Ok(reads) = std::env::var(READS_VARIABLE) {
        names = reads.split(',').map(str::to_owned).collect();
    }
    // For as long as the process.
    Ok(names.iter().filter_map(|name| topic(name)).collect::<Vec<_>>().leak())
}

/// What happens when the messages before it have been given, or taken.
fn strike(mode: Mode) {
    match mode {
        Mode::CrashLate | Mode::Live => std::process::abort(),
        Mode::HangAfterReady => hang(),
        _ => {}
    }
}

fn hang() -> ! {
    loop {
        std::thread::sleep(Duration::from_secs(3600));
    }
}

/// From now on a request to end is not even heard.
fn go_deaf() {
    // SAFETY: no handler is set that could do anything.
    let _ = unsafe { signal(Signal::SIGTERM, SigHandler::SigIgn) };
    let _ = SigSet::from(Signal::SIGTERM).thread_unblock();
}
