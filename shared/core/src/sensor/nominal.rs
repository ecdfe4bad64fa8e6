//! The sensor whose trust is reported.

use serde::{Deserialize, Serialize};

use crate::odometry::OdometryErrors;
use crate::robot::Robot;
use crate::sensor_model::nominal_trust;

/// The widest cone that a robot has, or the paper's sonar.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct NominalSensor {
    aperture_rad: f64,
    range_error_ratio: f64,
}

impl NominalSensor {
    /// The nominal sensor of a robot; of one without sensors it is the paper's sonar.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        let widest = robot.sensors.iter().max_by(|a, b| a.aperture_rad.total_cmp(&b.aperture_rad));
        widest.map_or(Self { aperture_rad: core::f64::consts::FRAC_PI_6, range_error_ratio: 0.01 }, |sensor| Self {
            aperture_rad: sensor.aperture_rad,
            range_error_ratio: sensor.range_error_ratio,
        })
    }

    /// The weight of its reading of 2 m, in [0, 1], on a grid of `resolution_m` (eqs 22, 23).
    #[must_use]
    pub fn trust(self, errors: &OdometryErrors, resolution_m: f64) -> f64 {
        nominal_trust(errors, self.aperture_rad, self.range_error_ratio, resolution_m)
    }
}
