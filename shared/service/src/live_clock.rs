//! The clock of a sensor that measures what is now: it may be set, or stand still, as that of a recording may.
//!
//! Nothing that comes later can be waited for here, so less can be told apart than in a log: a message that is a little late
//! takes the stamp of the one before it; when several are late the clock was set back, and later stamps are moved on.

use std::collections::BTreeMap;

use echogrid_topics::Topic;

/// So many messages of one topic in a row must be late before the clock counts as set back.
const LATE: u32 = 3;
/// Made-up time between two poses of one stamp where the sensor has shown no other.
const PERIOD_NS: u64 = 100_000_000;
/// A longer time between two poses is a pause.
const PAUSE_NS: u64 = 2_000_000_000;

/// Gives the messages of a live sensor stamps that never run backwards.
#[derive(Debug, Default)]
pub struct LiveClock {
    /// Added to the sensor's stamps, nanoseconds.
    offset_ns: u64,
    /// The last stamp that an earlier life gave out.
    begins_ns: u64,
    /// Last stamp given out, and how many in a row were late, by topic.
    tracks: BTreeMap<&'static str, (u64, u32)>,
    /// Stamp of the last pose as the sensor gave it, and how many more had it.
    last_pose_ns: Option<u64>,
    repeated: u32,
    /// Time over which poses came, and their number.
    flown_ns: u64,
    poses: u64,
}

impl LiveClock {
    /// A clock that goes on after the last stamp of an earlier life: a sensor that is started again may count its time anew.
    #[must_use]
    pub fn after(begins_ns: u64) -> Self {
        Self { begins_ns, ..Self::default() }
    }

    /// The stamp for a message that the sensor gives this one.
    #[must_use]
    pub fn stamp_ns(&mut self, topic: Topic, raw_ns: u64) -> u64 {
        if !topic.delivery().is_stream() {
            return raw_ns.saturating_add(self.offset_ns);
        }
        if self.tracks.is_empty() && raw_ns < self.begins_ns {
            let back_s = (self.begins_ns - raw_ns) as f64 * 1e-9;
            tracing::warn!(back_s, "the clock of the sensor begins before where it was: its stamps are moved on");
            self.offset_ns = (self.begins_ns - raw_ns).saturating_add(PERIOD_NS);
        }
        let stands_still = self.stands_still(topic, raw_ns);
        let period_ns = if self.flown_ns == 0 { PERIOD_NS } else { self.flown_ns / self.poses.max(1) };
        let newest_ns = self.tracks.values().map(|(last_ns, _)| *last_ns).max().unwrap_or(0);
        let (last_ns, late) = self.tracks.entry(topic.name()).or_insert((self.begins_ns, 0));
        let mut stamp_ns = raw_ns.saturating_add(self.offset_ns);
        if stands_still {
            // A scan belongs to the pose before it.
            stamp_ns = if topic == Topic::OdometryRaw { last_ns.saturating_add(period_ns) } else { newest_ns };
        } else if stamp_ns < *last_ns {
            *late += 1;
            if *late >= LATE {
                let back_ns = last_ns.saturating_add(period_ns) - stamp_ns;
                tracing::warn!(
                    topic = topic.name(),
                    back_s = back_ns as f64 * 1e-9,
                    "the clock of the sensor was set back"
                );
                self.offset_ns = self.offset_ns.saturating_add(back_ns);
                stamp_ns = last_ns.saturating_add(period_ns);
                *late = 0;
            }
        } else {
            *late = 0;
        }
        *last_ns = stamp_ns.max(*last_ns);
        *last_ns
    }

    /// Whether the clock has not moved since the last pose but one.
    fn stands_still(&mut self, topic: Topic, raw_ns: u64) -> bool {
        let is_same = self.last_pose_ns == Some(raw_ns);
        if topic != Topic::OdometryRaw {
            return is_same && self.repeated > 0;
        }
        self.poses += u64::from(self.last_pose_ns.is_some());
        if is_same {
            self.repeated = self.repeated.saturating_add(1);
            if self.repeated == LATE {
                tracing::warn!(stamp_ns = raw_ns, "several poses of the sensor have one stamp: they are spread");
            }
            return true;
        }
        let gap_ns = raw_ns.saturating_sub(self.last_pose_ns.unwrap_or(raw_ns));
        if gap_ns <= PAUSE_NS {
            self.flown_ns += gap_ns;
        }
        (self.last_pose_ns, self.repeated) = (Some(raw_ns), 0);
        false
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TENTH: u64 = 100_000_000;

    fn poses(tenths: &[u64]) -> Vec<u64> {
        let mut clock = LiveClock::default();
        tenths.iter().map(|tenth| clock.stamp_ns(Topic::OdometryRaw, tenth * TENTH) / TENTH).collect()
    }

    #[test]
    fn good_stamps_stay() {
        assert_eq!(poses(&[10, 11, 12, 13, 14]), [10, 11, 12, 13, 14]);
    }

    #[test]
    fn one_that_is_late_moves_nobody() {
        assert_eq!(poses(&[10, 11, 9, 12, 13]), [10, 11, 11, 12, 13]);
    }

    #[test]
    fn a_clock_set_back_goes_on() {
        let stamps = poses(&[100, 101, 102, 50, 51, 52, 53, 54]);
        assert_eq!(stamps[..5], [100, 101, 102, 102, 102]);
        assert!(stamps[5..].windows(2).all(|pair| pair[1] == pair[0] + 1), "{stamps:?}");
    }

    #[test]
    fn a_clock_that_stands_still_is_spread() {
        let mut clock = LiveClock::default();
        let stamps = [10, 11, 12, 12, 12, 12, 16, 17].map(|tenth| clock.stamp_ns(Topic::OdometryRaw, tenth * TENTH));
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{stamps:?}");
        assert_eq!(stamps[6..], [16 * TENTH, 17 * TENTH]);
        let mut clock = LiveClock::default();
        let given: Vec<u64> = [(Topic::OdometryRaw, 5), (Topic::OdometryRaw, 5), (Topic::RangeScan, 5)]
            .map(|(topic, tenth)| clock.stamp_ns(topic, tenth * TENTH) / TENTH)
            .to_vec();
        assert_eq!(given, [5, 6, 6]);
    }

    #[test]
    fn a_clock_that_begins_anew_goes_on_where_it_was() {
        let mut clock = LiveClock::after(90 * TENTH);
        let given = [(Topic::OdometryRaw, 0), (Topic::RangeScan, 0), (Topic::OdometryRaw, 2), (Topic::OdometryRaw, 3)];
        let given = given.map(|(topic, tenth)| clock.stamp_ns(topic, tenth * TENTH) / TENTH);
        assert_eq!(given, [91, 91, 93, 94]);
        // One that went on meanwhile is believed.
        assert_eq!(LiveClock::after(90 * TENTH).stamp_ns(Topic::OdometryRaw, 120 * TENTH), 120 * TENTH);
    }

    proptest! {
        #[test]
        fn stamps_never_fall(stamps in prop::collection::vec((0..2_u8, 0..1000_u64), 0..200)) {
            let mut clock = LiveClock::default();
            let mut last = [0, 0];
            for (topic, tenth) in stamps {
                let of = [Topic::OdometryRaw, Topic::RangeScan][usize::from(topic)];
                let stamp_ns = clock.stamp_ns(of, tenth * TENTH);
                prop_assert!(stamp_ns >= last[usize::from(topic)]);
                last[usize::from(topic)] = stamp_ns;
            }
        }
    }
}
