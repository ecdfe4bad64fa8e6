//! Dead reckoning and the odometry error model (paper section 3.1): raw odometry in, pose
//! estimates with their accumulated errors out, one for one.

use std::process::ExitCode;

use anyhow::{Context, Result};
use echogrid_core::{Odometry, OdometryConfig, Pose2, Robot, nominal_trust};
use echogrid_service::{Input, Outbox, Plan, Service, process};
use echogrid_topics::{Message, PoseEstimate, Topic};

/// What it reads.
pub const INPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw];
/// What it writes.
pub const OUTPUTS: &[Topic] = &[Topic::OdometryEstimate];

/// The sensor whose trust is reported: the widest cone the robot has, or the paper's sonar.
#[derive(Debug, Clone, Copy)]
struct NominalSensor {
    aperture_rad: f64,
    range_error_ratio: f64,
}

impl NominalSensor {
    fn of(robot: &Robot) -> Self {
        let widest = robot.sensors.iter().max_by(|a, b| a.aperture_rad.total_cmp(&b.aperture_rad));
        widest.map_or(Self { aperture_rad: core::f64::consts::FRAC_PI_6, range_error_ratio: 0.01 }, |sensor| Self {
            aperture_rad: sensor.aperture_rad,
            range_error_ratio: sensor.range_error_ratio,
        })
    }
}

/// The odometry service.
#[derive(Debug)]
pub struct OdometryService {
    odometry: Odometry,
    resolution_m: f64,
    sensor: NominalSensor,
    last: Option<Pose2>,
    distance_m: f64,
}

impl OdometryService {
    /// From the configuration; `resolution_m` is the side of the map's cells, which bounds how
    /// exact a reading can be.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(config: &OdometryConfig, resolution_m: f64) -> Result<Self> {
        config.validate().context("[odometry]")?;
        Ok(Self {
            odometry: Odometry::new(config),
            resolution_m,
            sensor: NominalSensor::of(&Robot::default()),
            last: None,
            distance_m: 0.0,
        })
    }

    /// From the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let mapper: echogrid_core::MapperConfig = plan.section("mapper")?;
        Self::new(&plan.section("odometry")?, mapper.resolution_m)
    }
}

impl Service for OdometryService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        let Input::Message { stamp_ns, message, .. } = input else { return Ok(()) };
        match message {
            Message::Robot(robot) => self.sensor = NominalSensor::of(&robot),
            Message::Odometry(raw) => {
                let estimate = self.odometry.step(raw.odom_from_base);
                let NominalSensor { aperture_rad, range_error_ratio } = self.sensor;
                let trust = nominal_trust(&estimate.errors, aperture_rad, range_error_ratio, self.resolution_m);
                self.distance_m += self.last.map_or(0.0, |last| last.distance_m(estimate.pose));
                self.last = Some(estimate.pose);
                let distance_m = self.distance_m;
                out.send(stamp_ns, Message::Estimate(PoseEstimate { estimate, trust, distance_m }));
            }
            _ => {}
        }
        Ok(())
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("odometry", INPUTS, OUTPUTS, OdometryService::from_plan)
}
