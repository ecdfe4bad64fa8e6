//! What the processes of a run are told.

use std::time::SystemTime;

use anyhow::{Context, Result, bail};
use echogrid_core::localization::Choice;
use echogrid_core::{GridMapper, Robot, SensorKind};
use echogrid_formats::log::LogSurvey;
use echogrid_formats::map::Provenance;
use echogrid_localizer::config::Source;
use echogrid_service::Plan;
use echogrid_topics::contract::{MAX_SENSORS, RobotWire};

use crate::config::{self, Config, Rate};

/// What the processes are told.
pub(super) fn of(config: &Config, survey: Option<&LogSurvey>, earlier: Vec<String>) -> Result<Plan> {
    let robot: Option<&Robot> = config.robot.as_ref().or(survey.map(|survey| &survey.robot));
    if let Some(robot) = robot.filter(|robot| robot.sensors.len() > MAX_SENSORS) {
        bail!("robot {:?} has {} sensors, at most {MAX_SENSORS} are possible", robot.name, robot.sensors.len());
    }
    // Who reads its description would refuse what can't be, and all would wait for another.
    if let Some(robot) = robot {
        Robot::try_from(&RobotWire::from(robot)).with_context(|| format!("robot {:?}", robot.name))?;
    }
    // A sonar that the robot does not have, limits that leave a sensor nothing: said before anything is started.
    if let Some(robot) = robot {
        let odometry = &config.odometry;
        GridMapper::new(&config.mapper, odometry.noise, odometry.seed, robot.clone())?;
    }
    let provenance = Provenance { earlier, ..config.provenance(survey)? };
    // What `auto` comes to, the processes can't know.
    let (mut localization, odometry) = (config.resolved_localization(), config.resolved_odometry());
    let has_lidars_alone =
        robot.is_some_and(|robot| robot.sensors.iter().all(|sensor| sensor.kind == SensorKind::Lidar));
    if config.localizer.source == Source::Map && config.localization.hold == Choice::Auto && has_lidars_alone {
        // Beams so long are never trusted much: to wait for better would be to wait for ever.
        localization.hold = false.into();
    }
    let mut table = Config { localization, odometry, ..config.clone() }.to_table()?;
    table.insert("provenance".into(), toml::Value::try_from(&provenance)?);
    table.insert(Plan::SETTINGS.into(), config.run_settings()?.into());
    if config.drives_pioneer() {
        table.insert("robots".into(), toml::Value::try_from(config::known_robots())?);
    }
    Ok(Plan {
        rate: match config.run.rate {
            // It can't be had faster, and who looks on is told of the map as it goes.
            Rate::Max if config.measures_what_is_now() => Some(1.0),
            Rate::Max => None,
            Rate::Times(times) => Some(times),
        },
        max_readings: config.max_readings(survey),
        epoch: new_epoch(),
        state: None,
        synced: false,
        consumers: echogrid_supervision::consumers(&config.services),
        config: table,
    })
}

/// Differs between any two runs of this machine.
fn new_epoch() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which means "no message yet".
    since.as_nanos() as u64 | 1
}
