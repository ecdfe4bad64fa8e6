//! The loop of a service's life: what stands between its `step` and the graph.
//!
//! The loops wait in one place, [`Runtime::attend`]. In a process that blocks, and the whole is one call; who plays several
//! processes in one thread holds each where it waits, and goes on with another.

use std::io::{self, ErrorKind};
use std::time::Duration;

use anyhow::Result;
use echogrid_topics::{Header, Message, ServiceState, Topic};

use crate::live_clock::LiveClock;
use crate::pace::Pace;
use crate::runtime::{Runtime, Stop, Taken};
use crate::{Input, Outbox, Sensor, Service};

/// Steps between two looks at signals and acknowledgements …
const BATCH: usize = 64;
/// … which are taken after this, however few steps there were: one may take seconds.
const LOOK_AFTER: Duration = Duration::from_millis(100);
/// A service that is asked to stop takes in what it was sent before; not for longer than this, as
/// there may be no end of it.
const CATCH_UP_WITHIN: Duration = Duration::from_millis(500);
/// Something always ends a wait earlier.
const LONG: Duration = Duration::from_secs(60);

/// Marks an error of a step, which would be the same another time: steps depend on what they are given alone.
#[derive(Debug)]
pub(crate) struct InVain;

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
        let mut steps = 0;
        let begun = runtime.now();
        while steps < BATCH && out.is_empty() && runtime.now().saturating_duration_since(begun) < LOOK_AFTER {
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
        if steps == 0 {
            runtime.set_note(service.note());
        }
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

/// The life of a sensor: plays its messages at the planned rate, within the windows of the consumers, says when the stream
/// ends, leaves when all is integrated.
///
/// # Errors
/// The sensor failed, or the outside refuses.
pub async fn play(runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<()> {
    let is_live = sensor.is_live();
    // What is measured now is due now: who waited here, be it for the time that an earlier life was dead, would not listen meanwhile.
    let mut pace = Pace::new(runtime.plan().rate.filter(|_| !is_live));
    runtime.set_total(sensor.total().unwrap_or(0));
    let mut again = runtime.begin(is_live).await?;
    runtime.set_state(ServiceState::Running)?;
    tracing::info!("ready");
    // The last that was measured stays spooled until another is.
    let mut clock = LiveClock::after(again.iter().map(|(stamp_ns, _)| *stamp_ns).max().unwrap_or(0));
    // Messages that the sensor has made.
    let mut made: u64 = 0;
    let mut waiting: Option<(u64, Message)> = None;
    let mut patience = Duration::ZERO;
    // Asked to stop, it goes on at full speed to where an earlier life ended, or no consumer has more of it.
    'playing: while runtime.stop().is_none() || (runtime.stop() == Some(Stop::Asked) && !runtime.may_end()) {
        runtime.attend(patience).await?;
        runtime.serve(Some(made), is_live, |command| sensor.command(command))?;
        patience = Duration::ZERO;
        runtime.set_waits_for(None);
        runtime.set_note(sensor.note());
        let begun = runtime.now();
        let is_late = runtime.stop().is_some() && !runtime.may_end();
        for _ in 0..BATCH {
            if (is_late && runtime.may_end()) || runtime.now().saturating_duration_since(begun) >= LOOK_AFTER {
                break;
            }
            while let Some(command) = runtime.order_at(made) {
                // What it answered was said when it was given.
                let _ = sensor.command(command);
            }
            if !is_live && runtime.ends_here(is_live) {
                break 'playing;
            }
            let (stamp_ns, message) = match waiting.take().or_else(|| again.pop_front()) {
                Some(message) => message,
                None if runtime.ends_here(is_live) => break 'playing,
                // What can be made anew fails anew.
                None if !sensor.is_ready()? => break,
                None => match sensor.next().map_err(|error| if is_live { error } else { judged(error) })? {
                    // Another service of the graph says it.
                    Some((_, message)) if !runtime.writes(message.topic()) => {
                        made += 1;
                        continue;
                    }
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
            if runtime.is_catching_up() || !again.is_empty() || is_late {
                // Some of it was sent by an earlier process: no time is to be lost with that.
                pace.skip_to(stamp_ns, runtime.now());
            }
            patience = pace.until(stamp_ns, runtime.now());
            if patience.is_zero() && runtime.send(stamp_ns, &message)? {
                if is_live {
                    // The next may be waited for within `next`.
                    runtime.ring()?;
                }
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
    let is_stopped = runtime.stop() == Some(Stop::Asked) || runtime.ends_here(is_live);
    // Without it nobody downstream would read on to the end that follows.
    if made == 0
        && is_stopped
        && sensor.is_ready()?
        && let Some((stamp_ns, robot @ Message::Robot(_))) = sensor.next()?
        && runtime.writes(robot.topic())
    {
        runtime.send(stamp_ns, &robot)?;
        runtime.ring()?;
    }
    sensor.close();
    runtime.set_note(sensor.note());
    let is_mute = made == 0 && again.is_empty() && !runtime.has_spoken() && runtime.writes(Topic::RobotDescription);
    if is_mute && runtime.stop() == Some(Stop::Asked) {
        // Without a robot nobody reads on to an end: the launcher asks the others.
        return runtime.leave();
    }
    if runtime.stop() != Some(Stop::Orphaned) {
        runtime.write_down_end()?;
    }
    // What was measured is spooled, and would come again.
    let mut rest = Outbox::default();
    let measured = waiting.into_iter().chain(again).filter(|_| is_live);
    measured.for_each(|(stamp_ns, message)| rest.send(stamp_ns, message));
    runtime.set_state(ServiceState::Draining)?;
    tracing::debug!(asked = runtime.stop().is_some(), "finishes");
    drain(runtime, &mut rest, runtime.stop() != Some(Stop::Orphaned), |_, _| {}).await
}

/// Sends the rest. If the streams `ended`: says so, and waits until every consumer is done with all of it; `welcome` tells
/// whoever comes meanwhile what counts. If the service only leaves early, the rest is for those who go on with the run.
async fn drain(
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
                break;
            }
        }
        runtime.set_waits_for(runtime.awaited_output());
        runtime.attend(LONG).await?;
    }
    runtime.leave()
}
