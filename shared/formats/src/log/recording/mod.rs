//! Recordings: many streams of messages in one file, of which a log is made.
//!
//! | file | module |
//! |---|---|
//! | ROS 1 bag, version 2.0 | [`bag`] |
//! | MCAP | [`mcap`]; [`mcap_writer`] writes it |
//! | rosbag2's `.db3` | [`database`], which reads [`sqlite`] |
//! | folder of rosbag2 | [`folder`] |
//!
//! A recording is read three times, as a stream each time: [`inventory`] learns what is in it, [`plan`] chooses of that what is used
//! and as what, and [`translate`] then gives the messages of a log, to the survey and to the replay. What echogrid itself recorded is in
//! order already: [`native`]; with which settings, [`run`].

pub(crate) mod bag;
mod container;
mod contents;
mod database;
pub(crate) mod folder;
mod frames;
pub(crate) mod inventory;
pub(crate) mod mcap;
mod mcap_writer;
mod message;
mod native;
mod plan;
mod run;
mod sqlite;
mod translate;
mod wire;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;

pub(crate) use container::Container;
use container::Entry;
pub use contents::{RecordingContents, TopicContents};
use folder::Chain;
pub(crate) use folder::Files;
use inventory::Inventory;
pub use mcap_writer::{McapChannel, McapWriter};
pub(crate) use native::{is_native, read as read_native, survey as survey_native};
pub(crate) use plan::RecordingPlan;
pub use run::{RUN_SETTINGS, RunWords, words_of_run};
use translate::Translator;

use super::carmen::message::Message;
use super::detect::open_file;
use super::fault::Refusal;
use super::{LogError, LogFormat, SurveyOptions};
use crate::open_regular;

/// One file of a recording, of which at most so many bytes are read.
fn container(path: &Path, format: LogFormat, stored: File, bytes: u64) -> std::io::Result<Box<dyn Container>> {
    Ok(match format {
        LogFormat::Mcap => Box::new(mcap::Mcap::new(stored.take(bytes))?),
        LogFormat::Rosbag2 => Box::new(database::Database::new(path, stored)?),
        _ => Box::new(bag::Bag::new(stored.take(bytes))?),
    })
}

/// Opens a recording, to be read from its beginning; of a single file at most so many bytes are read.
pub(crate) fn open(files: &Files, format: LogFormat, bytes: u64) -> Result<Box<dyn Container>, LogError> {
    match files.paths.as_slice() {
        [path] if !files.packs_messages => {
            let stored = open_file(path)?;
            container(path, format, stored, bytes).map_err(|source| LogError::open(path, source))
        }
        _ => Ok(Box::new(Chain::new(
            files.clone(),
            Box::new(move |path| container(path, format, open_regular(path)?, u64::MAX)),
        ))),
    }
}

/// The recording that begins so, if it is one.
pub(crate) fn format_of(head: &[u8]) -> Option<LogFormat> {
    if head.starts_with(bag::MAGIC) {
        Some(LogFormat::RosBag)
    } else if head.starts_with(mcap::MAGIC) {
        Some(LogFormat::Mcap)
    } else if head.starts_with(sqlite::MAGIC) {
        Some(LogFormat::Rosbag2)
    } else {
        None
    }
}

/// Learns what is in a recording.
pub(crate) fn inventory(path: &Path, mut container: Box<dyn Container>) -> Result<Inventory, LogError> {
    let mut inventory = Inventory::default();
    while container.advance(&mut |entry| inventory.add(&entry)).map_err(|source| LogError::open(path, source))? {}
    Ok(inventory)
}

/// Chooses what of a recording is used.
pub(crate) fn choose(path: &Path, inventory: &Inventory, options: &SurveyOptions) -> Result<RecordingPlan, LogError> {
    RecordingPlan::new(path, inventory, options)
}

/// The messages of a log, out of a recording.
pub(crate) struct Messages {
    container: Box<dyn Container>,
    translator: Translator,
    /// Messages of the recording so far.
    number: u64,
}

impl Messages {
    pub(crate) fn new(container: Box<dyn Container>, plan: Arc<RecordingPlan>) -> Self {
        Self { container, translator: Translator::new(plan), number: 0 }
    }

    /// Reads on; false at the end. Each message comes with its number, counted from 1.
    pub(crate) fn advance(
        &mut self,
        take: &mut dyn FnMut(u64, Result<Message<'static>, Refusal>),
    ) -> std::io::Result<bool> {
        let Self { container, translator, number } = self;
        container.advance(&mut |entry| match entry {
            Entry::Message { channel, log_ns, data } => {
                *number += 1;
                translator.message(channel, log_ns, data, &mut |message| take(*number, message));
            }
            Entry::Damage(refusal) => take(*number, Err(refusal)),
        })
    }

    pub(crate) fn into_container(self) -> Box<dyn Container> {
        self.container
    }
}
