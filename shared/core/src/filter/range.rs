//! `range`: what is nearer or farther than a sensor can tell is refused (section 4.1 of the paper).

use crate::config::{ConfigError, Fusion, Limit, MapperConfig};
use crate::reading::Echo;
use crate::robot::{SensorKind, Transducer};
use crate::verdict::Verdict;

/// The paper's limits for a sonar, metres. (It prints "4 and 15 cm … respectively", which must be 15 cm and 4 m.)
const SONAR_LIMITS_M: (f64, f64) = (0.15, 4.0);

/// The farthest that a sonar is believed where the rule of fusion knows that walls mirror, metres: what is heard from there after all
/// has come by a detour no more often than what is heard from nearer by.
const ORIENTED_MAX_M: f64 = 6.0;

/// The farthest that a lidar is believed unless it is said otherwise, metres: what a log gives as farther is mostly a code or another
/// unit, and rays of kilometres fill the memory.
pub(crate) const LIDAR_MAX_M: f64 = 100.0;

/// The range of an echo, metres, or why it is none. No filter is needed for that, and none can be without.
///
/// # Errors
/// `NoEcho` or `Invalid`.
pub(crate) fn range_of(echo: Echo) -> Result<f64, Verdict> {
    match echo {
        Echo::Hit { range_m } if range_m.is_finite() && range_m > 0.0 => Ok(range_m),
        Echo::NoEcho => Err(Verdict::NoEcho),
        Echo::Hit { .. } | Echo::Invalid => Err(Verdict::Invalid),
    }
}

/// Lowest and highest range of a transducer, metres.
///
/// # Errors
/// Nothing is left between them.
pub(crate) fn range_limits(config: &MapperConfig, transducer: &Transducer) -> Result<(f64, f64), ConfigError> {
    let own = match transducer.kind {
        SensorKind::Sonar if config.fusion.of(transducer.kind) == Fusion::Oriented => {
            (SONAR_LIMITS_M.0, transducer.range_max_m.clamp(SONAR_LIMITS_M.1, ORIENTED_MAX_M))
        }
        SensorKind::Sonar => SONAR_LIMITS_M,
        SensorKind::Lidar => (transducer.range_min_m, transducer.range_max_m.min(LIDAR_MAX_M)),
    };
    let metres = |limit: Limit, own: f64| match limit {
        Limit::Metres(metres) => metres,
        Limit::Word(_) => own,
    };
    let (min, max) = (metres(config.min_range_m, own.0), metres(config.max_range_m, own.1));
    ConfigError::unless(min < max, "min_range_m", min, "less than max_range_m")?;
    Ok((min, max))
}
