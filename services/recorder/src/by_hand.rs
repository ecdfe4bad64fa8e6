//! `echogrid record`: a graph that runs already is recorded by somebody who looks on.

use std::path::Path;

use anyhow::{Context, Result};
use echogrid_service::onlooker::{ANSWER_WITHIN, Onlooker, Operator};
use echogrid_service::signals::Signals;
use echogrid_service::{Plan, in_words};
use echogrid_topics::{Command, Domain};
use nix::sys::signal::Signal;

use crate::INPUTS;
use crate::recording::{Recorded, Recording, words_of};

/// What this process calls itself.
const NAME: &str = "record";

/// Records the graph that runs in `domain` until it is over, or this process is told to end.
///
/// # Errors
/// There is no such graph, or the file can't be written.
pub fn record(domain: &Domain, file: &Path, with_foxglove: bool) -> Result<Recorded> {
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
    let mut onlooker = Onlooker::enter(domain, NAME, INPUTS)?;
    let run = words_of(&Plan::read(domain)?, false);
    let mut recording = Recording::begin(file, with_foxglove, &run)?;
    let failed = || file.display().to_string();
    loop {
        let is_over = signals.next()?.is_some();
        let mut outcome = Ok(());
        let was_there = onlooker.take_in_numbered(|sequence, stamp_ns, message| {
            if outcome.is_ok() {
                outcome = recording.take(sequence, stamp_ns, message);
            }
        })?;
        outcome.with_context(failed)?;
        recording.flush_if_due().with_context(failed)?;
        if is_over || !was_there {
            break;
        }
        if onlooker.misses_tiles() {
            // It is asked for again as long as tiles are missing.
            let operator = Operator::enter(domain, NAME);
            let asked = operator.and_then(|operator| operator.order("mapper", Command::Tiles, ANSWER_WITHIN));
            if let Err(error) = asked {
                tracing::debug!("asking for the whole map: {}", in_words(&error));
            }
        }
        onlooker.wait(&signals)?;
    }
    recording.finish(onlooker.lost()).with_context(failed)
}
