//! Health: how a service is doing, and what it is done with.

use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use super::checks::{Fault, check};
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, bytes_to_text, text_to_bytes, wire};

/// Inputs that a health message can acknowledge.
pub const MAX_ACKS: usize = 8;

impl Content for Health {
    const TOPIC: Topic = Topic::Health;
    type Payload = HealthWire;

    fn qos(_: usize) -> Qos {
        // All services write it, and all producers read it.
        Qos { buffer: 4, publishers: 16, subscribers: 16, ..Qos::LATEST }
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// State of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum ServiceState {
    /// Not ready yet.
    Starting = 1,
    /// Taking messages.
    Running = 2,
    /// The inputs have ended; the service finishes.
    Draining = 3,
    /// Done, about to leave.
    Finished = 4,
    /// About to leave for an error.
    Failed = 5,
    /// It will not come back, says the launcher: nobody need wait for it.
    Gone = 6,
}

impl ServiceState {
    /// The state as people say it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Draining => "draining",
            Self::Finished => "finished",
            Self::Failed => "failed",
            Self::Gone => "gone",
        }
    }
}

impl Serialize for ServiceState {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.word())
    }
}

/// How far a consumer has integrated one of its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Ack {
    /// The topic of the input.
    pub topic: Topic,
    /// Epoch of the sequence; 0 before the first message.
    pub epoch: u64,
    /// Last sequence that will not be needed again.
    pub sequence: u64,
}

/// How a service is doing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Health {
    /// The service's name in the graph.
    pub service: String,
    /// The number of the service's process.
    pub pid: u32,
    /// What it is doing.
    pub state: ServiceState,
    /// Messages taken in (of a sensor: given out).
    pub progress: u64,
    /// How many there will be in all; 0 unknown.
    pub total: u64,
    /// Stamp of the latest message handled, nanoseconds.
    pub stamp_ns: u64,
    /// Stamp of the first message of a stream that was handled, nanoseconds; 0: none yet.
    pub first_stamp_ns: u64,
    /// Messages refused as faulty.
    pub faults: u64,
    /// Messages known to be lost.
    pub lost: u64,
    /// How far each input is integrated, one for each.
    pub acks: Vec<Ack>,
    /// What it can't go on without: an input that has nothing new, or an output without room; none: it works, or does not say.
    pub waits_for: Option<Topic>,
    /// Empty if there was none.
    pub last_error: String,
    /// How what it measures with is doing, for people; empty: nothing to say.
    pub note: String,
}

impl Health {
    /// The health of a process that has done nothing yet.
    #[must_use]
    pub fn new(service: impl Into<String>, pid: u32, state: ServiceState) -> Self {
        Self {
            service: service.into(),
            pid,
            state,
            progress: 0,
            total: 0,
            stamp_ns: 0,
            first_stamp_ns: 0,
            faults: 0,
            lost: 0,
            acks: Vec::new(),
            waits_for: None,
            last_error: String::new(),
            note: String::new(),
        }
    }
}

wire! {
    /// How far a consumer has integrated one of its inputs.
    "echogrid/Ack/2" AckWire {
        /// Topic code.
        topic: u32,
        /// Zero.
        reserved: u32,
        /// Epoch that the sequence belongs to; 0 before the first message.
        epoch: u64,
        /// Last sequence that will not be needed again: stored with all that came of it (lossless topics), or taken in.
        sequence: u64,
    }
}

wire! {
    /// `health`: how a service is doing. Sent from its main loop, so it stops when the loop hangs.
    "echogrid/Health/4" HealthWire {
        /// UTF-8, padded with zeros.
        service: [u8; 32],
        /// Process id.
        pid: u32,
        /// 1 starting, 2 running, 3 draining, 4 finished, 5 failed, 6 gone for good (said by the launcher).
        state: u32,
        /// Messages taken in (of a sensor: given out).
        progress: u64,
        /// How many there will be in all; 0 unknown.
        total: u64,
        /// Stamp of the latest message handled, nanoseconds.
        stamp_ns: u64,
        /// Stamp of the first message of a stream that was handled, nanoseconds; 0: none yet.
        first_stamp_ns: u64,
        /// Messages refused as faulty.
        faults: u64,
        /// Messages known to be lost (gaps in a sequence).
        lost: u64,
        /// How many of `acks` are in use.
        ack_count: u32,
        /// Code of the topic that it can't go on without: an input has nothing new, or an output no room; 0: it works, or does not say.
        waits_for: u32,
        /// One per input.
        acks: [AckWire; 8],
        /// Last error, UTF-8, padded with zeros.
        last_error: [u8; 512],
        /// How what it measures with is doing, UTF-8, padded with zeros.
        note: [u8; 256],
    }
}

