//! A transducer with all that the configuration says about it.

use super::range::{LIDAR_MAX_M, range_limits};
use super::selection::selected;
use crate::config::{ConfigError, MapperConfig};
use crate::robot::{Robot, Sensor, SensorKind, Transducer};
use crate::verdict::Verdict;

/// A transducer, its range limits, and whether it is used.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channel {
    pub(crate) transducer: Transducer,
    /// Its number among the robot's sonars, if it is one.
    pub(crate) sonar: Option<u16>,
    pub(crate) selected: bool,
    /// Metres.
    pub(crate) min_range_m: f64,
    /// Metres.
    pub(crate) max_range_m: f64,
}

impl Channel {
    /// Why a range is refused, if it is.
    pub(crate) fn refusal(&self, range_m: f64) -> Option<Verdict> {
        if range_m < self.min_range_m {
            Some(Verdict::BelowMinimum)
        } else if range_m > self.max_range_m {
            Some(Verdict::AboveMaximum)
        } else {
            None
        }
    }
}

/// What the configuration says about each transducer of the robot, by index; none where it has none.
///
/// # Errors
/// A sonar is selected that the robot does not have, or a sensor is left without a range between its limits.
pub(crate) fn channels(config: &MapperConfig, robot: &Robot) -> Result<Vec<Option<Channel>>, ConfigError> {
    let end_of = |sensor: &Sensor| u32::from(sensor.first_transducer) + u32::from(sensor.transducers);
    let end = robot.sensors.iter().map(end_of).max().unwrap_or(0);
    let transducers: Vec<Option<Transducer>> =
        (0..=u16::MAX).take(end as usize).map(|index| robot.transducer(index)).collect();
    let selected = selected(&config.sonars, &transducers)?;
    let mut sonars = 0..=u16::MAX;
    let channel = |(transducer, selected): (Option<Transducer>, bool)| {
        let Some(mut transducer) = transducer else { return Ok(None) };
        let (min_range_m, max_range_m) = range_limits(config, &transducer)?;
        if transducer.kind == SensorKind::Lidar {
            // Nor does a reading without an echo clear what is farther.
            transducer.range_max_m = transducer.range_max_m.min(max_range_m.max(LIDAR_MAX_M));
        }
        let sonar = if transducer.kind == SensorKind::Sonar { sonars.next() } else { None };
        Ok(Some(Channel { transducer, sonar, selected, min_range_m, max_range_m }))
    };
    transducers.into_iter().zip(selected).map(channel).collect()
}
