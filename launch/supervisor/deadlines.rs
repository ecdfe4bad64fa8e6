//! How it is known that a service hangs, or waits for what will never come.

use std::time::{Duration, Instant};

use super::Supervisor;
use super::unit::Unit;
use crate::config::ServiceKind;

/// From the sensor's end until its readers have heard that the streams ended.
const END_WITHIN: Duration = Duration::from_secs(5);

impl Supervisor<'_> {
    /// A service that hangs, and how that is known.
    pub(super) fn hanging(&mut self, now: Instant) -> Option<(usize, String)> {
        let first_within = Duration::from_secs_f64(self.graph.supervision.first_output_within_s);
        let progress = |unit: &Unit| unit.alive().and_then(|process| process.health.as_ref()).map_or(0, |h| h.progress);
        let sent = self.units.iter().any(|unit| unit.kind == ServiceKind::Sensor && progress(unit) > 0);
        if sent {
            self.first_output.get_or_insert(now);
        }
        let all_ready = self.units.iter().filter(|unit| unit.is_here()).all(Unit::is_ready);
        let hangs = |unit: &Unit| {
            let process = unit.alive()?;
            let too_long = |since: Instant, limit: Duration, what: &str| {
                let late = now.saturating_duration_since(since) > limit;
                late.then(|| format!("{what} for {} s: it hangs", limit.as_secs()))
            };
            let Some(ready_at) = process.ready_at else {
                return too_long(process.started, self.graph.ready_within, "not ready");
            };
            if let Some(why) = too_long(process.silent_since(), self.graph.alive_within, "no sign of life") {
                return Some(why);
            }
            // Whoever waits for somebody that is being started is not silent by itself.
            let since = match unit.kind {
                ServiceKind::Sensor => self.ready,
                ServiceKind::Odometry | ServiceKind::Mapper => self.first_output,
                ServiceKind::Localizer | ServiceKind::Publisher => None,
            }
            .filter(|_| all_ready && unit.is_running() && progress(unit) == 0)?;
            too_long(since.max(ready_at), first_within, "not a single message")
        };
        self.units.iter().enumerate().find_map(|(index, unit)| hangs(unit).map(|why| (index, why)))
    }

    /// A sensor that does not end each of its streams leaves the others waiting.
    pub(super) fn check_for_a_missing_end(&mut self, now: Instant) {
        let has_ended = |kind| self.units.iter().any(|unit| unit.kind == kind && unit.has_ended());
        let (sensor_ended, odometry_ended) = (has_ended(ServiceKind::Sensor), has_ended(ServiceKind::Odometry));
        let waiting = |unit: &&Unit| {
            let waits_for_sensor = match unit.kind {
                ServiceKind::Odometry => true,
                // All poses have come; what may be missing is the end of the scans.
                ServiceKind::Mapper => odometry_ended,
                ServiceKind::Sensor | ServiceKind::Localizer | ServiceKind::Publisher => false,
            };
            waits_for_sensor && unit.is_running()
        };
        let waiting = self.units.iter().find(waiting).filter(|_| sensor_ended && self.ending.is_none());
        // Whoever still takes messages is not waiting.
        let waiting = waiting.map(|unit| (unit.kind, unit.health.as_ref().map_or(0, |health| health.progress)));
        match (waiting, self.waiting_since) {
            (None, _) => self.waiting_since = None,
            (Some(now_waiting), Some((before, since))) if now_waiting == before => {
                if now.saturating_duration_since(since) > END_WITHIN {
                    self.outcome.failures.push("sensor: left without saying that its streams end".into());
                    self.end_after_failure(ServiceKind::Sensor);
                }
            }
            (Some(now_waiting), _) => self.waiting_since = Some((now_waiting, now)),
        }
    }
}
