//! Robots: the built-in ones, and those of a file.

use echogrid_core::robot::SENSORS_MAX;
use echogrid_core::{Footprint, Pose2, Robot, Sensor, SensorKind};
use serde::{Deserialize, Serialize};

/// What the name of a robot file ends with.
pub(crate) const FILE_ENDING: &str = ".toml";

/// The built-in robots: name, file.
pub(crate) const BUILTIN: &[(&str, &str)] = &[
    ("pioneer3at", include_str!("../robots/pioneer3at.toml")),
    ("pioneer3dx", include_str!("../robots/pioneer3dx.toml")),
    ("laser", include_str!("../robots/laser.toml")),
];

/// The names of the built-in robots.
pub fn builtin_robots() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// The top of a robot file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RawTop {
    pub(crate) name: String,
}

/// `[footprint]` of a robot file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RawFootprint {
    length_m: f64,
    width_m: f64,
}

/// `[sonars]` of a robot file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RawSonars {
    aperture_deg: f64,
    range_min_m: f64,
    range_max_m: f64,
    range_error_ratio: f64,
}

/// `[[sonar]]` of a robot file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RawSonar {
    x_m: f64,
    y_m: f64,
    heading_deg: f64,
}

/// `[lidar]` of a robot file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RawLidar {
    x_m: f64,
    y_m: f64,
    heading_deg: f64,
    beams: u16,
    first_bearing_deg: f64,
    field_of_view_deg: f64,
    range_min_m: f64,
    range_max_m: f64,
    range_error_ratio: f64,
}

/// A robot file but for `[odometry]` and `[simulator]`, every value within its range.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RawRobot {
    name: String,
    footprint: RawFootprint,
    sonars: RawSonars,
    sonar: Vec<RawSonar>,
    lidar: Option<RawLidar>,
}

impl RawRobot {
    /// Whether its name can travel in a message and is not a word of the configuration.
    pub(crate) fn has_proper_name(&self) -> bool {
        let name = self.name.as_bytes();
        (1..=40).contains(&name.len())
            && self.name != "auto"
            && name.iter().all(|b| b.is_ascii_alphanumeric() || b" _-.".contains(b))
    }

    /// The table whose nearest range is beyond its farthest.
    pub(crate) fn reversed_range(&self) -> Option<&'static str> {
        let reversed = |min: f64, max: f64| min >= max;
        if !self.sonar.is_empty() && reversed(self.sonars.range_min_m, self.sonars.range_max_m) {
            return Some("sonars");
        }
        self.lidar.as_ref().filter(|lidar| reversed(lidar.range_min_m, lidar.range_max_m)).map(|_| "lidar")
    }

    /// What it means: sonars first, in the order of the file, then the beams of the lidar.
    /// None when it has no sensor or more than [`SENSORS_MAX`].
    pub(crate) fn resolve(self) -> Option<Robot> {
        let sonars = u16::try_from(self.sonar.len()).ok()?;
        let mut sensors: Vec<Sensor> =
            (0..sonars).zip(&self.sonar).map(|(index, sonar)| sonar.resolve(index, &self.sonars)).collect();
        if let Some(lidar) = self.lidar {
            sonars.checked_add(lidar.beams)?;
            sensors.push(lidar.resolve(sonars));
        }
        let footprint = Footprint { length_m: self.footprint.length_m, width_m: self.footprint.width_m };
        (1..=SENSORS_MAX).contains(&sensors.len()).then_some(Robot { name: self.name, footprint, sensors })
    }
}

impl RawSonar {
    fn resolve(&self, index: u16, shared: &RawSonars) -> Sensor {
        Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(self.x_m, self.y_m, self.heading_deg.to_radians()),
            first_transducer: index,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: shared.aperture_deg.to_radians(),
            range_min_m: shared.range_min_m,
            range_max_m: shared.range_max_m,
            range_error_ratio: shared.range_error_ratio,
        }
    }
}

impl RawLidar {
    fn resolve(&self, first_transducer: u16) -> Sensor {
        // At least two beams, so at least one step. A beam is taken to be as wide as a step.
        let step_rad = self.field_of_view_deg.to_radians() / f64::from(self.beams.saturating_sub(1).max(1));
        Sensor {
            kind: SensorKind::Lidar,
            base_from_sensor: Pose2::new(self.x_m, self.y_m, self.heading_deg.to_radians()),
            first_transducer,
            transducers: self.beams,
            first_bearing_rad: self.first_bearing_deg.to_radians(),
            bearing_step_rad: step_rad,
            aperture_rad: step_rad,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            range_error_ratio: self.range_error_ratio,
        }
    }
}
