//! A laser range finder: narrow beams, all at once.

use echogrid_core::noise::Draws;
use echogrid_core::{Echo, Pose2, Reading, Robot, SensorKind, Transducer};

use crate::cause::{Cause, Heard};
use crate::config::SimulatorConfig;
use crate::people::nearest_m;
use crate::sonar::Scene;

/// All beams of a robot's lidars.
#[derive(Debug, Clone)]
pub(crate) struct Lidar {
    beams: Vec<(u16, Transducer)>,
    dropout: f64,
    period_ns: u64,
    draws: Draws,
    /// The truth about the last scan.
    pub(crate) heard: Vec<Heard>,
}

impl Lidar {
    /// The lidars of a robot; none if it has none.
    pub(crate) fn new(config: &SimulatorConfig, robot: &Robot) -> Option<Self> {
        let count = u16::try_from(robot.transducer_count()).unwrap_or(u16::MAX);
        let beams: Vec<(u16, Transducer)> = (0..count)
            .filter_map(|number| Some((number, robot.transducer(number)?)))
            .filter(|(_, transducer)| transducer.kind == SensorKind::Lidar)
            .collect();
        (!beams.is_empty()).then(|| Self {
            beams,
            dropout: config.lidar_dropout_ratio,
            period_ns: crate::nanoseconds(config.lidar_period_s),
            draws: Draws::new(config.seed, "lidar"),
            heard: Vec::new(),
        })
    }

    pub(crate) fn period_ns(&self) -> u64 {
        self.period_ns
    }

    pub(crate) fn scan(&mut self, scene: &Scene<'_>, map_from_base: Pose2) -> Vec<Reading> {
        self.heard.clear();
        let mut readings = Vec::with_capacity(self.beams.len());
        for (number, beam) in &self.beams {
            let Pose2 { x, y, theta } = map_from_base * beam.base_from_transducer;
            let (sin, cos) = libm::sincos(theta);
            let direction = [cos, sin];
            let meeting = scene.world.meet([x, y], direction, beam.range_max_m);
            let wall_m = meeting.map_or(f64::INFINITY, |meeting| meeting.distance_m);
            let person_m = nearest_m(scene.people, [x, y], direction);
            let range_m = wall_m.min(person_m);
            let cause = if person_m < wall_m { Cause::Person } else { Cause::Direct };
            let noisy_m = range_m * (1.0 + beam.range_error_ratio * self.draws.normal());
            let dropped = self.draws.uniform() < self.dropout;
            let (echo, cause) = if dropped || !noisy_m.is_finite() || noisy_m >= beam.range_max_m {
                (Echo::NoEcho, Cause::Nothing)
            } else if range_m < beam.range_min_m || noisy_m <= 0.0 {
                (Echo::Invalid, cause)
            } else {
                (Echo::Hit { range_m: noisy_m }, cause)
            };
            let incidence_rad = meeting.map_or(0.0, |meeting| {
                libm::acos((-(meeting.normal[0] * cos + meeting.normal[1] * sin)).clamp(0.0, 1.0))
            });
            let ahead_m = meeting.map(|meeting| meeting.distance_m);
            self.heard.push(Heard { transducer: *number, echo, cause, ahead_m, incidence_rad });
            readings.push(Reading { transducer: *number, echo, offset_ns: 0 });
        }
        readings
    }
}
