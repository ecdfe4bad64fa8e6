//! A service as a process: the loops that stand between its `step` and the graph.

use std::ffi::CString;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_topics::{Header, Message, ServiceState, Topic};

use crate::live_clock::LiveClock;
use crate::pace::Pace;
use crate::plan::{Plan, SERVICE_VARIABLE};
use crate::runtime::{Runtime, Stop, Taken, Terminated};
use crate::{Input, Outbox, Sensor, Service, in_words, logging};

/// Steps between two looks at signals and acknowledgements …
const BATCH: usize = 64;
/// … which are taken after this, however few steps there were: one may take seconds.
const LOOK_AFTER: Duration = Duration::from_millis(100);
/// A service that is asked to stop takes in what it was sent before; not for longer than this, as
/// there may be no end of it.
const CATCH_UP_WITHIN: Duration = Duration::from_millis(500);
/// Exit code of a process that could not enter the graph (`EX_UNAVAILABLE`): that may not be its own fault.
pub const NO_GRAPH: u8 = 69;
/// Exit code of a service whose step failed for a reason that another process would meet, too.
pub const IN_VAIN: u8 = 65;
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
            let code = match failure.downcast_ref::<Terminated>() {
                // As a shell has it.
                Some(Terminated(caught)) => ExitCode::from(128 + caught.signal as i32 as u8),
                None if failure.is::<InVain>() => ExitCode::from(IN_VAIN),
                None => ExitCode::FAILURE,
            };
            let error = in_words(&failure);
            // The launcher hears of it and says so; by hand nobody else does.
            if !runtime.fail(&error) {
                tracing::error!("{name}: {error}");
            }
            code
        }
    }
}

/// Marks an error of a step, which would be the same another time: steps depend on what they are given alone.
#[derive(Debug)]
struct InVain;

impl core::fmt::Display for InVain {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("starting it again would not help")
    }
}

/// What the outside refused may go well another time.
fn judged(error: anyhow::Error) -> anyhow::Error {
    let is_outside = error.chain().any(|cause| cause.is::<std::io::Error>());
    if is_outside { error } else { error.context(InVain) }
}

fn step_until_done(runtime: &mut Runtime, service: &mut impl Service) -> Result<()> {
    let mut out = Outbox::default();
    runtime.recover(service)?;
    runtime.set_state(ServiceState::Running)?;
    tracing::info!("ready");
    let mut patience = Duration::ZERO;
    while runtime.stop().is_none() {
        runtime.attend(patience)?;
        runtime.serve(None, |command| service.command(command, &mut out))?;
        runtime.welcome_newcomers(service, &mut out);
        let mut steps = 0;
        let begun = Instant::now();
        while steps < BATCH && out.is_empty() && begun.elapsed() < LOOK_AFTER {
            let Some(taken) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
            take_in(service, taken, &mut out)?;
            runtime.flush(&mut out)?;
            steps += 1;
        }
        runtime.flush(&mut out)?;
        // Nothing to read, or no room to write: the next event is what to wait for.
        patience = if steps == 0 { LONG } else { Duration::ZERO };
        runtime.set_waits_for(match out.front() {
            Some((_, message)) => Some(message.topic()),
            None if steps == 0 => runtime.awaited_input(|topic| service.is_ready_for(topic)),
            None => None,
        });
        if out.is_empty() {
            patience = patience.min(runtime.store_if_due(service, steps == 0)?);
            if steps == 0 && runtime.inputs_ended(|topic| service.outlives(topic)) {
                break;
            }
        }
    }
    runtime.set_state(ServiceState::Draining)?;
    tracing::debug!(asked = runtime.stop().is_some(), "finishes");
    catch_up(runtime, service, &mut out)?;
    let ended = runtime.inputs_ended(|topic| service.outlives(topic));
    service.step(Input::Finish, &mut out).map_err(judged)?;
    drain(runtime, &mut out, ended, |runtime, out| runtime.welcome_newcomers(service, out))
}

