//! Finding a robot by its name, and reading its file.

use std::path::Path;

use echogrid_core::Robot;
use echogrid_core::robot::SENSORS_MAX;
use toml::{Table, Value};

use super::problem::{ConfigError, Origin, Problem};
use super::reading::{self, Findings, Setting};
use super::robot::{BUILTIN, FILE_ENDING, RawRobot, builtin_robots};
use super::run::AUTO;
use super::schema::{ODOMETRY, SIMULATOR};
use super::source::{self, Source};
use super::suggest;

/// A robot (none when the log is to say), and the `[odometry]` and `[simulator]` of its file.
pub(crate) type Resolved = (Option<Robot>, Vec<Setting>);

/// The robots that are known by name, for a sensor that learns only from the robot which one it is.
pub fn known_robots() -> std::collections::BTreeMap<String, Robot> {
    let robot = |(name, _): &(&str, &str)| Some(((*name).to_owned(), find(name, None, None).ok()?.0?));
    BUILTIN.iter().filter_map(robot).collect()
}

/// A robot by its name; `base` is none where no file may be read.
pub(crate) fn find(name: &str, origin: Option<&Origin>, base: Option<&Path>) -> Result<Resolved, ConfigError> {
    if name == AUTO {
        return Ok((None, Vec::new()));
    }
    if let Some((_, text)) = BUILTIN.iter().find(|(builtin, _)| *builtin == name) {
        return parse(text, &Source::file(&format!("robot {name}"), text, None)).map_err(ConfigError::Invalid);
    }
    let problem = |message: String| {
        ConfigError::Invalid(vec![Problem {
            origin: origin.cloned(),
            key: "run.robot".to_owned(),
            value: Some(format!("{name:?}")),
            message,
        }])
    };
    let is_file = name.contains('/') || name.ends_with(FILE_ENDING);
    match base {
        Some(base) if is_file => {
            let path = base.join(name);
            let text = source::read(&path).map_err(|error| problem(error.to_string()))?;
            let label = path.strip_prefix(base).unwrap_or(&path).display().to_string();
            parse(&text, &Source::file(&label, &text, path.parent())).map_err(ConfigError::Invalid)
        }
        None if is_file => Ok((None, Vec::new())),
        _ => {
            let names: Vec<&str> = [AUTO].into_iter().chain(builtin_robots()).collect();
            let near = suggest::nearest(name, names.iter().copied());
            let near = near.map_or_else(String::new, |near| format!("; did you mean \"{near}\"?"));
            Err(problem(format!("no such robot; expected {} or a file *{FILE_ENDING}{near}", names.join(", "))))
        }
    }
}

/// The robot that the text of a robot file describes.
///
/// # Errors
/// Everything that is wrong with it.
pub fn parse_robot(text: &str) -> Result<Robot, ConfigError> {
    let (robot, _) = parse(text, &Source::file("robot", text, None)).map_err(ConfigError::Invalid)?;
    Ok(robot.unwrap_or_default())
}

/// Whether a table of a robot file is one of a graph file too.
fn is_setting(table: &str) -> bool {
    [ODOMETRY.name, SIMULATOR.name].contains(&table)
}

/// What the text of a robot file means.
fn parse(text: &str, source: &Source) -> Result<Resolved, Vec<Problem>> {
    let Findings { settings, problems } = reading::robot(text, source);
    if !problems.is_empty() {
        return Err(problems);
    }
    let (calibration, geometry): (Vec<_>, Vec<_>) =
        settings.into_iter().partition(|setting| setting.path.first().is_some_and(|table| is_setting(table)));
    let refused = |key: &str, message: &str| Problem {
        origin: Some(source.origin(&(0..0))),
        key: key.to_owned(),
        value: None,
        message: message.to_owned(),
    };
    let raw: RawRobot = Value::Table(tables(geometry))
        .try_into()
        .map_err(|error: toml::de::Error| vec![refused("", error.message())])?;
    let mut problems = Vec::new();
    if !raw.has_proper_name() {
        problems.push(refused("name", "expected 1 to 40 letters, digits, blanks, _, - or . (and not \"auto\")"));
    }
    if let Some(section) = raw.reversed_range() {
        problems.push(refused(section, "range_min_m must be below range_max_m"));
    }
    match raw.resolve() {
        Some(robot) if problems.is_empty() => return Ok((Some(robot), calibration)),
        Some(_) => {}
        None => problems.push(refused("", &format!("a robot has 1 to {SENSORS_MAX} sonars and lidars"))),
    }
    Err(problems)
}

/// The settings of a robot file as the tables that they were read from.
fn tables(settings: Vec<Setting>) -> Table {
    let mut tables = Table::new();
    let mut sonars: Vec<Table> = Vec::new();
    for Setting { path, value, .. } in settings {
        match path.as_slice() {
            [key] => {
                tables.insert(key.clone(), value);
            }
            [table, key] => {
                let table = tables.entry(table.clone()).or_insert_with(|| Value::Table(Table::new()));
                if let Value::Table(table) = table {
                    table.insert(key.clone(), value);
                }
            }
            // `sonar.3.x_m`, in rising order.
            [_, index, key] => {
                if index.parse() == Ok(sonars.len()) {
                    sonars.push(Table::new());
                }
                if let Some(sonar) = sonars.last_mut() {
                    sonar.insert(key.clone(), value);
                }
            }
            _ => {}
        }
    }
    tables.insert("sonar".to_owned(), Value::Array(sonars.into_iter().map(Value::Table).collect()));
    tables
}
