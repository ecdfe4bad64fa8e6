//! The channels, what each holds, and who takes it.

use echogrid_formats::log::McapChannel;
use foxglove::Encode;
use foxglove::messages::{FrameTransform, Grid, LaserScan, Log, PoseInFrame, SceneUpdate};
use serde_json::{Value, json};

/// A stream of messages for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channel {
    /// The whole map, for people: now and then.
    Map,
    /// Tiles that changed, for programs.
    Tiles,
    /// Where the robot's frame stands in the map's.
    Tf,
    /// The robot.
    Pose,
    /// The ellipse in which it is with 95 %.
    Uncertainty,
    /// The way, in pieces.
    Path,
    /// Beams and cones in the colours of their verdicts.
    Readings,
    /// The hits of lidars, as they were heard.
    Scan,
    /// What became of the services.
    Log,
    /// Pose, covariance, trust, distance: numbers to plot.
    Estimate,
    /// Transducer and verdict of each reading.
    Verdicts,
    /// The map in numbers.
    Info,
    /// How each service is doing.
    Health,
}

impl Channel {
    /// Every channel.
    pub const ALL: [Self; 13] = [
        Self::Map,
        Self::Tiles,
        Self::Tf,
        Self::Pose,
        Self::Uncertainty,
        Self::Path,
        Self::Readings,
        Self::Scan,
        Self::Log,
        Self::Estimate,
        Self::Verdicts,
        Self::Info,
        Self::Health,
    ];

    /// The topic of the channel.
    #[must_use]
    pub fn topic(self) -> &'static str {
        match self {
            Self::Map => "/map",
            Self::Tiles => "/map/tiles",
            Self::Tf => "/tf",
            Self::Pose => "/pose",
            Self::Uncertainty => "/pose/uncertainty",
            Self::Path => "/path",
            Self::Readings => "/readings",
            Self::Scan => "/scan",
            Self::Log => "/log",
            Self::Estimate => "/pose/estimate",
            Self::Verdicts => "/readings/verdicts",
            Self::Info => "/map/info",
            Self::Health => "/health",
        }
    }

    /// The topic, encoding and message type of the channel.
    #[must_use]
    pub fn described(self) -> McapChannel {
        match self {
            Self::Map | Self::Tiles => of::<Grid>(self),
            Self::Tf => of::<FrameTransform>(self),
            Self::Pose => of::<PoseInFrame>(self),
            Self::Uncertainty | Self::Path | Self::Readings => of::<SceneUpdate>(self),
            Self::Scan => of::<LaserScan>(self),
            Self::Log => of::<Log>(self),
            Self::Estimate => of_json(self, "echogrid/estimate"),
            Self::Verdicts => of_json(self, "echogrid/verdicts"),
            Self::Info => of_json(self, "echogrid/info"),
            Self::Health => of_json(self, "echogrid/health"),
        }
    }
}

fn of<T: Encode>(channel: Channel) -> McapChannel {
    let (topic, encoding) = (channel.topic().to_owned(), T::get_message_encoding());
    let schema = T::get_schema();
    let (schema_name, schema_encoding, schema) =
        schema.map(|schema| (schema.name, schema.encoding, schema.data.into_owned())).unwrap_or_default();
    McapChannel { topic, encoding, schema_name, schema_encoding, schema }
}

/// Of JSON objects.
fn of_json(channel: Channel, name: &str) -> McapChannel {
    McapChannel {
        topic: channel.topic().to_owned(),
        encoding: "json".to_owned(),
        schema_name: name.to_owned(),
        schema_encoding: "jsonschema".to_owned(),
        schema: json!({ "type": "object" }).to_string().into_bytes(),
    }
}

/// Who takes messages.
pub trait Sink {
    /// Whether anybody wants the messages of a channel: making them costs something.
    fn wants(&self, channel: Channel) -> bool;

    /// Takes a message of a channel.
    fn put(&mut self, channel: Channel, stamp_ns: u64, message: &[u8]);
}

/// What encodes messages on their way to a sink.
pub(crate) struct Out<'a>(pub(crate) &'a mut dyn Sink);

impl Out<'_> {
    /// Whether anybody wants them.
    pub(crate) fn wants(&self, channel: Channel) -> bool {
        self.0.wants(channel)
    }

    pub(crate) fn message<T: Encode>(&mut self, channel: Channel, stamp_ns: u64, message: &T) {
        if !self.wants(channel) {
            return;
        }
        let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
        // A vector has room for everything.
        if message.encode(&mut bytes).is_ok() {
            self.0.put(channel, stamp_ns, &bytes);
        }
    }

    pub(crate) fn json(&mut self, channel: Channel, stamp_ns: u64, value: &Value) {
        if self.wants(channel) {
            self.0.put(channel, stamp_ns, value.to_string().as_bytes());
        }
    }
}
