//! A recording that is being made.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use echogrid_core::Robot;
use echogrid_formats::log::{McapChannel, McapWriter, RUN_SETTINGS, RunWords, words_of_run};
use echogrid_scene::{Channel, Show, Sink};
use echogrid_service::Plan;
use echogrid_topics::{Delivery, Message, Topic, wire};

/// What is in memory goes to the file this often …
const FLUSH_EVERY: Duration = Duration::from_millis(250);
/// … and from the file to the disk this often: a power cut takes no more.
const SYNC_EVERY: Duration = Duration::from_millis(500);
/// The whole map is recorded at most this often; tiles that changed are in between.
const MAP_EVERY: Duration = Duration::from_secs(5);
/// No message fits into so much of a file.
const HEAD_BYTES: u64 = 64;
/// The key of a run's words for what tells it from any other.
const EPOCH: &str = "epoch";
/// The key for who recorded it.
const SOFTWARE: &str = "software";
/// How messages are encoded that are as they were in shared memory.
const NATIVE: &str = "echogrid";

/// What came of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recorded {
    /// Messages that are in it.
    pub messages: u64,
    /// Messages that were sent meanwhile and are not: it did not keep up.
    pub missed: u64,
}

/// A recording that is being made.
#[derive(Debug)]
pub(crate) struct Recording {
    file: Mcap,
    /// None: echogrid's own messages are all that is recorded.
    show: Option<Show>,
    flushed: Instant,
    synced: Instant,
}

/// The file, and its streams.
#[derive(Debug)]
struct Mcap {
    writer: McapWriter,
    native: BTreeMap<Topic, u16>,
    shown: BTreeMap<Channel, u16>,
    messages: u64,
    /// Messages that were sent and did not come, of those that may be dropped.
    missed: u64,
    /// The number of the last message of these topics.
    last: BTreeMap<Topic, u64>,
    /// The latest stamp of the sensor: who has no clock of its own is recorded at it.
    latest_ns: u64,
    /// The first error of those that can't be handed on at once.
    failure: Option<std::io::Error>,
}

impl Recording {
    /// Begins a file, in which nothing is recorded yet, with what it says of the run.
    pub(crate) fn begin(path: &Path, with_foxglove: bool, run: &RunWords) -> Result<Self> {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| format!("{}: making the folder", folder.display()))?;
        }
        let beginning = || format!("{}: beginning the recording", path.display());
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let file = file.with_context(beginning)?;
        // Who was killed at once has left a file of no message; or one of this very run, of which nothing counts: it comes again.
        let bytes = file.metadata().with_context(beginning)?.len();
        let is_ours = || run.contains_key(EPOCH) && words_of_run(path).ok().flatten().as_ref() == Some(run);
        ensure!(
            bytes <= HEAD_BYTES || is_ours(),
            "{}: holds something already, and a recording is never replaced",
            path.display()
        );
        file.set_len(0).with_context(beginning)?;
        Self::of(McapWriter::new(file, &library(), run), path, with_foxglove)
    }

    /// Goes on with a file of which `length` bytes count, or with as much of them as the disk has kept.
    pub(crate) fn resume(path: &Path, length: u64, with_foxglove: bool) -> Result<Self> {
        let file = File::options().read(true).write(true).open(path);
        let file = file.with_context(|| format!("{}: going on with the recording", path.display()))?;
        let kept = file.metadata().with_context(|| path.display().to_string())?.len();
        if kept < length {
            let lost = length - kept;
            tracing::warn!(lost, file = %path.display(), "the disk has not kept the last bytes of the recording");
        }
        Self::of(McapWriter::resume(file, length), path, with_foxglove)
    }

    fn of(writer: std::io::Result<McapWriter>, path: &Path, with_foxglove: bool) -> Result<Self> {
        let writer = writer.with_context(|| path.display().to_string())?;
        let (native, shown) = (BTreeMap::new(), BTreeMap::new());
        let now = Instant::now();
        Ok(Self {
            file: Mcap {
                writer,
                native,
                shown,
                messages: 0,
                missed: 0,
                last: BTreeMap::new(),
                latest_ns: 0,
                failure: None,
            },
            show: with_foxglove.then(|| Show::new(MAP_EVERY)),
            flushed: now,
            synced: now,
        })
    }

    /// What was recorded before tells of this robot, which is not told of again.
    pub(crate) fn knows(&mut self, robot: &Robot) {
        if let Some(show) = &mut self.show {
            show.take(0, Message::Robot(robot.clone()), &mut self.file);
        }
    }

    /// Records a message.
    pub(crate) fn take(&mut self, sequence: u64, stamp_ns: u64, message: Message) -> std::io::Result<()> {
        let stamp_ns = self.file.native(sequence, stamp_ns, &message)?;
        if let Some(show) = &mut self.show {
            show.take(stamp_ns, message, &mut self.file);
        }
        self.flush_if_due()
    }

    /// Writes what is in memory to the file, if it is time to.
    pub(crate) fn flush_if_due(&mut self) -> std::io::Result<()> {
        if self.flushed.elapsed() >= FLUSH_EVERY { self.flush().map(drop) } else { self.file.check() }
    }

    /// Writes what is in memory to the file; how long it is then, bytes.
    pub(crate) fn flush(&mut self) -> std::io::Result<u64> {
        if let Some(show) = &mut self.show {
            show.tell_what_is_due(false, &mut self.file);
        }
        self.file.check()?;
        self.flushed = Instant::now();
        let length = self.file.writer.flush()?;
        if self.synced.elapsed() >= SYNC_EVERY {
            self.sync()?;
        }
        Ok(length)
    }

    /// What is in the file survives a power cut.
    pub(crate) fn sync(&mut self) -> std::io::Result<()> {
        self.synced = Instant::now();
        self.file.writer.sync()
    }

    /// Ends the file; how many messages this process has recorded, and missed: `missed` besides those that it knows of.
    pub(crate) fn finish(mut self, missed: u64) -> std::io::Result<Recorded> {
        if let Some(show) = &mut self.show {
            show.tell_what_is_due(true, &mut self.file);
        }
        self.file.check()?;
        let recorded = Recorded { messages: self.file.messages, missed: missed + self.file.missed };
        self.file.writer.finish("echogrid", &BTreeMap::from([("missed".to_owned(), recorded.missed.to_string())]))?;
        Ok(recorded)
    }
}

