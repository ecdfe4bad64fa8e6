//! A service as a process: the loops that stand between its `step` and the graph.

use std::ffi::CString;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_topics::{Message, ServiceState, Topic};

use crate::pace::Pace;
use crate::plan::Plan;
use crate::runtime::{Runtime, Stop};
use crate::{Input, Outbox, Sensor, Service, in_words, logging};

/// Steps between two looks at signals and acknowledgements.
const BATCH: usize = 64;
/// A service that is asked to stop takes in what it was sent before; not for longer than this, as
/// there may be no end of it.
const CATCH_UP_WITHIN: Duration = Duration::from_millis(500);
/// Something always ends a wait earlier.
const LONG: Duration = Duration::from_secs(60);

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
        step_until_done(runtime, &mut service)
    })
}

/// Runs a sensor as this process: plays its messages at the planned rate, within the windows of
/// the consumers, says when the stream ends, leaves when all is integrated.
pub fn run_sensor<S: Sensor>(name: &str, outputs: &'static [Topic], make: impl FnOnce(&Plan) -> Result<S>) -> ExitCode {
    start(name, &[], outputs, |runtime| {
        let mut sensor = make(runtime.plan())?;
        play(runtime, &mut sensor)
    })
}

fn start(
    name: &str,
    inputs: &'static [Topic],
    outputs: &'static [Topic],
    body: impl FnOnce(&mut Runtime) -> Result<()>,
) -> ExitCode {
    logging::start();
    // What `ps` shows; the kernel cuts it at 15 bytes.
    if let Ok(comm) = CString::new(format!("echogrid-{name}")) {
        let _ = nix::sys::prctl::set_name(&comm);
    }
    let mut runtime = match Runtime::enter(name, inputs, outputs) {
        Ok(runtime) => runtime,
        Err(error) => {
            tracing::error!("{name}: {}", in_words(&error));
            return ExitCode::FAILURE;
        }
    };
    match body(&mut runtime) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let error = in_words(&error);
            // The launcher hears of it and says so; by hand nobody else does.
            if !runtime.fail(&error) {
                tracing::error!("{name}: {error}");
            }
            ExitCode::FAILURE
        }
    }
}

fn step_until_done(runtime: &mut Runtime, service: &mut impl Service) -> Result<()> {
    let mut out = Outbox::default();
    runtime.set_state(ServiceState::Running)?;
    let mut patience = Duration::ZERO;
    while runtime.stop().is_none() {
        runtime.attend(patience)?;
        runtime.serve(|command| service.command(command, &mut out))?;
        let mut steps = 0;
        while steps < BATCH && out.is_empty() {
            let Some((header, message)) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
            let input = Input::Message { sequence: header.sequence, stamp_ns: header.stamp_ns, message };
            service.step(input, &mut out)?;
            runtime.flush(&mut out)?;
            steps += 1;
        }
        runtime.flush(&mut out)?;
        if steps == 0 && out.is_empty() && runtime.inputs_ended(|topic| service.outlives(topic)) {
            break;
        }
        // Nothing to read, or no room to write: the next event is what to wait for.
        patience = if steps == 0 { LONG } else { Duration::ZERO };
    }
    runtime.set_state(ServiceState::Draining)?;
    catch_up(runtime, service, &mut out)?;
    service.step(Input::Finish, &mut out)?;
    drain(runtime, &mut out)
}

/// Asked to stop, a service still takes what has come in by then: its producer may be gone, and
/// what is in the ports would be gone with it.
fn catch_up(runtime: &mut Runtime, service: &mut impl Service, out: &mut Outbox) -> Result<()> {
    let deadline = Instant::now() + CATCH_UP_WITHIN;
    let mut patience = Duration::ZERO;
    while runtime.stop() == Some(Stop::Asked) && Instant::now() < deadline {
        runtime.attend(patience)?;
        runtime.flush(out)?;
        if !out.is_empty() {
            patience = deadline.saturating_duration_since(Instant::now());
            continue;
        }
        let Some((header, message)) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
        service.step(Input::Message { sequence: header.sequence, stamp_ns: header.stamp_ns, message }, out)?;
        patience = Duration::ZERO;
    }
    Ok(())
}

fn play(runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<()> {
    let mut pace = Pace::new(runtime.plan().rate);
    runtime.set_total(sensor.total().unwrap_or(0));
    runtime.set_state(ServiceState::Running)?;
    let mut waiting: Option<(u64, Message)> = None;
    let mut patience = Duration::ZERO;
    'playing: while runtime.stop().is_none() {
        runtime.attend(patience)?;
        runtime.serve(|command| sensor.command(command))?;
        patience = Duration::ZERO;
        for _ in 0..BATCH {
            let (stamp_ns, message) = match waiting.take() {
                Some(waiting) => waiting,
                None => match sensor.next()? {
                    Some(next) => next,
                    None => break 'playing,
                },
            };
            patience = pace.until(stamp_ns, Instant::now());
            if patience.is_zero() && runtime.send(stamp_ns, &message)? {
                continue;
            }
            if patience.is_zero() {
                // No room: an acknowledgement is what to wait for.
                patience = LONG;
            }
            waiting = Some((stamp_ns, message));
            break;
        }
        runtime.ring()?;
    }
    runtime.set_state(ServiceState::Draining)?;
    drain(runtime, &mut Outbox::default())
}

/// Sends the rest, says that the streams end, and waits until every consumer has it all.
fn drain(runtime: &mut Runtime, out: &mut Outbox) -> Result<()> {
    let orphaned = |runtime: &Runtime| runtime.stop() == Some(Stop::Orphaned);
    loop {
        runtime.flush(out)?;
        if out.is_empty() || orphaned(runtime) {
            break;
        }
        runtime.attend(LONG)?;
    }
    runtime.end_outputs()?;
    while !runtime.is_drained() && !orphaned(runtime) {
        runtime.attend(LONG)?;
    }
    runtime.set_state(ServiceState::Finished)
}
