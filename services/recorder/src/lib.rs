//! A run in a file: every topic as it was in shared memory, so that the map of the recording is that of the run, and what they say in
//! Foxglove's well-known messages beside it.
//!
//! As a service of a graph the recorder *reads* what a map is made of, and the poses and tiles that come of it: producers stay within
//! their windows of what is in the file, so nothing is missing in it, whoever is killed. It costs the others no more than that: when
//! it can't write it says so, ends the recording, and takes in what comes as before. What it only looks on at it may miss, and counts.
//! Started by hand ([`record`]) it only looks on.

mod by_hand;
pub mod config;
mod recording;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
pub use by_hand::record;
use config::RecorderConfig;
use echogrid_core::Robot;
use echogrid_core::parts::{Parts, Saved};
use echogrid_formats::log::{McapWriter, RunWords};
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, in_words, process};
use echogrid_topics::{Message, Topic};
use serde::Deserialize;

pub use crate::recording::Recorded;
use crate::recording::{Recording, words_of};

/// All that it records: what it is waited for on, then what it takes what comes of.
pub const INPUTS: &[Topic] = &[
    Topic::RobotDescription,
    Topic::TruePose,
    Topic::OdometryRaw,
    Topic::RangeScan,
    Topic::OdometryEstimate,
    Topic::MapTiles,
    Topic::TrueWorld,
    Topic::RangeVerdict,
    Topic::MapInfo,
    Topic::LocalizationRequest,
    Topic::LocalizationFix,
    Topic::Health,
];
const READS_AND_LOOKS_ON: (&[Topic], &[Topic]) = INPUTS.split_at(6);
/// What it declares of itself.
pub const DECLARATION: Declaration =
    Declaration { reads: READS_AND_LOOKS_ON.0, looks_on: READS_AND_LOOKS_ON.1, writes: &[], orders: &[] };

/// Whether a recording goes on to the end of its run: one that ended early, or is not there, does not.
#[must_use]
pub fn is_whole(file: &Path) -> bool {
    McapWriter::is_finished(file).unwrap_or(false)
}

/// The part of `[run]` that the recorder needs.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
}

/// The recorder service.
#[derive(Debug)]
pub struct RecorderService {
    file: PathBuf,
    config: RecorderConfig,
    /// What the recording says of its run.
    run: RunWords,
    /// Whether what is stored of this service outlives the machine: then what is in the file by then must, too.
    is_synced: bool,
    robot: Option<Robot>,
    state: State,
}

/// How far the recording is.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of it")]
enum State {
    /// Not begun; an earlier life has written so much.
    Ahead(Option<u64>),
    Open(Recording),
    /// Nothing can be written any more, which has been said.
    Over,
}

impl RecorderService {
    /// Records to `file`.
    #[must_use]
    pub fn new(file: PathBuf, config: RecorderConfig) -> Self {
        Self { file, config, run: RunWords::new(), is_synced: false, robot: None, state: State::Ahead(None) }
    }

    /// Makes the recorder from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let run: Run = plan.section("run")?;
        let config: RecorderConfig = plan.section("recorder")?;
        Ok(Self { is_synced: plan.synced, run: words_of(plan, true), ..Self::new(config.path(&run.out), config) })
    }

    /// The recording, opened if it is not yet; none when it is over.
    fn open(&mut self) -> Option<&mut Recording> {
        if let State::Ahead(length) = self.state {
            let opened = match length {
                Some(length) => Recording::resume(&self.file, length, self.config.foxglove),
                None => Recording::begin(&self.file, self.config.foxglove, &self.run),
            };
            match opened {
                Ok(mut recording) => {
                    self.robot.iter().for_each(|robot| recording.knows(robot));
                    self.state = State::Open(recording);
                }
                Err(error) => self.give_up(&error),
            }
        }
        match &mut self.state {
            State::Open(recording) => Some(recording),
            State::Ahead(_) | State::Over => None,
        }
    }

    /// Does something with the recording, if there is one; when that fails it is over.
    fn with<T>(&mut self, what: impl FnOnce(&mut Recording) -> std::io::Result<T>) -> Option<T> {
        match what(self.open()?) {
            Ok(done) => Some(done),
            Err(error) => {
                let error = anyhow::Error::new(error).context(self.file.display().to_string());
                self.give_up(&error);
                None
            }
        }
    }

    fn give_up(&mut self, error: &anyhow::Error) {
        self.state = State::Over;
        tracing::error!("{}: the recording ends here; the graph goes on without it", in_words(error));
    }

    fn finish(&mut self) -> Result<()> {
        // A run without a message has a recording, too.
        self.open();
        let State::Open(recording) = std::mem::replace(&mut self.state, State::Over) else { return Ok(()) };
        let recorded = recording.finish(0).with_context(|| self.file.display().to_string());
        match recorded {
            Ok(Recorded { messages, missed }) => {
                tracing::info!(messages, missed, file = %self.file.display(), "recorded");
            }
            Err(error) => self.give_up(&error),
        }
        Ok(())
    }
}

impl Service for RecorderService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { sequence, stamp_ns, message } => {
                if let Message::Robot(robot) = &message {
                    self.robot = Some(robot.clone());
                }
                self.with(|recording| recording.take(sequence, stamp_ns, message));
                Ok(())
            }
            Input::Finish => self.finish(),
        }
    }

    /// Not every sensor knows the truth, and no service but the localizer asks.
    fn outlives(&self, topic: Topic) -> bool {
        !matches!(topic, Topic::TruePose | Topic::LocalizationRequest)
    }

    /// How much of the file counts: who goes on cuts off what follows, which comes again.
    fn save(&mut self, parts: &mut Parts) {
        let is_synced = self.is_synced;
        let length: Option<u64> = self.with(|recording| {
            let length = recording.flush()?;
            if is_synced {
                recording.sync()?;
            }
            Ok(length)
        });
        parts.put_value("length", &length);
        parts.put_value("robot", &self.robot);
        parts.put_value("over", &matches!(self.state, State::Over));
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.robot = saved.value("robot")?;
        self.state = match saved.value("over")? {
            true => State::Over,
            false => State::Ahead(saved.value("length")?),
        };
        Ok(())
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("recorder", INPUTS, &[], RecorderService::from_plan)
}