impl Mcap {
    /// Records a message as it was in shared memory; at which stamp.
    fn native(&mut self, sequence: u64, stamp_ns: u64, message: &Message) -> std::io::Result<u64> {
        let topic = message.topic();
        // A sensor's clock may begin at 0.
        let is_untimed = topic == Topic::Health || stamp_ns == 0 && !topic.delivery().is_stream();
        let stamp_ns = if is_untimed { self.latest_ns } else { stamp_ns };
        self.latest_ns = self.latest_ns.max(stamp_ns);
        if topic.delivery() == Delivery::Droppable {
            // Another life of its producer begins at 1.
            let last = self.last.insert(topic, sequence).filter(|last| *last < sequence);
            self.missed += last.map_or(0, |last| sequence - last - 1);
        }
        let channel = match self.native.get(&topic) {
            Some(channel) => *channel,
            None => {
                let channel = self.writer.channel(&native(topic))?;
                self.native.insert(topic, channel);
                channel
            }
        };
        self.messages += 1;
        self.writer.message(channel, sequence, stamp_ns, &message.bytes())?;
        Ok(stamp_ns)
    }

    fn shown(&mut self, channel: Channel, stamp_ns: u64, message: &[u8]) -> std::io::Result<()> {
        let number = match self.shown.get(&channel) {
            Some(number) => *number,
            None => {
                let number = self.writer.channel(&channel.described())?;
                self.shown.insert(channel, number);
                number
            }
        };
        let stamp_ns = if stamp_ns == 0 { self.latest_ns } else { stamp_ns };
        self.writer.message(number, 0, stamp_ns, message)
    }

    fn check(&mut self) -> std::io::Result<()> {
        self.failure.take().map_or(Ok(()), Err)
    }
}

impl Sink for Mcap {
    fn wants(&self, _: Channel) -> bool {
        self.failure.is_none()
    }

    fn put(&mut self, channel: Channel, stamp_ns: u64, message: &[u8]) {
        if self.failure.is_none() {
            self.failure = self.shown(channel, stamp_ns, message).err();
        }
    }
}

/// The stream of a topic, as it is in shared memory.
fn native(topic: Topic) -> McapChannel {
    McapChannel {
        topic: topic.name().to_owned(),
        encoding: NATIVE.to_owned(),
        schema_name: topic.layout().schema.to_owned(),
        schema_encoding: format!("{NATIVE}-layout"),
        schema: wire::layout_of(topic).into_bytes(),
    }
}

/// What a recording says of the run that has this plan; `from_its_beginning`: nobody else records it into the same file.
pub(crate) fn words_of(plan: &Plan, from_its_beginning: bool) -> RunWords {
    let mut words = RunWords::from([(SOFTWARE.to_owned(), library())]);
    if from_its_beginning {
        words.insert(EPOCH.to_owned(), plan.epoch.to_string());
    }
    let settings = plan.config.get(Plan::SETTINGS).and_then(|settings| settings.as_str());
    words.extend(settings.map(|settings| (RUN_SETTINGS.to_owned(), settings.to_owned())));
    words
}

fn library() -> String {
    format!("echogrid {}", env!("CARGO_PKG_VERSION"))
}
