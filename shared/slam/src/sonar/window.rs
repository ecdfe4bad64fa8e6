//! The last metres before a node, as one piece that is laid on places.

use std::collections::BTreeMap;

use echogrid_core::{Echo as Answered, Increment, Pose2, SensorKind};

use super::rings::Heard;
use super::slam::SonarSlam;
use crate::known::{Echo, Stop, Trail};

/// How long it is, metres.
pub(super) const WINDOW_M: f64 = 4.0;
/// A sonar is heard again after so much way or turn.
const HEARD_EVERY: (f64, f64) = (0.28, 0.25);
/// Nearer a sonar hears itself, farther what it hears has come by detours, metres.
const RANGE_M: (f64, f64) = (0.15, 5.0);

impl SonarSlam<'_> {
    /// What was heard on the last metres until a node.
    pub(super) fn window(&self, end: usize) -> Trail {
        let mut trail = Trail { scales: self.scales(), ..Trail::default() };
        let last = &self.nodes[end];
        let mut later = last.odom_from_base;
        let mut heard_at: BTreeMap<u16, Pose2> = BTreeMap::new();
        for node in (0..=end).rev() {
            let at = &self.nodes[node];
            if last.way_m - at.way_m > WINDOW_M || at.left_open != last.left_open {
                break;
            }
            let mut echoes = Vec::new();
            let rings = self.rings_of(node).filter(|(_, ring)| ring.stamp_ns <= last.stamp_ns);
            for heard in rings.flat_map(|(_, ring)| &ring.heard) {
                let Some(echo) = self.echo(heard, at.odom_from_base) else { continue };
                let is_new = heard_at.get(&heard.reading.transducer).is_none_or(|later| {
                    let step = Increment::between(heard.odom_from_base, *later);
                    step.length_m() >= HEARD_EVERY.0 || step.turn_rad.abs() >= HEARD_EVERY.1
                });
                if is_new {
                    heard_at.insert(heard.reading.transducer, heard.odom_from_base);
                    echoes.push(echo);
                }
            }
            if last.way_m - at.way_m > 0.5 * WINDOW_M {
                trail.older += echoes.len();
            }
            trail.stops.push(Stop { step: Increment::between(at.odom_from_base, later), echoes });
            later = at.odom_from_base;
        }
        trail
    }

    /// An echo seen from where the base was at a node.
    fn echo(&self, heard: &Heard, odom_from_node: Pose2) -> Option<Echo> {
        let Answered::Hit { range_m } = heard.reading.echo else { return None };
        let sonar = self.robot.transducer(heard.reading.transducer)?;
        let counts = sonar.kind == SensorKind::Sonar
            && range_m >= RANGE_M.0.max(sonar.range_min_m)
            && range_m < RANGE_M.1.min(sonar.range_max_m);
        counts.then(|| Echo {
            base_from_transducer: odom_from_node.inverse() * heard.odom_from_base * sonar.base_from_transducer,
            range_m,
            range_error_ratio: sonar.range_error_ratio,
            aperture_rad: sonar.aperture_rad,
            range_cap_m: sonar.range_max_m,
        })
    }
}
