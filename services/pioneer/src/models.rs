//! Models of robots: what their counts mean, and where their sonars sit.

use echogrid_arcos::Parameters;
use echogrid_core::{Footprint, Pose2, Robot, Sensor, SensorKind};

/// Sonars of a Pioneer hear walls from 0.1 m to 5 m, in a cone of 30°, within 1 %.
const RANGE_MIN_M: f64 = 0.1;
const RANGE_MAX_M: f64 = 5.0;
const APERTURE_RAD: f64 = core::f64::consts::FRAC_PI_6;
const RANGE_ERROR_RATIO: f64 = 0.01;

/// The robot that echogrid knows by this name is of this model; none if it knows none.
#[must_use]
pub fn model_of(subclass: &str) -> Option<&'static str> {
    match subclass {
        _ if subclass.starts_with("p3at") => Some("pioneer3at"),
        _ if subclass.starts_with("p3dx") => Some("pioneer3dx"),
        _ => None,
    }
}

/// What the counts of a model mean, as ARIA's parameter files say; none if it is not one of these.
pub(crate) fn parameters_of(subclass: &str) -> Option<Parameters> {
    let (distance_mm_per_count, turn_per_difference) = match subclass {
        "p3at" => (0.465, 0.0034),
        "p3at-sh" => (1.0, 0.0034),
        "p3dx" => (0.485, 0.0056),
        "p3dx-sh" => (1.0, 0.0056),
        _ => return None,
    };
    let subclass = subclass.to_owned();
    Some(Parameters { subclass, distance_mm_per_count, turn_per_difference, ..Parameters::default() })
}

/// The robot of a parameter file.
#[must_use]
pub fn robot_of(parameters: &Parameters) -> Robot {
    let range_max_m = if parameters.sonar_max_mm > 0.0 { parameters.sonar_max_mm * 1e-3 } else { RANGE_MAX_M };
    let sonar = |number: usize, place: &echogrid_arcos::SonarPlace| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(place.x_mm * 1e-3, place.y_mm * 1e-3, place.heading_deg.to_radians()),
        first_transducer: u16::try_from(number).unwrap_or(u16::MAX),
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: APERTURE_RAD,
        range_min_m: RANGE_MIN_M,
        range_max_m,
        range_error_ratio: RANGE_ERROR_RATIO,
    };
    Robot {
        name: parameters.subclass.clone(),
        footprint: Footprint { length_m: parameters.length_mm * 1e-3, width_m: parameters.width_mm * 1e-3 },
        sensors: parameters.sonars.iter().enumerate().map(|(number, place)| sonar(number, place)).collect(),
    }
}
