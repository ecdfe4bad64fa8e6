//! Range readings: what the sensors hear, and what became of each reading.

use echogrid_core::{Echo, Reading, Verdict};
use serde_json::{Value, json};

use super::checks::Fault;
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, wire};

/// Ranges beyond are taken for faults, metres.
pub(super) const RANGE_LIMIT_M: f64 = 1e5;

/// A scan.
impl Content for Vec<Reading> {
    const TOPIC: Topic = Topic::RangeScan;
    type Payload = [ReadingWire];

    fn qos(max_readings: usize) -> Qos {
        let slice_len = max_readings.max(1);
        let history = ((2 << 20) / (slice_len * size_of::<ReadingWire>())).clamp(64, 2048);
        Qos { history, buffer: history + history / 2, window: (history / 2) as u64, slice_len, ..Qos::STREAM }
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// Transducer and verdict, in the order of the scan with the same stamp.
impl Content for Vec<(u16, Verdict)> {
    const TOPIC: Topic = Topic::RangeVerdict;
    type Payload = [VerdictWire];

    fn qos(max_readings: usize) -> Qos {
        Qos { history: 0, buffer: 16, window: u64::MAX, slice_len: max_readings.max(1), ..Qos::STREAM }
    }

    fn json(&self) -> Value {
        self.iter().map(|(transducer, verdict)| json!([transducer, verdict.name()])).collect()
    }
}

wire! {
    /// One reading of a `range/scan` message, whose payload is a slice of these.
    "echogrid/RangeReading/1" ReadingWire {
        /// Metres from the transducer; counts only for a hit.
        range_m: f64,
        /// Nanoseconds after the stamp of the message.
        offset_ns: i32,
        /// Index into the robot's transducers.
        transducer: u16,
        /// 0 hit, 1 no echo, 2 invalid.
        echo: u8,
        /// Zero.
        reserved: u8,
    }
}

wire! {
    /// One verdict of a `range/verdict` message, whose payload is a slice of these, in the order of the scan with the same stamp.
    "echogrid/RangeVerdict/1" VerdictWire {
        /// Index into the robot's transducers.
        transducer: u16,
        /// Verdict code; 0 is accepted.
        verdict: u8,
        /// Zero.
        reserved: u8,
    }
}

impl From<&Reading> for ReadingWire {
    fn from(reading: &Reading) -> Self {
        let (echo, range_m) = match reading.echo {
            Echo::Hit { range_m } => (0, range_m),
            Echo::NoEcho => (1, 0.0),
            Echo::Invalid => (2, 0.0),
        };
        Self { range_m, offset_ns: reading.offset_ns, transducer: reading.transducer, echo, reserved: 0 }
    }
}

/// A reading that breaks its contract is an invalid reading: its neighbours are not lost with it.
impl From<&ReadingWire> for Reading {
    fn from(wire: &ReadingWire) -> Self {
        let echo = match wire.echo {
            0 if wire.range_m > 0.0 && wire.range_m <= RANGE_LIMIT_M => Echo::Hit { range_m: wire.range_m },
            1 => Echo::NoEcho,
            _ => Echo::Invalid,
        };
        Self { transducer: wire.transducer, echo, offset_ns: wire.offset_ns }
    }
}

impl From<&(u16, Verdict)> for VerdictWire {
    fn from((transducer, verdict): &(u16, Verdict)) -> Self {
        Self { transducer: *transducer, verdict: *verdict as u8, reserved: 0 }
    }
}

impl TryFrom<&VerdictWire> for (u16, Verdict) {
    type Error = Fault;

    fn try_from(wire: &VerdictWire) -> Result<Self, Fault> {
        let verdict = Verdict::ALL.into_iter().find(|verdict| *verdict as u8 == wire.verdict).ok_or(Fault {
            field: "verdict",
            value: wire.verdict.to_string(),
            expected: "a known verdict code",
        })?;
        Ok((wire.transducer, verdict))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{any_bytes, refused, sent, survives};
    use super::*;

    fn reading() -> impl Strategy<Value = Reading> {
        let echo = prop_oneof![
            (1e-9..=1e5).prop_map(|range_m| Echo::Hit { range_m }),
            Just(Echo::NoEcho),
            Just(Echo::Invalid)
        ];
        (any::<u16>(), echo, any::<i32>()).prop_map(|(transducer, echo, offset_ns)| Reading {
            transducer,
            echo,
            offset_ns,
        })
    }

    proptest! {
        #[test]
        fn what_is_sent_arrives(reading in reading(), transducer: u16, verdict in 0..Verdict::COUNT) {
            let verdict = (transducer, Verdict::ALL[verdict]);
            prop_assert_eq!(sent::<ReadingWire, _>(&reading), reading);
            prop_assert_eq!(sent::<VerdictWire, _>(&verdict), verdict);
        }

        #[test]
        fn any_bytes_are_survived(bytes in any_bytes()) {
            survives::<ReadingWire, Reading>(&bytes);
            survives::<VerdictWire, (u16, Verdict)>(&bytes);
        }
    }

    #[test]
    fn a_reading_that_cannot_be_is_an_invalid_one() {
        let check = |echo: u8, range_m: f64, expected: Echo| {
            let reading = Reading::from(&ReadingWire { echo, range_m, transducer: 3, offset_ns: -1, reserved: 0 });
            assert_eq!(reading, Reading { transducer: 3, echo: expected, offset_ns: -1 });
        };
        check(0, 1e5, Echo::Hit { range_m: 1e5 });
        for range_m in [0.0, -1.0, 1.1e5, f64::NAN, f64::INFINITY] {
            check(0, range_m, Echo::Invalid);
        }
        check(1, f64::NAN, Echo::NoEcho);
        check(2, 1.0, Echo::Invalid);
        check(3, 1.0, Echo::Invalid);
    }

    #[test]
    fn verdicts_that_cannot_be() {
        refused::<_, (u16, Verdict)>(VerdictWire::default(), "verdict", |w| w.verdict = Verdict::COUNT as u8);
    }

    #[test]
    fn the_window_of_scans_keeps_within_two_mebibytes() {
        for max_readings in [1, 8, 16, 181, 361, 1024, 5000] {
            let history = ((2 << 20) / (16 * max_readings)).clamp(64, 2048);
            let qos = Topic::RangeScan.qos(max_readings);
            assert_eq!((qos.history, qos.buffer, qos.window), (history, history + history / 2, history as u64 / 2));
        }
    }
}
