//! The configuration of a run: what the user typed, and what it means.
//!
//! Settings come from five places, each over the one before: built-in defaults, the run whose recording is
//! played, the `[odometry]` and `[simulator]` of the robot's file, the graph file, the command line. [`Config::load`] reads them, tells
//! everything that is wrong at once, and gives a [`Config`] in which everything is resolved: the
//! rest of the program sees only that.

mod argument;
mod assemble;
mod files;
mod interval;
mod load;
mod problem;
mod ranges;
mod reading;
mod recorded;
mod render;
mod request;
mod robot;
mod robot_file;
#[cfg(test)]
mod robot_tests;
mod roles;
mod run;
mod schema;
mod service;
mod source;
mod standard;
mod suggest;
#[cfg(test)]
mod tests;
mod value;
mod wiring;

use std::collections::BTreeMap;
use std::path::PathBuf;

use echogrid_core::Robot;
use echogrid_core::config::{MapperConfig, OdometryConfig, Start, StartWord};
use echogrid_core::localization::{Ask, Choice, LocalizationConfig};
use echogrid_formats::log::LogSurvey;
use echogrid_formats::map::Provenance;
use echogrid_lidar::LidarConfig;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_pioneer::PioneerConfig;
use echogrid_publisher::config::PublisherConfig;
use echogrid_recorder::config::RecorderConfig;
use echogrid_replay::config::ReplayConfig;
use echogrid_simulator::SimulatorConfig;
use echogrid_slam::SlamConfig;
use echogrid_topics::{DeclaredTopic, Delivery, Topic};
use serde::{Deserialize, Serialize};

pub use echogrid_supervision::Wiring;
pub use echogrid_supervision::config::{Restart, Strategy, SupervisionConfig};
pub use interval::Interval;
pub use load::{Loaded, parse_graph};
pub use problem::{ConfigError, Origin, Problem};
pub use recorded::{RunSetting, settings_of_recording};
pub use render::render;
pub use request::LoadRequest;
pub use request::MAP_FILE;
pub use robot::builtin_robots;
pub use robot_file::known_robots;
pub use robot_file::parse_robot;
pub use run::{Domain, NotA, Rate, RunConfig};
pub use schema::{json_schema_of_graphs, json_schema_of_robots};
pub use service::{Builtin, Care, Exec, Service, ServiceKind, Speech};
pub use standard::default_services;
pub use suggest::nearest;

/// Readings in a scan of a sensor that says nothing of its size before it starts.
const READINGS_OF_AN_UNKNOWN_SENSOR: usize = 1024;

/// The effective configuration: validated, every default filled in, every path absolute.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Config {
    /// How fast, where to, on which robot.
    pub run: RunConfig,
    /// The processes, by name.
    pub services: BTreeMap<String, Service>,
    /// Topics besides echogrid's own, by name.
    pub topics: BTreeMap<String, DeclaredTopic>,
    /// What `builtin:replay` plays.
    pub replay: ReplayConfig,
    /// What `builtin:simulator` simulates.
    pub simulator: SimulatorConfig,
    /// Where the robot of `builtin:pioneer` is.
    pub pioneer: PioneerConfig,
    /// The lidar of `builtin:lidar`.
    pub lidar: LidarConfig,
    /// The odometry error model.
    pub odometry: OdometryConfig,
    /// What `builtin:slam` does.
    pub slam: SlamConfig,
    /// When an absolute localization is asked for.
    pub localization: LocalizationConfig,
    /// Who answers when an absolute localization is asked for.
    pub localizer: LocalizerConfig,
    /// The grid and the sensor model.
    pub mapper: MapperConfig,
    /// The files that a map is saved to.
    pub publisher: PublisherConfig,
    /// What `builtin:recorder` records, and where.
    pub recorder: RecorderConfig,
    /// What happens when a service dies or hangs.
    pub supervision: SupervisionConfig,
    /// The robot that `run.robot` names; none when the log is to say. Not a table of a graph file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<Robot>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            run: RunConfig::default(),
            services: default_services(false),
            topics: BTreeMap::new(),
            replay: ReplayConfig::default(),
            simulator: SimulatorConfig::default(),
            pioneer: PioneerConfig::default(),
            lidar: LidarConfig::default(),
            odometry: OdometryConfig::default(),
            slam: SlamConfig::default(),
            localization: LocalizationConfig::default(),
            localizer: LocalizerConfig::default(),
            mapper: MapperConfig::default(),
            publisher: PublisherConfig::default(),
            recorder: RecorderConfig::default(),
            supervision: SupervisionConfig::default(),
            robot: None,
        }
    }
}

