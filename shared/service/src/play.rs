//! The loop of a sensor's life.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_topics::{Message, ServiceState, Topic};

use crate::life::{BATCH, LONG, LOOK_AFTER, drain, judged};
use crate::live_clock::LiveClock;
use crate::pace::Pace;
use crate::runtime::{Runtime, Stop};
use crate::{Outbox, Sensor};

/// The life of a sensor: plays its messages at the planned rate, within the windows of the consumers, says when the stream
/// ends, leaves when all is integrated.
///
/// # Errors
/// The sensor failed, or the outside refuses.
pub async fn play(runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<()> {
    let mut player = Player::begin(runtime, sensor).await?;
    runtime.set_state(ServiceState::Running)?;
    tracing::info!("ready");
    // Asked to stop, it goes on at full speed to where an earlier life ended, or no consumer has more of it.
    while runtime.stop().is_none() || (runtime.stop() == Some(Stop::Asked) && !runtime.may_end()) {
        runtime.attend(player.patience).await?;
        runtime.serve(Some(player.made), player.is_live, |command| sensor.command(command))?;
        runtime.set_waits_for(None);
        runtime.set_note(sensor.note());
        if !player.play_some(runtime, sensor)? {
            break;
        }
        runtime.ring()?;
    }
    player.end(runtime, sensor).await
}

/// What a sensor has made, and sends when it is due.
struct Player {
    is_live: bool,
    pace: Pace,
    clock: LiveClock,
    /// What an earlier life measured, and nobody downstream has stored.
    again: VecDeque<(u64, Message)>,
    /// Messages that the sensor has made.
    made: u64,
    /// It is not due yet, or nobody has room for it.
    waiting: Option<(u64, Message)>,
    /// How long there is nothing to do.
    patience: Duration,
}

/// What comes next.
#[expect(clippy::large_enum_variant, reason = "nearly all are messages: a box for each would cost more than it saves")]
enum Next {
    Message(u64, Message),
    /// Another service of the graph says it.
    Skipped,
    NotYet,
    End,
}

impl Player {
    async fn begin(runtime: &mut Runtime, sensor: &impl Sensor) -> Result<Self> {
        let is_live = sensor.is_live();
        // What is measured now is due now: who waited here, be it for the time that an earlier life was dead, would not listen meanwhile.
        let pace = Pace::new(runtime.plan().rate.filter(|_| !is_live));
        runtime.set_total(sensor.total().unwrap_or(0));
        let again = runtime.begin(is_live).await?;
        // The last that was measured stays spooled until another is.
        let clock = LiveClock::after(again.iter().map(|(stamp_ns, _)| *stamp_ns).max().unwrap_or(0));
        Ok(Self { is_live, pace, clock, again, made: 0, waiting: None, patience: Duration::ZERO })
    }

    /// Sends what is due, as long as there is room for it; whether more may come.
    fn play_some(&mut self, runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<bool> {
        self.patience = Duration::ZERO;
        let begun = runtime.now();
        let is_late = runtime.stop().is_some() && !runtime.may_end();
        for _ in 0..BATCH {
            if (is_late && runtime.may_end()) || is_over(begun, runtime) {
                break;
            }
            while let Some(command) = runtime.order_at(self.made) {
                // What it answered was said when it was given.
                let _ = sensor.command(command);
            }
            if !self.is_live && runtime.ends_here(false) {
                return Ok(false);
            }
            let (stamp_ns, message) = match self.next(runtime, sensor)? {
                Next::Message(stamp_ns, message) => (stamp_ns, message),
                Next::Skipped => continue,
                Next::NotYet => break,
                Next::End => return Ok(false),
            };
            if runtime.is_catching_up() || !self.again.is_empty() || is_late {
                // Some of it was sent by an earlier process: no time is to be lost with that.
                self.pace.skip_to(stamp_ns, runtime.now());
            }
            if !self.send(runtime, stamp_ns, message)? {
                break;
            }
        }
        Ok(true)
    }

    fn next(&mut self, runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<Next> {
        if let Some((stamp_ns, message)) = self.waiting.take().or_else(|| self.again.pop_front()) {
            return Ok(Next::Message(stamp_ns, message));
        }
        if runtime.ends_here(self.is_live) {
            return Ok(Next::End);
        }
        if !sensor.is_ready()? {
            return Ok(Next::NotYet);
        }
        // What can be made anew fails anew.
        let next = sensor.next().map_err(|error| if self.is_live { error } else { judged(error) })?;
        let Some((mut stamp_ns, message)) = next else { return Ok(Next::End) };
        self.made += 1;
        if !runtime.writes(message.topic()) {
            return Ok(Next::Skipped);
        }
        if self.is_live {
            stamp_ns = self.clock.stamp_ns(message.topic(), stamp_ns);
            runtime.spool(stamp_ns, &message)?;
        }
        Ok(Next::Message(stamp_ns, message))
    }

    /// Sends a message, or keeps it until it is due and there is room for it; whether it was sent.
    fn send(&mut self, runtime: &mut Runtime, stamp_ns: u64, message: Message) -> Result<bool> {
        self.patience = self.pace.until(stamp_ns, runtime.now());
        let is_due = self.patience.is_zero();
        if is_due && runtime.send(stamp_ns, &message)? {
            if self.is_live {
                // The next may be waited for within `next`.
                runtime.ring()?;
            }
            return Ok(true);
        }
        if is_due {
            // No room: an acknowledgement is what to wait for.
            self.patience = LONG;
            runtime.set_waits_for(Some(message.topic()));
        }
        self.waiting = Some((stamp_ns, message));
        Ok(false)
    }

    /// Says where the stream ends, and leaves when all of it is integrated.
    async fn end(self, runtime: &mut Runtime, sensor: &mut impl Sensor) -> Result<()> {
        let is_stopped = runtime.stop() == Some(Stop::Asked) || runtime.ends_here(self.is_live);
        // Without it nobody downstream would read on to the end that follows.
        if self.made == 0
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
        let has_said = self.made > 0 || !self.again.is_empty() || runtime.has_spoken();
        if !has_said && runtime.writes(Topic::RobotDescription) && runtime.stop() == Some(Stop::Asked) {
            // Without a robot nobody reads on to an end: the launcher asks the others.
            return runtime.leave();
        }
        if runtime.stop() != Some(Stop::Orphaned) {
            runtime.write_down_end()?;
        }
        // What was measured is spooled, and would come again.
        let mut rest = Outbox::default();
        let measured = self.waiting.into_iter().chain(self.again).filter(|_| self.is_live);
        measured.for_each(|(stamp_ns, message)| rest.send(stamp_ns, message));
        runtime.set_state(ServiceState::Draining)?;
        tracing::debug!(asked = runtime.stop().is_some(), "finishes");
        drain(runtime, &mut rest, runtime.stop() != Some(Stop::Orphaned), |_, _| {}).await
    }
}

/// Whether it is time to look at signals and acknowledgements again.
fn is_over(begun: Instant, runtime: &Runtime) -> bool {
    runtime.now().saturating_duration_since(begun) >= LOOK_AFTER
}
