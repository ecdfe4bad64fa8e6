//! Where the robot really was at the stamp of each odometry pose, for a log that knows.

use std::collections::VecDeque;

use echogrid_core::Pose2;
use echogrid_formats::log::{LogError, LogEvent, LogReader};

/// Between true poses that are farther apart nothing is known, nanoseconds.
const GAP_NS: u64 = 2_000_000_000;

/// The events of a log, read ahead as far as a true pose may be needed for an earlier one.
#[derive(Debug)]
pub(crate) struct Ahead {
    events: LogReader,
    read: VecDeque<LogEvent>,
    /// The latest true pose that was passed.
    before: Option<(u64, Pose2)>,
}

impl Ahead {
    pub(crate) fn new(events: LogReader) -> Self {
        Self { events, read: VecDeque::new(), before: None }
    }

    /// The next event.
    pub(crate) fn next(&mut self) -> Result<Option<LogEvent>, LogError> {
        let event = match self.read.pop_front() {
            Some(event) => Some(event),
            None => self.events.next().transpose()?,
        };
        if let Some(LogEvent::TruePose { stamp_ns, map_from_base }) = event {
            self.before = Some((stamp_ns, map_from_base));
        }
        Ok(event)
    }

    /// The true pose at the stamp of the last event, interpolated; none where none is near.
    pub(crate) fn truth_at(&mut self, stamp_ns: u64) -> Result<Option<Pose2>, LogError> {
        if let Some((_, pose)) = self.before.filter(|(before_ns, _)| *before_ns == stamp_ns) {
            return Ok(Some(pose));
        }
        let Some((after_ns, after)) = self.first_from(stamp_ns)? else { return Ok(None) };
        if after_ns == stamp_ns {
            return Ok(Some(after));
        }
        let Some((before_ns, before)) = self.before else { return Ok(None) };
        let gap_ns = after_ns - before_ns;
        let fraction = (stamp_ns - before_ns) as f64 / gap_ns as f64;
        Ok((gap_ns <= GAP_NS).then(|| before.interpolate(after, fraction)))
    }

    /// The first true pose from `stamp_ns` on, if one is near.
    fn first_from(&mut self, stamp_ns: u64) -> Result<Option<(u64, Pose2)>, LogError> {
        let mut index = 0;
        loop {
            if index == self.read.len() {
                let Some(event) = self.events.next().transpose()? else { return Ok(None) };
                self.read.push_back(event);
            }
            match self.read[index] {
                LogEvent::TruePose { stamp_ns, map_from_base } => return Ok(Some((stamp_ns, map_from_base))),
                ref event if event.stamp_ns().saturating_sub(stamp_ns) > GAP_NS => return Ok(None),
                _ => index += 1,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn truth(stamp_ns: u64, x: f64) -> LogEvent {
        LogEvent::TruePose { stamp_ns, map_from_base: Pose2::new(x, 0.0, 0.0) }
    }

    fn odometry(stamp_ns: u64) -> LogEvent {
        LogEvent::Odometry { stamp_ns, odom_from_base: Pose2::IDENTITY, v_mps: 0.0, w_radps: 0.0 }
    }

    /// The true x at each odometry pose.
    fn known(events: Vec<LogEvent>) -> Vec<Option<f64>> {
        let mut ahead = Ahead::new(LogReader::from_events(events));
        let mut known = Vec::new();
        while let Some(event) = ahead.next().unwrap() {
            if let LogEvent::Odometry { stamp_ns, .. } = event {
                known.push(ahead.truth_at(stamp_ns).unwrap().map(|pose| pose.x));
            }
        }
        known
    }

    #[test]
    fn between_true_poses_and_at_them() {
        let events = vec![odometry(0), truth(0, 1.0), odometry(SECOND / 2), odometry(SECOND), truth(SECOND, 2.0)];
        assert_eq!(known(events), [Some(1.0), Some(1.5), Some(2.0)]);
        // The true pose first, as echogrid's own simulator writes.
        assert_eq!(known(vec![truth(5, 1.0), odometry(5), truth(7, 3.0), odometry(7)]), [Some(1.0), Some(3.0)]);
    }

    #[test]
    fn not_before_not_after_and_not_across_a_gap() {
        let events = vec![
            odometry(0),
            truth(SECOND, 1.0),
            odometry(2 * SECOND),
            truth(4 * SECOND, 2.0),
            odometry(4 * SECOND),
            odometry(5 * SECOND),
        ];
        assert_eq!(known(events), [None, None, Some(2.0), None]);
    }

    #[test]
    fn no_event_is_lost_by_reading_ahead() {
        let events = vec![odometry(0), odometry(1), odometry(2), truth(3, 0.0), odometry(4)];
        let mut ahead = Ahead::new(LogReader::from_events(events.clone()));
        let mut given = Vec::new();
        while let Some(event) = ahead.next().unwrap() {
            ahead.truth_at(event.stamp_ns()).unwrap();
            given.push(event);
        }
        assert_eq!(given, events);
    }
}
