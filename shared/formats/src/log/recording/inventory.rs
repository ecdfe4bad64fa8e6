//! What is in a recording, learnt by reading it once: topics, their frames, how frames stand in each other.

use std::collections::BTreeMap;

use super::container::{Channel, Entry};
use super::frames::Frames;
use super::message::{Head, LaserScan, Placed, Range, Type};
use super::wire::Fields;
use crate::log::fault::Refusal;

/// Topics that are told apart.
const TOPICS_MAX: usize = 4096;
/// Frames of one topic that are told apart.
const FRAMES_MAX: usize = 512;

/// One topic.
#[derive(Debug, Clone, Default)]
pub(crate) struct TopicRecord {
    /// As the recording names it; of several the first.
    pub(crate) datatype: String,
    pub(crate) kind: Option<Type>,
    pub(crate) count: u64,
    pub(crate) first_ns: u64,
    pub(crate) last_ns: u64,
    /// Messages that are not what their type says.
    pub(crate) damaged: u64,
    /// Messages by the frame that they are in, and the frame that they place.
    pub(crate) frames: BTreeMap<(String, String), u64>,
    /// The least time that passed from the stamp of a message until it was recorded, nanoseconds; none: they have no stamps.
    pub(crate) least_delay_ns: Option<i128>,
}

impl TopicRecord {
    /// Messages per second.
    pub(crate) fn rate_hz(&self) -> f64 {
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9;
        if seconds > 0.0 { (self.count.saturating_sub(1)) as f64 / seconds } else { 0.0 }
    }
}

/// What is in a recording.
#[derive(Debug, Clone, Default)]
pub(crate) struct Inventory {
    pub(crate) topics: BTreeMap<String, TopicRecord>,
    pub(crate) frames: Frames,
    pub(crate) messages: u64,
    /// How often something of the file could not be read, and what was wrong first.
    damage: Option<(u64, String)>,
}

impl Inventory {
    pub(crate) fn add(&mut self, entry: &Entry<'_>) {
        let (channel, log_ns, data) = match entry {
            Entry::Message { channel, log_ns, data } => (channel, log_ns, data),
            Entry::Damage(refusal) => return self.note(refusal),
        };
        self.messages += 1;
        if self.topics.len() >= TOPICS_MAX && !self.topics.contains_key(&channel.topic) {
            return;
        }
        let kind = Type::of(channel);
        let topic = self.topics.entry(channel.topic.clone()).or_insert_with(|| TopicRecord {
            datatype: channel.datatype.clone(),
            kind,
            first_ns: *log_ns,
            last_ns: *log_ns,
            ..TopicRecord::default()
        });
        topic.count += 1;
        topic.first_ns = topic.first_ns.min(*log_ns);
        topic.last_ns = topic.last_ns.max(*log_ns);
        let Some(kind) = kind else { return };
        match heads(kind, channel, data) {
            Some(Found::One(head, child)) => topic.note(&head, &child, *log_ns),
            Some(Found::Transforms(transforms)) => {
                for placed in transforms {
                    topic.note(&placed.head, &placed.child, *log_ns);
                    let Head { stamp_ns, frame } = &placed.head;
                    match placed.transform {
                        Some(transform) => self.frames.add(frame, &placed.child, *stamp_ns, *log_ns, transform),
                        None => topic.damaged += 1,
                    }
                }
            }
            None => topic.damaged += 1,
        }
    }

    fn note(&mut self, damage: &Refusal) {
        match &mut self.damage {
            Some((count, _)) => *count += 1,
            None => self.damage = Some((1, format!("{} ({})", damage.kind, damage.sample))),
        }
    }

    /// The topics of a type, with their names.
    pub(crate) fn of(&self, kind: Type) -> impl Iterator<Item = (&str, &TopicRecord)> {
        self.topics
            .iter()
            .filter(move |(_, topic)| topic.kind == Some(kind))
            .map(|(name, topic)| (name.as_str(), topic))
    }

    /// Whether there are point clouds, which are no scans.
    pub(crate) fn has_clouds(&self) -> bool {
        self.topics.values().any(|topic| topic.datatype.starts_with("sensor_msgs/PointCloud"))
    }

    /// All topics, a line each, as what follows "it holds".
    pub(crate) fn list(&self) -> String {
        let damage = self.damage.as_ref().map_or(String::new(), |(count, first)| {
            format!("; {count} times something of it could not be read, first: {first}")
        });
        if self.topics.is_empty() {
            return format!(" no message{damage}");
        }
        let width = self.topics.keys().map(|name| name.chars().count()).max().unwrap_or(0).min(60);
        let types = self.topics.values().map(|topic| topic.datatype.chars().count()).max().unwrap_or(0).min(60);
        let mut text = String::new();
        for (name, topic) in &self.topics {
            let TopicRecord { datatype, count, .. } = topic;
            text += &format!("\n  {name:width$}  {datatype:types$}  {count:>7}  {:7.1} Hz", topic.rate_hz());
        }
        text + &damage
    }
}

impl TopicRecord {
    fn note(&mut self, head: &Head, child: &str, log_ns: u64) {
        let key = (head.frame.clone(), child.to_owned());
        if self.frames.len() < FRAMES_MAX || self.frames.contains_key(&key) {
            *self.frames.entry(key).or_insert(0) += 1;
        }
        if let Some(stamp_ns) = head.stamp_ns {
            let delay_ns = i128::from(log_ns) - i128::from(stamp_ns);
            self.least_delay_ns = Some(self.least_delay_ns.map_or(delay_ns, |least| least.min(delay_ns)));
        }
    }
}

enum Found {
    One(Head, String),
    Transforms(Vec<Placed>),
}

fn heads(kind: Type, channel: &Channel, data: &[u8]) -> Option<Found> {
    let fields = Fields::new(data, channel.encoding)?;
    let placed = |placed: Placed| Found::One(placed.head, placed.child);
    match kind {
        Type::LaserScan => LaserScan::read_head(fields).map(|head| Found::One(head, String::new())),
        Type::Range => Range::read(fields).map(|range| Found::One(range.head, String::new())),
        Type::Odometry => Placed::odometry(fields).map(placed),
        Type::Transforms => Placed::transforms(fields).map(Found::Transforms),
        Type::Pose | Type::PoseWithCovariance => Placed::pose(fields).map(placed),
        Type::Transform => Placed::transform(fields).map(placed),
    }
}
