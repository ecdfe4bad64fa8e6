//! What echogrid's own recorder writes: the messages of a run as they were in shared memory, so that the map of a recording is, byte
//! for byte, that of the run.
//!
//! The stamps are those of the run, which are in order already: nothing is made of them. The streams of a sensor lie one beside the
//! other in the file, each in its order; here they are one again, in the order of their stamps.

mod decode;

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use echogrid_core::{Pose2, Robot, Sideways};

use self::decode::Native;
use super::container::{Channel, Container, Entry};
use super::inventory::Inventory;
use crate::log::carmen::CarmenPlan;
use crate::log::fault::{CountedBy, FaultCounter, FaultKind, Refusal, first_fault};
use crate::log::source::hex;
use crate::log::{ClockReport, LogError, LogEvent, LogFormat, LogReader, LogSurvey};

/// Whether a recording holds what echogrid needs of its own messages.
///
/// # Errors
/// It does, and another echogrid wrote it, whose messages lie otherwise.
pub(crate) fn is_native(path: &Path, inventory: &Inventory) -> Result<bool, LogError> {
    for (topic, schema) in decode::NEEDED {
        let Some(record) = inventory.topics.get(topic) else { return Ok(false) };
        let name = |schema: &str| schema.rsplit_once('/').map(|(name, _version)| name.to_owned());
        if record.datatype != schema && name(&record.datatype) == name(schema) {
            let why = format!(
                "{topic} is of {}, which another version of echogrid recorded; expected {schema}: map it with that one",
                record.datatype
            );
            return Err(LogError::Topics { path: path.to_path_buf(), why, list: inventory.list() });
        }
        if record.datatype != schema {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Surveys a recording of a run.
pub(crate) fn survey(mut container: Box<dyn Container>, path: &Path) -> Result<LogSurvey, LogError> {
    let mut taker = Taker::default();
    let mut found = Found::default();
    let mut number = 0;
    let mut take = |entry: Entry<'_>| match entry {
        Entry::Message { channel, log_ns, data } => {
            number += 1;
            match taker.take(channel, log_ns, data) {
                Ok(Some(Taken::Event(stream, event))) => found.add(stream, &event),
                Ok(Some(Taken::Scan(event, foreign))) => {
                    found.add(2, &event);
                    if foreign > 0 {
                        let what = Refusal::new(FaultKind::MessageDamaged, "a reading of no sensor of the robot");
                        found.faults.count_many(number, what, foreign);
                    }
                }
                Ok(None) => {}
                Err(refusal) => found.faults.count(number, refusal),
            }
        }
        Entry::Damage(refusal) => found.faults.count(number, refusal),
    };
    let failed = |source| LogError::open(path, source);
    while container.advance(&mut take).map_err(failed)? {}
    let stored = container.finish().map_err(failed)?;
    let robot = taker.robot;
    let faults = found.faults.into_faults();
    let [true_pose_count, odometry_count, scan_count] = found.counts;
    let missing = |expected| (path.to_path_buf(), expected, first_fault(&faults));
    if odometry_count == 0 {
        let (path, expected, first_fault) = missing("messages of odometry/raw");
        return Err(LogError::NoOdometry { path, expected, first_fault });
    }
    let Some(robot) = robot.filter(|_| found.readings > 0) else {
        let (path, expected, first_fault) = missing("messages of robot/description and range/scan");
        return Err(LogError::NoReadings { path, expected, first_fault });
    };
    Ok(LogSurvey {
        format: LogFormat::EchogridRecording,
        robot,
        odometry_count,
        scan_count,
        reading_count: found.readings,
        true_pose_count,
        max_readings_per_scan: found.most_readings,
        first_stamp_ns: found.first_ns.unwrap_or(0),
        last_stamp_ns: found.last_ns,
        distance_m: found.distance_m,
        sideways: found.sideways,
        clock: ClockReport { lines: found.counts.iter().sum(), place: CountedBy::Message, ..ClockReport::default() },
        skipped: BTreeMap::new(),
        faults,
        remarks: Vec::new(),
        sha256: hex(stored.hasher),
        params: BTreeMap::new(),
        byte_counts: vec![stored.bytes],
        plan: CarmenPlan::default(),
    })
}

/// Reads the events of a recording that has been surveyed.
pub(crate) fn read(container: Box<dyn Container>, path: &Path, survey: &LogSurvey) -> LogReader {
    LogReader(Box::new(Reader {
        container: Some(container),
        path: path.to_path_buf(),
        surveyed: survey.byte_counts.first().copied().unwrap_or(0),
        shrunk: None,
        taker: Taker::default(),
        merge: Merge::new([survey.true_pose_count, survey.odometry_count, survey.scan_count]),
    }))
}

/// What a survey adds up.
struct Found {
    faults: FaultCounter,
    /// By stream.
    counts: [u64; 3],
    readings: u64,
    most_readings: usize,
    first_ns: Option<u64>,
    last_ns: u64,
    distance_m: f64,
    sideways: Sideways,
    last_pose: Option<Pose2>,
}

impl Default for Found {
    fn default() -> Self {
        Self {
            faults: FaultCounter::new(CountedBy::Message),
            counts: [0; 3],
            readings: 0,
            most_readings: 0,
            first_ns: None,
            last_ns: 0,
            distance_m: 0.0,
            sideways: Sideways::default(),
            last_pose: None,
        }
    }
}

impl Found {
    fn add(&mut self, stream: usize, event: &LogEvent) {
        if let Some(count) = self.counts.get_mut(stream) {
            *count += 1;
        }
        let stamp_ns = event.stamp_ns();
        self.first_ns = Some(self.first_ns.map_or(stamp_ns, |first| first.min(stamp_ns)));
        self.last_ns = self.last_ns.max(stamp_ns);
        match event {
            LogEvent::Odometry { odom_from_base, .. } => {
                self.distance_m += self.last_pose.map_or(0.0, |last| last.distance_m(*odom_from_base));
                self.last_pose = Some(*odom_from_base);
                self.sideways.add(*odom_from_base);
            }
            LogEvent::Scan { readings, .. } => {
                self.readings += readings.len() as u64;
                self.most_readings = self.most_readings.max(readings.len());
            }
            LogEvent::TruePose { .. } => {}
        }
    }
}

/// What came of a message.
enum Taken {
    /// An event of a stream.
    Event(usize, LogEvent),
    /// A scan, and how many of its readings are of no sensor of the robot; they are left out.
    Scan(LogEvent, u64),
}

/// From messages to events; the same in both passes.
#[derive(Default)]
struct Taker {
    /// The first description counts, as in a run.
    robot: Option<Robot>,
    /// Stamp of the last message, by stream.
    last_ns: [u64; 3],
}

impl Taker {
    fn take(&mut self, channel: &Channel, stamp_ns: u64, data: &[u8]) -> Result<Option<Taken>, Refusal> {
        let refused = |why: &str| {
            let what = format!("{} of {} bytes: {why}", channel.topic, data.len());
            Refusal::new(FaultKind::MessageDamaged, what)
        };
        let Some(native) = decode::decode(channel, data) else {
            // What came of it is made anew.
            return Ok(None);
        };
        let native = native.map_err(refused)?;
        let (stream, event) = match native {
            Native::Robot(robot) => {
                self.robot.get_or_insert(robot);
                return Ok(None);
            }
            // It was not known then.
            Native::TruePose(None) => return Ok(None),
            Native::TruePose(Some(map_from_base)) => (0, LogEvent::TruePose { stamp_ns, map_from_base }),
            Native::Odometry { odom_from_base, v_mps, w_radps } => {
                (1, LogEvent::Odometry { stamp_ns, odom_from_base, v_mps, w_radps })
            }
            Native::Scan(readings) => (2, LogEvent::Scan { stamp_ns, readings }),
        };
        let last_ns = self.last_ns.get_mut(stream).ok_or_else(|| refused("of no stream"))?;
        if stamp_ns < *last_ns {
            return Err(refused("earlier than the one before it"));
        }
        *last_ns = stamp_ns;
        let LogEvent::Scan { stamp_ns, mut readings } = event else { return Ok(Some(Taken::Event(stream, event))) };
        let Some(robot) = &self.robot else { return Err(refused("before any description of the robot")) };
        let all = readings.len();
        readings.retain(|reading| robot.transducer(reading.transducer).is_some());
        let foreign = (all - readings.len()) as u64;
        Ok(Some(Taken::Scan(LogEvent::Scan { stamp_ns, readings }, foreign)))
    }
}

/// Streams, each in order, as one; of each it is known how many events there are.
struct Merge {
    waiting: [VecDeque<LogEvent>; 3],
    /// Events that are still to come, by stream.
    left: [u64; 3],
}

impl Merge {
    fn new(left: [u64; 3]) -> Self {
        Self { waiting: [const { VecDeque::new() }; 3], left }
    }

    fn push(&mut self, stream: usize, event: LogEvent) {
        // What the survey did not see came later.
        if let (Some(waiting), Some(left)) = (self.waiting.get_mut(stream), self.left.get_mut(stream))
            && *left > 0
        {
            *left -= 1;
            waiting.push_back(event);
        }
    }

    /// No more follows.
    fn finish(&mut self) {
        self.left = [0; 3];
    }

    /// The next of all, when none that is still to come can be earlier.
    fn pop(&mut self) -> Option<LogEvent> {
        let is_open = self.waiting.iter().zip(self.left).any(|(waiting, left)| waiting.is_empty() && left > 0);
        if is_open {
            return None;
        }
        let fronts = self.waiting.iter_mut().filter(|waiting| !waiting.is_empty());
        fronts.min_by_key(|waiting| waiting.front().map(LogEvent::stamp_ns))?.pop_front()
    }
}

struct Reader {
    /// None after its end.
    container: Option<Box<dyn Container>>,
    path: PathBuf,
    /// Bytes of the file when it was surveyed.
    surveyed: u64,
    /// What is said after the last event.
    shrunk: Option<LogError>,
    taker: Taker,
    merge: Merge,
}

impl Reader {
    /// Reads on, by a chunk or so.
    fn advance(&mut self) -> std::io::Result<()> {
        let Some(container) = &mut self.container else { return Ok(()) };
        let (taker, merge) = (&mut self.taker, &mut self.merge);
        let goes_on = container.advance(&mut |entry| {
            let Entry::Message { channel, log_ns, data } = entry else { return };
            // What is refused has been counted by the survey.
            match taker.take(channel, log_ns, data) {
                Ok(Some(Taken::Event(stream, event))) => merge.push(stream, event),
                Ok(Some(Taken::Scan(event, _))) => merge.push(2, event),
                Ok(None) | Err(_) => {}
            }
        })?;
        if goes_on {
            return Ok(());
        }
        self.merge.finish();
        let Some(container) = self.container.take() else { return Ok(()) };
        let (left, surveyed) = (container.finish()?.bytes, self.surveyed);
        self.shrunk = (left < surveyed).then(|| LogError::Shrunk { path: self.path.clone(), surveyed, left });
        Ok(())
    }
}

impl Iterator for Reader {
    type Item = Result<LogEvent, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(event) = self.merge.pop() {
                return Some(Ok(event));
            }
            if self.container.is_none() {
                return self.shrunk.take().map(Err);
            }
            if let Err(source) = self.advance() {
                self.container = None;
                return Some(Err(LogError::open(&self.path, source)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_one_again_in_the_order_of_their_stamps() {
        let odometry =
            |stamp_ns| LogEvent::Odometry { stamp_ns, odom_from_base: Pose2::IDENTITY, v_mps: 0.0, w_radps: 0.0 };
        let scan = |stamp_ns| LogEvent::Scan { stamp_ns, readings: Vec::new() };
        let mut merge = Merge::new([0, 3, 2]);
        let mut given = Vec::new();
        for (stream, event) in [(2, scan(2)), (1, odometry(1)), (1, odometry(2)), (2, scan(4)), (1, odometry(5))] {
            merge.push(stream, event);
            given.extend(std::iter::from_fn(|| merge.pop()));
        }
        assert_eq!(given, [odometry(1), odometry(2), scan(2), scan(4), odometry(5)]);
    }
}
