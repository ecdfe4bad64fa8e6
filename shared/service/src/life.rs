//! The loop of a service's life: what stands between its `step` and the graph.
//!
//! The loops wait in one place, [`Runtime::attend`]. In a process that blocks, and the whole is one call; who plays several
//! processes in one thread holds each where it waits, and goes on with another.

use std::io::{self, ErrorKind};
use std::time::Duration;

use anyhow::Result;
use echogrid_topics::{Header, ServiceState};

use crate::runtime::{Runtime, Stop, Taken};
use crate::{Input, Outbox, Service};

/// Steps between two looks at signals and acknowledgements …
pub(crate) const BATCH: usize = 64;
/// … which are taken after this, however few steps there were: one may take seconds.
pub(crate) const LOOK_AFTER: Duration = Duration::from_millis(100);
/// A service that is asked to stop takes in what it was sent before; not for longer than this, as
/// there may be no end of it.
const CATCH_UP_WITHIN: Duration = Duration::from_millis(500);
/// Something always ends a wait earlier.
pub(crate) const LONG: Duration = Duration::from_secs(60);

/// Marks an error of a step, which would be the same another time: steps depend on what they are given alone.
#[derive(Debug)]
pub(crate) struct InVain;

impl core::fmt::Display for InVain {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("starting it again would not help")
    }
}

/// What the outside refused may go well another time.
pub(crate) fn judged(error: anyhow::Error) -> anyhow::Error {
    let is_outside = error.chain().any(|cause| cause.is::<std::io::Error>());
    if is_outside { error } else { error.context(InVain) }
}

/// What the system refuses as long as nobody makes room or gives leave: each life would be refused the same, at the end.
fn judged_last(error: anyhow::Error) -> anyhow::Error {
    let is_refusal = |error: &io::Error| {
        matches!(
            error.kind(),
            ErrorKind::StorageFull
                | ErrorKind::QuotaExceeded
                | ErrorKind::FileTooLarge
                | ErrorKind::PermissionDenied
                | ErrorKind::ReadOnlyFilesystem
        )
    };
    let is_refused = error.chain().filter_map(|cause| cause.downcast_ref()).any(is_refusal);
    if is_refused { error.context(InVain) } else { judged(error) }
}

/// The life of a service: goes on where an earlier one was, steps until its inputs end, drains its outputs, leaves.
///
/// # Errors
/// A step failed, or the outside refuses.
pub async fn serve(runtime: &mut Runtime, service: &mut impl Service) -> Result<()> {
    let mut out = Outbox::default();
    if !runtime.recover(service).await? {
        return runtime.leave();
    }
    runtime.set_state(ServiceState::Running)?;
    tracing::info!("ready");
    let mut patience = Duration::ZERO;
    while runtime.stop().is_none() {
        runtime.attend(patience).await?;
        runtime.serve(None, false, |command| service.command(command, &mut out))?;
        runtime.welcome_newcomers(service, &mut out);
        let steps = take_some(runtime, service, &mut out)?;
        // Nothing to read, or no room to write: the next event is what to wait for.
        patience = if steps == 0 { LONG } else { Duration::ZERO };
        say_what_is_waited_for(runtime, service, &out, steps);
        if out.is_empty() {
            patience = patience.min(runtime.store_if_due(service, steps == 0)?);
            let counts = |topic| service.outlives(topic);
            if steps == 0 && runtime.has_streams(counts) && runtime.inputs_ended(counts) {
                break;
            }
        }
    }
    runtime.set_state(ServiceState::Draining)?;
    tracing::debug!(asked = runtime.stop().is_some(), "finishes");
    catch_up(runtime, service, &mut out).await?;
    let ended = runtime.inputs_ended(|topic| service.outlives(topic));
    service.step(Input::Finish, &mut out).map_err(judged_last)?;
    runtime.set_note(service.note());
    drain(runtime, &mut out, ended, |runtime, out| runtime.welcome_newcomers(service, out)).await
}

/// Takes in what is there, as long as what comes of it can be sent; how many steps that were.
fn take_some(runtime: &mut Runtime, service: &mut impl Service, out: &mut Outbox) -> Result<usize> {
    let (mut steps, begun) = (0, runtime.now());
    while steps < BATCH && out.is_empty() && runtime.now().saturating_duration_since(begun) < LOOK_AFTER {
        let Some(taken) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
        take_in(service, taken, out)?;
        runtime.flush(out)?;
        steps += 1;
    }
    runtime.flush(out)?;
    Ok(steps)
}

fn say_what_is_waited_for(runtime: &mut Runtime, service: &impl Service, out: &Outbox, steps: usize) {
    runtime.set_waits_for(match out.front() {
        Some((_, message)) => Some(message.topic()),
        None if steps == 0 => runtime.awaited_input(|topic| service.is_ready_for(topic)),
        None => None,
    });
    if steps == 0 {
        runtime.set_note(service.note());
    }
}

fn take_in(service: &mut impl Service, taken: Taken, out: &mut Outbox) -> Result<()> {
    match taken {
        Taken::Message(Header { sequence, stamp_ns, .. }, message) => {
            service.step(Input::Message { sequence, stamp_ns, message }, out).map_err(judged)
        }
        Taken::End(topic) => {
            service.ended(topic, out);
            Ok(())
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
async fn catch_up(runtime: &mut Runtime, service: &mut impl Service, out: &mut Outbox) -> Result<()> {
    let deadline = runtime.now() + CATCH_UP_WITHIN;
    let mut patience = Duration::ZERO;
    while runtime.stop() == Some(Stop::Asked) && runtime.now() < deadline {
        runtime.attend(patience).await?;
        runtime.flush(out)?;
        if !out.is_empty() {
            patience = deadline.saturating_duration_since(runtime.now());
            continue;
        }
        let Some(taken) = runtime.take(|topic| service.is_ready_for(topic))? else { break };
        take_in(service, taken, out)?;
        patience = Duration::ZERO;
    }
    Ok(())
}

/// Sends the rest. If the streams `ended`: says so, and waits until every consumer is done with all of it; `welcome` tells
/// whoever comes meanwhile what counts. If the service only leaves early, the rest is for those who go on with the run.
pub(crate) async fn drain(
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
        runtime.attend(LONG).await?;
    }
    runtime.leave()
}