impl From<&Health> for HealthWire {
    fn from(health: &Health) -> Self {
        let mut acks = [AckWire::default(); MAX_ACKS];
        for (slot, ack) in acks.iter_mut().zip(&health.acks) {
            *slot = AckWire { topic: ack.topic as u32, reserved: 0, epoch: ack.epoch, sequence: ack.sequence };
        }
        Self {
            service: text_to_bytes(&health.service),
            pid: health.pid,
            state: health.state as u32,
            progress: health.progress,
            total: health.total,
            stamp_ns: health.stamp_ns,
            first_stamp_ns: health.first_stamp_ns,
            faults: health.faults,
            lost: health.lost,
            ack_count: health.acks.len().min(MAX_ACKS) as u32,
            waits_for: health.waits_for.map_or(0, |topic| topic as u32),
            acks,
            last_error: text_to_bytes(&health.last_error),
            note: text_to_bytes(&health.note),
        }
    }
}

impl TryFrom<&HealthWire> for Health {
    type Error = Fault;

    fn try_from(wire: &HealthWire) -> Result<Self, Fault> {
        use ServiceState::{Draining, Failed, Finished, Gone, Running, Starting};
        let state = [Starting, Running, Draining, Finished, Failed, Gone]
            .into_iter()
            .find(|state| *state as u32 == wire.state)
            .ok_or(Fault { field: "state", value: wire.state.to_string(), expected: "1 to 6" })?;
        check(wire.ack_count as usize <= MAX_ACKS, "ack_count", wire.ack_count, "at most 8")?;
        let acks = wire.acks[..wire.ack_count as usize]
            .iter()
            .map(|ack| {
                let topic = Topic::from_code(ack.topic).ok_or(Fault {
                    field: "acks.topic",
                    value: ack.topic.to_string(),
                    expected: "a topic code",
                })?;
                Ok(Ack { topic, epoch: ack.epoch, sequence: ack.sequence })
            })
            .collect::<Result<_, Fault>>()?;
        Ok(Self {
            service: bytes_to_text(&wire.service),
            pid: wire.pid,
            state,
            progress: wire.progress,
            total: wire.total,
            stamp_ns: wire.stamp_ns,
            first_stamp_ns: wire.first_stamp_ns,
            faults: wire.faults,
            lost: wire.lost,
            acks,
            // A code that is not known says no more than none.
            waits_for: Topic::from_code(wire.waits_for),
            last_error: bytes_to_text(&wire.last_error),
            note: bytes_to_text(&wire.note),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{any_bytes, refused, sent, survives};
    use super::*;

    fn health() -> impl Strategy<Value = Health> {
        use ServiceState::{Draining, Failed, Finished, Running, Starting};
        let state = prop::sample::select(vec![Starting, Running, Draining, Finished, Failed]);
        let ack = (prop::sample::select(Topic::ALL.to_vec()), any::<u64>(), any::<u64>());
        let ack = ack.prop_map(|(topic, epoch, sequence)| Ack { topic, epoch, sequence });
        let acks = prop::collection::vec(ack, 0..=MAX_ACKS);
        let waits = prop::option::of(prop::sample::select(Topic::ALL.to_vec()));
        ("[a-z0-9-]{1,20}", any::<u32>(), state, any::<[u64; 6]>(), acks, waits, ["[ -~äß]{0,256}", "[ -~äß]{0,128}"])
            .prop_map(
                |(
                    service,
                    pid,
                    state,
                    [progress, total, stamp_ns, first_stamp_ns, faults, lost],
                    acks,
                    waits_for,
                    [last_error, note],
                )| Health {
                    service,
                    pid,
                    state,
                    progress,
                    total,
                    stamp_ns,
                    first_stamp_ns,
                    faults,
                    lost,
                    acks,
                    waits_for,
                    last_error,
                    note,
                },
            )
    }

    proptest! {
        #[test]
        fn what_is_sent_arrives(health in health()) {
            prop_assert_eq!(sent::<HealthWire, _>(&health), health);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<HealthWire, Health>(&bytes);
        }
    }

    fn good_health() -> HealthWire {
        HealthWire { state: 1, ack_count: 1, ..HealthWire::default() }
    }

    #[test]
    fn health_that_cannot_be() {
        let check = |field, spoil: fn(&mut HealthWire)| refused::<_, Health>(good_health(), field, spoil);
        check("acks.topic", |_| {});
        check("acks.topic", |w| w.acks[0].topic = 99);
        check("state", |w| w.state = 0);
        check("state", |w| w.state = 7);
        check("ack_count", |w| w.ack_count = 9);
        assert!(Health::try_from(&HealthWire { ack_count: 0, ..good_health() }).is_ok());
    }

    #[test]
    fn health_as_json() {
        let acks = vec![Ack { topic: Topic::MapTiles, epoch: 1, sequence: 2 }];
        let health =
            Health { acks, waits_for: Some(Topic::MapInfo), ..Health::new("mapper", 1, ServiceState::Draining) };
        let json = health.json();
        assert_eq!(json["acks"], json!([{ "topic": "map/tiles", "epoch": 1, "sequence": 2 }]));
        assert_eq!((&json["state"], &json["waits_for"]), (&json!("draining"), &json!("map/info")));
    }
}
