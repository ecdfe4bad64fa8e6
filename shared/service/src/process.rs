//! A service as a process: from its start to its exit code.

use std::ffi::CString;
use std::pin::pin;
use std::process::ExitCode;
use std::task::{Context, Poll, Waker};

use anyhow::Result;
use echogrid_topics::Topic;

use crate::life::{self, InVain};
use crate::plan::{Plan, SERVICE_VARIABLE};
use crate::play;
use crate::runtime::{Runtime, Terminated};
use crate::{Sensor, Service, in_words, logging, signals};

/// Exit code of a process that could not enter the graph (`EX_UNAVAILABLE`): that may not be its own fault.
pub const NO_GRAPH: u8 = 69;
/// Exit code of a service whose step failed for a reason that another process would meet, too.
pub const IN_VAIN: u8 = 65;

/// Runs a service as this process: enters the graph, makes the service from the plan, steps it
/// until its inputs end, drains its outputs, leaves.
pub fn run<S: Service>(
    name: &str,
    inputs: &'static [Topic],
    outputs: &'static [Topic],
    make: impl FnOnce(&Plan) -> Result<S>,
) -> ExitCode {
    start(name, inputs, outputs, |runtime| {
        let mut service = make(runtime.plan())?;
        block_on(life::serve(runtime, &mut service))
    })
}

/// Runs a sensor as this process: plays its messages at the planned rate, within the windows of
/// the consumers, says when the stream ends, leaves when all is integrated.
pub fn run_sensor<S: Sensor>(name: &str, outputs: &'static [Topic], make: impl FnOnce(&Plan) -> Result<S>) -> ExitCode {
    start(name, &[], outputs, |runtime| {
        let mut sensor = make(runtime.plan())?;
        block_on(play::play(runtime, &mut sensor))
    })
}

/// Runs to its end what waits for nothing but the runtime of this process, whose waiting blocks.
pub fn block_on<T>(life: impl Future<Output = T>) -> T {
    let mut life = pin!(life);
    loop {
        if let Poll::Ready(end) = life.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return end;
        }
    }
}

fn start(
    name: &str,
    inputs: &'static [Topic],
    outputs: &'static [Topic],
    body: impl FnOnce(&mut Runtime) -> Result<()>,
) -> ExitCode {
    signals::survive_file_size_limit();
    let shown = std::env::var(SERVICE_VARIABLE).unwrap_or_else(|_| name.to_owned());
    let _whose = logging::start(&shown);
    tracing::debug!(process = std::process::id(), "starts");
    // What `ps` shows; the kernel cuts it at 15 bytes.
    if let Ok(comm) = CString::new(format!("echogrid-{name}")) {
        let _ = nix::sys::prctl::set_name(&comm);
    }
    let mut runtime = match Runtime::enter(name, inputs, outputs) {
        Ok(runtime) => runtime,
        Err(error) => {
            tracing::error!("{name}: {}", in_words(&error));
            return ExitCode::from(NO_GRAPH);
        }
    };
    match body(&mut runtime) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let code = exit_code(&failure);
            let error = in_words(&failure);
            // The launcher hears of it and says so; by hand nobody else does.
            if !runtime.fail(&error) {
                tracing::error!("{name}: {error}");
            }
            ExitCode::from(code)
        }
    }
}

/// What a service leaves with that failed so.
#[must_use]
pub fn exit_code(failure: &anyhow::Error) -> u8 {
    match failure.downcast_ref::<Terminated>() {
        // As a shell has it.
        Some(Terminated(caught)) => 128 + caught.signal as i32 as u8,
        None if failure.is::<InVain>() => IN_VAIN,
        None => 1,
    }
}
