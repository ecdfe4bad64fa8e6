//! Whether every value of a section is in its range.

use std::collections::BTreeSet;

use echogrid_core::config::{ConfigError as OutOfRange, MapperConfig, SonarSelection};
use echogrid_core::{Robot, SensorKind};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::Config;
use super::assemble::Origins;
use super::problem::Problem;

/// All values that are out of their range.
pub(crate) fn problems(config: &Config, origins: &Origins) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut add = |section: &str, refused: Vec<OutOfRange>| {
        found.extend(refused.into_iter().map(|refused| {
            let key = format!("{section}.{}", refused.key);
            Problem {
                origin: origins.get(&key).cloned(),
                key,
                value: Some(refused.value),
                message: format!("expected {}", refused.expected),
            }
        }));
    };
    add("simulator", refused(&config.simulator, |section| section.validate()));
    add("pioneer", refused(&config.pioneer, |section| section.validate()));
    add("lidar", refused(&config.lidar, |section| section.validate()));
    add("odometry", refused(&config.odometry, |section| section.validate()));
    add("slam", refused(&config.slam, |section| section.validate()));
    add("localization", refused(&config.localization, |section| section.validate()));
    add("localizer", refused(&config.localizer, |section| section.validate()));
    add("mapper", refused(&config.mapper, |section| section.validate()));
    add("publisher", refused(&config.publisher, |section| section.validate()));
    add("supervision", refused(&config.supervision, |section| section.validate()));
    found.extend(config.robot.as_ref().and_then(|robot| absent_sonar(&config.mapper, robot, origins)));
    found
}

/// What a section's `validate` refuses, one key after the other: a refused value makes room for
/// its default, so that the next can be found.
fn refused<T>(section: &T, validate: impl Fn(&T) -> Result<(), OutOfRange>) -> Vec<OutOfRange>
where
    T: Clone + Default + Serialize + DeserializeOwned,
{
    let mut found: Vec<OutOfRange> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut section = section.clone();
    while let Err(refused) = validate(&section) {
        let key = refused.key;
        if !seen.insert(key) {
            break;
        }
        found.push(refused);
        let (Ok(mut table), Ok(mut defaults)) = (Table::try_from(&section), Table::try_from(T::default())) else {
            break;
        };
        let Some(default) = defaults.remove(key) else { break };
        table.insert(key.to_owned(), default);
        let Ok(next) = Value::Table(table).try_into() else { break };
        section = next;
    }
    found
}

/// A sonar that is asked for and that the robot has not.
fn absent_sonar(mapper: &MapperConfig, robot: &Robot, origins: &Origins) -> Option<Problem> {
    let SonarSelection::Numbers(numbers) = &mapper.sonars else { return None };
    let sonars = robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Sonar).count();
    let absent = numbers.iter().find(|number| usize::from(**number) >= sonars)?;
    let key = "mapper.sonars".to_owned();
    let has = match sonars {
        0 => "no sonar".to_owned(),
        n => format!("sonars 0 to {}", n - 1),
    };
    Some(Problem {
        origin: origins.get(&key).cloned(),
        key,
        value: Some(format!("{numbers:?}")),
        message: format!("there is no sonar {absent}: robot {} has {has}", robot.name),
    })
}
