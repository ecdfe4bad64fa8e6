//! The channels, and what each holds.

use std::sync::Arc;

use anyhow::{Context, Result};
use foxglove::messages::{FrameTransform, Grid, LaserScan, Log, PoseInFrame, SceneUpdate};
use foxglove::{Channel, ChannelBuilder, PartialMetadata, RawChannel, Schema};
use serde_json::{Value, json};

/// All channels.
pub(crate) struct Channels {
    /// The whole map, for people: at most once a second.
    pub(crate) map: Channel<Grid>,
    /// Tiles that changed, for programs.
    pub(crate) tiles: Channel<Grid>,
    pub(crate) tf: Channel<FrameTransform>,
    pub(crate) pose: Channel<PoseInFrame>,
    /// Uncertainty ellipse.
    pub(crate) uncertainty: Channel<SceneUpdate>,
    pub(crate) path: Channel<SceneUpdate>,
    /// Beams and cones in the colours of their verdicts.
    pub(crate) readings: Channel<SceneUpdate>,
    /// Of lidars: hits as they were heard.
    pub(crate) scan: Channel<LaserScan>,
    pub(crate) log: Channel<Log>,
    /// Pose, covariance, trust, distance: numbers to plot.
    pub(crate) estimate: Json,
    /// Transducer and verdict of each reading.
    pub(crate) verdicts: Json,
    /// The map in numbers.
    pub(crate) info: Json,
    pub(crate) health: Json,
}

/// A channel of JSON objects.
pub(crate) struct Json(Arc<RawChannel>);

impl Json {
    fn new(topic: &str, name: &str) -> Result<Self> {
        let schema = Schema::new(name.to_owned(), "jsonschema", json!({ "type": "object" }).to_string().into_bytes());
        let channel = ChannelBuilder::new(topic).message_encoding("json").schema(schema).build_raw();
        Ok(Self(channel.with_context(|| format!("making the channel {topic}"))?))
    }

    pub(crate) fn log(&self, stamp_ns: u64, value: &Value) {
        if self.0.has_sinks() {
            self.0.log_with_meta(value.to_string().as_bytes(), PartialMetadata::with_log_time(stamp_ns));
        }
    }
}

impl Channels {
    pub(crate) fn new() -> Result<Self> {
        Ok(Self {
            map: Channel::new("/map"),
            tiles: Channel::new("/map/tiles"),
            tf: Channel::new("/tf"),
            pose: Channel::new("/pose"),
            uncertainty: Channel::new("/pose/uncertainty"),
            path: Channel::new("/path"),
            readings: Channel::new("/readings"),
            scan: Channel::new("/scan"),
            log: Channel::new("/log"),
            estimate: Json::new("/pose/estimate", "echogrid/estimate")?,
            verdicts: Json::new("/readings/verdicts", "echogrid/verdicts")?,
            info: Json::new("/map/info", "echogrid/info")?,
            health: Json::new("/health", "echogrid/health")?,
        })
    }
}