/// What decides the bytes of a map, besides the readings.
#[derive(Serialize)]
struct Deciding<'a> {
    odometry: &'a OdometryConfig,
    #[serde(skip_serializing_if = "Option::is_none")]
    slam: Option<&'a SlamConfig>,
    localization: &'a LocalizationConfig,
    localizer: toml::Table,
    mapper: toml::Table,
    #[serde(skip_serializing_if = "Option::is_none")]
    simulator: Option<toml::Table>,
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<&'a Robot>,
}

impl Config {
    /// Everything as TOML, the resolved `[robot]` included: what services are started with.
    ///
    /// # Errors
    /// The configuration was not loaded but made, of values that TOML has no way to write.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        Ok(toml::to_string(self)?)
    }

    /// The configuration as [`Config::to_toml`] writes it, as a table.
    ///
    /// # Errors
    /// As there.
    pub fn to_table(&self) -> Result<toml::Table, ConfigError> {
        Ok(toml::Table::try_from(self)?)
    }

    /// What [`Config::to_toml`] wrote.
    ///
    /// # Errors
    /// It did not write this.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// Names of all topics of the graph: echogrid's own, and those that the graph file declares.
    pub fn topic_names(&self) -> impl Iterator<Item = &str> {
        let own = Topic::ALL.into_iter().map(|topic| -> &str { topic.name() });
        own.chain(self.topics.keys().map(String::as_str))
    }

    /// What the topic of this name promises, if there is one.
    #[must_use]
    pub fn delivery(&self, topic: &str) -> Option<Delivery> {
        let own = Topic::ALL.into_iter().find(|known| known.name() == topic).map(Topic::delivery);
        own.or_else(|| self.topics.get(topic).map(|declared| declared.delivery.into()))
    }

    /// Whether a service is this program of echogrid's own.
    fn runs(&self, builtin: Builtin) -> bool {
        self.services.values().any(|service| service.exec == Exec::Builtin(builtin))
    }

    /// Whether the sensor plays a log.
    #[must_use]
    pub fn plays_log(&self) -> bool {
        self.runs(Builtin::Replay)
    }

    /// Whether the sensor is the simulator.
    #[must_use]
    pub fn simulates(&self) -> bool {
        self.runs(Builtin::Simulator)
    }

    /// Whether the sensor is a Pioneer.
    #[must_use]
    pub fn drives_pioneer(&self) -> bool {
        self.runs(Builtin::Pioneer)
    }

    /// Whether a lidar is read.
    #[must_use]
    pub fn reads_lidar(&self) -> bool {
        self.runs(Builtin::Lidar)
    }

    /// The number of readings in the largest scan: as the log was surveyed, or as the robot's sensors give.
    #[must_use]
    pub fn max_readings(&self, survey: Option<&LogSurvey>) -> usize {
        let of_robot = self.robot.as_ref().map_or(READINGS_OF_AN_UNKNOWN_SENSOR, Robot::transducer_count);
        survey.map_or(of_robot, |survey| survey.max_readings_per_scan).max(1)
    }

    /// Where the run is recorded, if it is.
    #[must_use]
    pub fn recording(&self) -> Option<PathBuf> {
        self.runs(Builtin::Recorder).then(|| self.recorder.path(&self.run.out))
    }

    /// Whether some process answers when the odometry asks where the robot is.
    #[must_use]
    pub fn has_localizer(&self) -> bool {
        self.services.values().any(|service| service.kind == ServiceKind::Localizer)
    }

    /// `[localization]` with what `auto` comes to in this graph: mapping holds where somebody is asked to mend it, and the
    /// odometry waits for whoever does, unless a robot would have to wait with it.
    #[must_use]
    pub fn resolved_localization(&self) -> LocalizationConfig {
        let asked = self.has_localizer() && matches!(self.localization.ask, Ask::Degraded | Ask::Both);
        let mended = asked || self.localizer.source == Source::Operator;
        let mut sensors = self.services.values().filter(|service| service.kind == ServiceKind::Sensor);
        let is_real = sensors.any(|sensor| match sensor.exec {
            Exec::Path(_) => !sensor.replays,
            Exec::Builtin(builtin) => builtin.is_live(),
        });
        LocalizationConfig {
            hold: self.localization.hold.resolve(mended).into(),
            wait: self.localization.wait.resolve(!is_real).into(),
            ..self.localization.clone()
        }
    }

    /// Whether a sensor is known to measure what is now, at its own pace: a robot, a lidar, or a program that prints lines and does
    /// not replay them.
    #[must_use]
    pub fn measures_what_is_now(&self) -> bool {
        let mut sensors = self.services.values().filter(|service| service.kind == ServiceKind::Sensor);
        sensors.any(|sensor| match sensor.exec {
            Exec::Path(_) => sensor.speaks.is_some() && !sensor.replays,
            Exec::Builtin(builtin) => builtin.is_live(),
        })
    }

    /// Whether poses are corrected by SLAM.
    #[must_use]
    pub fn does_slam(&self) -> bool {
        self.services.values().any(|service| service.exec == Exec::Builtin(Builtin::Slam))
    }

    /// `[odometry]` with what `auto` comes to in this graph: a simulated robot is started where its odometry believes to be,
    /// and who wants no mapping held has it begin where the odometry says; but where a map lies only the first fix in it says.
    #[must_use]
    pub fn resolved_odometry(&self) -> OdometryConfig {
        let start = match self.odometry.start {
            start if start.is_open() && self.localizer.source == Source::Map => start,
            start if start.is_open() && (self.simulates() || self.localization.hold == Choice::Never) => {
                Start::Word(StartWord::Odometry)
            }
            start => start,
        };
        OdometryConfig { start, ..self.odometry.clone() }
    }

    /// Where a map comes from, for its file: the log as it was surveyed, if one is played, and what decides the map besides the readings.
    ///
    /// # Errors
    /// As [`Config::to_toml`].
    pub fn provenance(&self, survey: Option<&LogSurvey>) -> Result<Provenance, ConfigError> {
        Ok(Provenance {
            software: concat!("echogrid ", env!("CARGO_PKG_VERSION")).into(),
            log_sha256: survey.map(|survey| survey.sha256.clone()),
            earlier: Vec::new(),
            config_toml: self.provenance_toml(survey.map(|survey| &survey.robot))?,
        })
    }

    /// What decides the bytes of a map besides the readings: `[odometry]`, `[localization]`,
    /// `[localizer]`, `[mapper]`, `[simulator]` if it is one, and `[robot]`; no path, rate, domain or folder. Without a robot of its own,
    /// the configuration leaves `[robot]` to the log, which is named as `robot` once it spoke.
    fn provenance_toml(&self, robot: Option<&Robot>) -> Result<String, ConfigError> {
        let robot = self.robot.as_ref().or(robot);
        let Self { odometry, localization, mapper, .. } = self;
        let slam = self.does_slam().then_some(&self.slam);
        let localizer = without(&self.localizer, &LocalizerConfig::FILES)?;
        // How often it is told, which is less while it is recorded, is no part of a map.
        let mapper = without(mapper, &["tiles_every_s"])?;
        let is_file = self.simulator.world.contains('/');
        let of_files: &[&str] = if is_file { &["record", "world"] } else { &["record"] };
        let simulator = self.simulates().then(|| without(&self.simulator, of_files)).transpose()?;
        Ok(toml::to_string(&Deciding { odometry, slam, localization, localizer, mapper, simulator, robot })?)
    }
}

/// A section without some of its keys, such as where files lie: they decide nothing.
fn without(section: &impl Serialize, keys: &[&str]) -> Result<toml::Table, ConfigError> {
    let mut table = toml::Table::try_from(section)?;
    table.retain(|key, _| !keys.contains(&key));
    Ok(table)
}
