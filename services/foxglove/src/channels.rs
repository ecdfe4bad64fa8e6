//! The channels of the server.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result};
use echogrid_scene::{Channel, Sink};
use foxglove::{ChannelBuilder, PartialMetadata, RawChannel, Schema};

/// All channels.
pub(crate) struct Channels(BTreeMap<Channel, Arc<RawChannel>>);

impl Channels {
    pub(crate) fn new() -> Result<Self> {
        let channel = |channel: Channel| {
            let described = channel.described();
            let schema = Schema::new(described.schema_name, described.schema_encoding, described.schema);
            let built = ChannelBuilder::new(&described.topic).message_encoding(described.encoding).schema(schema);
            let built = built.build_raw().with_context(|| format!("making the channel {}", described.topic))?;
            Ok((channel, built))
        };
        Channel::ALL.into_iter().map(channel).collect::<Result<_>>().map(Self)
    }
}

impl Sink for Channels {
    fn wants(&self, channel: Channel) -> bool {
        self.0.get(&channel).is_some_and(|channel| channel.has_sinks())
    }

    fn put(&mut self, channel: Channel, stamp_ns: u64, message: &[u8]) {
        if let Some(channel) = self.0.get(&channel) {
            channel.log_with_meta(message, PartialMetadata::with_log_time(stamp_ns));
        }
    }
}
