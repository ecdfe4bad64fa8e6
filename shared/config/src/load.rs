//! Loading: built-in defaults, then those of the run that is played, then the robot's, then the graph file, then the command line.

use std::collections::BTreeMap;

use echogrid_core::Robot;
use toml::Table;

use super::assemble::{self, Origins};
use super::problem::{ConfigError, Origin, Problem};
use super::reading::{self, Findings, Setting};
use super::robot_file::{self, Resolved};
use super::run::AUTO;
use super::service::{BUILTIN_PREFIX, Builtin, Exec};
use super::source::{self, Source};
use super::{Config, LoadRequest, RunSetting, files, ranges, recorded, roles};

/// The robot that is simulated where none is named.
const SIMULATED: &str = "pioneer3at";

/// A configuration, and where its values came from.
#[derive(Debug, Clone)]
pub struct Loaded {
    config: Config,
    origins: Origins,
    /// `config` as a table, for showing it.
    table: Table,
    run_settings: Vec<RunSetting>,
}

impl Loaded {
    /// What it comes to.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// What it comes to.
    #[must_use]
    pub fn into_config(self) -> Config {
        self.config
    }

    /// The effective configuration as a table, the resolved `[robot]` included.
    #[must_use]
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// The robot; none when the log is to say.
    #[must_use]
    pub fn robot(&self) -> Option<&Robot> {
        self.config.robot.as_ref()
    }

    /// Where the value of a key (`mapper.resolution_m`) was written; none for a default.
    #[must_use]
    pub fn origin(&self, key: &str) -> Option<&Origin> {
        self.origins.get(key)
    }

    /// Every key that was set, and where.
    pub fn origins(&self) -> impl Iterator<Item = (&str, &Origin)> {
        self.origins.iter().map(|(key, origin)| (key.as_str(), origin))
    }

    /// The settings that are neither defaults nor said, but those of the run whose recording is played.
    #[must_use]
    pub fn run_settings(&self) -> &[RunSetting] {
        &self.run_settings
    }

    /// Whether the graph can be started: `check` shows a graph that plays a log yet to be named.
    ///
    /// # Errors
    /// What has to be given first.
    pub fn require_runnable(&self) -> Result<(), ConfigError> {
        let plays_a_log = self.config.services.values().any(|service| service.exec == Exec::Builtin(Builtin::Replay));
        if plays_a_log && self.config.replay.log.as_os_str().is_empty() {
            let message = "which log? Name one: --set replay.log=FILE".to_owned();
            let key = "replay.log".to_owned();
            return Err(ConfigError::Invalid(vec![Problem { origin: None, key, value: None, message }]));
        }
        Ok(())
    }
}

impl Config {
    /// The configuration that was asked for, with everything resolved.
    ///
    /// # Errors
    /// A file can't be read, or what was written does not make sense: then everything that is
    /// wrong, at once.
    pub fn load(request: &LoadRequest) -> Result<Loaded, ConfigError> {
        let base = match &request.base {
            Some(base) => std::path::absolute(base),
            None => std::env::current_dir(),
        }
        .map_err(ConfigError::WorkingDirectory)?;
        let mut found = Findings::default();
        if let Some(graph) = &request.graph {
            let path = base.join(graph);
            let text = source::read(&path).map_err(|source| ConfigError::Read { path: graph.clone(), source })?;
            let source = Source::file(&graph.display().to_string(), &text, path.parent());
            found.add(reading::graph(&text, &source));
        }
        found.add(request.settings(&found.settings, &base));
        let robot = |name: &str, origin: Option<&Origin>| robot_file::find(name, origin, Some(&base));
        let path = std::env::var_os("PATH");
        let recorded = recorded::settings(&found.settings);
        load(found, recorded, robot, |config, origins| {
            if config.run.out.is_relative() && !config.run.out.as_os_str().is_empty() {
                config.run.out = base.join(&config.run.out);
            }
            files::resolve(config, origins, path.as_deref())
        })
    }
}

/// What the text of a graph file means, without a look at any other file.
///
/// # Errors
/// Everything that is wrong with it.
pub fn parse_graph(text: &str) -> Result<Config, ConfigError> {
    let found = reading::graph(text, &Source::file("graph", text, None));
    load(found, Findings::default(), |name, origin| robot_file::find(name, origin, None), |_, _| Vec::new())
        .map(Loaded::into_config)
}

/// Whether the sensor is the simulator, as far as can be told before the services are put together.
fn simulates(settings: &[Setting]) -> bool {
    let exec = |setting: &'_ Setting| match setting.path.as_slice() {
        [services, name, key] if services == "services" && key == "exec" => Some(name.clone()),
        _ => None,
    };
    let simulator = format!("{BUILTIN_PREFIX}{}", Builtin::Simulator.name());
    let last: BTreeMap<String, &Setting> = settings.iter().filter_map(|s| Some((exec(s)?, s))).collect();
    last.values().any(|setting| setting.value.as_str() == Some(&simulator))
}

fn load(
    found: Findings,
    recorded: Findings,
    robot: impl FnOnce(&str, Option<&Origin>) -> Result<Resolved, ConfigError>,
    resolve: impl FnOnce(&mut Config, &Origins) -> Vec<Problem>,
) -> Result<Loaded, ConfigError> {
    let Findings { mut settings, mut problems } = found;
    let named = settings.iter().rev().find(|setting| setting.path == ["run", "robot"]);
    let name = named.and_then(|setting| setting.value.as_str()).unwrap_or(AUTO);
    // There is no log to say what drives.
    let name = if name == AUTO && simulates(&settings) { SIMULATED } else { name }.to_owned();
    let robot = match robot(&name, named.map(|setting| &setting.origin)) {
        Ok((robot, calibration)) => {
            settings.splice(0..0, calibration);
            robot
        }
        Err(ConfigError::Invalid(more)) => {
            problems.extend(more);
            None
        }
        Err(other) => return Err(other),
    };
    settings.splice(0..0, recorded.settings.iter().cloned());
    problems.extend(recorded.problems);
    let origins = assemble::origins(&settings);
    let mut config = assemble::sections(&settings).map_err(|problem| ConfigError::Invalid(vec![problem]))?;
    assemble::localize_to_go_on(&mut config, &origins);
    assemble::ask_by_way(&mut config, &origins);
    config.robot = robot;
    problems.extend(ranges::problems(&config, &origins));
    // What is wrong with the graph may only follow from a key that was refused.
    if problems.is_empty() {
        match assemble::topics(&settings, &origins) {
            Ok(topics) => config.topics = topics,
            Err(more) => problems.extend(more),
        }
        match assemble::services(&settings, &origins, config.localizer.is_served()) {
            Ok(services) => {
                config.services = services;
                assemble::wire_localizer(&mut config);
                problems.extend(roles::problems(&config, &origins));
            }
            Err(more) => problems.extend(more),
        }
    }
    if problems.is_empty() {
        problems.extend(resolve(&mut config, &origins));
    }
    if !problems.is_empty() {
        return Err(ConfigError::Invalid(problems));
    }
    let table = config.to_table()?;
    let run_settings = recorded::in_force(&recorded.settings, &origins)?;
    Ok(Loaded { config, origins, table, run_settings })
}
