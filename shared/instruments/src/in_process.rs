//! A whole graph in this process and thread, of the same steps as its processes: the same bytes, without shared memory. For
//! experiments, which run many, and for tests.

use anyhow::{Context, Result};
use echogrid_localizer::LocalizerService;
use echogrid_mapper::MapperService;
use echogrid_odometry::OdometryService;
use echogrid_replay::Replay;
use echogrid_service::{Sensor, Service, local};
use echogrid_simulator::{Simulator, world_of};

use echogrid_config::{Builtin, Config, Exec, ServiceKind};

/// Plays the sensor of `config`, a built-in one, to its end through odometry, localizer if there is one, mapper and
/// `publisher`, which sees what any publisher would.
///
/// # Errors
/// The configuration can't be run so, or a service fails.
pub fn run(config: &Config, publisher: &mut dyn Service) -> Result<()> {
    run_through(config, &mut MapperService::new(&config.mapper, &config.resolved_odometry())?, publisher)
}

/// Plays the sensor as [`run`] does, through a mapper that can be asked afterwards.
///
/// # Errors
/// As [`run`].
pub fn run_through(config: &Config, mapper: &mut MapperService, publisher: &mut dyn Service) -> Result<()> {
    let mut sensor = sensor(config)?;
    let localization = config.resolved_localization();
    let drive = config.resolved_odometry();
    let mut odometry = OdometryService::new(&drive, config.mapper.resolution_m, &localization, config.has_localizer())?;
    if config.has_localizer() {
        let mut localizer = LocalizerService::new(&config.localizer)?;
        local::run(sensor.as_mut(), &mut [&mut odometry, &mut localizer, mapper, publisher])
    } else {
        local::run(sensor.as_mut(), &mut [&mut odometry, mapper, publisher])
    }
}

/// The sensor of a configuration.
fn sensor(config: &Config) -> Result<Box<dyn Sensor>> {
    let service = config.services.values().find(|service| service.kind == ServiceKind::Sensor);
    Ok(match service.map(|service| &service.exec) {
        Some(Exec::Builtin(Builtin::Replay)) => Box::new(Replay::new(&config.replay, config.robot.clone())?),
        Some(Exec::Builtin(Builtin::Simulator)) => {
            let robot = config.robot.clone().context("a simulator needs a robot")?;
            Box::new(Simulator::new(&config.simulator, world_of(&config.simulator)?, robot)?)
        }
        _ => anyhow::bail!(
            "the sensor of this graph is a robot or a program of its own, which can't be run in this process"
        ),
    })
}

#[cfg(test)]
mod tests {
    use echogrid_topics::Topic;

    /// Where the robot really is must not come into a map but by a fix.
    #[test]
    fn the_localizer_alone_is_told_the_truth() {
        assert!(echogrid_localizer::INPUTS.contains(&Topic::TruePose));
        for inputs in [echogrid_odometry::INPUTS, echogrid_mapper::INPUTS, echogrid_publisher::INPUTS] {
            assert!(!inputs.contains(&Topic::TruePose) && !inputs.contains(&Topic::TrueWorld), "{inputs:?}");
        }
    }
}