fn take_in(service: &mut impl Service, taken: Taken, out: &mut Outbox) -> Result<()> {
    match taken {
        Taken::Message(Header { sequence, stamp_ns, .. }, message) => {
            service.step(Input::Message { sequence, stamp_ns, message }, out).map_err(judged)
        }
        Taken::Command(command) => {
            // What it answered was said when it was given.
            if let Err(error) = service.command(command, out) {
                tracing::debug!(?error, "an order of before could not be carried out then either");
            }
            Ok(())
        }
    }
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
        let Some(taken) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
        take_in(service, taken, out)?;
        patience = Duration::ZERO;
    }
    Ok(())
}

fn play(runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<()> {
    let mut pace = Pace::new(runtime.plan().rate);
    runtime.set_total(sensor.total().unwrap_or(0));
    let is_live = sensor.is_live();
    let mut again = runtime.begin(is_live)?;
    runtime.set_state(ServiceState::Running)?;
    tracing::info!("ready");
    let mut clock = LiveClock::default();
    // Messages that the sensor has made.
    let mut made: u64 = 0;
    let mut waiting: Option<(u64, Message)> = None;
    let mut patience = Duration::ZERO;
    'playing: while runtime.stop().is_none() {
        runtime.attend(patience)?;
        runtime.serve(Some(made), |command| sensor.command(command))?;
        patience = Duration::ZERO;
        runtime.set_waits_for(None);
        let begun = Instant::now();
        for _ in 0..BATCH {
            if begun.elapsed() >= LOOK_AFTER {
                break;
            }
            while let Some(command) = runtime.order_at(made) {
                // What it answered was said when it was given.
                let _ = sensor.command(command);
            }
            let (stamp_ns, message) = match waiting.take().or_else(|| again.pop_front()) {
                Some(message) => message,
                // What can be made anew fails anew.
                None => match sensor.next().map_err(|error| if is_live { error } else { judged(error) })? {
                    Some((stamp_ns, message)) if is_live => {
                        made += 1;
                        let stamp_ns = clock.stamp_ns(message.topic(), stamp_ns);
                        runtime.spool(stamp_ns, &message)?;
                        (stamp_ns, message)
                    }
                    Some(message) => {
                        made += 1;
                        message
                    }
                    None => break 'playing,
                },
            };
            if runtime.is_catching_up() || !again.is_empty() {
                // Some of it was sent by an earlier process: no time is to be lost with that.
                pace.skip_to(stamp_ns, Instant::now());
            }
            patience = pace.until(stamp_ns, Instant::now());
            if patience.is_zero() && runtime.send(stamp_ns, &message)? {
                continue;
            }
            if patience.is_zero() {
                // No room: an acknowledgement is what to wait for.
                patience = LONG;
                runtime.set_waits_for(Some(message.topic()));
            }
            waiting = Some((stamp_ns, message));
            break;
        }
        runtime.ring()?;
    }
    // Without it nobody downstream would read on to the end that follows.
    if made == 0
        && runtime.stop() == Some(Stop::Asked)
        && let Some((stamp_ns, robot @ Message::Robot(_))) = sensor.next()?
    {
        runtime.send(stamp_ns, &robot)?;
        runtime.ring()?;
    }
    runtime.set_state(ServiceState::Draining)?;
    tracing::debug!(asked = runtime.stop().is_some(), "finishes");
    drain(runtime, &mut Outbox::default(), runtime.stop() != Some(Stop::Orphaned), |_, _| {})
}

/// Sends the rest. If the streams `ended`: says so, and waits until every consumer is done with all of it; `welcome` tells
/// whoever comes meanwhile what counts. If the service only leaves early, the rest is for those who go on with the run.
fn drain(
    runtime: &mut Runtime,
    out: &mut Outbox,
    ended: bool,
    mut welcome: impl FnMut(&mut Runtime, &mut Outbox),
) -> Result<()> {
    while runtime.stop() != Some(Stop::Orphaned) {
        welcome(runtime, out);
        runtime.flush(out)?;
        if out.is_empty() {
            if !ended {
                break;
            }
            runtime.end_outputs()?;
            if runtime.is_drained() {
                return runtime.finish();
            }
        }
        runtime.set_waits_for(runtime.awaited_output());
        runtime.attend(LONG)?;
    }
    runtime.leave()
}
