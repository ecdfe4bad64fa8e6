//! Processes that are no service of the graph, and meddle until their standard input closes.

use std::io::Write;
use std::os::fd::AsFd;
use std::time::Duration;

use anyhow::{Result, bail};
use echogrid_service::Plan;
use echogrid_topics::{Input, Output, Participant, Topic};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::Mode;
use super::reader::PER_MESSAGE;
use super::walk::{garbled, scan};

/// Messages of garbage.
const GARBAGE: u64 = 30;
const FOREVER: Option<Duration> = None;

pub(super) fn meddle(mode: Mode, topic: Topic) -> Result<()> {
    let domain = super::domain()?;
    let participant = Participant::join(&domain, "stranger")?;
    if mode == Mode::SlowReader {
        let mut port = Input::open(&participant, topic)?;
        say("reading")?;
        while !is_over(Some(PER_MESSAGE))? {
            port.hush()?;
            port.receive()?;
        }
        return Ok(());
    }
    let plan = Plan::read(&domain)?;
    // It does not know which run this is.
    let mut port = Output::open(&participant, topic, plan.max_readings, plan.epoch ^ 2, &[])?;
    for number in 1..=GARBAGE {
        let (stamp_ns, message) = match topic {
            Topic::OdometryRaw => garbled(number * super::walk::GARBLED_EVERY),
            Topic::RangeScan => scan(number),
            other => bail!("no garbage for {}", other.name()),
        };
        port.send(stamp_ns, &message)?;
    }
    port.ring()?;
    say("sent")?;
    // What it sent would go with it.
    is_over(FOREVER).map(drop)
}

fn say(what: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{what}")?;
    Ok(out.flush()?)
}

/// Whether standard input has closed, within `patience`.
fn is_over(patience: Option<Duration>) -> Result<bool> {
    let stdin = std::io::stdin();
    let mut fds = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
    let timeout = patience.map_or(PollTimeout::NONE, |patience| PollTimeout::from(patience.as_millis() as u16));
    Ok(poll(&mut fds, timeout)? > 0)
}
